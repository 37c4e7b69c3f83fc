//! Shows what the model's simulation gets wrong, names the cause, extends the model, and measures the gain.
//!
//! In: healthy signals with what was recorded beside them ([`observations`]). Out: a [`finding::Critique`]
//! and the extended model. A mixed-effects baseline ([`model`]) is fitted to single signals, never to an
//! average alone. All extensions of it are tested at once (`space`, `candidates`); those that compete are
//! refitted (`refit`, `selection`), and one `search`, the same for all plants, decides which of them enters.
//! What the causes found leave to each other is no cause (`leftovers`).

mod adequacy;
mod between;
mod candidate;
mod candidates;
pub mod catalogue;
mod chance;
mod clusters;
mod codes;
mod contributions;
pub mod covariates;
mod curvature;
pub mod decay;
pub mod digits;
pub mod engine;
mod ensemble;
mod evidence;
mod extended;
mod figures;
pub mod finding;
mod found;
mod gain;
#[cfg(test)]
mod generator;
mod held_out;
mod jitter;
mod leftovers;
mod matrices;
pub mod model;
mod nuisance;
mod objection;
pub mod observations;
pub mod outcome;
mod outliers;
mod pictures;
mod population;
mod predictive;
mod refit;
pub mod report;
mod scatter;
mod search;
mod selection;
mod space;
mod start;
pub mod tuned;
mod verdict;
mod waves;
mod whiteness;
mod words;
mod worth;
