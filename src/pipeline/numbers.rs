//! What nobody derived of who judges, which times and samples are believed and how often a head is looked at. Half and twice of
//! these were not measured.

/// A printhead that prints again after a longer pause than this, ns, would be in another recording.
pub const JUMP_NS: i64 = 86_400_000_000_000;
/// So many moments in a row are no accident: a clock was set.
pub const STEADY: u32 = 8;
/// By how much delays of transport differ, ns.
pub const DELAY_NS: u64 = 2_000_000_000;
/// By how much the clocks of two devices may differ, ns.
pub const DIFFER_NS: u64 = 60_000_000_000;
/// How long a lead over the records lasts that is no accident of buffers, ns.
pub const LASTS_NS: i64 = 10_000_000_000;
/// A head does not change within this time, ns: ink and supplies take seconds.
pub const LOOK_EVERY_NS: i64 = 50_000_000;
/// The time between two looks at a head is at most this part of the time since the first one.
pub const LOOKS: i64 = 8;
/// A window of so many times the signals that may be kept is long enough.
pub const ENOUGH: u64 = 4;
/// Least number of signals of a window that are kept, and how many of each channel: 30 heads of 48 channels take a
/// third less CPU than with 64 of each channel.
pub const FEWEST: u64 = 1024;
pub const OF_CHANNEL: u64 = 32;
/// So many windows of a group are tried: while its bursts wait for a judge, all others do.
pub const MOST_WINDOWS: u32 = 4;

/// Signals are clipped that have so many samples in a row at one value, if this share of all signals is so: tried on the
/// sample, clipped at three quarters of its amplitude and not clipped, and on rings in few codes.
pub const STAND_STILL: usize = 3;
pub const CLIPPED: f64 = 0.25;
/// A step from one sample to the next that no signal of 16 bits makes: three quarters of their range.
pub const WRAPS: f64 = 49_152.0;
/// In so many bursts, each with other samples, channels are alike bit for bit that are copies of each other.
pub const ALIKE_BURSTS: usize = 3;
