//! The numbers of the state's model that nobody derived, as a table, and below it the bounds and
//! times that it decides by. *Process* is how levels and channels move and become faulty. What half
//! and twice of each number of the table do is printed by `cargo test --release -p inkling-core
//! state::prices -- --nocapture --ignored`; `docs/state.md` has the result. Variances and standard
//! deviations "of one look" are 1 in the canonical coordinates of `kind.rs`.

crate::numbers! {
    /// How far a head's level wanders from sweep to sweep: variance, in that of one look at a
    /// healthy channel (noise and spread together).
    walk = 0.05;
    /// Probability that a channel is faulty before anything is heard of it, that a faulty one is
    /// healthy again by its next look, and that a channel was replaced in a pause. A hundredth of
    /// it is the probability that a channel becomes faulty between two looks, and that the level
    /// leaps between two sweeps.
    change = 0.01;
    /// Scale of how far faulty channels lie off, in standard deviations of healthy channels, and at
    /// least in those of one look's noise.
    wide = 2.0;
    /// Standard deviation of a channel from day to day, in those of one look's noise.
    between = 0.3;
    /// Number of looks below which a channel's level is not known.
    few = 4.0;
    /// Number of looks that the scatter within channels, as a head begins with it, counts as; and
    /// the most looks that a faulty level is the mean of, since faults grow.
    of_beginning = 16.0;
    /// Most looks that the scatter of a head's looks about their channels is averaged over.
    most_within = 4096.0;
    /// Weight of one sweep in what is known of how far channels lie from each other
    /// (`Head::wider`); the weight of all before is the rest to 1.
    of_sweep = 0.5;
    /// Variance of heads' levels about their kind's, in that of one look at a healthy channel.
    of_heads = 0.25;
}

/// Probability of what may happen at any moment, from one look or sweep to the next: a fault, a
/// leap of the level.
pub fn sudden() -> f64 {
    change() * 0.01
}

/// Probability that the level leaps in a pause, of which nothing is known: even odds.
pub const LEAP_IN_PAUSE: f64 = 0.5;
/// A level is known only if at least this share of the looks lie about it as healthy looks do
/// (`level::alike`).
pub const MAJORITY: f64 = 0.5;

/// Squared distance of a move of the level beyond which it is no move of ink or supply but another
/// head: upper 1e-5 of chi-squared with four degrees of freedom, by the covariance of what walk and
/// leap allow.
pub const NOT_THIS_HEAD: f64 = 28.47;
/// Squared distance of a channel's level from one of its past levels beyond which the channel
/// drifts alone: upper 1e-6 of chi-squared with four degrees of freedom.
pub const DRIFTED: f64 = 33.38;
/// Squared distance of a channel's level from all channels of its head beyond which the channel
/// lies apart: upper 1e-5 of the same chi-squared.
pub const ODD_ONE: f64 = 28.47;
/// A channel's past is kept as three means (*rungs*), over about so many days, each four times the
/// one before. The next look is expected from the first rung; today's level is compared with all
/// three.
pub const RUNG_DAYS: [f64; 3] = [4.0, 16.0, 64.0];
/// Looks that lie further apart than this belong to two days, ns.
pub const DAY_NS: i64 = 12 * 3_600_000_000_000;
/// After a pause of more than this, ns, supply and ink may be others, and channels may have been
/// replaced.
pub const PAUSE_NS: u64 = 600_000_000_000;
/// Fewest channels that have a level in common: fewer do not outvote a faulty one.
pub const FEWEST: usize = 5;
