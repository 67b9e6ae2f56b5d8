//! The optimiser's settings.

/// Adam (Kingma & Ba 2015), with clipping.
#[derive(Clone, Debug, PartialEq)]
pub struct OptimizerConfig {
    /// Step size α.
    pub learning_rate: f64,
    /// β₁, decay of the mean of the gradients.
    pub adam_beta1: f64,
    /// β₂, decay of the mean of the squared gradients.
    pub adam_beta2: f64,
    /// ε of Adam's denominator.
    pub adam_eps: f64,
    /// Gradients of one seed are scaled down to this Euclidean norm.
    pub max_grad_norm: f64,
}
