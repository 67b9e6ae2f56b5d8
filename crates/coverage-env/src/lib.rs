//! Coverage path planning on a grid: levels, environment, planners.
