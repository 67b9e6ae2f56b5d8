//! Statistics for a handful of runs of reinforcement learning.
//!
//! A *run* is one seed, a *task* is what it is scored on. Scores are grouped by task, `scores[task][run]`, and tasks may
//! have differing numbers of runs. Intervals are over runs, never over episodes, and resample the runs of each task by
//! themselves (Agarwal et al., "Deep Reinforcement Learning at the Edge of the Statistical Precipice", 2021; its package
//! rliable is the reference that the tests compare with).
//!
//! **NaN.** No function drops a value. A NaN among the scores makes the result NaN, also where trimming or a
//! comparison would hide it; a caller who wants it left out leaves it out, and says so.
//!
//! **One run.** It has no spread: [`Estimate::interval`] is `None` as soon as a task has fewer than two runs.

pub mod aggregate;
mod binomial;
mod bootstrap;
pub mod continual;
pub mod curve;
pub mod few;
pub mod pairs;
pub mod ratio;

pub use binomial::{LEAST_OF_MEDIAN, estimate_median, median_interval};
pub use bootstrap::{Bootstrap, Estimate, Interval, Resamples, ShapeError, percentile_interval, quantile};
pub use curve::Time;
