//! The numbers of the state's model that nobody derived, as a table, and below it bounds and times.
//! *Process* is how levels and channels move and become faulty. `docs/design/numbers.md` tells what half and
//! twice of each number do. "Of one look": 1 in the canonical coordinates of `kind.rs`.

/// How far a head's level wanders from sweep to sweep: variance, in that of one look at a
/// healthy channel (noise and spread together).
pub const WALK: f64 = 0.05;
/// Probability that an unknown channel is faulty, that a faulty one is healthy by its next look,
/// and that a channel was replaced in a pause.
pub const CHANGE: f64 = 0.01;
/// How far faulty channels lie off, in standard deviations of healthy channels or of one look.
pub const WIDE: f64 = 2.0;
/// Standard deviation of a channel from day to day, in those of one look's noise.
pub const BETWEEN: f64 = 0.3;
/// Number of looks below which a channel's level is not known.
pub const FEW: f64 = 4.0;
/// Number of looks that the scatter within channels begins with, and most of a faulty level.
pub const OF_BEGINNING: f64 = 16.0;
/// Most looks of the scatter of a head's looks about their channels.
pub const MOST_WITHIN: f64 = 4096.0;
/// Weight of one sweep in how far channels lie from each other (`Head::wider`).
pub const OF_SWEEP: f64 = 0.5;
/// Variance of heads' levels about their kind's, in that of one look at a healthy channel.
pub const OF_HEADS: f64 = 0.25;

/// Probability of a fault, or of a leap of the level, from one look or sweep to the next.
pub const SUDDEN: f64 = CHANGE * 0.01;

/// Probability that the level leaps in a pause, of which nothing is known: even odds.
pub const LEAP_IN_PAUSE: f64 = 0.5;
/// A level is known only if at least this share of the looks lie about it (`level::alike`).
pub const MAJORITY: f64 = 0.5;

/// Squared distance of a move of the level beyond which it is another head's: upper 1e-5 of
/// chi-squared with four degrees of freedom.
pub const NOT_THIS_HEAD: f64 = 28.47;
/// Squared distance of a channel's level from one of its past levels beyond which it drifts: upper
/// 1e-6 of chi-squared with four degrees of freedom.
pub const DRIFTED: f64 = 33.38;
/// The same from all channels of its head, beyond which it lies apart: upper 1e-5.
pub const ODD_ONE: f64 = 28.47;
/// A channel's past is kept as three means (*rungs*), over about so many days.
pub const RUNG_DAYS: [f64; 3] = [4.0, 16.0, 64.0];
/// Looks that lie further apart than this belong to two days, ns.
pub const DAY_NS: i64 = 12 * 3_600_000_000_000;
/// After a pause of more than this, ns, supply, ink and channels may be others.
pub const PAUSE_NS: u64 = 600_000_000_000;
/// Fewest channels that have a level in common: fewer do not outvote a faulty one.
pub const FEWEST: usize = 5;
