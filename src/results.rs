//! One result type for whatever is evaluated: planners, agents in training, checkpoints.

use serde::{Deserialize, Serialize};

/// How actions follow from a network's outputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Policy {
    /// The arg max, ties to the lowest index.
    #[default]
    Greedy,
    /// As the agent acts while it trains: drawn from the softmax, or ε-greedy.
    Sampled,
}

impl Policy {
    /// Both, in the order of files.
    pub const ALL: [Self; 2] = [Self::Greedy, Self::Sampled];

    /// As files call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Greedy => "greedy",
            Self::Sampled => "sampled",
        }
    }
}

/// One finished episode.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Episode {
    /// `[row, column]`, from 0.
    pub start: [usize; 2],
    /// Sum of rewards.
    #[serde(rename = "return")]
    pub return_: i64,
    /// Timesteps.
    pub length: u32,
    /// Whether every target was visited before the step limit.
    pub solved: bool,
}

/// All episodes of one policy on one level.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LevelResult {
    /// The level's name.
    pub level: String,
    /// Mean return.
    pub mean: f64,
    /// Population standard deviation (ddof 0) of the returns, as the paper's.
    pub std: f64,
    /// Least return.
    pub min: i64,
    /// Largest return.
    pub max: i64,
    /// Share of episodes solved.
    pub solved_share: f64,
    /// In row-major order of their start cells, or in the order they were drawn.
    pub episodes: Vec<Episode>,
}

/// What one policy earned on several levels.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluation {
    /// A planner's name or an arm's.
    pub policy: String,
    /// The run's directory, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// The stage after which the policy was taken.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stage: Option<u16>,
    /// The seed that was trained.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// One result per level.
    pub levels: Vec<LevelResult>,
}

impl LevelResult {
    /// Sums up the episodes of the level with this name; there is at least one.
    pub fn new(level: &str, episodes: Vec<Episode>) -> Self {
        let returns = || episodes.iter().map(|episode| episode.return_);
        let (mean, std) = mean_std(&returns().map(|r| r as f64).collect::<Vec<f64>>());
        let solved = episodes.iter().filter(|episode| episode.solved).count();
        Self {
            level: level.to_owned(),
            mean,
            std,
            min: returns().min().unwrap_or_default(),
            max: returns().max().unwrap_or_default(),
            solved_share: solved as f64 / episodes.len() as f64,
            episodes,
        }
    }

    /// Mean length, an unsolved episode counting the step limit.
    pub fn length(&self) -> f64 {
        self.episodes.iter().map(|episode| f64::from(episode.length)).sum::<f64>() / self.episodes.len() as f64
    }
}

/// Mean and population standard deviation (ddof 0).
pub fn mean_std(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count;
    (mean, variance.sqrt())
}
