//! Published methods against loss of plasticity: what one is to the rest of the program, and the list of them.
//!
//! A mitigation is its settings and its formula; it has no state of its own. What it must remember it keeps in the agent
//! ([`Kept`](super::state::Kept)), so that checkpoints hold it and a killed run goes on with the same bits. It sees no
//! engine: it names a [`Pull`](super::engine::Pull) or a [`Penalty`](super::engine::Penalty), or edits a [`Patient`].

mod adam_rel;
mod adam_reset;
mod by_settings;
mod churn;
mod continual_backprop;
mod fire;
mod head_rescale;
mod hooks;
mod l2;
mod l2_init;
mod list;
mod normalise_project;
mod parseval;
mod patient;
mod redo;
mod redo_saturation;
mod regimen;
mod reset;
mod self_normalised_resets;
mod shrink_perturb;
mod soft_shrink_perturb;
mod spectral;
mod weight_clipping;

pub use churn::{Churn, ChurnRecords, WithChurn};
pub use hooks::{Brought, Descent, Mitigation, Surroundings};
pub use l2::{L2, L2Covers, L2Penalty};
pub use list::{Listed, Mitigations};
pub use patient::{Patient, Place};
pub use regimen::Regimen;
