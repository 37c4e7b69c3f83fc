//! Where healthy ends among signals of which nobody says who is faulty.
//!
//! In: detection statistics of a window's signals, up to two in five of them faulty, and the channel
//! each came from. Out: the value that healthy signals exceed at a chosen rate.
//!
//! # What is assumed
//!
//! Statistics are squared distances. Those of healthy signals follow a generalised F law,
//! (s / c)^gamma = F, F of 2a and 2 kappa degrees: chi-squared at gamma = 1, kappa = infinity (Gaussian
//! scatter), lighter tails at gamma > 1 (bounded scatter), power laws at small kappa (Student's t, with
//! 2 kappa degrees). Faulty signals lie evenly in the space of the features near the healthy ones, so
//! that their share grows as s^(1/2) ds, and evenly over orders of magnitude further out. c, gamma,
//! kappa and the share of healthy signals are what makes the window likeliest; so the tail is read from
//! the body where faults hide it, and from itself where they do not. Measured on seven shapes of
//! scatter with 0, 3 and 40 % of faults: docs/open_world.md.
//!
//! Signals of one channel resemble each other: how well the threshold is known comes from leaving out
//! one group of channels after the other (jackknife), and widens it.

use super::DetectError;
use super::threshold::{Method, Threshold};
use crate::model::student::student_quantile;
use nalgebra::{Matrix4, Vector4};

/// Bins of ln (s / median), and where they begin and end.
const STEP: f64 = 0.1;
const FIRST: f64 = -5.0;
const LAST: f64 = 12.0;
/// The law is followed so far on either side.
const BEYOND: f64 = 10.0;
/// Faults lie evenly in space up to so many medians, over orders of magnitude from there on.
const EVENLY: f64 = 20.0;
/// Prior: standard deviation of ln gamma, mean of 1 / kappa.
const GAMMA_SD: f64 = 0.25;
const TAIL_MEAN: f64 = 0.15;
/// Groups of the jackknife.
const GROUPS: usize = 8;
/// Fewer signals say nothing of a law.
const FEWEST: usize = 24;

/// Which kind of statistic: squares of so many features.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Degrees {
    /// Distance along amplitude, damping and frequency.
    Three,
    /// The upper side of one feature's.
    OneSided,
}

impl Degrees {
    fn half(self) -> f64 {
        match self {
            Degrees::Three => 1.5,
            Degrees::OneSided => 0.5,
        }
    }
}

/// ln c, ln gamma, ln (1 / kappa), and the share of healthy signals on a scale without ends.
type Law = Vector4<f64>;

/// The statistic that healthy signals of the window exceed at `rate`, widened so that it is enough with
/// `confidence`. `statistics`: at least 0. `channels`: the channel of each.
pub fn contaminated(
    statistics: &[f64],
    channels: &[u32],
    degrees: Degrees,
    rate: f64,
    confidence: f64,
) -> Result<Threshold, DetectError> {
    if let Some(index) = statistics.iter().position(|s| !(s.is_finite() && *s >= 0.0)) {
        return Err(DetectError::NotAnEnergy { value: statistics[index], index });
    }
    // of a one-sided statistic what lies below is 0, and tells nothing of the tail
    let counted: Vec<(f64, u32)> = statistics
        .iter()
        .zip(channels)
        .filter(|(s, _)| degrees == Degrees::Three || **s > 0.0)
        .map(|(s, c)| (*s, *c))
        .collect();
    if counted.len() < FEWEST {
        let (found, needed) = (counted.len(), FEWEST);
        return Err(DetectError::TooFewSignals { found, needed, method: "window" });
    }
    let median = median(&mut counted.iter().map(|(s, _)| *s).collect::<Vec<_>>());
    if median <= 0.0 {
        return Err(DetectError::NoEnergy { signals: statistics.len() });
    }
    let rate = rate * statistics.len() as f64 / counted.len() as f64;
    let groups = groups(&counted);
    let mut bins = vec![[0.0; GROUPS]; bin_count()];
    for ((s, _), group) in counted.iter().zip(&groups) {
        bins[bin(s / median)][*group] += 1.0;
    }
    let fitter = Fitter::new(degrees.half());
    let all: Vec<f64> = bins.iter().map(|of| of.iter().sum()).collect();
    let law = fitter.fit(&all, None);
    let estimate = fitter.quantile(&law, rate);
    let without: Vec<f64> = (0..GROUPS)
        .filter(|g| bins.iter().any(|of| of[*g] > 0.0))
        .map(|g| {
            let left: Vec<f64> = all.iter().zip(&bins).map(|(all, of)| all - of[g]).collect();
            fitter.quantile(&fitter.fit(&left, Some(law)), rate)
        })
        .collect();
    let n = without.len() as f64;
    let mean = without.iter().sum::<f64>() / n;
    let square: f64 = without.iter().map(|ln| (ln - mean).powi(2)).sum();
    let widening = match without.len() {
        0 | 1 => 0.0,
        _ => student_quantile(confidence, n - 1.0) * ((n - 1.0) / n * square).sqrt(),
    };
    let value = median * (estimate + widening).exp();
    let mut numbers: Vec<u32> = channels.to_vec();
    numbers.sort_unstable();
    numbers.dedup();
    if !value.is_finite() {
        return Err(DetectError::TooFewChannels { channels: numbers.len(), confidence });
    }
    Ok(Threshold {
        value,
        method: Method::Window,
        mu: None,
        false_alarm_rate: Some(rate * counted.len() as f64 / statistics.len() as f64),
        confidence: Some(confidence),
        n_signals: statistics.len(),
        n_channels: numbers.len(),
        n_effective: healthy_share(&law) * statistics.len() as f64,
        n_tail: 0,
        tail_shape: law[2].exp(),
        widened: Some(widening.exp()),
    })
}

/// Channels in turn; of a single channel its signals.
fn groups(counted: &[(f64, u32)]) -> Vec<usize> {
    let mut numbers: Vec<u32> = counted.iter().map(|(_, c)| *c).collect();
    numbers.sort_unstable();
    numbers.dedup();
    match numbers.len() < 2 * GROUPS {
        true => (0..counted.len()).map(|i| i % GROUPS).collect(),
        false => {
            let place = |c: u32| numbers.partition_point(|n| *n < c);
            counted.iter().map(|(_, c)| place(*c) % GROUPS).collect()
        }
    }
}

fn bin_count() -> usize {
    ((LAST - FIRST) / STEP).round() as usize
}

fn bin(ratio: f64) -> usize {
    let place = ((ratio.ln() - FIRST) / STEP).floor();
    place.clamp(0.0, bin_count() as f64 - 1.0) as usize
}

fn healthy_share(law: &Law) -> f64 {
    0.5 + 0.5 / (1.0 + (-law[3]).exp())
}

struct Fitter {
    a: f64,
    /// Probability of every bin for a faulty signal.
    faulty: Vec<f64>,
}

/// Of every bin: its probability for a healthy signal.
impl Fitter {
    fn new(a: f64) -> Fitter {
        let density = |t: f64| 1.5 * t - 1.5 * (t.exp() + EVENLY).ln();
        let mut faulty: Vec<f64> =
            (0..bin_count()).map(|i| density(FIRST + (i as f64 + 0.5) * STEP).exp()).collect();
        let sum: f64 = faulty.iter().sum();
        faulty.iter_mut().for_each(|p| *p /= sum);
        Fitter { a, faulty }
    }

    /// The law's density of ln s at steps from `FIRST - BEYOND` on, times the step.
    fn healthy(&self, law: &Law) -> Vec<f64> {
        let (gamma, kappa) = (law[1].exp(), (-law[2]).exp());
        let steps = ((LAST - FIRST + 2.0 * BEYOND) / STEP).round() as usize;
        let mut p: Vec<f64> = (0..steps)
            .map(|i| {
                let t = gamma * (FIRST - BEYOND + (i as f64 + 0.5) * STEP - law[0]);
                (self.a * t - (self.a + kappa) * (t.exp() / kappa).ln_1p()).exp()
            })
            .collect();
        let sum: f64 = p.iter().sum();
        p.iter_mut().for_each(|p| *p /= sum);
        p
    }

    fn of_bins(&self, law: &Law) -> Vec<f64> {
        let p = self.healthy(law);
        let before = (BEYOND / STEP).round() as usize;
        let mut bins = p[before..before + bin_count()].to_vec();
        bins[0] += p[..before].iter().sum::<f64>();
        *bins.last_mut().unwrap_or(&mut 0.0) += p[before + bin_count()..].iter().sum::<f64>();
        bins
    }

    fn mixed(&self, law: &Law) -> Vec<f64> {
        let h = healthy_share(law);
        let mix = |(p, q): (f64, &f64)| (h * p + (1.0 - h) * q).max(1e-300);
        self.of_bins(law).into_iter().zip(&self.faulty).map(mix).collect()
    }

    /// ln likelihood and prior.
    fn ln(&self, counts: &[f64], law: &Law) -> f64 {
        let data: f64 = counts.iter().zip(self.mixed(law)).map(|(n, p)| n * p.ln()).sum();
        data - 0.5 * (law[1] / GAMMA_SD).powi(2) - law[2].exp() / TAIL_MEAN
    }

    /// The likeliest law, by Fisher scoring with a damped step.
    fn fit(&self, counts: &[f64], near: Option<Law>) -> Law {
        let starts = match near {
            Some(law) => vec![law],
            None => [(-4.0, 3.0), (-1.5, 3.0), (-3.0, -1.0)]
                .map(|(tail, share)| Vector4::new(-0.2, 0.0, tail, share))
                .to_vec(),
        };
        let found = starts.into_iter().map(|start| self.climb(counts, start));
        let best = found.max_by(|p, q| p.1.total_cmp(&q.1));
        best.map_or(Vector4::new(-0.2, 0.0, -4.0, 3.0), |(law, _)| law)
    }

    fn climb(&self, counts: &[f64], start: Law) -> (Law, f64) {
        const ROUNDS: usize = 40;
        let (mut law, mut damping) = (within(start), 1e-3);
        let mut height = self.ln(counts, &law);
        for _ in 0..ROUNDS {
            let (gradient, information) = self.slope(counts, &law);
            let damped = information
                + Matrix4::from_diagonal(&information.diagonal()) * damping
                + Matrix4::identity() * 1e-6;
            let Some(inverse) = damped.try_inverse() else { break };
            let next = within(law + inverse * gradient);
            let there = self.ln(counts, &next);
            if there > height {
                let gained = there - height;
                (law, height, damping) = (next, there, damping * 0.2);
                if gained < 1e-4 {
                    break;
                }
            } else if damping > 1e6 {
                break;
            } else {
                damping *= 10.0;
            }
        }
        (law, height)
    }

    fn slope(&self, counts: &[f64], law: &Law) -> (Vector4<f64>, Matrix4<f64>) {
        const H: f64 = 1e-4;
        let p = self.mixed(law);
        let slopes: [Vec<f64>; 4] = std::array::from_fn(|k| {
            let mut step = Vector4::zeros();
            step[k] = H;
            let (up, down) = (self.mixed(&(law + step)), self.mixed(&(law - step)));
            up.iter().zip(down).map(|(u, d)| (u - d) / (2.0 * H)).collect()
        });
        let n: f64 = counts.iter().sum();
        let mut gradient = Vector4::from_fn(|k, _| {
            (0..p.len()).map(|i| counts[i] * slopes[k][i] / p[i]).sum::<f64>()
        });
        let mut information = Matrix4::from_fn(|j, k| {
            n * (0..p.len()).map(|i| slopes[j][i] * slopes[k][i] / p[i]).sum::<f64>()
        });
        gradient[1] -= law[1] / (GAMMA_SD * GAMMA_SD);
        information[(1, 1)] += 1.0 / (GAMMA_SD * GAMMA_SD);
        gradient[2] -= law[2].exp() / TAIL_MEAN;
        information[(2, 2)] += law[2].exp() / TAIL_MEAN;
        (gradient, information)
    }

    /// ln (s / median) that healthy signals exceed at a rate.
    fn quantile(&self, law: &Law, rate: f64) -> f64 {
        let p = self.healthy(law);
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
}

/// Laws that are possible at all.
fn within(law: Law) -> Law {
    Vector4::new(
        law[0].clamp(-6.0, 6.0),
        law[1].clamp(-0.7, 0.7),
        law[2].clamp(-7.0, 0.7),
        law[3].clamp(-5.0, 9.0),
    )
}

fn median(values: &mut [f64]) -> f64 {
    let mid = values.len() / 2;
    *values.select_nth_unstable_by(mid, f64::total_cmp).1
}
