//! The bounds and the advice for a printhead of which so many channels are faulty at once that a
//! shared cause (another design, a cable, a clock) is likelier than that many faults.

/// A shared cause is told of if more than this share of channels is faulty (somewhat arbitrary).
pub const MOST_AT_ONCE: f64 = 1.0 / 3.0;
/// Of fewer channels than this most may be faulty by themselves.
pub const FEWEST_CHANNELS: usize = 5;
pub const ADVICE: &str = "So much hardly fails together: before cleaning, see whether the design was made for this \
    printhead, ink and drive, and whether its cable, amplifier and clock are sound";
