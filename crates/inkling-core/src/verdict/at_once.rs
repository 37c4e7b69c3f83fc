//! The bounds and the advice for a printhead of which so many channels are faulty at once that a
//! cause which the channels share (another design, a cable, a clock) is likelier than that many
//! faults.
//!
//! `pipeline/at_once.rs` applies the bounds to the flagged signals of a run, `report/notes.rs` to
//! episodes.

/// If more than this share of a printhead's channels is faulty at the same time, a shared cause is
/// told of. Nozzles hardly fail together in such numbers. (The share is somewhat arbitrary.)
pub const MOST_AT_ONCE: f64 = 1.0 / 3.0;
/// With fewer channels than this nothing is told: of so few, most may be faulty by themselves.
pub const FEWEST_CHANNELS: usize = 5;
/// What the user should do about it; the end of the warning.
pub const ADVICE: &str = "So much hardly fails together: before cleaning, see whether the design was made for this \
    printhead, ink and drive, and whether its cable, amplifier and clock are sound";
