//! The numbers of the process that nobody derived, all of them. What half and twice of each do is printed by
//! `cargo test --release -p inkling-core state::prices -- --nocapture --ignored`; `docs/state.md` has
//! that table.

crate::numbers! {
    /// How far a head's level wanders from sweep to sweep: variance, in that of one look at a healthy channel.
    walk = 0.05;
    /// Probability that a channel is faulty before anything is heard of it, that a faulty one is healthy
    /// again by its next look, and that a channel was replaced in a pause. A hundredth of it is the probability
    /// that a channel becomes faulty between two looks, and that the level leaps between two sweeps.
    change = 0.01;
    /// Standard deviation of faults, in those of healthy channels, and at least so many of one look's noise.
    wide = 2.0;
    /// Standard deviation of a channel from day to day, in those of one look's noise.
    between = 0.3;
    /// Looks below which a channel's level is not known.
    few = 4.0;
    /// Looks that a head counts for before any is heard, and most that a faulty level is the mean of: faults grow.
    of_beginning = 16.0;
    /// Most looks that the scatter of a head's looks about their channels is averaged over.
    most_within = 4096.0;
    /// Share of a sweep in what is known of how far channels lie from each other.
    of_sweep = 0.5;
    /// Variance of heads about their kind, in that of channels about their head.
    of_heads = 0.25;
}

/// Probability of what may happen at any moment, from one look or sweep to the next: a fault, a leap of the level.
pub fn sudden() -> f64 {
    change() * 0.01
}

/// Probability that the level leaps in a pause, of which nothing is known: even odds.
pub const LEAP_IN_PAUSE: f64 = 0.5;
/// A level that less than the majority of looks lie about, as healthy ones do, is not known.
pub const MAJORITY: f64 = 0.5;

/// A move of the level so far in the tail of what the process allows (upper 1e-5 of chi-squared with 4 degrees of
/// freedom) is none of ink or supply.
pub const NOT_THIS_HEAD: f64 = 28.47;
/// Squared distance of a channel's level from one of the past beyond which it drifts alone: upper 1e-6 of
/// chi-squared with four degrees of freedom.
pub const DRIFTED: f64 = 33.38;
/// The same from all channels of its head: upper 1e-5.
pub const ODD_ONE: f64 = 28.47;
/// Days that a channel's levels are means of, each four times the one before: looks are expected from the
/// first; today's level is compared with all.
pub const RUNG_DAYS: [f64; 3] = [4.0, 16.0, 64.0];
/// What lies further apart belongs to two days, ns.
pub const DAY_NS: i64 = 12 * 3_600_000_000_000;
/// A head that was not heard for so long stood still: supply and ink may be others, channels replaced. ns.
pub const PAUSE_NS: u64 = 600_000_000_000;
/// Channels that have a level in common: fewer do not outvote a faulty one.
pub const FEWEST: usize = 5;
