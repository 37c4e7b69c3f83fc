//! The numbers of the process that nobody derived, all of them. They were chosen on features drawn from the model
//! itself; `WALK` on drifting recordings (`open_world together`), too. What half and twice of each do was not measured.

/// How far a head's level wanders from sweep to sweep: variance, in that of one look at a healthy channel.
pub const WALK: f64 = 0.05;
/// Probability that the level leaps between two sweeps, and in a pause.
pub const LEAP: f64 = 1e-4;
pub const LEAP_IN_PAUSE: f64 = 0.5;
/// Probability that the head is another one from a sweep on, and after a pause.
pub const STRANGE: f64 = 1e-8;
pub const STRANGE_IN_PAUSE: f64 = 1e-6;
/// A move of the level so far in the tail of what the process allows (upper 1e-5 of chi-squared with 4 degrees of
/// freedom) is none of ink or supply.
pub const NOT_THIS_HEAD: f64 = 28.47;
/// Probability that a channel that was never heard is faulty; of becoming so between two looks it is a hundredth of that.
pub const ONSET: f64 = 0.01;
/// Probability that a faulty channel is healthy again, per look.
pub const CURED: f64 = 0.01;
/// Standard deviation of faults, in those of healthy channels, and at least so many of one look's noise.
pub const WIDE: f64 = 10.0;
/// Probability that a channel was replaced in a pause.
pub const REPLACED: f64 = 1e-3;
/// Probability that all of a head was swapped for another one in a pause.
pub const SWAPPED: f64 = 1e-4;
/// Share of healthy channels that lie three times as far as the design's spread says: its tail.
pub const ODD: f64 = 0.05;
/// Standard deviation of a channel from day to day, in those of one look's noise.
pub const BETWEEN: f64 = 0.3;
/// Days that a channel's levels are means of: looks are expected from the first; today's level is compared with all.
pub const RUNG_DAYS: [f64; 3] = [4.0, 16.0, 64.0];
/// Days in which a healthy channel forgets where it was among its head's.
pub const AGE_DAYS: f64 = 3650.0;
/// Squared distance of a channel's level from one of the past beyond which it drifts alone: upper 1e-6 of chi-squared with
/// four degrees of freedom.
pub const DRIFTED: f64 = 33.38;
/// The same from all channels of its head: upper 1e-5.
pub const ODD_ONE: f64 = 28.47;
/// What lies further apart belongs to two days, ns.
pub const DAY_NS: i64 = 12 * 3_600_000_000_000;
/// A head that was not heard for so long stood still: supply and ink may be others, channels replaced. ns.
pub const PAUSE_NS: i64 = 600_000_000_000;
/// Channels that have a level in common: fewer do not outvote a faulty one.
pub const FEWEST: usize = 5;
