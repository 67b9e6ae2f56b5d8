"""Coverage path planning for Gymnasium, and converters from and to Stable-Baselines3."""
