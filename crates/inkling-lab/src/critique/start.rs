//! `Model::start`: the first model of a recording, from which all fits descend.
//!
//! In: signals. Out: a [`Model`] with a wide guess of the scatter and no causes, or `None` where nothing
//! rings.
//!
//! The steps: (1) average all signals per unit drive; (2) find the best single ring of this average by a grid
//! over frequency and damping; (3) let each channel descend from that ring to its own; (4) move the mean to the
//! channels' median.

use super::matrices::{Matrix5, Vector5};
use super::model::{Additions, LAMBDA_OVER_SIGMA, Model};
use super::observations::Observations;
use inkling_core::model::free_decay::{FREE, Theta};
use inkling_core::model::median::median_of;
use inkling_core::model::waves::power_at;
use inkling_core::numbers::LITTLE;
use nalgebra::{DMatrix, DVector};

const START_OVER_NOISE: f64 = 300.0;

impl Model {
    pub fn start(data: &Observations) -> Option<Model> {
        let n = data.samples;
        let mut average = vec![0.0; n];
        let mut weight = 0.0;
        for i in 0..data.len() {
            let s = data.beside.drive[i];
            weight += s * s;
            average.iter_mut().zip(data.signal(i)).for_each(|(a, &y)| *a += s * f64::from(y));
        }
        average.iter_mut().for_each(|a| *a /= weight);
        let mut mean = first_guess(&average)?;
        mean[5] = LAMBDA_OVER_SIGMA.ln(); // a model holds ln lambda/sigma, not ln lambda
        let amplitude = mean[2].hypot(mean[3]).max(f64::MIN_POSITIVE);
        // scatter of ln damping, ln frequency, a, b and c, wide enough for channels to move freely
        let sds = Vector5::from([0.5, 0.1, amplitude, amplitude, 0.3 * amplitude]);
        let wide = Matrix5::from_diagonal(&sds.map(|sd| sd * sd));
        let mut model = Model {
            mean,
            between: wide,
            within: wide * 1e-6,
            estimated: false,
            // in proportion to the ring, since the unit of the signals is unknown
            noise_var: (amplitude / START_OVER_NOISE).powi(2),
            added: Additions::none(n),
            units: vec![mean; data.units],
            each: vec![Theta::zeros(); data.len()],
            codes: Vec::new(),
        };

        model.fit_units(data, 12);
        // the median over the channels, which a few channels that differ do not move
        for j in 0..FREE {
            model.mean[j] = median_of(model.units.iter().map(|unit| unit[j]));
        }
        Some(model)
    }
}

/// The best single ring of one signal y (counts), by a grid over frequency and damping. The offset
/// only keeps an offset of the signal from bending the ring. `None`: the ring explains less than a
/// tenth (`little`) of the signal's square about its mean. The last element is ln lambda.
fn first_guess(y: &[f64]) -> Option<Theta> {
    let n = y.len();
    let mut best: Option<(f64, Theta)> = None;
    let most = std::f64::consts::PI * n as f64 * 0.9;
    let yv = DVector::from_column_slice(y);
    let mean = yv.mean();
    let total = yv.map(|v| v - mean).norm_squared();
    if !(total > 0.0 && total.is_finite()) {
        return None;
    }

    // frequencies up to 0.9 of half the sampling rate, of which the twelve with the largest power are tried
    let moved: Vec<f64> = y.iter().map(|v| v - mean).collect();
    let omegas = (0..).map(|k| 2.0 + 0.9 * f64::from(k)).take_while(|omega| *omega < most);
    let power = |omega: f64| (power_at(omega / n as f64, &moved), omega);
    let mut powers: Vec<(f64, f64)> = omegas.map(power).collect();
    powers.sort_by(|p, q| q.0.total_cmp(&p.0));
    for &(_, omega) in powers.iter().take(12) {
        for ln_sigma in [-4.0_f64, -2.5, -1.5, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.2] {
            let sigma = ln_sigma.exp();
            let columns = DMatrix::from_fn(n, 4, |k, j| {
                let t = k as f64 / n as f64;
                match j {
                    0 => (-sigma * t).exp() * (omega * t).cos(),
                    1 => (-sigma * t).exp() * (omega * t).sin(),
                    2 => 1.0,
                    _ => (-LAMBDA_OVER_SIGMA * sigma * t).exp(),
                }
            });
            let gram = columns.tr_mul(&columns) + DMatrix::identity(4, 4) * 1e-6;
            let Some(x) = gram.cholesky().map(|c| c.solve(&columns.tr_mul(&yv))) else { continue };
            let left = (&yv - &columns * &x).norm_squared();
            if best.as_ref().is_none_or(|(cost, _)| left < *cost) && x[0].hypot(x[1]) > 0.0 {
                let lambda = (LAMBDA_OVER_SIGMA * sigma).ln();
                best = Some((left, Theta::from([ln_sigma, omega.ln(), x[0], x[1], x[3], lambda])));
            }
        }
    }
    let (cost, theta) = best?;
    (cost < (1.0 - LITTLE) * total && theta.iter().all(|v| v.is_finite())).then_some(theta)
}
