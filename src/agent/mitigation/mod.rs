//! Published methods against loss of plasticity: what one is to the rest of the program, and the list of them.
//!
//! A mitigation is its settings and its formula; it has no state of its own. What it must remember it keeps in the agent
//! ([`Kept`](super::state::Kept)), so that checkpoints hold it and a killed run goes on with the same bits. It sees no
//! engine: it names a [`Pull`](super::engine::Pull), or edits a [`Patient`].

mod adam_rel;
mod adam_reset;
mod head_rescale;
mod hooks;
mod l2;
mod l2_init;
mod list;
mod patient;
mod redo;
mod regimen;
mod reset;
mod shrink_perturb;

pub use hooks::Mitigation;
pub use l2::{L2, L2Covers, L2Penalty};
pub use list::{Listed, Mitigations};
pub use patient::Patient;
pub use regimen::Regimen;
