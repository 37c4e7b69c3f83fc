//! Names faults (thesis: fault isolation, §3-3): which class of fault a flagged signal shows,
//! whether it is of any class at all, and how severe the fault is.
//!
//! In: residuals or fitted rings of flagged signals, and per fault class what is known of its
//! signals. Out: a weight per class, and what may be said on the strength of the weights.
//! `design/isolator.rs` and `design/named_ring.rs` put these parts together.
//!
//! * The default, a posterior over the classes from a fitted ring's features: [`fault_physics`] (the
//!   channel's parameters), [`fault_curve`] with [`fault_simulator`] (what a fault does to the
//!   features) and [`discrepancy`] (how far that lies off labelled sizes), [`physics_density`] with
//!   `node_columns` (densities along these curves), [`class_density`] (densities from labelled
//!   signals), [`posterior`] and [`stacking`] (both together), [`alternatives`] (what is no class),
//!   [`typical`] (what may lie beside the ring).
//! * The thesis's methods: [`residual_matching`] with [`signatures`], [`model_matching`],
//!   [`neighbours`].
//! * From weights to words: [`decision`], [`severity`], [`appearance`].

pub mod alternatives;
pub mod appearance;
pub mod channel_spread;
pub mod class_density;
pub mod decision;
pub mod discrepancy;
pub mod fault_curve;
pub mod fault_physics;
pub mod fault_simulator;
pub mod model_matching;
pub mod neighbours;
mod node_columns;
pub mod physics_density;
pub mod posterior;
pub mod residual_matching;
mod settings;
pub mod severity;
pub mod signatures;
pub mod stacking;
pub mod tuned;
pub mod typical;

pub use decision::{Decision, Likeness};
pub use residual_matching::Simplex;
pub use settings::{IsolateMethod, IsolateSettings, IsolateSignal};
pub use signatures::SignatureMatrix;

/// Largest number of classes of a design: scratch space of the stream has this size.
pub const MAX_CLASSES: usize = 32;

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum IsolateError {
    #[error("{what} holds a number that is not finite, at index {index}")]
    NotFinite { what: &'static str, index: usize },
    #[error("{neighbours} neighbours of {found} residuals: ask for 1 to that many")]
    NeighbourCount { neighbours: usize, found: usize },
    #[error("isolate.priors names \"{name}\", which is no class of the design ({classes})")]
    UnknownPrior { name: String, classes: String },
}
