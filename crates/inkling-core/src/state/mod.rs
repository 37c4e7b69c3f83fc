//! What is known of a printhead and of each of its channels now: one state-space model, filtered in
//! the order of time. `src/pipeline/head.rs` feeds it and moves the judges by what it says.
//!
//! In: sweep by sweep, looks at channels' rings (ln amplitude, ln damping, ln frequency, phase)
//! from one base ring. Out: the head's *level*, what all channels have in common; each channel's
//! offset from there; whether the head is the one that it was. The model: `docs/design/state.md`.
//!
//! `head` holds the state and the order of the steps of a sweep, `level` finds the level that
//! explains it, `channel` is what is known of one channel, `within` how looks scatter about channels,
//! `ageing` tells slow faults from channels that age, `kind` has the coordinates, `process` the
//! numbers, and `memory` the file.

mod ageing;
mod channel;
#[cfg(test)]
mod crowd_tests;
mod head;
mod kind;
mod level;
pub mod memory;
#[cfg(test)]
mod nights_tests;
pub mod process;
#[cfg(test)]
mod tests;
mod within;

pub use channel::{Channel, Sum};
pub use head::{Head, Look, OtherChannel, OwnLevel, SweepOutcome};
pub use kind::{Features, Kind, at_least_as_wide};
pub use memory::{HeadMemory, Memory, Replaced};
