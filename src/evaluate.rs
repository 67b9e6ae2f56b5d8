//! Evaluation: episodes of a policy from every start cell or from drawn ones.

use std::sync::Arc;

use bit_mlp::Prepared;
use coverage_env::planner::{PlanError, Planner};
use coverage_env::random::below;
use coverage_env::{Action, CellSet, CoverageEnv, Level, Scene, Sensor, State};

use crate::agent::network::Network;
use crate::agent::state::AgentState;
use crate::agent::{Behaviour, greedy};
use crate::random::{Purpose, Stream};
use crate::results::{Episode, LevelResult};

/// Where episodes start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Starts {
    /// Every start cell once, in row-major order.
    Exhaustive,
    /// Drawn uniformly from a stream of their own.
    Drawn {
        /// Episodes per level.
        episodes: u32,
        /// The seed of the stream.
        seed: u64,
    },
}

impl Starts {
    /// The start cells on a level.
    pub fn cells(self, level: &Level) -> Vec<usize> {
        match self {
            Self::Exhaustive => level.starts().to_vec(),
            Self::Drawn { episodes, seed } => {
                let mut stream = Stream::new(seed, 0, Purpose::EvaluationStarts);
                let starts = level.starts();
                (0..episodes).map(|_| starts[below(&mut stream, starts.len() as u32) as usize]).collect()
            }
        }
    }
}

/// How a network's outputs become actions.
#[derive(Debug)]
pub enum Choose {
    /// The arg max, ties to the lowest index.
    Greedy,
    /// As an agent behaves while it trains, drawn from this stream.
    Sampled(Behaviour, Box<Stream>),
}

impl Choose {
    /// As an agent behaves, for an evaluation of an agent in training.
    ///
    /// The stream depends on the seed, the stage, the agent's timesteps and the map alone. So a level's returns are the
    /// same whatever else is evaluated.
    pub fn in_training(behaviour: Behaviour, agent: &AgentState, stage: u16, level: &Level) -> Self {
        let when_and_where = [&agent.counters.timesteps.to_le_bytes(), level.to_map().as_bytes()].concat();
        let place = crc32fast::hash(&when_and_where);
        let stream = Stream::new(agent.seed, stage, Purpose::SampledEvaluation { place });
        Self::Sampled(behaviour, Box::new(stream))
    }

    fn action(&mut self, outputs: &[f32]) -> Action {
        match self {
            Self::Greedy => greedy(outputs),
            Self::Sampled(behaviour, stream) => behaviour.choose(outputs, &mut **stream),
        }
    }
}

/// Episodes of a network with these parameters on one level, which it sees with `sensor`.
pub fn network(
    network: &Network,
    sensor: &dyn Sensor,
    parameters: &[f32],
    level: &Arc<Level>,
    max_steps: u32,
    starts: Starts,
    choose: &mut Choose,
) -> LevelResult {
    let mut acting = Prepared::new(network.acting(), parameters, &sensor.constant_inputs(level));
    let mut active = Vec::new();
    let mut circle = Circle { visited: None, outputs: vec![None; level.len()] };
    let episode = |start| {
        episode(level, max_steps, start, |state| {
            let ask = || {
                active.clear();
                sensor.push_active(Scene::new(level, state), &mut active);
                std::array::from_fn({
                    let outputs = acting.forward_one(parameters, &active);
                    |action| outputs[action]
                })
            };
            choose.action(circle.outputs(state, ask))
        })
    };
    LevelResult::new(level.name(), starts.cells(level).into_iter().map(episode).collect())
}

/// What a network said in each cell since the agent last came to a new one.
///
/// What an agent observes depends on its cell and the visited cells alone, and so does what the network says. An agent that
/// fails walks over visited cells, mostly: the network is asked once for each, instead of at each step until the limit.
struct Circle {
    visited: Option<CellSet>,
    /// By cell.
    outputs: Vec<Option<[f32; Action::COUNT]>>,
}

impl Circle {
    fn outputs(&mut self, state: &State, ask: impl FnOnce() -> [f32; Action::COUNT]) -> &[f32] {
        if self.visited.as_ref() != Some(&state.visited) {
            self.visited = Some(state.visited.clone());
            self.outputs.fill(None);
        }
        self.outputs[usize::from(state.agent)].get_or_insert_with(ask)
    }
}

/// Episodes of a planner on one level.
///
/// # Errors
/// Where the planner cannot plan this level.
pub fn planner(
    planner: &mut dyn Planner,
    level: &Arc<Level>,
    max_steps: u32,
    starts: Starts,
) -> Result<LevelResult, PlanError> {
    let plan = |start| {
        let plan = planner.plan(level, start, max_steps)?;
        let mut actions = plan.into_iter();
        // A plan that ends before its episode has nothing left to gain; Down is as good as any move.
        Ok(episode(level, max_steps, start, |_| actions.next().unwrap_or(Action::Down)))
    };
    let episodes: Result<Vec<Episode>, PlanError> = starts.cells(level).into_iter().map(plan).collect();
    Ok(LevelResult::new(level.name(), episodes?))
}

/// One episode from `start`, a start cell of the level.
fn episode(level: &Arc<Level>, max_steps: u32, start: usize, mut act: impl FnMut(&State) -> Action) -> Episode {
    let mut env = CoverageEnv::new(level.clone(), max_steps);
    env.reset_at(start).expect("start cells of a level are valid starts");
    let mut return_ = 0;
    loop {
        let action = act(env.state());
        let step = env.step(action);
        return_ += step.reward as i64;
        if step.terminated || step.truncated {
            let (row, column) = level.position(start);
            let length = env.state().steps;
            return Episode { start: [row, column], return_, length, solved: step.terminated };
        }
    }
}

#[cfg(test)]
mod tests {
    use coverage_env::BUILTIN_IDS;
    use coverage_env::sensor::SENSORS;

    use super::*;
    use crate::agent::config;

    #[test]
    fn asking_once_around_changes_no_episode() {
        for sensor in SENSORS.iter().copied() {
            let sets = [format!("sensor={}", sensor.name())];
            let config = config::resolve(Some("ppo"), None, &sets, None).unwrap();
            for (seed, id) in BUILTIN_IDS.into_iter().enumerate() {
                let level = Arc::new(Level::builtin(id).unwrap());
                let network = config.network(&level);
                let mut parameters = config.agent(&level, seed as u64).parameters;
                // Louder than at first, so that the policy has opinions: it walks about before it goes round.
                parameters.iter_mut().for_each(|parameter| *parameter *= 3.0);
                let stream = || Box::new(Stream::new(0, 0, Purpose::EvaluationActions));
                let sampled = |behaviour| move || Choose::Sampled(behaviour, stream());
                let (softmax, epsilon) = (sampled(Behaviour::Sampled), sampled(Behaviour::EpsilonGreedy(0.05)));
                let ways: [&dyn Fn() -> Choose; 3] = [&|| Choose::Greedy, &softmax, &epsilon];
                for choose in ways {
                    let starts = Starts::Exhaustive;
                    let found = super::network(&network, sensor, &parameters, &level, 200, starts, &mut choose());

                    let mut acting = Prepared::new(network.acting(), &parameters, &sensor.constant_inputs(&level));
                    let mut choose = choose();
                    let mut ask = |state: &State| {
                        let mut active = Vec::new();
                        sensor.push_active(Scene::new(&level, state), &mut active);
                        choose.action(acting.forward_one(&parameters, &active))
                    };
                    let plain = level.starts().iter().map(|&start| episode(&level, 200, start, &mut ask)).collect();
                    assert_eq!(found, LevelResult::new(level.name(), plain));
                }
            }
        }
    }
}
