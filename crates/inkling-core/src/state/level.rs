//! Where most of a head's channels are in one sweep, whatever the others do.
//!
//! In: where the level is expected ([`Expected`], a mixture of three Gaussians: the level walks,
//! leaps, or is another head's), and the sweep's looks, each prepared by what is known of its
//! channel ([`Member`]). Out: the level h that explains the sweep best, what each look is put down
//! to, and how many looks agree ([`Explained`]). `Head::find` calls [`explain`] and decides whether
//! the level is believed. All positions are canonical (`kind.rs`), from the base ring.
//!
//! The density of a look given h is a sum of four hypotheses: its channel is healthy, has a new
//! fault, has its old fault again, or was replaced. Expectation-maximisation alternates between (1)
//! the probability of each hypothesis for each look at the present h, and with it how frequent
//! faults are in this sweep ([`Odds`]), and (2) the h that is the mean of prior and looks, each
//! look weighted by its probability of being healthy. That finds the maximum next to where it
//! begins, so that several beginnings are tried. The formula stands in `docs/state.md` ("The
//! model").

use super::channel::{Channel, Responsibility, wide};
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

/// Where the level is expected before a sweep is looked at: a Gaussian for each way in which it may
/// have moved.
#[derive(Clone, Debug)]
pub struct Expected {
    /// Where the level was, which is the mean of all three Gaussians.
    pub level: Features,
    /// The Gaussians, in the order of `MOVES`.
    moves: [Mode; 3],
}

/// The Gaussian of one way in which the level may have moved.
#[derive(Clone, Debug)]
struct Mode {
    /// ln of how probable the move is, with the Gaussian's normalisation but for the power of 2 pi.
    ln_weight: f64,
    /// Inverse of the Gaussian's covariance.
    precision: Matrix4<f64>,
}

impl Expected {
    /// `level`: where the level was after the last sweep; `covariance`: of the level, after it has
    /// walked on since then; `kind`: what a leap adds to the covariance, and what another head
    /// adds, which is taken to be as rare as two leaps at once; `paused`: after a pause a leap is
    /// as probable as a walk. `None`: a sum of these covariances is not positive definite.
    pub fn new(
        level: Features,
        covariance: &Matrix4<f64>,
        kind: &Kind,
        paused: bool,
    ) -> Option<Expected> {
        let leap = if paused { process::LEAP_IN_PAUSE } else { process::sudden() };
        let mode = |rate: f64, add: Matrix4<f64>| {
            let precision = (covariance + add).try_inverse()?;
            let ln_det = precision.determinant().ln();
            let ln_weight = rate.ln() + 0.5 * ln_det;
            ln_weight.is_finite().then_some(Mode { ln_weight, precision })
        };
        let moves = [
            mode(1.0 - leap, Matrix4::zeros())?,
            mode(leap, kind.leap)?,
            mode(process::sudden().powi(2), kind.anywhere)?,
        ];
        Some(Expected { level, moves })
    }

    /// The same expectation for a level that certainly neither leaps nor is another head's.
    pub fn as_it_walks(&self) -> Expected {
        let mut expected = self.clone();
        expected.moves[1..].iter_mut().for_each(|of| of.ln_weight = f64::NEG_INFINITY);
        expected
    }

    /// The share of each of the moves in the prior density of a level, and the ln of that density.
    fn shares(&self, level: &Features) -> ([f64; 3], f64) {
        // in logarithms, with the largest one taken out
        let d = level - self.level;
        let lns = self.moves.each_ref().map(|of| of.ln_weight - 0.5 * d.dot(&(of.precision * d)));
        let most = lns.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let shares = lns.map(|ln| (ln - most).exp());
        let all: f64 = shares.iter().sum();
        (shares.map(|share| share / all), most + all.ln())
    }
}

/// One look at a channel, prepared for being compared with many levels: what it may be put down to,
/// with the densities of that.
#[derive(Clone, Debug)]
pub struct Member {
    /// The look itself, from the base ring.
    at: Features,
    /// The look, less where its channel lies from the level while it is healthy. For a healthy
    /// channel this scatters about the level.
    from_own: Features,
    /// The look, less where its channel lies from the level while it has the fault that it had
    /// before. For a channel with that fault this scatters about the level.
    from_fault: Features,
    /// The channel is healthy: a Gaussian of `from_own` about the level.
    healthy: Hypothesis,
    /// The channel has a fault that it never had before: a wide Student's t of `from_own` about the
    /// level.
    elsewhere: Hypothesis,
    /// The channel has the fault that it had before: a Gaussian of `from_fault` about the level.
    back: Hypothesis,
    /// The channel is another one than before the pause: a Gaussian of `at` about the level, as
    /// wide as healthy channels spread.
    replaced: Hypothesis,
    /// Probability before the look that the channel is faulty.
    was_faulty: f64,
    /// Probability before the look that it is another channel than before the pause.
    is_replaced: f64,
}

/// A density with diagonal covariance and a weight. The power of 2 pi that normalises four
/// dimensions is left out of all hypotheses, for only ratios matter.
#[derive(Clone, Copy, Debug)]
struct Hypothesis {
    /// Prior probability over the square root of the covariance's determinant; 0: it is impossible.
    weight: f64,
    /// Inverse variances.
    precision: Features,
}

impl Hypothesis {
    /// `weight`: prior probability; `variance`: of each coordinate.
    fn new(weight: f64, variance: Features) -> Hypothesis {
        let det: f64 = variance.iter().product();
        Hypothesis { weight: weight / det.sqrt(), precision: variance.map(|v| 1.0 / v) }
    }

    /// Squared distance of an offset from the hypothesis's centre, in its own standard deviations.
    fn square(&self, off: &Features) -> f64 {
        self.precision.iter().zip(off.iter()).map(|(p, d)| p * d * d).sum()
    }

    /// Weighted density of a Gaussian.
    fn gaussian(&self, off: &Features) -> f64 {
        if self.weight > 0.0 { self.weight * (-0.5 * self.square(off)).exp() } else { 0.0 }
    }

    /// Weighted density of Student's t with one degree of freedom, in four dimensions: 3 det^-½
    /// (1 + d²)^-5/2, where a Gaussian has det^-½ e^(-d²/2). Its tail leaves no size of a fault out
    /// of the question.
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
    /// Of healthy signals of this kind of head about its level, beyond the noise that the design
    /// states.
    pub spread: Features,
}

impl Member {
    /// Prepares a look. `at`: its features, canonical, from the base ring; `looks`: its precision,
    /// 1 at the reference drive; `channel`: what is known of its channel; `by`: how far looks and
    /// channels scatter; `may_be_new`: it is the first look at its channel after a pause, in which
    /// the channel may have been replaced.
    pub fn new(
        at: Features,
        looks: f64,
        channel: &Channel,
        by: &Variances,
        may_be_new: bool,
    ) -> Member {
        let Variances { noise, lasting, spread } = by;

        // The variance of this look about its channel. A smaller drive enlarges the noise alone (1
        // at the reference drive); what is drawn anew for each drop does not depend on the drive.
        let own = noise.add_scalar(1.0 / looks - 1.0);

        // where the channel lies while healthy (c) and with its fault (f), how sure that is, and
        // the probability z that it is faulty
        let ((c, c_variance), z) = (channel.healthy().posterior(lasting, noise), channel.is_faulty);
        let (f, f_variance) = channel.faulty.posterior(&wide(spread), noise);
        let (known, knows_fault) = (channel.healthy().looks > 0.0, channel.knows_fault());
        let back = if knows_fault { 0.5 } else { 0.0 };
        let is_replaced = if may_be_new && known { process::change() } else { 0.0 };
        let healthy = c_variance + own;
        Member {
            at,
            from_own: at - c,
            from_fault: at - f,
            healthy: Hypothesis::new(1.0 - z, healthy),
            elsewhere: Hypothesis::new(z * (1.0 - back), healthy + wide(spread)),
            back: Hypothesis::new(z * back, f_variance + own),
            replaced: Hypothesis::new(is_replaced, spread + own),
            was_faulty: z,
            is_replaced,
        }
    }

    /// Whether the look lies as near to where it is expected at this level as the nearer three in
    /// four of healthy looks do, for its own channel or for another one in its place.
    fn lies_near(&self, level: &Features) -> bool {
        let may_be_new = self.replaced.weight > 0.0;
        self.healthy.square(&(self.from_own - level)) < NEAR
            || may_be_new && self.replaced.square(&(self.at - level)) < NEAR
    }

    /// What the look is put down to if the level lies there (the expectation step for one look),
    /// and the look's density given that level. `odds` multiply the prior probabilities of faulty
    /// and of replaced.
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

    /// How probable it is before the look, by its channel's past and the sweep's odds, that the
    /// channel is faulty, or another one.
    fn prior(&self, odds: &Odds) -> Prior {
        let (faulty, replaced) = (odds.faulty * self.was_faulty, odds.replaced * self.is_replaced);
        Prior { faulty, replaced, all: 1.0 - self.was_faulty + faulty + replaced }
    }
}

/// How many times as many channels of a sweep are faulty, or others than before, as their pasts
/// say: factors on prior weights, common to all looks of the sweep.
#[derive(Clone, Copy, Debug)]
struct Odds {
    faulty: f64,
    replaced: f64,
}

/// Prior weights of what a look may be put down to; `all` is their sum, healthy included.
struct Prior {
    faulty: f64,
    replaced: f64,
    all: f64,
}

impl Odds {
    const AS_THOUGHT: Odds = Odds { faulty: 1.0, replaced: 1.0 };

    /// One step of expectation-maximisation: the odds by which as many channels are expected to be
    /// faulty (or others) as were found to be. One more is added to both numbers, so that a sweep
    /// without any does not make the odds zero.
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

/// Squared distance within which three in four healthy looks lie: chi-squared with four degrees of
/// freedom.
const NEAR: f64 = 5.385;
/// The share of healthy looks that lie within `NEAR`.
const OF_HEALTHY: f64 = 0.75;

/// What the looks of a sweep say of the level, each weighed by how probably it is a healthy one.
#[derive(Clone, Copy, Debug)]
pub struct Evidence {
    /// Inverse variance of the level by these looks alone, coordinate by coordinate.
    pub precision: Features,
    /// The precision times where these looks say that the level is: their weighted sum.
    pub sum: Features,
}

/// A level that explains a sweep.
#[derive(Clone, Debug)]
pub struct Explained {
    pub level: Features,
    /// The most probable way in which the level got there.
    pub by: Move,
    pub evidence: Evidence,
    /// What each look of the sweep is put down to, in the order of the looks.
    pub responsibilities: Vec<Responsibility>,
    /// About 1: the looks agree with the level as healthy looks do ([`alike`]); 0: none agrees.
    pub alike: f64,
    /// ln of the sweep's density at this level, the prior of the level included: by it levels from
    /// different beginnings are compared.
    pub ln_density: f64,
}

/// Steps of expectation-maximisation from one beginning, at most.
const STEPS: usize = 16;
/// A step of the level below this, in standard deviations of one look's noise, ends the steps.
const CONVERGED: f64 = 1e-2;
/// The positions of up to so many looks are tried as beginnings where the level is not found where
/// it is expected.
const BEGINNINGS: usize = 6;

/// The likeliest level of a sweep. Expectation-maximisation finds the maximum of the density next
/// to where it begins. It begins where the level is expected. Unless most looks agree with what it
/// finds from there, it begins at some looks and at the median of all looks, too, and the likeliest
/// result counts.
pub fn explain(expected: &Expected, members: &[Member]) -> Explained {
    let first = converged(expected, members, expected.level);
    // "most": half-way between all looks and the share below which a level is not believed
    if first.alike >= 0.5 + 0.5 * process::MAJORITY {
        return first;
    }

    // other beginnings: where single looks say that the level is, and where half of them do
    let step = members.len().div_ceil(BEGINNINGS).max(1);
    let some = members.iter().step_by(step).map(|of| of.from_own);
    let middle = Vector4::from_fn(|k, _| median_of(members.iter().map(|of| of.from_own[k])));
    let others = some.chain([middle]).map(|from| converged(expected, members, from));
    others.fold(first, |best, next| if next.ln_density > best.ln_density { next } else { best })
}

/// The share of the channels that lie near a level, over the share of healthy channels that do
/// (three in four): about 1 where all are healthy and the level is right. Channels count by the
/// probability that they were not faulty before.
pub fn alike(members: &[Member], level: &Features) -> f64 {
    let (mut near, mut all) = (0.0, 0.0);
    for of in members {
        let healthy = 1.0 - of.was_faulty;
        all += healthy;
        near += if of.lies_near(level) { healthy } else { 0.0 };
    }
    near / (OF_HEALTHY * all.max(f64::MIN_POSITIVE))
}

/// Expectation-maximisation from one level on, and what it has found.
fn converged(expected: &Expected, members: &[Member], mut level: Features) -> Explained {
    // the steps
    let mut odds = Odds::AS_THOUGHT;
    for _ in 0..STEPS {
        let (next, more) = improved(expected, members, &level, &odds);
        let step = (next - level).amax();
        (level, odds) = (next, more);
        if step < CONVERGED {
            break;
        }
    }

    // what each look is put down to at the level that was found, and the density of all looks
    let (mut responsibilities, mut ln_density) = (Vec::with_capacity(members.len()), 0.0);
    for of in members {
        let (responsibility, density) = of.weigh(&level, &odds);
        responsibilities.push(responsibility);
        ln_density += density.ln();
    }
    let evidence = evidence(members, &responsibilities);

    // the prior of the level is a sum over the moves; the largest of these tells which move it was
    let (shares, ln_prior) = expected.shares(&level);
    ln_density += ln_prior;
    let likeliest = (0..3).max_by(|&a, &b| shares[a].total_cmp(&shares[b]));
    let by = likeliest.map_or(Move::Walk, |k| MOVES[k]);
    let alike = alike(members, &level);
    Explained { level, by, evidence, responsibilities, alike, ln_density }
}

/// One step of expectation-maximisation, from a level and odds to better ones.
fn improved(
    expected: &Expected,
    members: &[Member],
    level: &Features,
    odds: &Odds,
) -> (Features, Odds) {
    // expectation: what each look is put down to; then the odds, and what healthy looks say of the
    // level
    let responsibilities: Vec<Responsibility> =
        members.iter().map(|of| of.weigh(level, odds).0).collect();
    let odds = odds.improved(members, &responsibilities);
    let Evidence { precision, sum } = evidence(members, &responsibilities);

    // the prior's precision is that of the moves, each by its share at the level as it is
    let prior = expected.moves.iter().zip(expected.shares(level).0);
    let prior = prior.fold(Matrix4::zeros(), |all, (of, share)| all + of.precision * share);

    // maximisation: the mean of the Gaussian that prior and looks make together
    let known = prior + Matrix4::from_diagonal(&precision);
    let level =
        known.try_inverse().map_or(*level, |inverse| inverse * (prior * expected.level + sum));
    (level, odds)
}

/// What the looks say of the level: those of healthy channels by where they are from their own
/// place, those of replaced channels by where they are. Looks at faults say nothing.
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
