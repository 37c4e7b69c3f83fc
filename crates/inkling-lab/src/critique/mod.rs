//! Shows what the model's simulation gets wrong, names the cause, extends the model, and measures the gain.
//!
//! In: healthy signals with what was recorded beside them ([`observations`]). Out: a [`finding::Critique`]
//! and the extended model. `docs/critique.md` describes the method for users. The way through this room:
//!
//! 1. `engine` runs everything for ink channels; [`decay`] does so for few long decays of an oscillator.
//! 2. `outliers` leaves odd signals out. The baseline, a mixed-effects model ([`model`], `settle`, `start`, `scatter`,
//!    `matrices`), is fitted to single signals, never to an average alone.
//! 3. `codes` (with `lattice`), `ensemble` (with `autoregression`) and, later, `jitter` (with `clusters`) test
//!    converters, noise and trigger.
//! 4. All causes that move the expected signal ([`catalogue`]) are tested at once, as directions in one space of
//!    linear extensions (`space`, `contributions`, `curvature`, `nuisance`, `candidates`, `clusters`). Those
//!    that compete are refitted (`refit`, `selection`); one `search`, the same for all plants, picks the winner.
//! 5. What is no more than what a stronger cause leaves is no cause (`leftovers`); what all causes leave is
//!    tested without the catalogue (`adequacy`).
//! 6. On signals that nothing was fitted to (`held_out`), `gain` measures misfit and detection, `worth` the
//!    gain in likelihood (`predictive`, `whiteness`).
//! 7. `words`, `figures`, `pictures` and [`report`] tell it; [`outcome`] decides whether the model may become a
//!    design.
//!
//! Wherever signals are gone through, [`work`] is told, so that a critique shows its progress and can be ended
//! at any step. [`tuned`] holds every tuned number, `chance` turns statistics into probabilities.

mod adequacy;
mod autoregression;
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
pub mod engine;
mod ensemble;
mod figures;
pub mod finding;
mod gain;
#[cfg(test)]
mod generator;
mod held_out;
mod jitter;
mod lattice;
mod leftovers;
mod matrices;
pub mod model;
mod nuisance;
pub mod observations;
pub mod outcome;
mod outliers;
mod pictures;
mod predictive;
mod refit;
pub mod report;
mod scatter;
mod search;
mod selection;
mod settle;
mod space;
mod start;
pub mod tuned;
mod unmodelled;
mod whiteness;
mod words;
pub mod work;
mod worth;
