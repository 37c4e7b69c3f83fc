//! Where most of a head's channels are in one sweep, whatever the others do: expectation-maximisation over what each
//! look is put down to and over how the level moved.

use super::canonical::Features;
use super::channel::{Channel, Responsibility, wide};
use super::kind::Kind;
use super::process;
use nalgebra::{Matrix4, Vector4};

/// How a level may have moved since the sweep before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Move {
    Walk,
    Leap,
    /// Another head, or another way of looking at it.
    Strange,
}

const MOVES: [Move; 3] = [Move::Walk, Move::Leap, Move::Strange];

/// Where the level is expected.
#[derive(Clone, Debug)]
pub struct Expected {
    pub level: Features,
    moves: [Mode; 3],
}

#[derive(Clone, Debug)]
struct Mode {
    ln_weight: f64,
    precision: Matrix4<f64>,
}

impl Expected {
    /// `covariance`: of the level, as it walked on; `kind`: what a leap adds, and what another head. `None`: no covariance. Another
    /// head is as rare as two leaps at once.
    pub fn new(
        level: Features,
        covariance: &Matrix4<f64>,
        kind: &Kind,
        paused: bool,
    ) -> Option<Expected> {
        let leap = if paused { process::leap_in_pause() } else { process::leap() };
        let mode = |rate: f64, add: Matrix4<f64>| {
            let precision = (covariance + add).try_inverse()?;
            let ln_det = precision.determinant().ln();
            let ln_weight = rate.ln() + 0.5 * ln_det;
            ln_weight.is_finite().then_some(Mode { ln_weight, precision })
        };
        let moves = [
            mode(1.0 - leap, Matrix4::zeros())?,
            mode(leap, kind.leap)?,
            mode(process::leap().powi(2), kind.anywhere)?,
        ];
        Some(Expected { level, moves })
    }

    /// The same for a level that neither leaps nor is another head's.
    pub fn as_it_walks(&self) -> Expected {
        let mut expected = self.clone();
        expected.moves[1..].iter_mut().for_each(|of| of.ln_weight = f64::NEG_INFINITY);
        expected
    }

    fn ln_densities(&self, level: &Features) -> [f64; 3] {
        let d = level - self.level;
        self.moves.each_ref().map(|of| of.ln_weight - 0.5 * d.dot(&(of.precision * d)))
    }
}

/// One look, ready to be compared with levels.
#[derive(Clone, Debug)]
pub struct Member {
    /// The look, and from there where its channel is by itself.
    at: Features,
    from_own: Features,
    from_fault: Features,
    healthy: Hypothesis,
    elsewhere: Hypothesis,
    back: Hypothesis,
    replaced: Hypothesis,
    /// Probability that it is faulty, before the look.
    was_faulty: f64,
    /// That it is another one.
    is_replaced: f64,
}

/// A density with a weight; the same power of tau is left out of all.
#[derive(Clone, Copy, Debug)]
struct Hypothesis {
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

    /// Student's t with one degree of freedom, in four dimensions: 3 det^-½ (1 + d²)^-5/2, where a Gaussian has det^-½ e^(-d²/2).
    fn heavy(&self, off: &Features) -> f64 {
        let x = 1.0 + self.square(off);
        3.0 * self.weight / (x * x * x.sqrt())
    }
}

/// How far healthy looks lie from where they are expected, canonical.
#[derive(Clone, Copy, Debug)]
pub struct Variances {
    /// Of one look about its channel.
    pub noise: Features,
    /// Of channels about their head.
    pub lasting: Features,
    /// Of healthy signals of this kind of head, the design's noise apart.
    pub spread: Features,
}

impl Member {
    /// `looks`: precision of the look; `may_be_new`: first look after a pause.
    pub fn new(
        at: Features,
        looks: f64,
        channel: &Channel,
        by: &Variances,
        may_be_new: bool,
    ) -> Member {
        let Variances { noise, lasting, spread } = by;
        // what is drawn anew for each drop is no smaller where rings are larger
        let own = noise.add_scalar(1.0 / looks - 1.0);
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

    /// Whether it is among the nearer three in four of healthy looks, at its own channel or at another one in its place.
    fn lies_near(&self, level: &Features) -> bool {
        let may_be_new = self.replaced.weight > 0.0;
        self.healthy.square(&(self.from_own - level)) < NEAR
            || may_be_new && self.replaced.square(&(self.at - level)) < NEAR
    }

    /// What it is put down to at a level, and its density there.
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

/// How many times as many channels of a sweep are faulty, or others than before, as each one's past says.
#[derive(Clone, Copy, Debug)]
struct Odds {
    faulty: f64,
    replaced: f64,
}

/// Weights of what a look may be put down to, and the sum of all.
struct Prior {
    faulty: f64,
    replaced: f64,
    all: f64,
}

impl Odds {
    const AS_THOUGHT: Odds = Odds { faulty: 1.0, replaced: 1.0 };

    /// One step of expectation-maximisation; one channel of each kind is taken for granted.
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

/// Squared distance that three in four healthy looks lie within: chi-squared with four degrees of freedom.
const NEAR: f64 = 5.385;
const OF_HEALTHY: f64 = 0.75;

/// What looks say of the level: their precision, and that times where they say it is.
#[derive(Clone, Copy, Debug)]
pub struct Evidence {
    pub precision: Features,
    pub sum: Features,
}

/// A level that explains a sweep.
#[derive(Clone, Debug)]
pub struct Explained {
    pub level: Features,
    pub by: Move,
    pub evidence: Evidence,
    pub responsibilities: Vec<Responsibility>,
    /// Share of the looks that agree with it.
    pub alike: f64,
    pub ln_density: f64,
}

/// Most steps from one beginning; between levels that lie closer together than that nothing changes.
const STEPS: usize = 16;
const CONVERGED: f64 = 1e-2;
/// Looks from which the level is looked for where it is not as expected.
const BEGINNINGS: usize = 6;

/// The likeliest level of a sweep.
pub fn explain(expected: &Expected, members: &[Member]) -> Explained {
    let first = converged(expected, members, expected.level);
    // half-way between all and too few to be believed
    if first.alike >= 0.5 + 0.5 * process::least_alike() {
        return first;
    }
    let mut own: Vec<Features> = members.iter().map(|of| of.from_own).collect();
    let step = own.len().div_ceil(BEGINNINGS).max(1);
    let mut beginnings: Vec<Features> = own.iter().step_by(step).copied().collect();
    beginnings.push(median(&mut own));
    let others = beginnings.into_iter().map(|from| converged(expected, members, from));
    others.fold(first, |best, next| if next.ln_density > best.ln_density { next } else { best })
}

/// How many of the channels that were not faulty lie about a level, over how many of healthy ones do.
pub fn alike(members: &[Member], level: &Features) -> f64 {
    let (mut near, mut all) = (0.0, 0.0);
    for of in members {
        let healthy = 1.0 - of.was_faulty;
        all += healthy;
        near += if of.lies_near(level) { healthy } else { 0.0 };
    }
    near / (OF_HEALTHY * all.max(f64::MIN_POSITIVE))
}

fn median(of: &mut [Features]) -> Features {
    Vector4::from_fn(|k, _| {
        of.sort_unstable_by(|a, b| a[k].total_cmp(&b[k]));
        of[of.len() / 2][k]
    })
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
    let lns = expected.ln_densities(&level);
    let most = lns.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    ln_density += most + lns.iter().map(|ln| (ln - most).exp()).sum::<f64>().ln();
    let by = (0..3).max_by(|&a, &b| lns[a].total_cmp(&lns[b])).map_or(Move::Walk, |k| MOVES[k]);
    let alike = alike(members, &level);
    Explained { level, by, evidence, responsibilities, alike, ln_density }
}

/// One step of expectation-maximisation: the level, and how many times as many channels are faulty as their pasts say.
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
    let lns = expected.ln_densities(level);
    let most = lns.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let shares = lns.map(|ln| (ln - most).exp());
    let all: f64 = shares.iter().sum();
    let prior = expected.moves.iter().zip(shares);
    let prior =
        prior.fold(Matrix4::zeros(), |all_of, (of, share)| all_of + of.precision * (share / all));
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
