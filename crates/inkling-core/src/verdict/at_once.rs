//! Where so many of a printhead's channels are faulty at once that what they share is the likelier cause.

/// Nozzles do not fail by so large a share of their printhead at once.
pub const MOST_AT_ONCE: f64 = 1.0 / 3.0;
/// Channels, at least, of which that is said: of fewer, faulty ones may be most.
pub const FEWEST_CHANNELS: usize = 5;
/// What to do then.
pub const ADVICE: &str = "So much hardly fails together: before cleaning, see whether the design was made for this \
    printhead, ink and drive, and whether its cable, amplifier and clock are sound";
