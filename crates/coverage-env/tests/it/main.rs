//! Tests of the crate through its public interface, in one binary.

mod environment;
mod generator;
mod golden;
mod levels;
mod observation;
mod planners;
mod support;
mod vec_env;
