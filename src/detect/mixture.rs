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

use crate::model::inner_product::dot;
use crate::model::lane_math::{exp, ln};
use crate::processor::for_processor;
use nalgebra::{DMatrix, DVector};
use std::sync::LazyLock;

/// Bins of ln (s / median), and where they begin and end.
const STEP: f64 = 0.1;
const FIRST: f64 = -5.0;
const LAST: f64 = 12.0;
const BINS: usize = 170;
/// The law is followed so far on either side.
const BEYOND: f64 = 10.0;
const BEFORE: usize = 100;
const STEPS: usize = BINS + 2 * BEFORE;

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

/// Which kind of statistic: squares of so many features.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Degrees {
    /// Distance along amplitude, damping and frequency.
    Three,
    /// The upper side of one feature's.
    OneSided,
}

impl Degrees {
    /// Half of them.
    fn half(self) -> f64 {
        match self {
            Degrees::Three => 1.5,
            Degrees::OneSided => 0.5,
        }
    }
}

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
            let peak = best.peak(counts);
            if peak.stands < ASKS {
                break;
            }
            let starts = [-0.6, 0.0, 0.6]
                .into_iter()
                .flat_map(|off| [3.0, -1.0].map(|share| best.with_kind(peak.place + off, share)));
            let tried = starts.map(|start| Mixture::climb(a, start, counts, FEW));
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

    /// Where counts stand above what is expected by most standard deviations.
    fn peak(&self, counts: &Counts) -> Peak {
        const TOGETHER: usize = 5;
        let p = Parts::of(self.a, &self.at).mixed();
        let n = counts.sum();
        let of = |from: usize| {
            let bins = from..from + TOGETHER;
            let (seen, expected): (f64, f64) =
                bins.fold((0.0, 0.0), |(s, e), i| (s + counts.0[i], e + n * p[i]));
            let stands = (seen - expected) / expected.max(1.0).sqrt();
            Peak { place: place(from + TOGETHER / 2), stands }
        };
        let first = ((NEAREST - FIRST) / STEP) as usize;
        let peaks = (first..BINS - TOGETHER).map(of);
        peaks.fold(Peak { place: NEAREST, stands: 0.0 }, |most, next| {
            if next.stands > most.stands { next } else { most }
        })
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

/// Counts beyond what is expected.
struct Peak {
    place: f64,
    /// In standard deviations.
    stands: f64,
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
fn law(a: f64, at: &DVector<f64>) -> [f64; STEPS] {
    let (gamma, kappa) = (at[GAMMA].exp(), (-at[TAIL]).exp());
    let first = gamma * (FIRST - BEYOND + 0.5 * STEP - at[SCALE]);
    let mut p = densities(a, kappa, first, gamma * STEP);
    let sum: f64 = p.iter().sum();
    p.iter_mut().for_each(|p| *p /= sum);
    p
}

/// e to this is nothing.
const LEAST: f64 = -700.0;
const SQRT_TAU: f64 = 2.506_628_274_631_000_7;

for_processor! {
    /// e^(a t) (1 + e^t / kappa)^-(a + kappa), t from `first` on by steps.
    fn densities(a: f64, kappa: f64, first: f64, step: f64) -> [f64; STEPS] { all_densities }
}

#[inline(always)] // compiled once per instruction set
fn all_densities(a: f64, kappa: f64, first: f64, step: f64) -> [f64; STEPS] {
    let mut p = [0.0; STEPS];
    for (i, p) in p.iter_mut().enumerate() {
        let t = first + step * i as f64;
        let below = a * t - (a + kappa) * ln(1.0 + exp(t) / kappa);
        *p = exp(if below > LEAST { below } else { LEAST });
    }
    p
}

for_processor! {
    /// A Gaussian in ln s, of every bin.
    fn bump(middle: f64, sd: f64) -> [f64; BINS] { all_of_bump }
}

#[inline(always)] // compiled once per instruction set
fn all_of_bump(middle: f64, sd: f64) -> [f64; BINS] {
    let mut p = [0.0; BINS];
    for (i, p) in p.iter_mut().enumerate() {
        let z = (FIRST + (i as f64 + 0.5) * STEP - middle) / sd;
        let below = -0.5 * z * z;
        *p = STEP / (sd * SQRT_TAU) * exp(if below > LEAST { below } else { LEAST });
    }
    p
}

for_processor! {
    /// Sum of counts times ln probability.
    fn ln_of_counts(counts: &[f64; BINS], p: &[f64; BINS]) -> f64 { all_ln_of_counts }
}

#[inline(always)] // compiled once per instruction set
fn all_ln_of_counts(counts: &[f64; BINS], p: &[f64; BINS]) -> f64 {
    let mut each = [0.0; BINS];
    for ((each, n), p) in each.iter_mut().zip(counts).zip(p) {
        *each = n * ln(*p);
    }
    each.iter().sum()
}

/// The same of every bin; the outermost ones hold what lies beyond.
fn of_bins(a: f64, at: &DVector<f64>) -> [f64; BINS] {
    let p = law(a, at);
    let mut bins: [f64; BINS] = std::array::from_fn(|i| p[BEFORE + i]);
    bins[0] += p[..BEFORE].iter().sum::<f64>();
    bins[BINS - 1] += p[BEFORE + BINS..].iter().sum::<f64>();
    bins
}

/// Probability of every bin for a faulty signal of any size.
static OF_ANY_SIZE: LazyLock<[f64; BINS]> = LazyLock::new(|| {
    let density = |t: f64| 1.5 * t - 1.5 * (t.exp() + EVENLY).ln();
    let p: [f64; BINS] = std::array::from_fn(|i| density(place(i)).exp());
    let sum: f64 = p.iter().sum();
    p.map(|p| p / sum)
});

/// Probabilities of every bin.
struct Parts {
    healthy_share: f64,
    healthy: [f64; BINS],
    /// Of faults: of any size, then of every kind, each with its weight; sum 1.
    weights: Vec<f64>,
    faults: Vec<[f64; BINS]>,
}

impl Parts {
    fn of(a: f64, at: &DVector<f64>) -> Parts {
        let kinds = at.as_slice()[LAW..].chunks_exact(OF_KIND);
        let mut weights = vec![1.0];
        let mut faults = vec![*OF_ANY_SIZE];
        for kind in kinds {
            weights.push(kind[0].exp());
            faults.push(bump(kind[1], kind[2].exp()));
        }
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        let healthy = of_bins(a, at);
        Parts { healthy_share: healthy_share(at[HEALTHY]), healthy, weights, faults }
    }

    /// Of a faulty signal.
    fn faulty(&self) -> [f64; BINS] {
        let mut all = [0.0; BINS];
        for (w, p) in self.weights.iter().zip(&self.faults) {
            all.iter_mut().zip(p).for_each(|(all, p)| *all += w * p);
        }
        all
    }

    /// Of any signal.
    fn mixed(&self) -> [f64; BINS] {
        let (h, faulty) = (self.healthy_share, self.faulty());
        std::array::from_fn(|i| (h * self.healthy[i] + (1.0 - h) * faulty[i]).max(1e-300))
    }
}

/// With what is believed beforehand.
fn ln_likelihood(a: f64, at: &DVector<f64>, counts: &Counts) -> f64 {
    let mixed = Parts::of(a, at).mixed();
    let data = ln_of_counts(&counts.0, &mixed);
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
        let mut slopes: Vec<[f64; BINS]> = (SCALE..=TAIL)
            .map(|k| {
                let moved = |by: f64| {
                    let mut at = at.clone();
                    at[k] += by;
                    of_bins(a, &at)
                };
                let (up, down) = (moved(H), moved(-H));
                std::array::from_fn(|i| h * (up[i] - down[i]) / (2.0 * H))
            })
            .collect();
        // h = 1/2 + 1/2 logistic
        let of_share = 2.0 * (h - 0.5) * (1.0 - h);
        slopes.push(std::array::from_fn(|i| of_share * (parts.healthy[i] - faulty[i])));
        let kinds = at.as_slice()[LAW..].chunks_exact(OF_KIND);
        for ((kind, w), density) in kinds.zip(&parts.weights[1..]).zip(&parts.faults[1..]) {
            let sd = kind[2].exp();
            let z = |i: usize| (place(i) - kind[1]) / sd;
            let by = (1.0 - h) * w;
            slopes.push(std::array::from_fn(|i| by * (density[i] - faulty[i])));
            slopes.push(std::array::from_fn(|i| by * density[i] * z(i) / sd));
            slopes.push(std::array::from_fn(|i| by * density[i] * (z(i) * z(i) - 1.0)));
        }
        let n = counts.sum();
        let over: Vec<[f64; BINS]> =
            slopes.iter().map(|slope| std::array::from_fn(|i| slope[i] / p[i])).collect();
        let mut gradient = DVector::from_fn(at.len(), |k, _| dot(&counts.0, &over[k]));
        let mut information = DMatrix::zeros(at.len(), at.len());
        for j in 0..at.len() {
            for k in 0..=j {
                let of = n * dot(&slopes[j], &over[k]);
                (information[(j, k)], information[(k, j)]) = (of, of);
            }
        }
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
