//! What the paper printed, to stand beside what is measured here. Single seeds, each.

use coverage_env::Level;
use serde::Serialize;

/// The paper's title.
pub const TITLE: &str = "Reinforcement Learning and Loss of Plasticity Phenomenon in Coverage Path Planning \
                         Environments: An Exploratory Study";
/// The step limit of the paper's episodes.
const MAX_STEPS: u32 = 200;
/// The place in the sequence of the level after whose stage the paper evaluated its models on all levels.
const EVALUATED_AFTER: usize = 3;

/// The paper's Tables 1 to 5, columns in the order of its levels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Published {
    /// The paper's title.
    pub title: &'static str,
    /// What these numbers are.
    pub source: &'static str,
    /// The built-in names of its levels.
    pub levels: [&'static str; 5],
    /// Table 1: A*, mean over 20 episodes.
    pub astar_mean: [f64; 5],
    /// Table 1: the least return.
    pub astar_min: [f64; 5],
    /// Table 1: the largest return.
    pub astar_max: [f64; 5],
    /// Tables 2–4: each model after the stage on level 3, on all levels, over 20 episodes.
    pub after_level_3: [PublishedArm; 3],
    /// Table 5: each model right after training on a level, on that level, over 1,000 episodes.
    pub right_after: [PublishedArm; 3],
    /// Table 5: A*.
    pub right_after_astar: [PublishedMean; 5],
}

/// One row of the paper: one model.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PublishedArm {
    /// The preset that repeats it.
    pub preset: &'static str,
    /// Timesteps of training per level.
    pub timesteps: u64,
    /// In the order of the levels.
    pub levels: [PublishedMean; 5],
}

/// Mean and standard deviation of the return over episodes of one seed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PublishedMean {
    /// Mean.
    pub mean: f64,
    /// Population standard deviation.
    pub std: f64,
}

const fn row(pairs: [(f64, f64); 5]) -> [PublishedMean; 5] {
    let mut row = [PublishedMean { mean: 0.0, std: 0.0 }; 5];
    let mut i = 0;
    while i < 5 {
        row[i] = PublishedMean { mean: pairs[i].0, std: pairs[i].1 };
        i += 1;
    }
    row
}

const fn arm(preset: &'static str, timesteps: u64, pairs: [(f64, f64); 5]) -> PublishedArm {
    PublishedArm { preset, timesteps, levels: row(pairs) }
}

/// As printed. The paper's notebook has 40.45 and 40.65 for the A* means of levels 2 and 3.
pub const PAPER: Published = Published {
    title: TITLE,
    source: "Tables 1 to 5: one seed per model, deterministic, episodes from drawn start cells",
    levels: ["0", "1", "2", "3", "4"],
    astar_mean: [42.25, 45.50, 40.65, 38.25, 30.90],
    astar_min: [40.0, 43.0, 37.0, 38.0, 24.0],
    astar_max: [45.0, 48.0, 44.0, 44.0, 36.0],
    after_level_3: [
        arm("dqn", 1_000_000, [(-197.15, 4.08), (-198.80, 3.06), (-199.70, 0.90), (39.35, 2.41), (-199.70, 1.31)]),
        arm("ppo", 500_000, [(-194.45, 2.38), (-196.10, 6.23), (-199.55, 1.96), (40.55, 2.20), (-200.00, 0.00)]),
        arm("ppo-l2", 500_000, [(-194.60, 2.62), (-197.90, 3.69), (-148.50, 95.68), (37.40, 3.17), (-200.00, 0.00)]),
    ],
    right_after: [
        arm("dqn", 1_000_000, [(42.646, 1.49), (44.636, 2.39), (38.286, 3.71), (35.063, 30.76), (-197.549, 3.96)]),
        arm("ppo", 500_000, [(42.723, 1.48), (36.783, 44.46), (29.739, 46.56), (40.316, 2.13), (25.823, 33.18)]),
        arm("ppo-l2", 500_000, [(42.833, 1.61), (44.835, 2.00), (36.05, 28.22), (34.15, 35.19), (26.723, 31.56)]),
    ],
    right_after_astar: row([(42.22, 1.42), (45.45, 1.84), (39.92, 2.19), (40.23, 2.08), (31.18, 3.23)]),
};

impl Published {
    /// The column of a level: one with the paper's map and step limit, whatever it is called.
    pub fn column(&self, map: &str, max_steps: u32) -> Option<usize> {
        let has_map = |id: &&str| Level::builtin(id).is_some_and(|own| own.to_map().trim_end() == map.trim_end());
        if max_steps == MAX_STEPS { self.levels.iter().position(has_map) } else { None }
    }

    /// Whether the paper evaluated its models on all levels after the stage on the level of this column.
    pub fn evaluated_after(&self, column: usize) -> bool {
        column == EVALUATED_AFTER
    }

    /// Timesteps per level that the model of a preset was trained for.
    pub fn timesteps(&self, preset: &str) -> Option<u64> {
        self.right_after.iter().find(|model| model.preset == preset).map(|model| model.timesteps)
    }
}
