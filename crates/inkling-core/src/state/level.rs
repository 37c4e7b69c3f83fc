//! Where most of a head's channels are in one sweep, whatever the others do: expectation-maximisation over what each
//! look is put down to and over how the level moved.

use super::canonical::Features;
use super::channel::{Channel, Responsibility, wide};
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
    /// `covariance`: of the level, as it walked on; `leap`: what a leap adds. `None`: no covariance.
    pub fn new(
        level: Features,
        covariance: &Matrix4<f64>,
        leap: &Matrix4<f64>,
        paused: bool,
    ) -> Option<Expected> {
        let rates = match paused {
            true => [1.0 - process::leap_in_pause(), process::leap_in_pause(), process::strange()],
            false => [1.0 - process::leap(), process::leap(), process::strange()],
        };
        let anywhere = Matrix4::identity() * process::anywhere().powi(2);
        let mode = |rate: f64, add: Matrix4<f64>| {
            let precision = (covariance + add).try_inverse()?;
            let ln_det = precision.determinant().ln();
            let ln_weight = rate.ln() + 0.5 * ln_det;
            ln_weight.is_finite().then_some(Mode { ln_weight, precision })
        };
        let [walk, leaps, strange] = rates;
        let moves = [mode(walk, Matrix4::zeros())?, mode(leaps, *leap)?, mode(strange, anywhere)?];
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
    odd: Hypothesis,
    elsewhere: Hypothesis,
    back: Hypothesis,
    replaced: Hypothesis,
    was_faulty: bool,
}

/// A Gaussian with a weight; the same power of tau is left out of all.
#[derive(Clone, Copy, Debug)]
struct Hypothesis {
    ln_weight: f64,
    precision: Features,
}

impl Hypothesis {
    const NONE: Hypothesis =
        Hypothesis { ln_weight: f64::NEG_INFINITY, precision: Vector4::new(0.0, 0.0, 0.0, 0.0) };

    fn new(weight: f64, variance: Features) -> Hypothesis {
        let det: f64 = variance.iter().product();
        Hypothesis { ln_weight: (weight / det.sqrt()).ln(), precision: variance.map(|v| 1.0 / v) }
    }

    fn ln_density(&self, off: &Features) -> f64 {
        let square: f64 = self.precision.iter().zip(off.iter()).map(|(p, d)| p * d * d).sum();
        self.ln_weight - 0.5 * square
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
        let own = noise / looks;
        let ((c, c_variance), z) = (channel.healthy().posterior(lasting, noise), channel.is_faulty);
        let (f, f_variance) = channel.faulty.posterior(&wide(spread), noise);
        let (known, knows_fault) = (channel.healthy().looks > 0.0, channel.knows_fault());
        let odd = if known { 0.0 } else { process::odd() };
        let back = if knows_fault { 0.5 } else { 0.0 };
        let healthy = c_variance + own;
        Member {
            at,
            from_own: at - c,
            from_fault: at - f,
            healthy: Hypothesis::new((1.0 - z) * (1.0 - odd), healthy),
            odd: match known {
                true => Hypothesis::NONE,
                false => Hypothesis::new((1.0 - z) * odd, spread * 9.0 + own),
            },
            elsewhere: Hypothesis::new(z * (1.0 - back), healthy + wide(spread)),
            back: match knows_fault {
                true => Hypothesis::new(z * back, f_variance + own),
                false => Hypothesis::NONE,
            },
            replaced: match may_be_new && known {
                true => Hypothesis::new(process::replaced(), spread + own),
                false => Hypothesis::NONE,
            },
            was_faulty: z > 0.5,
        }
    }

    /// What it is put down to at a level, and its ln density there.
    fn weigh(&self, level: &Features) -> (Responsibility, f64) {
        let (own, fault, all) = (self.from_own - level, self.from_fault - level, self.at - level);
        let lns = [
            self.healthy.ln_density(&own),
            self.odd.ln_density(&own),
            self.elsewhere.ln_density(&own),
            self.back.ln_density(&fault),
            self.replaced.ln_density(&all),
        ];
        let most = lns.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let of = lns.map(|ln| if ln > most - 40.0 { (ln - most).exp() } else { 0.0 });
        let sum: f64 = of.iter().sum();
        let responsibility = Responsibility {
            healthy: (of[0] + of[1]) / sum,
            faulty: (of[2] + of[3]) / sum,
            replaced: of[4] / sum,
        };
        (responsibility, most + sum.ln())
    }
}

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
const CONVERGED: f64 = 1e-3;
/// Looks from which the level is looked for where it is not as expected.
const BEGINNINGS: usize = 6;

/// The likeliest level of a sweep.
pub fn explain(expected: &Expected, members: &[Member]) -> Explained {
    let first = converged(expected, members, expected.level);
    let new = first.responsibilities.iter().zip(members);
    let new = new.filter(|(r, of)| r.faulty > 0.5 && !of.was_faulty).count();
    if new as f64 <= process::unexplained() * members.len() as f64 {
        return first;
    }
    let mut own: Vec<Features> = members.iter().map(|of| of.from_own).collect();
    let step = own.len().div_ceil(BEGINNINGS).max(1);
    let mut beginnings: Vec<Features> = own.iter().step_by(step).copied().collect();
    beginnings.push(median(&mut own));
    let others = beginnings.into_iter().map(|from| converged(expected, members, from));
    others.fold(first, |best, next| if next.ln_density > best.ln_density { next } else { best })
}

fn median(of: &mut [Features]) -> Features {
    Vector4::from_fn(|k, _| {
        of.sort_unstable_by(|a, b| a[k].total_cmp(&b[k]));
        of[of.len() / 2][k]
    })
}

fn converged(expected: &Expected, members: &[Member], mut level: Features) -> Explained {
    for _ in 0..STEPS {
        let next = improved(expected, members, &level);
        let step = (next - level).amax();
        level = next;
        if step < CONVERGED {
            break;
        }
    }
    let (mut responsibilities, mut ln_density) = (Vec::with_capacity(members.len()), 0.0);
    for of in members {
        let (responsibility, ln) = of.weigh(&level);
        responsibilities.push(responsibility);
        ln_density += ln;
    }
    let evidence = evidence(members, &responsibilities);
    let lns = expected.ln_densities(&level);
    let most = lns.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    ln_density += most + lns.iter().map(|ln| (ln - most).exp()).sum::<f64>().ln();
    let by = (0..3).max_by(|&a, &b| lns[a].total_cmp(&lns[b])).map_or(Move::Walk, |k| MOVES[k]);
    let agrees: f64 = responsibilities.iter().map(|r| r.healthy + r.replaced).sum();
    let alike = agrees / members.len().max(1) as f64;
    Explained { level, by, evidence, responsibilities, alike, ln_density }
}

fn improved(expected: &Expected, members: &[Member], level: &Features) -> Features {
    let responsibilities: Vec<Responsibility> =
        members.iter().map(|of| of.weigh(level).0).collect();
    let Evidence { precision, sum } = evidence(members, &responsibilities);
    let lns = expected.ln_densities(level);
    let most = lns.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let shares = lns.map(|ln| (ln - most).exp());
    let all: f64 = shares.iter().sum();
    let prior = expected.moves.iter().zip(shares);
    let prior =
        prior.fold(Matrix4::zeros(), |all_of, (of, share)| all_of + of.precision * (share / all));
    let known = prior + Matrix4::from_diagonal(&precision);
    known.try_inverse().map_or(*level, |inverse| inverse * (prior * expected.level + sum))
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
