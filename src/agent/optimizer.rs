//! The optimiser's settings.

/// Adam (Kingma & Ba 2015), with clipping.
#[derive(Clone, Debug, PartialEq)]
pub struct OptimizerConfig {
    /// Step size α.
    pub learning_rate: f64,
    /// ε of Adam's denominator.
    pub adam_eps: f64,
    /// Gradients of one seed are scaled down to this Euclidean norm.
    pub max_grad_norm: f64,
}
