//! What settings that are possible one by one take together, told before anything is allocated.

use super::{Algorithm, Config};

/// The most bytes that the parameters, the rollout or the replay buffer of one seed may take.
const MAX_BYTES: u64 = 2 << 30;

impl Config {
    /// Checks that an agent for maps of this many cells has a size that is meant; larger ones are typing errors.
    ///
    /// # Errors
    /// Names the settings, what they amount to, and what is possible.
    pub fn check_size(&self, cells: usize) -> Result<(), String> {
        let parameters = self.num_parameters(cells as u64);
        let (beside, copies) = match self.algorithm {
            Algorithm::Ppo(_) => ("gradient and Adam's moments", 4),
            Algorithm::Dqn(_) => ("gradient, Adam's moments and target network", 5),
        };
        let what = || {
            let hidden = &self.hidden;
            format!("hidden: {hidden:?}: a network of {parameters} parameters on maps of {cells} cells, with {beside},")
        };
        refuse_large(parameters.saturating_mul(4 * copies), what)?;
        match &self.algorithm {
            Algorithm::Ppo(ppo) => {
                let samples = (ppo.n_steps * self.num_envs) as u64;
                // A sample lists the agent's cell and the visited ones, 2 bytes each, and holds some ten numbers.
                let visited = (cells as u64).min(u64::from(self.max_steps) + 1);
                let what = || format!("n_steps × num_envs: a rollout of {samples} samples on maps of {cells} cells");
                refuse_large(samples.saturating_mul(2 * visited + 40), what)
            }
            Algorithm::Dqn(dqn) => {
                // The visited cells before and after, one bit each, and ten bytes more.
                let transition = 2 * (cells as u64).div_ceil(64) * 8 + 10;
                let what = || format!("buffer_size: {} transitions on maps of {cells} cells", dqn.buffer_size);
                refuse_large((dqn.buffer_size as u64).saturating_mul(transition), what)
            }
        }
    }

    /// Weights and biases of all towers, without making them.
    fn num_parameters(&self, cells: u64) -> u64 {
        let heads: &[u64] = match self.algorithm {
            Algorithm::Ppo(_) => &[4, 1],
            Algorithm::Dqn(_) => &[4],
        };
        let tower = |&head: &u64| {
            let hidden = self.hidden.iter().map(|&width| width as u64);
            let sizes: Vec<u64> = [4 * cells].into_iter().chain(hidden).chain([head]).collect();
            sizes.windows(2).map(|pair| (pair[0] + 1) * pair[1]).sum::<u64>()
        };
        heads.iter().map(tower).sum()
    }
}

fn refuse_large(bytes: u64, what: impl FnOnce() -> String) -> Result<(), String> {
    if bytes <= MAX_BYTES {
        return Ok(());
    }
    let gib = |bytes: u64| bytes as f64 / f64::from(1 << 30);
    Err(format!("{} takes {:.1} GiB per seed; at most {:.0} GiB are possible", what(), gib(bytes), gib(MAX_BYTES)))
}

#[cfg(test)]
mod tests {
    use crate::agent;
    use crate::config::{preset_names, resolve};
    use coverage_env::Level;

    #[test]
    fn parameters_are_counted_as_networks_count_them() {
        let level = Level::from_map("a", "..T\n...").unwrap();
        for preset in preset_names() {
            let config = resolve(Some(preset), None, &[], None).unwrap();
            let expected = agent::network(&config, &level).num_parameters() as u64;
            assert_eq!(config.num_parameters(6), expected, "{preset}");
            assert_eq!(config.check_size(1 << 14), Ok(()), "presets fit the largest maps");
        }
    }
}
