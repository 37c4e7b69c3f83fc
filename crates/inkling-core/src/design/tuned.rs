//! The numbers of what a design learns and how signals are judged by it that nobody derived, all of them; docs/numbers.md tells what half and twice of each do.

crate::numbers! {
    /// Fewest signals for a window's own mean and thresholds; with fewer, the design's are used.
    fewest_own: usize = 200;
    /// A threshold that exceeds the robust one by more than this factor was probably learned on faulty signals, too.
    suspect = 3.0;
    /// Share of what healthy signals differ by, below which a channel's own level says no more than all channels do.
    least_lasting = 0.25;
    /// Channels that lie so many times as far from each other as the design says are not judged by its threshold where nothing else is
    /// known of them.
    aged = 1.5;
    /// A fit to noise alone explains less than this, in noise variances: two linear and two searched parameters explain some 20 at
    /// most.
    noise_alone = 40.0;
    /// A signal is no ring if its fit leaves more than this share of its energy, noise apart: a half, not tuned.
    most_left = 0.5;
    /// A signal is said to be of no class where that is as certain as a test at 5 %: what may be a class's as well as, say, a stiffer
    /// actuator's is undecided between the two.
    of_none = 0.05;
    /// Standard deviation of the damping that all channels change by at once, in the bound of `[identify]`. Supply and ink move
    /// amplitude and damping; what is beyond five of these is no ink.
    leap = 1.0;
    /// The same of frequency, in its bound.
    leap_of_frequency = 0.4;
    /// The same of ln amplitude.
    leap_of_gain = 0.1;
    /// The same of phase, rad.
    leap_of_phase = 0.05;
    /// Share of the posterior of its own signals that a user's class may lose to a class of the physics.
    most_taken = 0.1;
    /// Faults move the rates further than the ink of a healthy channel does: a blocked nozzle's a/b and d by more than 20
    /// (`model/faults.rs`). Bounds for a fault are this wide at least.
    fault_bound_factor = 300.0;
    /// Fewest labelled signals for a class's own bound on what it leaves beside its ring.
    fewest_of_class: usize = 8;
    /// Of fewer labelled signals none being named proves nothing.
    fewest_for_never: usize = 10;
    /// Fewer signals that look more like another class are chance: where labels are few, names are modest by themselves.
    fewest_alike: usize = 5;
    /// Bound on the change of ln damping and of ln frequency by a covariate.
    most_shift = 1.0;
}
