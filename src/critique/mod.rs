//! Shows what the model's simulation gets wrong, names the cause, extends the model, measures the gain.
//!
//! In: healthy signals with what was recorded beside them. Out: a [`finding::Critique`] and an
//! extended design.

pub mod finding;
