//! The bias of an average over channels that differ, and how far they differ.
//!
//! In: a window's signals, and the fit to their average. Out: the scatter of damping and frequency,
//! the sampling error of their means, and the average less the curvature that the scatter leaves in
//! it. The mean of decays with different poles is no decay: at 0.8 % scatter of the frequency the
//! fit to a perfect average has its damping off by 0.6 %.
//!
//! 1. theta = (damping, angular frequency, y, y', y'') of each signal, as a deviation from the
//!    fit's, is estimated by least squares on the tangent space of the fit (N x 5).
//! 2. The covariance of theta over the signals, less what white noise contributes, is how channels
//!    differ.
//! 3. The mean of y over theta is y(theta) + 1/2 sum of second derivatives times covariance: the
//!    second term is the curvature, computed by sigma points.

use super::SignalSet;
use super::averaging::MeanSignal;
use super::cubic::{basis, per_us};
use super::identification::{Identification, Scatter};
use crate::model::inner_product::dot;
use crate::numbers::FEW;
use nalgebra::{DMatrix, DVector, Matrix5, SymmetricEigen, Vector3, Vector5};
use std::collections::BTreeMap;

/// The decay as a function of theta, per µs, near a fit. The real pole is held.
struct Tangent {
    /// Damping, 1/µs, and angular frequency, rad/µs.
    pair: [f64; 2],
    /// 1/µs.
    lambda: f64,
    /// y, y', y'' at t_a, counts, counts/µs, counts/µs².
    state: [f64; 3],
    dt_us: f64,
    samples: usize,
}

impl Tangent {
    fn of(fit: &Identification, dt_s: f64, samples: usize) -> Tangent {
        let poles = fit.poles;
        Tangent {
            pair: [
                poles.damping_per_s * 1e-6,
                2.0 * std::f64::consts::PI * poles.frequency_hz * 1e-6,
            ],
            lambda: poles.lambda_per_s * 1e-6,
            state: per_us(fit.output_state),
            dt_us: dt_s * 1e6,
            samples,
        }
    }

    /// The decay where theta is changed by `step`, N counts.
    fn signal(&self, step: &Vector5<f64>) -> DVector<f64> {
        let (sigma, omega) = (self.pair[0] + step[0], self.pair[1] + step[1]);
        let square = sigma * sigma + omega * omega;
        let lambda = self.lambda;
        // (s + lambda)(s^2 + 2 sigma s + sigma^2 + omega^2)
        let cubic = [2.0 * sigma + lambda, square + 2.0 * sigma * lambda, square * lambda];
        let c = Vector3::from_fn(|k, _| self.state[k] + step[k + 2]);
        basis(cubic, self.dt_us, self.samples) * c
    }

    /// The derivatives of the decay by theta, N x 5, by central differences.
    fn columns(&self) -> DMatrix<f64> {
        let mut columns = DMatrix::zeros(self.samples, 5);
        for k in 0..5 {
            let size = match k {
                0 | 1 => self.pair[k],
                _ => self.state.iter().fold(0.0, |m: f64, v| m.max(v.abs())),
            };
            let h = 1e-5 * size.abs().max(1e-9);
            let step = Vector5::ith(k, h);
            let slope = (self.signal(&step) - self.signal(&-step)) / (2.0 * h);
            columns.set_column(k, &slope);
        }
        columns
    }

    /// What a scatter of theta adds to the mean signal, N counts. `covariance`: of theta times
    /// `scale`, component by component.
    ///
    /// By sigma points: along each principal direction of the covariance 1/2 (y(+) + y(-)) - y is
    /// added up, of the decays one standard deviation to either side. To second order that is half
    /// of the second derivatives times the covariance. A negative variance adds nothing.
    fn curvature(&self, covariance: Matrix5<f64>, scale: &Vector5<f64>) -> DVector<f64> {
        let expected = self.signal(&Vector5::zeros());
        let mut curvature = DVector::zeros(self.samples);
        let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(covariance);
        for (value, direction) in eigenvalues.iter().zip(eigenvectors.column_iter()) {
            if *value > 0.0 {
                let step = (direction * value.sqrt()).component_div(scale);
                curvature += (self.signal(&step) + self.signal(&-step)) / 2.0 - &expected;
            }
        }
        curvature
    }
}

/// The scatter of a set's signals about the fit to their `average`, and the average less the
/// curvature that the scatter leaves in it, N counts. `None`: the tangent space is degenerate.
pub fn scatter(
    set: &SignalSet,
    fit: &Identification,
    average: &MeanSignal,
    dt_s: f64,
) -> Option<(Scatter, Vec<f64>)> {
    // columns scaled to unit length: from here on theta is in these units
    let tangent = Tangent::of(fit, dt_s, set.samples);
    let expected = tangent.signal(&Vector5::zeros());
    let columns = tangent.columns();
    let scale = Vector5::from_fn(|k, _| columns.column(k).norm().max(f64::MIN_POSITIVE));
    let gram =
        Matrix5::from_fn(|i, j| columns.column(i).dot(&columns.column(j)) / (scale[i] * scale[j]));
    let inverse = gram.try_inverse()?;

    // theta of every signal by least squares: its moments, and sums per channel
    let (mut sum, mut square) = (Vector5::zeros(), Matrix5::zeros());
    let (mut of_noise, mut by_channel) = (0.0, BTreeMap::<u32, (Vector5<f64>, f64)>::new());
    let mut deviation = vec![0.0; set.samples];
    for i in 0..set.len() {
        let s = set.drive[i];
        let signal = set.signal(i).iter().zip(expected.iter());
        deviation.iter_mut().zip(signal).for_each(|(d, (&y, e))| *d = f64::from(y) / s - e);
        let along = |k: usize| &columns.as_slice()[k * set.samples..(k + 1) * set.samples];
        let product = Vector5::from_fn(|k, _| dot(along(k), &deviation) / scale[k]);
        let theta = inverse * product;
        sum += theta;
        square += theta * theta.transpose();
        of_noise += (average.noise / s).powi(2);
        let (of_channel, n) = by_channel.entry(set.channel[i]).or_default();
        *of_channel += theta;
        *n += 1.0;
    }

    let n = set.len() as f64;
    let mean = sum / n;
    let beyond_noise = square / n - mean * mean.transpose() - inverse * (of_noise / n);
    let curvature = tangent.curvature(beyond_noise, &scale);

    let relative_sd =
        |k: usize| beyond_noise[(k, k)].max(0.0).sqrt() / (scale[k] * tangent.pair[k].abs());

    // each channel counts as one independent draw, weighted by its number of signals
    let channels = by_channel.len();
    let relative_se = |k: usize| {
        if channels < FEW {
            return 0.0;
        }
        let variance: f64 =
            by_channel.values().map(|(sum, m)| ((sum[k] - m * mean[k]) / n).powi(2)).sum::<f64>()
                * (channels as f64 / (channels as f64 - 1.0));
        variance.sqrt() / (scale[k] * tangent.pair[k].abs())
    };
    let scatter = Scatter {
        damping_sd: relative_sd(0),
        frequency_sd: relative_sd(1),
        damping_se: relative_se(0),
        frequency_se: relative_se(1),
    };
    let straight = average.y.iter().zip(&curvature).map(|(y, c)| y - c).collect();
    Some((scatter, straight))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::burst::Beside;
    use crate::identify::rate_search::tests::{DT_S, decay_of};
    use crate::identify::{GreyBoxSettings, averaging, grey_box};
    use crate::model::InkChannel;
    use rand::{RngExt, SeedableRng};

    /// Half-widths of the uniform distributions by which stiffness and damping scatter, relative.
    const STIFFNESS: f64 = 0.016;
    const DAMPING: f64 = 0.10;

    /// Noise-free signals of `n` channels whose stiffness and damping scatter.
    fn channels(n: usize) -> SignalSet {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let mut set = SignalSet::new(128);
        for i in 0..n {
            let mut draw = |width: f64| 1.0 + width * rng.random_range(-1.0..1.0);
            let (q, r) = (draw(STIFFNESS), draw(DAMPING));
            let channel = InkChannel {
                a_per_s2: 5.6e10 * q,
                b_per_s2: 1.11e11 * q,
                g_per_s: 1.6e4 * r,
                d_per_s: 8.0e4 * r,
            };
            let y: Vec<f32> = decay_of(&channel).iter().map(|&v| v as f32).collect();
            set.push(&y, 1.0, &Beside::alone(i as u32, 0));
        }
        set
    }

    fn fitted(set: &SignalSet, settings: &GreyBoxSettings) -> Identification {
        let mean = averaging::average(set).unwrap();
        grey_box::identify_scattered(set, &mean, DT_S, settings, None).unwrap()
    }

    #[test]
    fn curvature_explains_what_averaging_leaves_and_planted_scatter_comes_back() {
        let set = channels(2000);
        let mean = averaging::average(&set).unwrap();
        let settings = GreyBoxSettings::default();
        let plain = grey_box::identify(&mean.y, DT_S, 1.0, &settings, None).unwrap();
        let corrected = fitted(&set, &settings);
        let truth = crate::identify::cubic::poles_of(InkChannel::NOMINAL.cubic()).unwrap();
        let off =
            |fit: &Identification| (fit.poles.damping_per_s / truth.damping_per_s - 1.0).abs();
        assert!(off(&corrected) < 0.3 * off(&plain), "{} of {}", off(&corrected), off(&plain));
        assert!(off(&corrected) < 0.004, "{}", off(&corrected));
        let lambda = corrected.poles.lambda_per_s / truth.lambda_per_s - 1.0;
        assert!(lambda.abs() < 0.2, "real pole off by {lambda}");
        // the standard deviation of a uniform distribution is its half-width over sqrt 3, and
        // frequency moves by half of the stiffness
        let scatter = corrected.scatter;
        for (found, width) in
            [(scatter.damping_sd, DAMPING), (scatter.frequency_sd, 0.5 * STIFFNESS)]
        {
            assert!((found * 3f64.sqrt() / width - 1.0).abs() < 0.1, "{scatter:?}");
        }
    }

    #[test]
    fn the_plain_mean_is_fitted_as_it_is() {
        let set = channels(200);
        let mean = averaging::average(&set).unwrap();
        let settings = GreyBoxSettings { plain_mean: true, ..GreyBoxSettings::default() };
        let fit = fitted(&set, &settings);
        let plain =
            grey_box::identify(&mean.y, DT_S, mean.standard_error(), &settings, None).unwrap();
        assert_eq!(fit.poles.damping_per_s, plain.poles.damping_per_s);
        let corrected = fitted(&set, &GreyBoxSettings::default());
        assert!(corrected.poles.damping_per_s < fit.poles.damping_per_s, "averaging damps");
    }
}
