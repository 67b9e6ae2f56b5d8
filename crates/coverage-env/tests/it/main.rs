//! Tests of the crate through its public interface, in one binary.

mod environment;
mod generator;
mod golden;
mod levels;
mod planners;
mod sensors;
mod support;
mod vec_env;
