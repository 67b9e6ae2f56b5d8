//! The parts of a report.

/// What a table or figure tells of; the sections of `report.html`, in its order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Topic {
    /// The maps and what planners earn on them.
    Levels,
    /// Returns during training.
    Learning,
    /// Returns right after training on a level.
    Returns,
    /// Returns on every level after every stage.
    Matrix,
    /// Measures of continual learning.
    Continual,
    /// Each level in the curriculum against the same level afresh.
    AgainstAfresh,
    /// Plasticity measures during training.
    Plasticity,
    /// The same, layer by layer.
    PlasticityByLayer,
    /// The settings in which arms differ.
    Settings,
    /// What has no result.
    Missing,
}

impl Topic {
    /// Every part, in order.
    pub const ALL: [Self; 10] = [
        Self::Levels,
        Self::Learning,
        Self::Returns,
        Self::Matrix,
        Self::Continual,
        Self::AgainstAfresh,
        Self::Plasticity,
        Self::PlasticityByLayer,
        Self::Settings,
        Self::Missing,
    ];

    /// Its heading.
    pub fn heading(self) -> &'static str {
        match self {
            Self::Levels => "Levels and planners",
            Self::Learning => "Learning curves",
            Self::Returns => "Returns right after training",
            Self::Matrix => "Returns on every level after every stage",
            Self::Continual => "Continual learning",
            Self::AgainstAfresh => "The curriculum against afresh",
            Self::Plasticity => "Plasticity during training",
            Self::PlasticityByLayer => "Plasticity, layer by layer",
            Self::Settings => "Settings",
            Self::Missing => "Missing results",
        }
    }
    /// What a reader should know before its figures and tables; empty for nothing.
    pub(super) fn lead(self) -> &'static str {
        match self {
            Self::Levels | Self::Settings => "",
            Self::Learning => {
                "Training explores; what the trained policy earns when it always takes its best action stands under \
                 Returns right after training."
            }
            Self::Returns => {
                "Runs are seeds: every interval is over seeds, none over episodes. Rows marked (published) are what the \
                 study printed, of one seed each, beside arms that were trained on its levels in its order."
            }
            Self::Matrix => "What is left of earlier levels, and what is there of later ones.",
            Self::Continual => "Of normalised returns: 0 is the worst return there is, 1 the proved mean optimum.",
            Self::AgainstAfresh => {
                "The same algorithm, settings and seed number, with a past and without one. DQN's two sides differ in \
                 exploration, too: afresh it begins with random actions (ε falls from 1 to 0.05), in a curriculum only on \
                 the first level, later ones having ε = 0.05 throughout. An arm whose exploration_initial_eps is 0.05 has \
                 the same ε on both sides, and tells how much of a difference is the exploration's. Negative transfer and \
                 a hard level look like lost plasticity here: read it with the plasticity measures."
            }
            Self::Plasticity => {
                "Measured on fixed states of each level. Dormancy calls a tanh unit that is stuck at ±1 healthy, so that \
                 dormant and saturated units belong together."
            }
            Self::PlasticityByLayer => "policy and value are PPO's two networks, q is DQN's; layers count from 0.",
            Self::Missing => "What should be there and is not. It is left out of every number above.",
        }
    }

    /// What is said where it has neither figure nor table.
    pub fn absence(self) -> &'static str {
        match self {
            Self::Levels => "No level can be read.",
            Self::Learning => "No run has a learning curve.",
            Self::Returns => "No stage is finished.",
            Self::Matrix => "There are no runs through a curriculum.",
            Self::Continual => "No run has finished its curriculum, or a level has no proved optimum.",
            Self::AgainstAfresh => {
                "No arm has finished a level both in a curriculum and afresh (cpp-rl train with the same settings)."
            }
            Self::Plasticity => "No run has logged plasticity.",
            Self::PlasticityByLayer => "No curriculum has logged plasticity of further layers.",
            Self::Settings => "The arms differ in their names alone.",
            Self::Missing => "Nothing is missing.",
        }
    }
}
