//! How bad a named fault is.
//!
//! In: the features of a signal's fitted ring, the class that was named. Out: the mean and the
//! standard deviation of the severity's posterior, from the physics of that kind of fault
//! ([`super::fault_curve`]): every severity from none to the largest is as likely beforehand, whatever
//! the class's name says of size. thesis §2-2, chapter 5 (fault estimation).

use super::fault_curve::{Bench, CHANGES, FaultCurve, Healthy, Slope, padded};
use crate::model::ring::Ring;
use crate::model::ring_fit::RingFitter;
use crate::model::{Actuation, InkChannel, faults};
use nalgebra::{DMatrix, Matrix4, SMatrix, Vector4};
use serde::{Deserialize, Serialize};

/// A severity in the contract's unit, with its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Severity {
    pub value: f64,
    pub sd: f64,
}

/// What the curves of the design's classes are made of.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FaultPhysics {
    pub channel: InkChannel,
    pub actuation: Actuation,
    /// The ring that signals are compared with.
    pub ring: Ring,
    /// Of one sample, counts.
    pub noise: f64,
    /// Standard deviations of healthy channels: ln a, ln b, ln g, ln d, ln gain.
    pub spread: [f64; CHANGES],
}

/// Curves of the design's classes.
#[derive(Clone, Debug)]
pub struct Severities {
    /// Per class its kind's curve; `None`: a user's own class, or a kind that does not ring.
    curve_of: Vec<Option<usize>>,
    curves: Vec<FaultCurve>,
    coordinates: usize,
}

impl FaultPhysics {
    /// Refused if it could not have been learned.
    pub fn check(&self) -> Result<(), String> {
        let InkChannel { a_per_s2, b_per_s2, g_per_s, d_per_s } = self.channel;
        let Ring { amplitude, damping_per_s, frequency_hz, lambda_per_s, .. } = self.ring;
        let positive =
            [a_per_s2, b_per_s2, g_per_s, d_per_s, amplitude, damping_per_s, frequency_hz]
                .iter()
                .chain([&lambda_per_s, &self.noise])
                .all(|v| v.is_finite() && *v > 0.0);
        let finite = [self.ring.phase_rad, self.ring.real_share].iter().all(|v| v.is_finite());
        let spread = self.spread.iter().all(|sd| (0.0..=1.0).contains(sd));
        let Actuation { pulse_s, delay_s } = self.actuation;
        let pulse = (1e-9..=1e-2).contains(&pulse_s) && (0.0..=1e-2).contains(&delay_s);
        match positive && finite && spread && pulse {
            true => Ok(()),
            false => Err("`physics` could not have been learned; train again".into()),
        }
    }

    fn healthy(&self) -> Healthy {
        Healthy { channel: self.channel, actuation: self.actuation }
    }

    fn covariance(&self) -> SMatrix<f64, CHANGES, CHANGES> {
        SMatrix::from_diagonal(&SMatrix::<f64, CHANGES, 1>::from(self.spread).map(|sd| sd * sd))
    }

    /// Curves of `classes`. `phase`: it is a feature.
    pub fn curves(&self, classes: &[String], phase: bool, dt_s: f64, samples: usize) -> Severities {
        let coordinates = if phase { 4 } else { 3 };
        let mut severities =
            Severities { curve_of: vec![None; classes.len()], curves: Vec::new(), coordinates };
        let fitter = RingFitter::new(self.ring, dt_s, samples);
        let bench = Bench::new(&fitter, self.healthy(), phase, self.noise, dt_s, samples);
        let Some(mut bench) = bench else { return severities };
        let mut kinds: Vec<(&str, Option<usize>)> = Vec::new();
        for (class, curve_of) in classes.iter().zip(&mut severities.curve_of) {
            let Some(kind) = faults::change(class) else { continue };
            if let Some((_, known)) = kinds.iter().find(|(k, _)| *k == kind) {
                *curve_of = *known;
                continue;
            }
            let curve = faults::largest(class)
                .and_then(|most| FaultCurve::new(&mut bench, class, most, &self.covariance()));
            if let Some(curve) = curve {
                *curve_of = Some(severities.curves.len());
                severities.curves.push(curve);
            }
            kinds.push((kind, *curve_of));
        }
        severities
    }
}

impl Severities {
    /// Of a fault of `class` with these features, at a drive. `None`: the physics knows no such
    /// class.
    pub fn estimate(&self, class: usize, features: &[f64], drive: f64) -> Option<Severity> {
        let curve = &self.curves[(*self.curve_of.get(class)?)?];
        let mut x = Vector4::zeros();
        x.iter_mut().zip(&features[..self.coordinates]).for_each(|(x, f)| *x = *f);
        let (mut most, mut sum, mut first, mut second) = (f64::NEG_INFINITY, 0.0, 0.0, 0.0);
        for node in &curve.nodes {
            let ln = node.ln_density(&x, drive) + node.length.ln();
            if ln > most {
                // scale what was summed to the new largest
                let factor = (most - ln).exp();
                (sum, first, second) = (sum * factor, first * factor, second * factor);
                most = ln;
            }
            if ln > most - 40.0 {
                let w = (ln - most).exp();
                sum += w;
                first += w * node.severity;
                second += w * node.severity * node.severity;
            }
        }
        let value = first / sum;
        let variance = (second / sum - value * value).max(0.0);
        value.is_finite().then_some(Severity { value, sd: variance.sqrt() })
    }
}

/// How far healthy channels differ in their rates and gain, from how far their features do beyond the
/// noise. `features`: of fits with the phase free. `noise`: their mean noise covariance.
///
/// Three or four features cannot tell five spreads: a and b are taken to spread alike, and g as d
/// unless the features say otherwise (a prior: within a factor of two of each other). Maximum a
/// posteriori, by a coordinate search.
pub fn spread_of_channels(
    slope: &Slope,
    features: &[Vec<f64>],
    noise: &DMatrix<f64>,
    channels: usize,
) -> Option<[f64; CHANGES]> {
    let n = features.len() as f64;
    if features.len() < 16 || noise.nrows() != 4 {
        return None;
    }
    let rows = || features.iter().map(|x| Vector4::from_fn(|k, _| x[k]));
    let mean = rows().sum::<Vector4<f64>>() / n;
    let sample =
        rows().map(|x| (x - mean) * (x - mean).transpose()).sum::<Matrix4<f64>>() / (n - 1.0);
    let noise = padded(noise);
    // ln of the standard deviations of (a and b, g, d, gain) and of what else turns the phase
    let cost = |ln_sd: &[f64; 5]| -> f64 {
        let v = ln_sd.map(|l| (2.0 * l).exp());
        let rates = SMatrix::<f64, CHANGES, 1>::from([v[0], v[0], v[1], v[2], v[3]]);
        let mut model = slope * SMatrix::from_diagonal(&rates) * slope.transpose() + noise;
        model[(3, 3)] += v[4];
        let Some(cholesky) = model.cholesky() else { return f64::INFINITY };
        let fit = cholesky.determinant().ln() + (cholesky.inverse() * sample).trace();
        let alike = (ln_sd[1] - ln_sd[2]) / std::f64::consts::LN_2;
        // what the features do not show tends to nothing, slowly
        let small: f64 = ln_sd.iter().map(|l| ((l + 5.0) / 3.0).powi(2)).sum();
        0.5 * channels as f64 * fit + 0.5 * (alike * alike + small)
    };
    let mut best = [-5.0; 5];
    let mut least = cost(&best);
    let mut step = 1.0;
    while step > 1e-3 {
        let before = least;
        for k in 0..best.len() {
            for sign in [-1.0, 1.0] {
                let mut trial = best;
                trial[k] = (trial[k] + sign * step).clamp(-12.0, 0.0);
                let c = cost(&trial);
                if c < least {
                    (best, least) = (trial, c);
                }
            }
        }
        if before - least < 1e-6 {
            step /= 2.0;
        }
    }
    let sd = best.map(f64::exp);
    least.is_finite().then_some([sd[0], sd[0], sd[1], sd[2], sd[3]])
}
