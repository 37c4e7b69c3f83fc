//! Healthy and faulty signals in one histogram of detection statistics.
//!
//! In: counts of ln (statistic / median). Out: the law of the healthy ones, as far as the data tell.
//!
//! # What is assumed
//!
//! Statistics are squared distances. Those of healthy signals follow a generalised F law,
//! (s / c)^gamma = F, F of 2a and 2 kappa degrees: chi-squared at gamma = 1, kappa = infinity (Gaussian
//! scatter), lighter tails at gamma > 1 (bounded scatter), power laws at small kappa (Student's t, with
//! 2 kappa degrees). At least half of the signals are healthy. Faulty signals come in sizes and in
//! kinds: of any size they lie evenly in the space of the features near the healthy ones, so that
//! their share grows as s^(3/2) d ln s, and evenly over orders of magnitude further out; a kind of one size
//! is a bump in ln s, and there is one where the counts ask for it (Schwarz's criterion). All of it is what
//! makes the counts likeliest; so the tail is read from the body where faults hide it, and from itself
//! where they do not. Measured on shapes of scatter and of faults: `contamination.rs`, docs/open_world.md.

use super::contamination::Degrees;
use nalgebra::{DMatrix, DVector};

/// Bins of ln (s / median), and where they begin and end.
const STEP: f64 = 0.1;
const FIRST: f64 = -5.0;
const LAST: f64 = 12.0;
const BINS: usize = 170;
/// The law is followed so far on either side.
const BEYOND: f64 = 10.0;
const BEFORE: usize = 100;

/// Chosen on seven shapes of scatter with 0, 3 and 40 % of faults over orders of magnitude (a study
/// apart from the tests), and on 72 windows of the open world's with 0 to 40 % of nine classes of faults
/// (seed 913001). Faults lie evenly in space up to so many medians.
const EVENLY: f64 = 20.0;
/// Prior: standard deviation of ln gamma, mean of 1 / kappa.
const GAMMA_SD: f64 = 0.25;
const TAIL_MEAN: f64 = 0.15;

/// No healthy tail is heavier than that of Student's t with four degrees, kappa = 2 (ln 1 / kappa).
const HEAVIEST: f64 = -0.69;

/// Kinds of one size, at most.
const MOST_KINDS: usize = 3;
/// A kind lies beyond so many medians (ln; nearer, it may as well be healthy channels of another make),
/// and is so wide (ln of the standard deviation of ln s: prior).
const NEAREST: f64 = 2.0;
const WIDTH: f64 = -1.4;
const WIDTH_SD: f64 = 0.5;
/// Counts that stand so many standard deviations above what is expected ask for a kind.
const ASKS: f64 = 4.0;

/// A histogram of ln (s / median).
#[derive(Clone, Debug)]
pub(super) struct Counts([f64; BINS]);

impl Default for Counts {
    fn default() -> Counts {
        Counts([0.0; BINS])
    }
}

impl Counts {
    pub fn add(&mut self, ratio: f64) {
        let place = ((ratio.ln() - FIRST) / STEP).floor();
        self.0[place.clamp(0.0, BINS as f64 - 1.0) as usize] += 1.0;
    }

    pub fn without(&self, part: &Counts) -> Counts {
        Counts(std::array::from_fn(|i| self.0[i] - part.0[i]))
    }

    pub fn is_empty(&self) -> bool {
        self.0.iter().all(|n| *n == 0.0)
    }

    fn sum(&self) -> f64 {
        self.0.iter().sum()
    }
}

/// Middle of a bin.
fn place(i: usize) -> f64 {
    FIRST + (i as f64 + 0.5) * STEP
}

/// Where the parameters stand: ln c, ln gamma, ln (1 / kappa), the share of healthy signals on a scale
/// without ends; then of every kind ln of its weight beside the faults of any size, its place, ln of
/// its width.
const SCALE: usize = 0;
const GAMMA: usize = 1;
const TAIL: usize = 2;
const HEALTHY: usize = 3;
const LAW: usize = 4;
const OF_KIND: usize = 3;

#[derive(Clone, Debug)]
pub(super) struct Mixture {
    a: f64,
    at: DVector<f64>,
    ln_likelihood: f64,
}

impl Mixture {
    pub fn fit(counts: &Counts, degrees: Degrees) -> Mixture {
        let a = degrees.half();
        let starts = [(-4.0, 3.0), (-1.5, 3.0), (-3.0, -1.0)];
        let start = |(tail, share): (f64, f64)| DVector::from_vec(vec![-0.2, 0.0, tail, share]);
        let mut best = likeliest(starts.map(|s| Mixture::climb(a, start(s), counts, ROUNDS)))
            .unwrap_or(Mixture { a, at: start(starts[0]), ln_likelihood: f64::NEG_INFINITY });
        let worth = 0.5 * OF_KIND as f64 * counts.sum().max(1.0).ln();
        for _ in 0..MOST_KINDS {
            if best.most_beyond(counts) < ASKS {
                break;
            }
            let tried = (0..24).map(|k| {
                let (place, share) = (1.25 + 0.6 * f64::from(k / 2), [3.0, -1.0][k as usize % 2]);
                Mixture::climb(a, best.with_kind(place, share), counts, FEW)
            });
            let Some(more) = likeliest(tried) else { break };
            let more = Mixture::climb(a, more.at, counts, ROUNDS);
            if more.ln_likelihood < best.ln_likelihood + worth {
                break;
            }
            best = more;
        }
        best
    }

    /// The same of a part of the counts.
    pub fn fit_again(&self, counts: &Counts) -> Mixture {
        Mixture::climb(self.a, self.at.clone(), counts, ROUNDS)
    }

    pub fn healthy_share(&self) -> f64 {
        healthy_share(self.at[HEALTHY])
    }

    /// 1 / kappa of the healthy law.
    pub fn tail(&self) -> f64 {
        self.at[TAIL].exp()
    }

    /// ln (s / median) that healthy signals exceed at a rate.
    pub fn ln_exceeded(&self, rate: f64) -> f64 {
        let p = law(self.a, &self.at);
        let mut beyond = 0.0;
        for (i, p) in p.iter().enumerate().rev() {
            if beyond + p > rate {
                // within the step the tail falls as a power
                let share = ((beyond + p) / rate).ln() / ((beyond + p) / beyond.max(1e-300)).ln();
                return FIRST - BEYOND + (i as f64 + share.clamp(0.0, 1.0)) * STEP;
            }
            beyond += p;
        }
        FIRST
    }

    /// One more kind of one size. What it explains the healthy tail need not.
    fn with_kind(&self, place: f64, share: f64) -> DVector<f64> {
        let mut at = self.at.clone().resize_vertically(self.at.len() + OF_KIND, 0.0);
        (at[GAMMA], at[TAIL], at[HEALTHY]) = (0.0, -4.0, share);
        let first = at.len() - OF_KIND;
        (at[first], at[first + 1], at[first + 2]) = (0.0, place, WIDTH);
        at
    }

    /// By how many standard deviations counts stand above what is expected, at most.
    fn most_beyond(&self, counts: &Counts) -> f64 {
        const TOGETHER: usize = 5;
        let p = Parts::of(self.a, &self.at).mixed();
        let n = counts.sum();
        let of = |from: usize| {
            let bins = from..from + TOGETHER;
            let (seen, expected): (f64, f64) =
                bins.fold((0.0, 0.0), |(s, e), i| (s + counts.0[i], e + n * p[i]));
            (seen - expected) / expected.max(1.0).sqrt()
        };
        let first = ((NEAREST - FIRST) / STEP) as usize;
        (first..BINS - TOGETHER).map(of).fold(0.0, f64::max)
    }

    /// The likeliest near a start, by Fisher scoring with a damped step.
    fn climb(a: f64, start: DVector<f64>, counts: &Counts, rounds: usize) -> Mixture {
        let (mut at, mut damping) = (within(start), 1e-3);
        let mut height = ln_likelihood(a, &at, counts);
        let mut slope = Slope::of(a, &at, counts);
        for _ in 0..rounds {
            let Some(step) = slope.step(damping) else { break };
            let next = within(&at + step);
            let there = ln_likelihood(a, &next, counts);
            if there > height {
                let gained = there - height;
                (at, height, damping) = (next, there, damping * 0.2);
                if gained < 1e-4 {
                    break;
                }
                slope = Slope::of(a, &at, counts);
            } else if damping > 1e6 {
                break;
            } else {
                damping *= 10.0;
            }
        }
        Mixture { a, at, ln_likelihood: height }
    }
}

/// Steps to the top, and to see which way is up.
const ROUNDS: usize = 40;
const FEW: usize = 12;

fn likeliest(of: impl IntoIterator<Item = Mixture>) -> Option<Mixture> {
    of.into_iter().max_by(|p, q| p.ln_likelihood.total_cmp(&q.ln_likelihood))
}

fn healthy_share(at: f64) -> f64 {
    0.5 + 0.5 / (1.0 + (-at).exp())
}

/// The healthy law's probability of every step from `FIRST - BEYOND` on.
fn law(a: f64, at: &DVector<f64>) -> Vec<f64> {
    let (gamma, kappa) = (at[GAMMA].exp(), (-at[TAIL]).exp());
    let mut p: Vec<f64> = (0..BINS + 2 * BEFORE)
        .map(|i| {
            let t = gamma * (FIRST - BEYOND + (i as f64 + 0.5) * STEP - at[SCALE]);
            (a * t - (a + kappa) * (t.exp() / kappa).ln_1p()).exp()
        })
        .collect();
    let sum: f64 = p.iter().sum();
    p.iter_mut().for_each(|p| *p /= sum);
    p
}

/// The same of every bin; the outermost ones hold what lies beyond.
fn of_bins(a: f64, at: &DVector<f64>) -> Vec<f64> {
    let p = law(a, at);
    let mut bins = p[BEFORE..BEFORE + BINS].to_vec();
    bins[0] += p[..BEFORE].iter().sum::<f64>();
    bins[BINS - 1] += p[BEFORE + BINS..].iter().sum::<f64>();
    bins
}

/// Probability of every bin for a faulty signal of any size.
fn of_any_size() -> Vec<f64> {
    let density = |t: f64| 1.5 * t - 1.5 * (t.exp() + EVENLY).ln();
    let mut p: Vec<f64> = (0..BINS).map(|i| density(place(i)).exp()).collect();
    let sum: f64 = p.iter().sum();
    p.iter_mut().for_each(|p| *p /= sum);
    p
}

/// Probabilities of every bin.
struct Parts {
    healthy_share: f64,
    healthy: Vec<f64>,
    /// Of faults: of any size, then of every kind, each with its weight; sum 1.
    weights: Vec<f64>,
    faults: Vec<Vec<f64>>,
}

impl Parts {
    fn of(a: f64, at: &DVector<f64>) -> Parts {
        let kinds = at.as_slice()[LAW..].chunks_exact(OF_KIND);
        let mut weights = vec![1.0];
        let mut faults = vec![of_any_size()];
        for kind in kinds {
            weights.push(kind[0].exp());
            let sd = kind[2].exp();
            let density = |i: usize| {
                let z = (place(i) - kind[1]) / sd;
                STEP / (sd * std::f64::consts::TAU.sqrt()) * (-0.5 * z * z).exp()
            };
            faults.push((0..BINS).map(density).collect());
        }
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        let healthy = of_bins(a, at);
        Parts { healthy_share: healthy_share(at[HEALTHY]), healthy, weights, faults }
    }

    /// Of a faulty signal.
    fn faulty(&self) -> Vec<f64> {
        let of = |i: usize| self.weights.iter().zip(&self.faults).map(|(w, p)| w * p[i]).sum();
        (0..BINS).map(of).collect()
    }

    /// Of any signal.
    fn mixed(&self) -> Vec<f64> {
        let mix = |(p, q): (&f64, f64)| {
            (self.healthy_share * p + (1.0 - self.healthy_share) * q).max(1e-300)
        };
        self.healthy.iter().zip(self.faulty()).map(mix).collect()
    }
}

/// With what is believed beforehand.
fn ln_likelihood(a: f64, at: &DVector<f64>, counts: &Counts) -> f64 {
    let mixed = Parts::of(a, at).mixed();
    let data: f64 = counts.0.iter().zip(mixed).map(|(n, p)| n * p.ln()).sum();
    let widths: f64 = at.as_slice()[LAW..]
        .chunks_exact(OF_KIND)
        .map(|kind| 0.5 * ((kind[2] - WIDTH) / WIDTH_SD).powi(2))
        .sum();
    data - 0.5 * (at[GAMMA] / GAMMA_SD).powi(2) - at[TAIL].exp() / TAIL_MEAN - widths
}

struct Slope {
    gradient: DVector<f64>,
    information: DMatrix<f64>,
}

impl Slope {
    fn of(a: f64, at: &DVector<f64>, counts: &Counts) -> Slope {
        const H: f64 = 1e-4;
        let parts = Parts::of(a, at);
        let (p, faulty, h) = (parts.mixed(), parts.faulty(), parts.healthy_share);
        let mut slopes: Vec<Vec<f64>> = (SCALE..=TAIL)
            .map(|k| {
                let moved = |by: f64| {
                    let mut at = at.clone();
                    at[k] += by;
                    of_bins(a, &at)
                };
                let ends = moved(H).into_iter().zip(moved(-H));
                ends.map(|(up, down)| h * (up - down) / (2.0 * H)).collect()
            })
            .collect();
        // h = 1/2 + 1/2 logistic
        let of_share = 2.0 * (h - 0.5) * (1.0 - h);
        slopes.push(parts.healthy.iter().zip(&faulty).map(|(p, q)| of_share * (p - q)).collect());
        let kinds = at.as_slice()[LAW..].chunks_exact(OF_KIND);
        for ((kind, w), density) in kinds.zip(&parts.weights[1..]).zip(&parts.faults[1..]) {
            let sd = kind[2].exp();
            let z = |i: usize| (place(i) - kind[1]) / sd;
            let by = (1.0 - h) * w;
            slopes.push((0..BINS).map(|i| by * (density[i] - faulty[i])).collect());
            slopes.push((0..BINS).map(|i| by * density[i] * z(i) / sd).collect());
            slopes.push((0..BINS).map(|i| by * density[i] * (z(i) * z(i) - 1.0)).collect());
        }
        let n = counts.sum();
        let mut gradient = DVector::from_fn(at.len(), |k, _| {
            (0..BINS).map(|i| counts.0[i] * slopes[k][i] / p[i]).sum::<f64>()
        });
        let mut information = DMatrix::from_fn(at.len(), at.len(), |j, k| {
            n * (0..BINS).map(|i| slopes[j][i] * slopes[k][i] / p[i]).sum::<f64>()
        });
        let mut believed = |k: usize, down: f64, weight: f64| {
            gradient[k] -= down;
            information[(k, k)] += weight;
        };
        let gamma = 1.0 / (GAMMA_SD * GAMMA_SD);
        believed(GAMMA, at[GAMMA] * gamma, gamma);
        believed(TAIL, at[TAIL].exp() / TAIL_MEAN, at[TAIL].exp() / TAIL_MEAN);
        for k in (LAW + 2..at.len()).step_by(OF_KIND) {
            let weight = 1.0 / (WIDTH_SD * WIDTH_SD);
            believed(k, (at[k] - WIDTH) * weight, weight);
        }
        Slope { gradient, information }
    }

    fn step(&self, damping: f64) -> Option<DVector<f64>> {
        let steadied = &self.information
            + DMatrix::from_diagonal(&self.information.diagonal()) * damping
            + DMatrix::identity(self.gradient.len(), self.gradient.len()) * 1e-6;
        Some(steadied.try_inverse()? * &self.gradient)
    }
}

/// Mixtures that are possible at all.
fn within(mut at: DVector<f64>) -> DVector<f64> {
    at[SCALE] = at[SCALE].clamp(-6.0, 6.0);
    at[GAMMA] = at[GAMMA].clamp(-0.7, 0.7);
    at[TAIL] = at[TAIL].clamp(-7.0, HEAVIEST);
    at[HEALTHY] = at[HEALTHY].clamp(-5.0, 9.0);
    for kind in at.as_mut_slice()[LAW..].chunks_exact_mut(OF_KIND) {
        kind[0] = kind[0].clamp(-6.0, 6.0);
        kind[1] = kind[1].clamp(NEAREST, LAST);
        kind[2] = kind[2].clamp(-2.5, -0.4);
    }
    at
}
