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
    /// A signal is said to be of no class if the probability of any class is below this, as certain as a test
    /// at 5 %. What may be a class's as well as, say, a stiffer actuator's is undecided between the two.
    of_none = 0.05;
    /// Standard deviation of a sudden change that all channels have in common: of ln amplitude; of damping and
    /// of frequency, in their bounds of `[identify]`; and of the phase, rad. Supply and ink move amplitude and
    /// damping; what is beyond five of these is no ink.
    leap: [f64; 4] = [0.1, 1.0, 0.4, 0.05];
    /// A user's class may lose up to this share of the posterior of its own signals to a class of the
    /// physics; one that takes more is left out of the design.
    most_taken = 0.1;
    /// Bounds of the rates in the identification of a fault are at least this wide. Faults move the rates
    /// further than the ink of a healthy channel does: a blocked nozzle's a/b and d by more than 20
    /// (`model/faults.rs`).
    fault_bound_factor = 300.0;
    /// Largest change of ln damping and of ln frequency that covariates may cause.
    most_shift = 1.0;
}
