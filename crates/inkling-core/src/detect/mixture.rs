//! A mixture model of healthy and faulty signals' detection statistics, fitted to their histogram
//! where nobody knows which signals are faulty.
//!
//! In: a histogram of ln (statistic / median). Out: the distribution of the healthy signals'
//! statistic, and the estimated share of healthy signals.
//!
//! # The model
//!
//! A statistic s is a squared distance, in units of the median of all signals, of which at least
//! half are healthy. A healthy s follows a generalised F distribution: (s / c)^gamma is, up to a
//! constant factor, F distributed with 2a and 2 kappa degrees of freedom. This is chi-squared with
//! 2a degrees of freedom at gamma = 1 and kappa = infinity (Gaussian scatter). It has a lighter tail
//! at gamma > 1 (scatter that ends at bounds), and a tail that falls as a power at small kappa (as
//! of Student's t with 2 kappa degrees of freedom).
//!
//! *Faults of any size*, one component, are uniform in the three-dimensional space of the features
//! near the healthy ones, so that their density by ln s grows as s^(3/2), and log-uniform in s
//! further out. *Faults of one size*, none to three components, are each a Gaussian in ln s.
//!
//! # The fit
//!
//! 1. Without any component of one size, maximise the penalised likelihood by damped Fisher
//!    scoring, from three starts.
//! 2. Add a component of one size where the counts exceed the fit most, and maximise again.
//! 3. Keep it, and go on with step 2, if the likelihood gains enough by Schwarz's criterion (BIC),
//!    or where signals are few by Akaike's corrected one.
//!
//! The choice of the distributions is heuristic; docs/design/measured.md tells what it was tried on.

use super::tuned;
use crate::model::descent::{Damping, descend};
use crate::model::inner_product::dot;
use crate::model::simd_math::{exp, ln};
use crate::processor::for_processor;
use nalgebra::{DMatrix, DVector};
use std::sync::LazyLock;

/// Bins of ln (s / median): width, range and number. The outermost ones hold what lies outside.
const STEP: f64 = 0.1;
const FIRST: f64 = -5.0;
const LAST: f64 = 12.0;
const BINS: usize = 170;
/// How far the healthy distribution is computed beyond the bins on either side, in ln s and in
/// steps, so that its normalisation includes the tails.
const BEYOND: f64 = 10.0;
const BEFORE: usize = 100;
const STEPS: usize = BINS + 2 * BEFORE;

/// Largest ln (1 / kappa): no healthy tail is heavier than Student's t with 4 degrees of freedom.
const HEAVIEST: f64 = -0.69;
const MOST_KINDS: usize = 3;

/// How many squared Gaussian features the statistic of a healthy signal is the sum of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Degrees {
    /// The squared distance along amplitude, damping and frequency.
    Three,
    /// One feature, of which only values above the middle count; below, the statistic is 0.
    OneSided,
}

/// Of which signals the spread is by which squared distances are taken; few make a heavier tail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spread {
    /// From the same signals whose distances are looked at, by their core (`sensitivity::core_of`).
    Own,
    /// From so many other signals that the spread's error does not matter.
    Known,
}

#[derive(Clone, Debug)]
pub(super) struct Counts([f64; BINS]);

impl Counts {
    pub const NONE: Counts = Counts([0.0; BINS]);

    /// Counts a signal whose statistic is `ratio` times the median, as `weight` signals.
    pub fn add(&mut self, ratio: f64, weight: f64) {
        let place = ((ratio.ln() - FIRST) / STEP).floor();
        self.0[place.clamp(0.0, BINS as f64 - 1.0) as usize] += weight;
    }

    pub fn without(&self, part: &Counts) -> Counts {
        Counts(std::array::from_fn(|i| self.0[i] - part.0[i]))
    }

    pub fn sum(&self) -> f64 {
        self.0.iter().sum()
    }
}

fn place(i: usize) -> f64 {
    FIRST + (i as f64 + 0.5) * STEP
}

// The parameters are one vector. Its first four are ln c, ln gamma, ln (1 / kappa), and the logit of
// 2 h - 1 (h: share of healthy signals). Then follow three for every component of one size: ln of
// its weight over that of faults of any size, its mean in ln s, and ln of its standard deviation.
const SCALE: usize = 0;
const GAMMA: usize = 1;
const TAIL: usize = 2;
const HEALTHY: usize = 3;
const LAW: usize = 4;
const OF_KIND: usize = 3;

#[derive(Clone, Copy, Debug)]
struct Freedom {
    a: f64,
    /// The part of 1 / kappa that comes from estimating the spread: squared distances by the
    /// covariance of m Gaussian points in d dimensions are F with d and m - d + 1 degrees of freedom.
    of_spread: f64,
}

impl Freedom {
    /// `n`: number of independent signals, of which `core_share` are the m points; d = 2a.
    fn new(degrees: Degrees, spread: Spread, n: f64) -> Freedom {
        let a = if degrees == Degrees::Three { 1.5 } else { 0.5 };
        let points = tuned::CORE_SHARE * n - 2.0 * a + 1.0;
        let of_spread = match spread {
            Spread::Own => 2.0 / points.max(1.0),
            Spread::Known => 0.0,
        };
        Freedom { a, of_spread }
    }

    fn kappa(self, at: &DVector<f64>) -> f64 {
        1.0 / (at[TAIL].exp() + self.of_spread)
    }
}

#[derive(Clone, Debug)]
pub(super) struct Mixture {
    freedom: Freedom,
    at: DVector<f64>,
    ln_likelihood: f64,
}

impl Mixture {
    pub fn fit(counts: &Counts, degrees: Degrees, spread: Spread) -> Mixture {
        let freedom = Freedom::new(degrees, spread, counts.sum());

        // ln (1 / kappa) and the healthy share's parameter: mostly healthy, or a good part faulty
        let starts = [(-4.0, 3.0), (-1.5, 3.0), (-3.0, -1.0)].map(|(tail, share)| {
            let start = DVector::from_vec(vec![-0.2, 0.0, tail, share]);
            Mixture::maximise(freedom, start, counts, ROUNDS)
        });
        let mut best = likeliest(starts);

        for _ in 0..MOST_KINDS {
            let peak = best.peak(counts);
            let starts = [-0.6, 0.0, 0.6]
                .into_iter()
                .flat_map(|off| [3.0, -1.0].map(|share| best.with_kind(peak + off, share)));
            let more =
                likeliest(starts.map(|start| Mixture::maximise(freedom, start, counts, FEW)));
            let more = Mixture::maximise(freedom, more.at, counts, ROUNDS);
            if more.ln_likelihood < best.ln_likelihood + best.worth_of_more(counts.sum()) {
                break;
            }
            best = more;
        }
        best
    }

    /// The gain of ln likelihood that one more component must bring, by Schwarz or by Akaike as
    /// corrected by Hurvich and Tsai (1989).
    fn worth_of_more(&self, n: f64) -> f64 {
        let akaike = |parameters: usize| {
            let (k, free) = (parameters as f64, n - parameters as f64 - 1.0);
            if free > 0.0 { k * n / free } else { f64::INFINITY }
        };
        let (before, after) = (self.at.len(), self.at.len() + OF_KIND);
        // `min` keeps infinity less infinity from being NaN
        let of_few = akaike(after) - akaike(before).min(f64::MAX);
        of_few.max(0.5 * OF_KIND as f64 * n.max(1.0).ln())
    }

    pub fn fit_again(&self, counts: &Counts) -> Mixture {
        Mixture::maximise(self.freedom, self.at.clone(), counts, ROUNDS)
    }

    pub fn healthy_share(&self) -> f64 {
        healthy_share(self.at[HEALTHY])
    }

    pub fn tail(&self) -> f64 {
        1.0 / self.freedom.kappa(&self.at)
    }

    /// That ln (s / median) which a healthy signal exceeds with probability `rate`.
    pub fn ln_exceeded(&self, rate: f64) -> f64 {
        let p = law(self.freedom, &self.at);
        let mut beyond = 0.0;
        for (i, p) in p.iter().enumerate().rev() {
            if beyond + p > rate {
                // within a bin the tail is interpolated as a power law
                let share = ((beyond + p) / rate).ln() / ((beyond + p) / beyond.max(1e-300)).ln();
                return FIRST - BEYOND + (i as f64 + share.clamp(0.0, 1.0)) * STEP;
            }
            beyond += p;
        }
        FIRST
    }

    /// Parameters to start from with one more component, about `place`; the healthy tail is light again.
    fn with_kind(&self, place: f64, share: f64) -> DVector<f64> {
        let mut at = self.at.clone().resize_vertically(self.at.len() + OF_KIND, 0.0);
        (at[GAMMA], at[TAIL], at[HEALTHY]) = (0.0, -4.0, share);
        let first = at.len() - OF_KIND;
        (at[first], at[first + 1], at[first + 2]) = (0.0, place, tuned::WIDTH);
        at
    }

    /// That ln (s / median), from `nearest` on, at which five neighbouring bins exceed the fit most, in
    /// standard deviations of a Poisson count.
    fn peak(&self, counts: &Counts) -> f64 {
        const TOGETHER: usize = 5;
        let p = Components::of(&law(self.freedom, &self.at), &self.at).mixed();
        let n = counts.sum();
        let first = ((tuned::NEAREST - FIRST) / STEP) as usize;
        let (mut most, mut at) = (0.0, tuned::NEAREST);
        for from in first..BINS - TOGETHER {
            let bins = from..from + TOGETHER;
            let (seen, expected): (f64, f64) =
                bins.fold((0.0, 0.0), |(s, e), i| (s + counts.0[i], e + n * p[i]));
            let excess_sds = (seen - expected) / expected.max(1.0).sqrt();
            if excess_sds > most {
                (most, at) = (excess_sds, place(from + TOGETHER / 2));
            }
        }
        at
    }

    fn maximise(freedom: Freedom, start: DVector<f64>, counts: &Counts, rounds: usize) -> Mixture {
        let cost = |at: &DVector<f64>| (-ln_likelihood(freedom, at, counts), ());
        let slope = |at: &DVector<f64>, ()| Some(Score::of(freedom, at, counts));
        let step = |at: &DVector<f64>, score: &Score, damping: f64| {
            Some(within(at + score.step(damping)?))
        };
        let rests = |gained: f64, _| gained < 1e-4;
        let (at, depth) = descend(within(start), DAMPING, rounds, cost, slope, step, rests);
        Mixture { freedom, at, ln_likelihood: -depth }
    }
}

const DAMPING: Damping = Damping { first: 1e-3, down: 0.2, least: 0.0, up: 10.0, most: 1e7 };
/// Numbers of steps of Fisher scoring: to converge, and to compare starts.
const ROUNDS: usize = 40;
const FEW: usize = 12;

fn likeliest(of: impl IntoIterator<Item = Mixture>) -> Mixture {
    let likelier = |p: &Mixture, q: &Mixture| p.ln_likelihood.total_cmp(&q.ln_likelihood);
    of.into_iter().max_by(likelier).expect("every fit has starts")
}

fn healthy_share(at: f64) -> f64 {
    0.5 + 0.5 / (1.0 + (-at).exp())
}

/// Probabilities of the healthy distribution in steps of `STEP` from ln s = `FIRST - BEYOND` on.
fn law(freedom: Freedom, at: &DVector<f64>) -> [f64; STEPS] {
    let (gamma, kappa) = (at[GAMMA].exp(), freedom.kappa(at));
    // t = gamma (ln s - ln c) is ln of an F variable
    let first = gamma * (FIRST - BEYOND + 0.5 * STEP - at[SCALE]);
    let mut p = densities(freedom.a, kappa, first, gamma * STEP);
    let sum: f64 = p.iter().sum();
    p.iter_mut().for_each(|p| *p /= sum);
    p
}

/// The smallest exponent that is computed: e to this counts as 0.
const LEAST: f64 = -700.0;
const SQRT_TAU: f64 = 2.506_628_274_631_000_7;

for_processor! {
    /// Density of t, the ln of an F variable (up to a constant factor), unnormalised:
    /// e^(a t) (1 + e^t / kappa)^-(a + kappa) at t = first, first + step, ..
    fn densities(a: f64, kappa: f64, first: f64, step: f64) -> [f64; STEPS] {
        let mut p = [0.0; STEPS];
        for (i, p) in p.iter_mut().enumerate() {
            let t = first + step * i as f64;
            let below = a * t - (a + kappa) * ln(1.0 + exp(t) / kappa);
            *p = exp(if below > LEAST { below } else { LEAST });
        }
        p
    }
}

for_processor! {
    fn gaussian(middle: f64, sd: f64) -> [f64; BINS] {
        let mut p = [0.0; BINS];
        for (i, p) in p.iter_mut().enumerate() {
            let z = (FIRST + (i as f64 + 0.5) * STEP - middle) / sd;
            let below = -0.5 * z * z;
            *p = STEP / (sd * SQRT_TAU) * exp(if below > LEAST { below } else { LEAST });
        }
        p
    }
}

for_processor! {
    fn ln_of_counts(counts: &[f64; BINS], p: &[f64; BINS]) -> f64 {
        let mut each = [0.0; BINS];
        for ((each, n), p) in each.iter_mut().zip(counts).zip(p) {
            *each = n * ln(*p);
        }
        each.iter().sum()
    }
}

for_processor! {
    /// How ln of a density grows with t and with kappa, where t = first, first + step, ..
    fn slopes_of_ln(a: f64, kappa: f64, first: f64, step: f64) -> [[f64; STEPS]; 2] {
        let (mut by_t, mut by_kappa) = ([0.0; STEPS], [0.0; STEPS]);
        for (i, (by_t, by_kappa)) in by_t.iter_mut().zip(&mut by_kappa).enumerate() {
            let t = first + step * i as f64;
            let over = exp(t) / kappa;
            let share = (a + kappa) * over / (1.0 + over);
            *by_t = a - share;
            *by_kappa = share / kappa - ln(1.0 + over);
        }
        [by_t, by_kappa]
    }
}

/// The slopes of [`law`], p, by ln c, ln gamma and ln (1 / kappa): p times by how much ln of the density grows faster
/// than on average, since the sum of p stays 1.
fn slopes_of_law(freedom: Freedom, at: &DVector<f64>, p: &[f64; STEPS]) -> [[f64; STEPS]; LAW - 1] {
    let (gamma, kappa) = (at[GAMMA].exp(), freedom.kappa(at));
    let first = gamma * (FIRST - BEYOND + 0.5 * STEP - at[SCALE]);
    let [by_t, by_kappa] = slopes_of_ln(freedom.a, kappa, first, gamma * STEP);
    let of_parameter = |k: usize| {
        let of_ln = |i: usize| match k {
            SCALE => -gamma * by_t[i],
            GAMMA => (first + gamma * STEP * i as f64) * by_t[i],
            _ => -kappa * kappa * at[TAIL].exp() * by_kappa[i],
        };
        let of_ln: [f64; STEPS] = std::array::from_fn(of_ln);
        let mean = dot(p, &of_ln);
        std::array::from_fn(|i| p[i] * (of_ln[i] - mean))
    };
    [SCALE, GAMMA, TAIL].map(of_parameter)
}

/// The outermost bins hold what lies beyond them.
fn in_bins(p: &[f64; STEPS]) -> [f64; BINS] {
    let mut bins: [f64; BINS] = std::array::from_fn(|i| p[BEFORE + i]);
    bins[0] += p[..BEFORE].iter().sum::<f64>();
    bins[BINS - 1] += p[BEFORE + BINS..].iter().sum::<f64>();
    bins
}

/// Probabilities of faults of any size in every bin, of the density (s / (s + `evenly`))^(3/2).
static OF_ANY_SIZE: LazyLock<[f64; BINS]> = LazyLock::new(|| {
    let density = |t: f64| 1.5 * t - 1.5 * (t.exp() + tuned::EVENLY).ln();
    let p: [f64; BINS] = std::array::from_fn(|i| density(place(i)).exp());
    let sum: f64 = p.iter().sum();
    p.map(|p| p / sum)
});

struct Components {
    healthy_share: f64,
    healthy: [f64; BINS],
    /// Weights among the faults, which sum to 1, first of faults of any size; and probabilities.
    weights: Vec<f64>,
    faults: Vec<[f64; BINS]>,
}

impl Components {
    /// `law`: of the healthy signals at these parameters ([`law`]).
    fn of(law: &[f64; STEPS], at: &DVector<f64>) -> Components {
        let kinds = at.as_slice()[LAW..].chunks_exact(OF_KIND);
        let mut weights = vec![1.0];
        let mut faults = vec![*OF_ANY_SIZE];
        for kind in kinds {
            weights.push(kind[0].exp());
            faults.push(gaussian(kind[1], kind[2].exp()));
        }
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        let healthy = in_bins(law);
        Components { healthy_share: healthy_share(at[HEALTHY]), healthy, weights, faults }
    }

    fn faulty(&self) -> [f64; BINS] {
        let mut all = [0.0; BINS];
        for (w, p) in self.weights.iter().zip(&self.faults) {
            all.iter_mut().zip(p).for_each(|(all, p)| *all += w * p);
        }
        all
    }

    /// Probabilities of a signal of either kind, at least 1e-300, so that their logarithms are finite.
    fn mixed(&self) -> [f64; BINS] {
        let (h, faulty) = (self.healthy_share, self.faulty());
        std::array::from_fn(|i| (h * self.healthy[i] + (1.0 - h) * faulty[i]).max(1e-300))
    }
}

/// ln likelihood of the counts plus ln density of the priors; 1 / kappa has an exponential one.
fn ln_likelihood(freedom: Freedom, at: &DVector<f64>, counts: &Counts) -> f64 {
    let mixed = Components::of(&law(freedom, at), at).mixed();
    let data = ln_of_counts(&counts.0, &mixed);
    let widths: f64 = at.as_slice()[LAW..]
        .chunks_exact(OF_KIND)
        .map(|kind| 0.5 * ((kind[2] - tuned::WIDTH) / tuned::WIDTH_SD).powi(2))
        .sum();
    data - 0.5 * (at[GAMMA] / tuned::GAMMA_SD).powi(2) - at[TAIL].exp() / tuned::TAIL_MEAN - widths
}

/// Gradient of the penalised ln likelihood, and its expected curvature (Fisher information).
struct Score {
    gradient: DVector<f64>,
    information: DMatrix<f64>,
}

impl Score {
    fn of(freedom: Freedom, at: &DVector<f64>, counts: &Counts) -> Score {
        let law = law(freedom, at);
        let components = Components::of(&law, at);
        let (p, faulty, h) = (components.mixed(), components.faulty(), components.healthy_share);

        let of_law = slopes_of_law(freedom, at, &law);
        let mut slopes: Vec<[f64; BINS]> =
            of_law.iter().map(|of| in_bins(of).map(|slope| h * slope)).collect();
        let of_share = 2.0 * (h - 0.5) * (1.0 - h);
        slopes.push(std::array::from_fn(|i| of_share * (components.healthy[i] - faulty[i])));
        let kinds = at.as_slice()[LAW..].chunks_exact(OF_KIND);
        for ((kind, w), density) in kinds.zip(&components.weights[1..]).zip(&components.faults[1..])
        {
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

        // The curvature of the exponential prior by ln (1 / kappa) equals the gradient's size.
        let mut add_prior = |k: usize, down: f64, weight: f64| {
            gradient[k] -= down;
            information[(k, k)] += weight;
        };
        let gamma = 1.0 / (tuned::GAMMA_SD * tuned::GAMMA_SD);
        add_prior(GAMMA, at[GAMMA] * gamma, gamma);
        add_prior(TAIL, at[TAIL].exp() / tuned::TAIL_MEAN, at[TAIL].exp() / tuned::TAIL_MEAN);
        for k in (LAW + 2..at.len()).step_by(OF_KIND) {
            let weight = 1.0 / (tuned::WIDTH_SD * tuned::WIDTH_SD);
            add_prior(k, (at[k] - tuned::WIDTH) * weight, weight);
        }
        Score { gradient, information }
    }

    fn step(&self, damping: f64) -> Option<DVector<f64>> {
        let regularised = &self.information
            + DMatrix::from_diagonal(&self.information.diagonal()) * damping
            + DMatrix::identity(self.gradient.len(), self.gradient.len()) * 1e-6;
        Some(regularised.try_inverse()? * &self.gradient)
    }
}

fn within(mut at: DVector<f64>) -> DVector<f64> {
    at[SCALE] = at[SCALE].clamp(-6.0, 6.0);
    at[GAMMA] = at[GAMMA].clamp(-0.7, 0.7);
    at[TAIL] = at[TAIL].clamp(-7.0, HEAVIEST);
    at[HEALTHY] = at[HEALTHY].clamp(-5.0, 9.0);
    for kind in at.as_mut_slice()[LAW..].chunks_exact_mut(OF_KIND) {
        kind[0] = kind[0].clamp(-6.0, 6.0);
        kind[1] = kind[1].clamp(tuned::NEAREST, LAST);
        kind[2] = kind[2].clamp(-2.5, -0.4);
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_of_any_size_are_alike_where_they_are_large_and_fade_where_they_are_small() {
        let p = &*OF_ANY_SIZE;
        assert!((p.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        let slopes: Vec<f64> = (1..BINS).map(|i| (p[i] / p[i - 1]).ln() / STEP).collect();
        assert!(slopes.is_sorted_by(|before, after| before >= after));
        // per ln of the statistic: as the volume of three dimensions, then not at all
        assert!(slopes.iter().all(|slope| (0.0..=1.5).contains(slope)));
        assert!(slopes[0] > 1.0 && slopes[BINS - 2] < 0.1, "{} {}", slopes[0], slopes[BINS - 2]);
    }

    #[test]
    fn the_gradient_is_that_of_the_likelihood() {
        let counts = Counts(std::array::from_fn(|i| ((i * 37) % 11) as f64));
        for (degrees, spread) in [(Degrees::Three, Spread::Own), (Degrees::OneSided, Spread::Known)]
        {
            let freedom = Freedom::new(degrees, spread, counts.sum());
            let at = DVector::from_vec(vec![-0.3, 0.2, -1.7, 1.1, 0.3, 4.0, -1.2]);
            let gradient = Score::of(freedom, &at, &counts).gradient;
            for k in 0..at.len() {
                let moved = |by: f64| {
                    let mut at = at.clone();
                    at[k] += by;
                    ln_likelihood(freedom, &at, &counts)
                };
                let slope = (moved(1e-5) - moved(-1e-5)) / 2e-5;
                assert!((gradient[k] - slope).abs() < 1e-4 * (1.0 + slope.abs()), "{k}: {slope}");
            }
        }
    }

    #[test]
    fn what_lies_within_its_ranges_stays_and_what_does_not_comes_to_their_ends() {
        let n = LAW + 2 * OF_KIND;
        let [low, high] = [-1e9, 1e9].map(|far| within(DVector::from_element(n, far)));
        for share in [0.0, 0.3, 1.0] {
            let inside = &low + (&high - &low) * share;
            assert!((within(inside.clone()) - inside).amax() < 1e-12);
        }
        assert!((0..n).all(|k| low[k] < high[k] && high[k] - low[k] < 100.0));
        assert!(within(DVector::zeros(n)).iter().all(|v| v.is_finite()));
    }
}
