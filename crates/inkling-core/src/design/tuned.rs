//! All numbers that nobody derived of what a design learns and how signals are judged by it; docs/numbers.md
//! tells what half and twice of each do.

crate::numbers! {
    /// Fewest signals of a window that get their own mean and thresholds; with fewer, the design's are used.
    fewest_own: usize = 200;
    /// A threshold that exceeds the robust one by more than this factor was probably learned on faulty
    /// signals, too.
    suspect = 3.0;
    /// If less than this share of what healthy signals differ by lasts, a channel's own level says no more
    /// than the level of all channels does.
    least_lasting = 0.25;
    /// Channels that lie more than this many times as far from each other as the design says are not judged
    /// by its threshold if nothing else is known of them.
    aged = 1.5;
    /// Standard deviation of a sudden change that all channels have in common: of ln amplitude; of damping and
    /// of frequency, in their bounds of `[identify]`; and of the phase, rad. Supply and ink move amplitude and
    /// damping; what is beyond five of these is no ink.
    leap: [f64; 4] = [0.1, 1.0, 0.4, 0.05];
}
