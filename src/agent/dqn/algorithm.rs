//! DQN as a choice: its network, its limits, its learner.

use std::any::Any;

use bit_mlp::Activation;
use coverage_env::{Action, Level};

use super::carried::Past;
use super::exploration::Exploration;
use super::learner::Dqn;
use super::loss::TARGET;
use super::replay::ReplayState;
use super::settings::DqnConfig;
use crate::agent::algorithm::{Algorithm, Misfit, Setup};
use crate::agent::choice::Behaviour;
use crate::agent::learner::Learner;
use crate::agent::network::{Head, Init, Outputs};
use crate::agent::shared::Shared;
use crate::agent::snapshot::Snapshot;
use crate::agent::stage::Stage;
use crate::agent::state::AgentState;

/// One tower: action values `[inputs] → [4]`.
const HEADS: [Head; 1] = [Head { name: "q", outputs: Action::COUNT, init: Init::Uniform }];

impl Algorithm for DqnConfig {
    fn name(&self) -> &'static str {
        "dqn"
    }

    fn defaults(&self, shared: &mut Shared) {
        shared.timesteps = 1_000_000;
        shared.activation = Activation::Relu;
        shared.optimizer.adam_eps = 1e-8;
        shared.optimizer.max_grad_norm = 10.0;
    }

    fn outputs(&self) -> Outputs {
        Outputs::Values
    }

    fn behaviour(&self, when: Option<(&Stage, u64)>) -> Behaviour {
        let epsilon = |(stage, timesteps)| Exploration::new(self, stage).epsilon(timesteps);
        Behaviour::EpsilonGreedy(when.map_or(self.exploration_final_eps, epsilon))
    }

    fn heads(&self) -> &'static [Head] {
        &HEADS
    }

    fn copies(&self) -> &'static [&'static str] {
        &[TARGET]
    }

    fn check(&self, shared: &Shared) -> Result<(), Misfit> {
        if self.buffer_size >= shared.num_envs {
            return Ok(());
        }
        Err(Misfit {
            keys: &["num_envs", "buffer_size"],
            problem: format!(
                "buffer_size: expected room for a transition of each environment, {} (num_envs) or more, got {}",
                shared.num_envs, self.buffer_size
            ),
        })
    }

    fn memory(&self, shared: &Shared, level: &Level) -> (String, u64) {
        let cells = level.len();
        let bits = |of: usize| (of as u64).div_ceil(64) * 8;
        // The visited cells before and after, one bit each, and ten bytes more.
        let own = 2 * bits(cells) + 10;
        // Where the buffer outlives its stage, all inputs as well.
        let observed = if self.saves_replay() { 2 * bits(shared.sensor.inputs(level)) } else { 0 };
        let transition = own + observed;
        let what = format!("buffer_size: {} transitions on maps of {cells} cells", self.buffer_size);
        (what, (self.buffer_size as u64).saturating_mul(transition))
    }

    fn optimizer_steps(&self, shared: &Shared, timesteps: u64) -> u64 {
        let interval = self.train_freq * shared.num_envs as u64;
        let updates = timesteps.div_ceil(interval).saturating_sub(self.learning_starts / interval);
        updates * self.gradient_steps as u64
    }

    fn goes_on_from(&self, parent: &dyn Algorithm) -> Result<(), String> {
        let parent = (parent as &dyn Any).downcast_ref::<Self>();
        if !self.replay_kept || parent.is_some_and(Self::saves_replay) {
            return Ok(());
        }
        Err("replay_kept: the parent's checkpoints hold no replay buffer: train the parent with replay_saved=true"
            .to_owned())
    }

    fn check_agent(&self, agent: &AgentState, shared: &Shared, level: &Level) -> Result<(), String> {
        if !self.replay_kept {
            return Ok(());
        }
        match Past::read(&agent.kept.buffers)? {
            Some(past) => past.check(shared.sensor.inputs(level)),
            None => {
                Err("it holds no replay buffer for replay_kept=true: what replay_saved=true writes does".to_owned())
            }
        }
    }

    fn begin(&self, snapshot: &mut Snapshot, level: &Level) {
        let brought = std::mem::take(&mut snapshot.agent.kept.buffers);
        let past =
            if self.replay_kept { Past::read(&brought).expect("an agent is checked before it is used") } else { None };
        let replay = past.map(|past| ReplayState::beginning(past, self.buffer_size, level)).unwrap_or_default();
        replay.write(&mut snapshot.buffers);
    }

    fn check_snapshot(&self, snapshot: &Snapshot, shared: &Shared, level: &Level) -> Result<(), String> {
        let replay = ReplayState::read(&snapshot.buffers)?;
        replay.check(self.buffer_size, level, shared.sensor).map_err(str::to_owned)
    }

    fn learner(&self, setup: Setup<'_>) -> Box<dyn Learner> {
        Box::new(Dqn::new(self, setup))
    }

    fn boxed(&self) -> Box<dyn Algorithm> {
        Box::new(self.clone())
    }
}
