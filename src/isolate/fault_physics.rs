//! What is believed of a machine's channels, from which everything said of faults unseen follows.
//!
//! In: a guess of the rates, the measured healthy ring, healthy features, labelled severities where
//! there are any. Out: [`FaultPhysics`]: rates, actuation, how channels differ, and how well the first
//! two are known; from it the curves of the fault classes. thesis (2-2), §2-2.
//!
//! Damping and frequency of the healthy ring fix two combinations of the four rates. The ratios a/b
//! and g/d are the guess's, as far as it is trusted (`isolate.guess_sd`): no healthy signal tells them.
//! Faults do, if their severity is labelled: every such signal is one look at the rates (Gauss-Newton
//! on the features, Student weights against wrong labels).

use super::fault_curve::{
    Bench, CHANGES, FaultCurve, Healthy, Scatter, Slope, of_change, padded, turned,
};
use super::physics_density::{FaultCurves, HealthySpread, SeenSizes};
use crate::model::ring::Ring;
use crate::model::ring_fit::{Features, RingFitter};
use crate::model::{Actuation, InkChannel, faults};
use nalgebra::{DMatrix, Matrix2, Matrix4, SMatrix, SVector, Vector2, Vector4};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

type Square = SMatrix<f64, CHANGES, CHANGES>;

/// What the curves of the design's classes are made of.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FaultPhysics {
    pub channel: InkChannel,
    pub actuation: Actuation,
    /// Covariance of what is believed: ln a, ln b, ln g, ln d, ln pulse.
    pub belief: [[f64; CHANGES]; CHANGES],
    /// The ring that signals are compared with.
    pub ring: Ring,
    /// Of one sample, counts.
    pub noise: f64,
    /// Standard deviations of healthy channels: ln a, ln b, ln g, ln d, ln gain.
    pub spread: [f64; CHANGES],
    /// Severities of the labelled signals of a class.
    pub seen: BTreeMap<String, SeenSizes>,
}

/// A labelled signal of known severity.
#[derive(Clone, Debug)]
pub struct Look {
    pub class: String,
    pub severity: f64,
    /// Of a fit with the phase free.
    pub features: Vector4<f64>,
    pub drive: f64,
    /// ln damping and ln frequency of the healthy ring then, from [`FaultPhysics::ring`]'s.
    pub ring: [f64; 2],
    /// 1, or less where one channel gave many.
    pub weight: f64,
}

/// Sampling of the signals: period in s, samples.
pub type Sampling = (f64, usize);

/// ln pulse is known to this, whatever the guess.
const PULSE_SD: f64 = 0.1;
/// The guess's scale of stiffness and of viscosity is known to a factor only.
const SCALE_SD: f64 = 1.0;
/// ln damping and ln frequency of the healthy ring are known to this.
const RING_SD: f64 = 1e-3;
/// Student's degrees of freedom of a labelled signal's distance from the curve.
const DEGREES: f64 = 8.0;
/// Gauss-Newton steps on the rates.
const ROUNDS: usize = 6;

impl FaultPhysics {
    /// Before any fault was seen. `guess`: rates and actuation; `guess_sd`: of its ratios.
    pub fn new(guess: Healthy, guess_sd: f64, ring: Ring, noise: f64) -> Option<FaultPhysics> {
        let mut physics = FaultPhysics {
            channel: guess.channel,
            actuation: guess.actuation,
            belief: [[0.0; CHANGES]; CHANGES],
            ring,
            noise,
            spread: [0.0; CHANGES],
            seen: BTreeMap::new(),
        };
        let prior = Prior::new(guess, guess_sd)?;
        for _ in 0..2 * ROUNDS {
            physics.step(&prior, Square::zeros(), SVector::zeros())?;
        }
        Some(physics)
    }

    /// Learns how healthy channels differ. `noise`: mean covariance of the features' noise.
    pub fn learn_spread(
        &mut self,
        features: &[Vec<f64>],
        noise: &DMatrix<f64>,
        channels: usize,
        (dt_s, samples): Sampling,
    ) -> Option<()> {
        let fitter = RingFitter::new(self.ring, dt_s, samples);
        let bench = Bench::new(&fitter, self.healthy(), true, self.noise, dt_s, samples)?;
        self.spread = spread_of_channels(bench.healthy_slope(), features, noise, channels)?;
        Some(())
    }

    /// Corrects rates and pulse by signals of known severity; what the physics does not know, or no
    /// fault of that size rings, is left out.
    pub fn learn_rates(
        &mut self,
        guess: Healthy,
        guess_sd: f64,
        looks: &[Look],
        (dt_s, samples): Sampling,
    ) -> Option<()> {
        let prior = Prior::new(guess, guess_sd)?;
        let fitter = RingFitter::new(self.ring, dt_s, samples);
        for _ in 0..ROUNDS {
            let change = self.change()?;
            let mut bench = Bench::new(&fitter, self.healthy(), true, self.noise, dt_s, samples)?;
            let (mut information, mut gradient) = (Square::zeros(), SVector::zeros());
            for look in looks.iter().filter(|look| look.severity.is_finite()) {
                let place = faults::scale(&look.class, look.severity);
                let Some(point) = place.and_then(|at| bench.point(&look.class, at)) else {
                    continue;
                };
                let scatter = point.slope * self.channels() * point.slope.transpose()
                    + point.noise / (look.drive * look.drive);
                let Some(inverse) = scatter.try_inverse() else { continue };
                let changed = change * Vector2::from(look.ring);
                let moved = of_change(&(point.slope - bench.healthy_slope())) * changed;
                let rest = turned(look.features - point.mean - moved);
                let square = rest.dot(&(inverse * rest));
                let weight = look.weight * (DEGREES + 4.0) / (DEGREES + square);
                information += point.off.transpose() * inverse * point.off * weight;
                gradient += point.off.transpose() * inverse * rest * weight;
            }
            self.step(&prior, information, gradient)?;
        }
        Some(())
    }

    /// From ln damping and ln frequency of the healthy ring to ln stiffness and ln viscosity.
    fn change(&self) -> Option<Matrix2<f64>> {
        const STEP: f64 = 1e-3;
        let ring = |stiffer: f64, thicker: f64| -> Option<Vector2<f64>> {
            let InkChannel { a_per_s2, b_per_s2, g_per_s, d_per_s } = self.channel;
            let (k, v) = ((stiffer * STEP).exp(), (thicker * STEP).exp());
            let p = InkChannel {
                a_per_s2: a_per_s2 * k,
                b_per_s2: b_per_s2 * k,
                g_per_s: g_per_s * v,
                d_per_s: d_per_s * v,
            }
            .poles()?;
            Some(Vector2::new(p.damping_per_s.ln(), p.frequency_hz.ln()))
        };
        let slope = |k: f64, v: f64| Some((ring(k, v)? - ring(-k, -v)?) / (2.0 * STEP));
        Matrix2::from_columns(&[slope(1.0, 0.0)?, slope(0.0, 1.0)?]).try_inverse()
    }

    /// One Gauss-Newton step on ln rates and ln pulse: the prior, the healthy ring, the looks.
    fn step(
        &mut self,
        prior: &Prior,
        information: Square,
        gradient: SVector<f64, CHANGES>,
    ) -> Option<()> {
        const MOST: f64 = 0.3;
        let of_ring = |c: &InkChannel| -> Option<[f64; 2]> {
            let p = c.poles()?;
            Some([p.damping_per_s.ln(), p.frequency_hz.ln()])
        };
        let theta = logs(&self.channel, &self.actuation);
        let measured = [self.ring.damping_per_s.ln(), self.ring.frequency_hz.ln()];
        let here = of_ring(&self.channel)?;
        let (mut total, mut slope) = (information + prior.information, gradient);
        slope += prior.information * (prior.mean - theta);
        let mut columns = [SVector::<f64, CHANGES>::zeros(); 2];
        for j in 0..4 {
            let h = 1e-4;
            let moved = |sign: f64| {
                let mut t = theta;
                t[j] += sign * h;
                of_ring(&channel(&t))
            };
            let (up, down) = (moved(1.0)?, moved(-1.0)?);
            for (k, column) in columns.iter_mut().enumerate() {
                column[j] = (up[k] - down[k]) / (2.0 * h);
            }
        }
        for (k, column) in columns.iter().enumerate() {
            total += column * column.transpose() / (RING_SD * RING_SD);
            slope += column * ((measured[k] - here[k]) / (RING_SD * RING_SD));
        }
        let covariance = total.try_inverse()?;
        let step = (covariance * slope).map(|v| v.clamp(-MOST, MOST));
        let theta = theta + step;
        if !theta.iter().all(|v| v.is_finite()) {
            return None;
        }
        of_ring(&channel(&theta))?;
        self.channel = channel(&theta);
        self.actuation.pulse_s = theta[4].exp();
        self.belief = std::array::from_fn(|i| std::array::from_fn(|j| covariance[(i, j)]));
        Some(())
    }

    /// Refused if it could not have been learned.
    pub fn check(&self) -> Result<(), String> {
        let InkChannel { a_per_s2, b_per_s2, g_per_s, d_per_s } = self.channel;
        let Ring { amplitude, damping_per_s, frequency_hz, lambda_per_s, .. } = self.ring;
        let positive = [a_per_s2, b_per_s2, g_per_s, d_per_s, amplitude, damping_per_s]
            .iter()
            .chain([&frequency_hz, &lambda_per_s, &self.noise])
            .all(|v| v.is_finite() && *v > 0.0);
        let finite = [self.ring.phase_rad, self.ring.real_share]
            .iter()
            .chain(self.belief.iter().flatten())
            .all(|v| v.is_finite());
        let spread = self.spread.iter().all(|sd| (0.0..=1.0).contains(sd));
        let Actuation { pulse_s, delay_s } = self.actuation;
        let pulse = (1e-10..=1e-1).contains(&pulse_s) && (0.0..=1e-2).contains(&delay_s);
        let seen =
            self.seen.values().all(|s| s.n >= 0.0 && s.severities.iter().all(|s| s.is_finite()));
        match positive && finite && spread && pulse && seen {
            true => Ok(()),
            false => Err("`physics` could not have been learned; train again".into()),
        }
    }

    fn healthy(&self) -> Healthy {
        Healthy { channel: self.channel, actuation: self.actuation }
    }

    fn channels(&self) -> Square {
        Square::from_diagonal(&SVector::from(self.spread).map(|sd| sd * sd))
    }

    /// Curves of `classes`. `phase`: it is a feature.
    pub fn curves(
        &self,
        classes: &[String],
        phase: bool,
        dt_s: f64,
        samples: usize,
    ) -> FaultCurves {
        let coordinates = if phase { 4 } else { 3 };
        let fitter = RingFitter::new(self.ring, dt_s, samples);
        let bench = Bench::new(&fitter, self.healthy(), phase, self.noise, dt_s, samples);
        let noise = fitter.noise_covariance(&Features::HEALTHY, true, self.noise);
        let healthy = HealthySpread {
            slope: bench.as_ref().map_or(Slope::zeros(), |bench| *bench.healthy_slope()),
            channels: self.channels(),
            noise: noise.map_or(Matrix4::identity(), |noise| padded(&noise)),
            change: self.change().unwrap_or_default(),
        };
        let mut curves = FaultCurves::new(classes.len(), coordinates, healthy);
        let Some(mut bench) = bench else { return curves };
        let belief = Square::from_fn(|i, j| self.belief[i][j]);
        let scatter = Scatter { channels: self.channels(), belief };
        let mut kinds: Vec<(&str, Option<usize>)> = Vec::new();
        for (k, class) in classes.iter().enumerate() {
            let Some(kind) = faults::change(class) else { continue };
            let known = kinds.iter().find(|(of, _)| *of == kind).map(|(_, curve)| *curve);
            let number = known.unwrap_or_else(|| {
                let curve = faults::largest(class)
                    .and_then(|most| FaultCurve::new(&mut bench, class, most, &scatter));
                let number = curve.map(|curve| curves.add(curve));
                kinds.push((kind, number));
                number
            });
            if let Some(number) = number {
                curves.set(k, class, number, self.seen.get(class));
            }
        }
        curves
    }

    /// What a fault of this severity adds to the healthy signal, counts. `None`: it does not ring.
    pub fn deviation(
        &self,
        class: &str,
        severity: f64,
        (dt_s, samples): Sampling,
    ) -> Option<Vec<f64>> {
        let fitter = RingFitter::new(self.ring, dt_s, samples);
        let bench = Bench::new(&fitter, self.healthy(), true, self.noise, dt_s, samples)?;
        let healthy = bench.decay(&self.channel)?;
        let faulty = bench.decay(&faults::apply(class, severity, &self.channel)?)?;
        Some(faulty.iter().zip(&healthy).map(|(f, h)| f - h).collect())
    }
}

/// What is believed before the healthy ring: ln rates and ln pulse.
struct Prior {
    mean: SVector<f64, CHANGES>,
    information: Square,
}

impl Prior {
    fn new(guess: Healthy, guess_sd: f64) -> Option<Prior> {
        let mut covariance = Square::identity() * (guess_sd * guess_sd);
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1), (2, 2), (2, 3), (3, 2), (3, 3)] {
            covariance[(i, j)] += SCALE_SD * SCALE_SD;
        }
        covariance[(4, 4)] = PULSE_SD * PULSE_SD;
        let mean = logs(&guess.channel, &guess.actuation);
        Some(Prior { mean, information: covariance.try_inverse()? })
    }
}

fn logs(channel: &InkChannel, actuation: &Actuation) -> SVector<f64, CHANGES> {
    let InkChannel { a_per_s2, b_per_s2, g_per_s, d_per_s } = *channel;
    SVector::from([a_per_s2, b_per_s2, g_per_s, d_per_s, actuation.pulse_s]).map(f64::ln)
}

fn channel(theta: &SVector<f64, CHANGES>) -> InkChannel {
    InkChannel {
        a_per_s2: theta[0].exp(),
        b_per_s2: theta[1].exp(),
        g_per_s: theta[2].exp(),
        d_per_s: theta[3].exp(),
    }
}

/// ln of the factor within which the spreads of g and d are believed.
const ALIKE: f64 = 0.405;
/// More channels than this do not make a Gaussian of what is none.
const MOST_CHANNELS: usize = 400;

/// How far healthy channels differ in their rates and gain, from how far their features do beyond the
/// noise. `features`: of fits with the phase free. `noise`: their mean noise covariance.
///
/// Three or four features cannot tell five spreads: a and b are taken to spread alike, and g as d
/// unless the features say otherwise (a prior: within a factor of 1.5 of each other). Maximum a
/// posteriori, by a coordinate search.
fn spread_of_channels(
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
        let alike = (ln_sd[1] - ln_sd[2]) / ALIKE;
        // what the features do not show tends to nothing, slowly
        let small: f64 = ln_sd.iter().map(|l| ((l + 5.0) / 3.0).powi(2)).sum();
        0.5 * channels.min(MOST_CHANNELS) as f64 * fit + 0.5 * (alike * alike + small)
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
