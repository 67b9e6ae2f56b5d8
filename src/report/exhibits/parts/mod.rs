//! What several exhibits have in common: words, styles, axes and cells.

pub mod caption;
pub mod curves;
pub mod notes;
pub mod own;
pub mod returns;
pub mod style;
pub mod timeline;
pub mod track;
