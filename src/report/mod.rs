//! From results to what people and programs read. Nothing here trains.
//!
//! [`analysis`] makes numbers of runs, [`exhibits`] make a report's sections of them, one file per topic, and
//! [`render`](mod@render) writes tables and pages, one file per format. Each depends on those before it alone.

pub mod analysis;
mod evaluations;
pub mod exhibits;
pub mod export;
pub mod find;
pub mod foreign;
mod names;
mod parallel;
pub mod published;
pub mod render;
pub mod runs;
mod table;

pub use evaluations::evaluations;
pub use render::{Format, render};
pub use table::{Cell, Table};
