//! Where most of a head's channels are in one sweep, whatever the others do.
//!
//! In: where the level is expected ([`Expected`], a mixture of three Gaussians: the level walks,
//! leaps, or is another head's), and the sweep's looks, each prepared by what is known of its
//! channel ([`Member`]). Out: the level h that explains the sweep best, what each look is put down
//! to, and how many looks agree ([`Explained`]). All positions are canonical, from the base ring.
//!
//! The density of a look given h is a sum of four hypotheses: its channel is healthy, has a new
//! fault, has its old fault again, or was replaced. Expectation-maximisation alternates between (1)
//! the probability of each hypothesis for each look, with how frequent faults are in this sweep
//! ([`Odds`]), and (2) the h that is the mean of prior and looks, weighted by their probability of
//! being healthy (formula in `docs/design/state.md`, "The model").

use super::channel::{Channel, FromLevel, Responsibility, Sum, wide};
use super::kind::{Features, Kind};
use super::process;
use crate::model::median::median_of;
use nalgebra::{Matrix4, Vector4};

/// How a level may have moved since the sweep before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Move {
    /// By as little as levels wander from one sweep to the next.
    Walk,
    /// As far as supply and ink move a head at once.
    Leap,
    /// Another head, or another way of looking at it.
    Strange,
}

const MOVES: [Move; 3] = [Move::Walk, Move::Leap, Move::Strange];

#[derive(Clone, Debug)]
pub struct Expected {
    pub level: Features,
    moves: [Mode; 3],
}

#[derive(Clone, Debug)]
struct Mode {
    /// ln of how probable the move is, with the Gaussian's normalisation but for the power of 2 pi.
    ln_weight: f64,
    precision: Matrix4<f64>,
}

impl Expected {
    /// `covariance`: of the walk since the last sweep; `kind`: of what a leap adds, and of what
    /// another head adds, which is as rare as two leaps; `paused`: a leap is as probable as a walk.
    /// `None`: a covariance is not positive definite.
    pub fn new(
        level: Features,
        covariance: &Matrix4<f64>,
        kind: &Kind,
        paused: bool,
    ) -> Option<Expected> {
        let leap = if paused { process::LEAP_IN_PAUSE } else { process::SUDDEN };
        let mode = |rate: f64, add: Matrix4<f64>| {
            let precision = (covariance + add).try_inverse()?;
            let ln_weight = rate.ln() + 0.5 * precision.determinant().ln();
            ln_weight.is_finite().then_some(Mode { ln_weight, precision })
        };
        let moves = [
            mode(1.0 - leap, Matrix4::zeros())?,
            mode(leap, kind.leap)?,
            mode(process::SUDDEN.powi(2), kind.anywhere)?,
        ];
        Some(Expected { level, moves })
    }

    /// The same expectation for a level that certainly neither leaps nor is another head's.
    pub fn as_it_walks(&self) -> Expected {
        let mut expected = self.clone();
        expected.moves[1..].iter_mut().for_each(|of| of.ln_weight = f64::NEG_INFINITY);
        expected
    }

    /// The shares of the moves in the prior density of a level, and the ln of that density.
    fn shares(&self, level: &Features) -> ([f64; 3], f64) {
        let d = level - self.level;
        let lns = self.moves.each_ref().map(|of| of.ln_weight - 0.5 * d.dot(&(of.precision * d)));
        let most = lns.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let shares = lns.map(|ln| (ln - most).exp());
        let all: f64 = shares.iter().sum();
        (shares.map(|share| share / all), most + all.ln())
    }
}

#[derive(Clone, Debug)]
pub struct Member {
    /// From the base ring.
    at: Features,
    /// The look, less where its channel lies from the level while it is healthy, or has the fault
    /// that it had before: for such a channel this scatters about the level.
    from_own: Features,
    from_fault: Features,
    /// The channel is healthy: a Gaussian of `from_own` about the level.
    healthy: Hypothesis,
    /// It has a fault that it never had before: a wide Student's t of `from_own`.
    elsewhere: Hypothesis,
    /// It has the fault that it had before: a Gaussian of `from_fault`.
    back: Hypothesis,
    /// It is another one than before the pause: a Gaussian of `at`, as wide as channels spread.
    replaced: Hypothesis,
    /// Probabilities before the look that the channel is faulty, and that it was replaced.
    was_faulty: f64,
    is_replaced: f64,
}

/// A density with diagonal covariance and a weight, but for the power of 2 pi.
#[derive(Clone, Copy, Debug)]
struct Hypothesis {
    /// Prior probability over the square root of the covariance's determinant; 0: it is impossible.
    weight: f64,
    precision: Features,
}

impl Hypothesis {
    fn new(weight: f64, variance: Features) -> Hypothesis {
        let det: f64 = variance.iter().product();
        Hypothesis { weight: weight / det.sqrt(), precision: variance.map(|v| 1.0 / v) }
    }

    fn square(&self, off: &Features) -> f64 {
        self.precision.iter().zip(off.iter()).map(|(p, d)| p * d * d).sum()
    }

    fn gaussian(&self, off: &Features) -> f64 {
        if self.weight > 0.0 { self.weight * (-0.5 * self.square(off)).exp() } else { 0.0 }
    }

    /// Weighted density of Student's t with one degree of freedom, in four dimensions: 3 det^-½
    /// (1 + d²)^-5/2. No size of a fault is out of the question.
    fn heavy(&self, off: &Features) -> f64 {
        let x = 1.0 + self.square(off);
        3.0 * self.weight / (x * x * x.sqrt())
    }
}

/// How far healthy looks lie from where they are expected, canonical.
#[derive(Clone, Copy, Debug)]
pub struct Variances {
    /// Of one look about where its channel lies.
    pub noise: Features,
    /// Of where channels lie about their head's level.
    pub lasting: Features,
    /// Of healthy signals of this kind of head about its level, beyond the design's noise.
    pub spread: Features,
    /// Of what a kelvin does to channels beside what it does to all.
    pub per_k: Features,
}

impl Member {
    /// `look`: counted from the base ring; `may_be_new`: since a pause the channel may have been replaced.
    pub fn new(
        FromLevel { at, looks, warmer }: FromLevel,
        channel: &Channel,
        by: &Variances,
        may_be_new: bool,
    ) -> Member {
        let Variances { noise, lasting, spread, per_k } = by;

        // a smaller drive enlarges the noise alone, which is 1 at the reference drive
        let own = noise.add_scalar(1.0 / looks - 1.0);

        // where the channel lies while healthy (c) and with its fault (f)
        let (healthy, z) = (channel.healthy(), channel.is_faulty);
        let (c, c_variance) = healthy.posterior(lasting, noise);
        let (f, f_variance) = channel.faulty.posterior(&wide(spread), noise);
        let (known, knows_fault) = (healthy.looks > 0.0, channel.knows_fault());
        let of_warmth = |of: &Sum| match of.looks > 0.0 {
            true => per_k * (warmer - of.warmer()).powi(2),
            false => Features::zeros(),
        };
        let back = if knows_fault { 0.5 } else { 0.0 };
        let is_replaced = if may_be_new && known { process::CHANGE } else { 0.0 };
        let healthy = c_variance + own + of_warmth(&healthy);
        Member {
            at,
            from_own: at - c,
            from_fault: at - f,
            healthy: Hypothesis::new(1.0 - z, healthy),
            elsewhere: Hypothesis::new(z * (1.0 - back), healthy + wide(spread)),
            back: Hypothesis::new(z * back, f_variance + own + of_warmth(&channel.faulty)),
            replaced: Hypothesis::new(is_replaced, spread + own),
            was_faulty: z,
            is_replaced,
        }
    }

    /// Whether the look lies as near as three in four healthy ones, of its own channel or another.
    fn lies_near(&self, level: &Features) -> bool {
        let may_be_new = self.replaced.weight > 0.0;
        self.healthy.square(&(self.from_own - level)) < NEAR
            || may_be_new && self.replaced.square(&(self.at - level)) < NEAR
    }

    /// The expectation step: what the look is put down to at this level, and its density.
    fn weigh(&self, level: &Features, odds: &Odds) -> (Responsibility, f64) {
        let (own, fault, all) = (self.from_own - level, self.from_fault - level, self.at - level);
        let healthy = self.healthy.gaussian(&own);
        let faulty = odds.faulty * (self.elsewhere.heavy(&own) + self.back.gaussian(&fault));
        let replaced = odds.replaced * self.replaced.gaussian(&all);
        let sum = (healthy + faulty + replaced).max(f64::MIN_POSITIVE);
        let by = Responsibility {
            healthy: healthy / sum,
            faulty: faulty / sum,
            replaced: replaced / sum,
        };
        (by, sum / self.prior(odds).all)
    }

    /// How probable it is before the look that the channel is faulty, or another one.
    fn prior(&self, odds: &Odds) -> Prior {
        let (faulty, replaced) = (odds.faulty * self.was_faulty, odds.replaced * self.is_replaced);
        Prior { faulty, replaced, all: 1.0 - self.was_faulty + faulty + replaced }
    }
}

/// How many times as many channels of a sweep are faulty, or replaced, as their pasts say.
#[derive(Clone, Copy, Debug)]
struct Odds {
    faulty: f64,
    replaced: f64,
}

struct Prior {
    faulty: f64,
    replaced: f64,
    all: f64,
}

impl Odds {
    const AS_THOUGHT: Odds = Odds { faulty: 1.0, replaced: 1.0 };

    /// The odds by which as many channels are expected to be faulty (or replaced) as were found to
    /// be, one more counted each lest the odds become zero.
    fn improved(&self, members: &[Member], found: &[Responsibility]) -> Odds {
        let (mut faulty, mut replaced) = ([1.0, 1.0], [1.0, 1.0]);
        for (member, r) in members.iter().zip(found) {
            let prior = member.prior(self);
            faulty = [faulty[0] + r.faulty, faulty[1] + prior.faulty / prior.all];
            replaced = [replaced[0] + r.replaced, replaced[1] + prior.replaced / prior.all];
        }
        Odds {
            faulty: self.faulty * faulty[0] / faulty[1],
            replaced: self.replaced * replaced[0] / replaced[1],
        }
    }
}

/// Squared distance within which three in four healthy looks lie.
const NEAR: f64 = 5.385;
const OF_HEALTHY: f64 = 0.75;

#[derive(Clone, Copy, Debug)]
pub struct Evidence {
    /// Inverse variance of the level by these looks alone, coordinate by coordinate.
    pub precision: Features,
    /// The precision times where these looks say that the level is: their weighted sum.
    pub sum: Features,
}

#[derive(Clone, Debug)]
pub struct Explained {
    pub level: Features,
    pub by: Move,
    pub evidence: Evidence,
    /// In the order of the looks.
    pub responsibilities: Vec<Responsibility>,
    /// About 1: the looks agree with the level as healthy looks do ([`alike`]); 0: none agrees.
    pub alike: f64,
    /// ln of the sweep's density at this level, the prior of the level included.
    pub ln_density: f64,
}

/// Steps of expectation-maximisation from one beginning, at most.
const STEPS: usize = 16;
/// A step of the level below this, in standard deviations of one look's noise, ends the steps.
const CONVERGED: f64 = 1e-2;
/// The positions of up to so many looks are tried as beginnings.
const BEGINNINGS: usize = 6;

/// Begins where the level is expected. Unless most looks agree with what is found, each as its own channel, it begins at
/// some looks and at the median of all, too, and the likeliest result counts: where all channels moved alike in a pause,
/// the first beginning may end at other channels in all their places.
pub fn explain(expected: &Expected, members: &[Member]) -> Explained {
    let first = converged(expected, members, expected.level);
    let are_own = first.responsibilities.iter().all(|r| r.replaced <= 0.5);
    // "most": half-way between all looks and the share below which a level is not believed
    if are_own && first.alike >= 0.5 + 0.5 * process::MAJORITY {
        return first;
    }

    let step = members.len().div_ceil(BEGINNINGS).max(1);
    let some = members.iter().step_by(step).map(|of| of.from_own);
    let middle = Vector4::from_fn(|k, _| median_of(members.iter().map(|of| of.from_own[k])));
    let others = some.chain([middle]).map(|from| converged(expected, members, from));
    others.fold(first, |best, next| if next.ln_density > best.ln_density { next } else { best })
}

/// The share of the channels that lie near a level, over the share of healthy channels that do.
/// Channels count by the probability that they were not faulty before.
pub fn alike(members: &[Member], level: &Features) -> f64 {
    let (mut near, mut all) = (0.0, 0.0);
    for of in members {
        let healthy = 1.0 - of.was_faulty;
        all += healthy;
        near += if of.lies_near(level) { healthy } else { 0.0 };
    }
    near / (OF_HEALTHY * all.max(f64::MIN_POSITIVE))
}

fn converged(expected: &Expected, members: &[Member], mut level: Features) -> Explained {
    let mut odds = Odds::AS_THOUGHT;
    for _ in 0..STEPS {
        let (next, more) = improved(expected, members, &level, &odds);
        let step = (next - level).amax();
        (level, odds) = (next, more);
        if step < CONVERGED {
            break;
        }
    }

    let (mut responsibilities, mut ln_density) = (Vec::with_capacity(members.len()), 0.0);
    for of in members {
        let (responsibility, density) = of.weigh(&level, &odds);
        responsibilities.push(responsibility);
        ln_density += density.ln();
    }
    let evidence = evidence(members, &responsibilities);

    // the largest of the prior's moves tells which one it was
    let (shares, ln_prior) = expected.shares(&level);
    ln_density += ln_prior;
    let likeliest = (0..3).max_by(|&a, &b| shares[a].total_cmp(&shares[b]));
    let by = likeliest.map_or(Move::Walk, |k| MOVES[k]);
    let alike = alike(members, &level);
    Explained { level, by, evidence, responsibilities, alike, ln_density }
}

fn improved(
    expected: &Expected,
    members: &[Member],
    level: &Features,
    odds: &Odds,
) -> (Features, Odds) {
    let responsibilities: Vec<Responsibility> =
        members.iter().map(|of| of.weigh(level, odds).0).collect();
    let odds = odds.improved(members, &responsibilities);
    let Evidence { precision, sum } = evidence(members, &responsibilities);

    let prior = expected.moves.iter().zip(expected.shares(level).0);
    let prior = prior.fold(Matrix4::zeros(), |all, (of, share)| all + of.precision * share);

    // maximisation: the mean of the Gaussian that prior and looks make together
    let known = prior + Matrix4::from_diagonal(&precision);
    let level =
        known.try_inverse().map_or(*level, |inverse| inverse * (prior * expected.level + sum));
    (level, odds)
}

fn evidence(members: &[Member], by: &[Responsibility]) -> Evidence {
    let mut of = Evidence { precision: Vector4::zeros(), sum: Vector4::zeros() };
    for (member, r) in members.iter().zip(by) {
        let healthy = member.healthy.precision * r.healthy;
        of.precision += healthy;
        of.sum += healthy.component_mul(&member.from_own);
        if r.replaced > 0.0 {
            let replaced = member.replaced.precision * r.replaced;
            of.precision += replaced;
            of.sum += replaced.component_mul(&member.at);
        }
    }
    of
}
