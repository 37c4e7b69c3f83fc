//! The numbers of the process that nobody derived, all of them. What half and twice of each do is printed by
//! `cargo test --release -p inkling-core what_half_and_twice -- --nocapture --ignored`; `docs/state.md` has that table.

crate::numbers! {
    /// How far a head's level wanders from sweep to sweep: variance, in that of one look at a healthy channel.
    walk = 0.05;
    /// Probability that the level leaps between two sweeps.
    leap = 1e-4;
    /// The same in a pause.
    leap_in_pause = 0.5;
    /// Probability that the head is another one from a sweep on, pause or none.
    strange = 1e-8;
    /// Standard deviation, in those of one look's noise, of the level of a head that is not this one.
    anywhere = 300.0;
    /// Probability that a channel that was never heard is faulty; of becoming so between two looks it is a hundredth of that.
    onset = 0.01;
    /// Probability that a faulty channel is healthy again, per look.
    cured = 0.01;
    /// Standard deviation of faults, in those of healthy channels, and at least so many of one look's noise.
    wide = 10.0;
    /// Probability that a channel was replaced in a pause.
    replaced = 1e-3;
    /// Probability that all of a head was swapped for another one in a pause.
    swapped = 1e-4;
    /// Share of healthy channels that lie three times as far as the design's spread says: its tail. Without it slight faults in
    /// a channel's first looks teach 3 % more than a test of this room allows.
    odd = 0.05;
    /// Standard deviation of a channel from day to day, in those of one look's noise.
    between = 0.3;
    /// Days in which a healthy channel forgets where it was among its head's.
    age_days = 3650.0;
    /// Looks that a faulty level is the mean of, about: faults grow.
    of_fault = 16.0;
    /// Looks below which a channel's level is not known.
    few = 4.0;
    /// Looks at a head that what nobody has heard of it yet counts as.
    of_beginning = 16.0;
    /// Most looks that the scatter of a head's looks about their channels is averaged over.
    most_within = 4096.0;
    /// Share of a sweep in what is known of how far channels lie from each other.
    of_sweep = 0.5;
    /// Variance of heads about their kind, in that of channels about their head.
    of_heads = 0.25;
    /// Share of the looks that must agree with a level, where channels differ for good.
    least_alike = 0.4;
    /// The same where they are drawn anew.
    least_alike_anew = 0.8;
    /// Of the looks, so many must be unexplained before a level is looked for elsewhere.
    unexplained = 0.25;
}

/// A move of the level so far in the tail of what the process allows (upper 1e-5 of chi-squared with 4 degrees of
/// freedom) is none of ink or supply.
pub const NOT_THIS_HEAD: f64 = 28.47;
/// Squared distance of a channel's level from one of the past beyond which it drifts alone: upper 1e-6 of chi-squared with
/// four degrees of freedom.
pub const DRIFTED: f64 = 33.38;
/// The same from all channels of its head: upper 1e-5.
pub const ODD_ONE: f64 = 28.47;
/// Days that a channel's levels are means of, each four times the one before: looks are expected from the first; today's level
/// is compared with all.
pub const RUNG_DAYS: [f64; 3] = [4.0, 16.0, 64.0];
/// What lies further apart belongs to two days, ns.
pub const DAY_NS: i64 = 12 * 3_600_000_000_000;
/// A head that was not heard for so long stood still: supply and ink may be others, channels replaced. ns.
pub const PAUSE_NS: i64 = 600_000_000_000;
/// Channels that have a level in common: fewer do not outvote a faulty one.
pub const FEWEST: usize = 5;
