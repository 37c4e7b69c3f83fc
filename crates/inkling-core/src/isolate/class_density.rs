//! How the features of one fault class are spread: a density that can be learned from few examples.
//!
//! In: features of labelled signals, and the covariance of the fit's noise at the class. Out: a
//! [`ClassDensity`], which gives the ln density of any features x. It is a product of one-dimensional
//! densities along axes u = B (x - mean), in each of which the noise has unit variance. How it is learned:
//!
//! 1. Mean and covariance of the examples, shrunk towards that of all classes as by one example.
//! 2. Of two choices of B the likelier is kept (of few examples the better by Schwarz's criterion):
//!    the axes that make the noise white and the class's covariance diagonal; and the features, each
//!    over the noise's standard deviation.
//! 3. Along each axis the density is a Gaussian, or (as faults come in severities over a range)
//!    uniform over a range convolved with the noise: uniform in the feature, or in its exponential.
//! 4. Both are widened, since the next signal is less well known than the examples: the Gaussian by
//!    its predictive variance, the range by how far its ends lie beyond the outermost examples.

use super::tuned;
use crate::model::normal::upper_tail;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use serde::{Deserialize, Serialize};
use std::sync::OnceLock;

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Axis {
    /// Standard deviation of a Gaussian about 0, noise included, in units of the noise's.
    Gaussian(f64),
    Range(Range),
}

/// Density proportional to e^(slope v) for |v| < half_width, and 0 elsewhere, before it is
/// convolved with the noise; v in standard deviations of the noise. With slope 0 it is uniform in
/// the feature, with the slope that makes e^(slope v) the exponential of the feature in that.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Range {
    half_width: f64,
    slope: f64,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ClassDensity {
    /// The features at u = 0: the middle of ranges, the examples' mean along Gaussian axes.
    mean: Vec<f64>,
    /// Rows of B.
    to_axes: Vec<Vec<f64>>,
    ln_determinant: f64,
    axes: Vec<Axis>,
    /// ln of what does not depend on the features; computed once.
    #[serde(skip)]
    ln_scale: OnceLock<f64>,
}

impl ClassDensity {
    /// `features`: per signal, four numbers at most; `noise`: covariance of a fit's noise;
    /// `pooled`: within-class covariance of all classes; `tell_ends`: whether an axis may be a
    /// range. `None`: too few examples, or `noise` is not positive definite.
    pub fn learn(
        features: &[DVector<f64>],
        noise: &DMatrix<f64>,
        pooled: Option<&DMatrix<f64>>,
        tell_ends: bool,
    ) -> Option<ClassDensity> {
        let n = features.len() as f64;
        let size = features.first()?.len();
        let (mean, scatter) = mean_and_scatter(features, DMatrix::zeros(size, size));
        let (freedom, scatter) = match pooled {
            Some(pooled) => (n - 1.0 + tuned::ONE_EXAMPLE, scatter + pooled * tuned::ONE_EXAMPLE),
            None if n > 1.0 => (n - 1.0, scatter),
            None => return None,
        };
        let covariance = scatter / freedom;

        // Predictive over estimated variance: the mean is uncertain (1 + 1/n), and so is the
        // variance (Student's t with nu degrees of freedom has variance nu / (nu - 2)).
        let wider = (1.0 + 1.0 / n) * freedom / (freedom - 2.0).max(0.5);

        // with noise = L L^T, the eigenvectors of the covariance whitened by L
        let inverse = noise.clone().cholesky()?.l().try_inverse()?;
        let spread = &inverse * &covariance * inverse.transpose();
        let SymmetricEigen { eigenvectors, .. } = SymmetricEigen::new(spread);
        let apart = DMatrix::from_diagonal(&noise.diagonal().map(|v| 1.0 / v.sqrt()));

        // turned axes are one more number per pair of features (Schwarz, 1978); many examples tell
        let turns = if tell_ends { 0.0 } else { 0.25 * (size * (size - 1)) as f64 * n.ln() };
        [(eigenvectors.transpose() * inverse, turns), (apart, 0.0)]
            .into_iter()
            .filter_map(|(to_axes, price)| {
                let of = (&covariance, wider);
                let (p, density) = density_along(to_axes, &mean, of, features, tell_ends)?;
                Some((p - price, density))
            })
            .max_by(|(p, _), (q, _)| p.total_cmp(q))
            .map(|(_, density)| density)
    }

    pub fn ln_density(&self, x: &[f64]) -> f64 {
        let scale = || self.ln_determinant + self.axes.iter().map(|a| a.ln_scale()).sum::<f64>();
        let axes = self.axes.iter().zip(&self.to_axes);
        let along: f64 = axes.map(|(axis, row)| axis.ln_shape(self.along(row, x))).sum();
        self.ln_scale.get_or_init(scale) + along
    }

    fn along(&self, row: &[f64], x: &[f64]) -> f64 {
        row.iter().zip(x.iter().zip(&self.mean)).map(|(b, (x, m))| b * (x - m)).sum()
    }
}

/// The mean of feature vectors, and `before` plus the outer squares of their deviations from it.
pub(super) fn mean_and_scatter(
    features: &[DVector<f64>],
    before: DMatrix<f64>,
) -> (DVector<f64>, DMatrix<f64>) {
    let size = before.nrows();
    let mean = features.iter().fold(DVector::zeros(size), |s, x| s + x) / features.len() as f64;
    let scatter = features.iter().fold(before, |s, x| {
        let d = x - &mean;
        s + &d * d.transpose()
    });
    (mean, scatter)
}

/// The density along the axes `to_axes` (B), and its ln likelihood for the examples. `covariance`:
/// of these, shrunk; `wider`: predictive over estimated variance. `None`: the axes are dependent.
fn density_along(
    to_axes: DMatrix<f64>,
    mean: &DVector<f64>,
    (covariance, wider): (&DMatrix<f64>, f64),
    features: &[DVector<f64>],
    tell_ends: bool,
) -> Option<(f64, ClassDensity)> {
    let ln_determinant = to_axes.determinant().abs().ln();
    if !ln_determinant.is_finite() {
        return None;
    }
    let n = features.len() as f64;
    let spread = &to_axes * covariance * to_axes.transpose();
    let mut likelihood = n * ln_determinant;
    let mut centre = DVector::zeros(mean.len());
    let mut axes = Vec::with_capacity(mean.len());
    for j in 0..mean.len() {
        let row = to_axes.row(j);
        // their variance is taken for no less than a quarter of the noise's
        let u: Vec<f64> = features.iter().map(|x| (row * (x - mean))[0]).collect();
        let variance = spread[(j, j)].max(0.25);

        // compared is the examples' own likelihood; kept is the predictive Gaussian
        let of_gaussian = Axis::Gaussian(variance.sqrt()).ln_likelihood(&u, 0.0);
        let gaussian = Axis::Gaussian((wider * variance).sqrt());

        // the search for a range starts at the half width w of a uniform density of variance w² / 3
        let width = (3.0 * (variance - 1.0).max(0.0) * (1.0 + 1.0 / n)).sqrt();
        // where the axis is a single log feature, the density may be uniform in its exponential
        let mut others = (0..row.len()).filter(|&k| k != j).map(|k| row[k]);
        let is_logarithm = j < LOGARITHMS && others.all(|b| b == 0.0);
        let slopes = [Some(0.0), is_logarithm.then_some(1.0 / row[j])];
        let slopes = slopes.into_iter().flatten().filter(|_| width >= 0.05 && tell_ends);
        let ranges = slopes.map(|slope| likeliest_range(&u, width, slope));

        let range = ranges.max_by(|p, q| p.0.total_cmp(&q.0)).filter(|range| range.0 > of_gaussian);
        let (of_axis, middle, axis) = range.unwrap_or((of_gaussian, 0.0, gaussian));
        likelihood += of_axis;
        centre[j] = middle;
        axes.push(axis);
    }
    let mean = mean + to_axes.clone().try_inverse()? * centre;
    let density = ClassDensity {
        mean: mean.as_slice().to_vec(),
        to_axes: to_axes.row_iter().map(|r| r.iter().copied().collect()).collect(),
        ln_determinant,
        axes,
        ln_scale: OnceLock::new(),
    };
    Some((likelihood, density))
}

/// Smallest half width of a range, in standard deviations of the noise.
const NARROWEST: f64 = 0.02;
/// The first three features are logarithms: of amplitude, damping and frequency.
const LOGARITHMS: usize = 3;

/// The likeliest range of a given slope for examples `u` along an axis, widened since its true ends
/// lie outside the outermost ones: ln likelihood, middle, range. `half_width`: to start from.
fn likeliest_range(u: &[f64], half_width: f64, slope: f64) -> (f64, f64, Axis) {
    let likelihood =
        |half_width, middle| Axis::Range(Range { half_width, slope }).ln_likelihood(u, middle);
    let mut best = (likelihood(half_width, 0.0), 0.0, half_width);
    // Pattern search over middle and half width, as the likelihood is smooth with a single maximum.
    let mut step = 0.2 * half_width;
    let ways = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1)];
    for _ in 0..60 {
        let better = ways.iter().find_map(|&(along, out)| {
            let middle = best.1 + f64::from(along) * step;
            let width = best.2 + f64::from(out) * step;
            if width < NARROWEST {
                return None;
            }
            let likelihood = likelihood(width, middle);
            (likelihood > best.0 + 1e-9).then_some((likelihood, middle, width))
        });
        match better {
            Some(better) => best = better,
            None => step /= 2.0,
        }
        if step < 0.01 {
            break;
        }
    }

    // A true end lies 2 w / n beyond the outermost of n examples on average, and with probability
    // e^-3 three times as far.
    let n = u.len() as f64;
    let half_width = best.2 * (1.0 + 6.0 / (n - 1.0));
    (best.0, best.1, Axis::Range(Range { half_width, slope }))
}

impl Range {
    /// ln of the integral of e^(slope v) over the range, 2 sinh(t) / slope with t = slope
    /// half_width, in a form that neither overflows nor cancels.
    fn ln_mass(self) -> f64 {
        let (ln_width, t) = ((2.0 * self.half_width).ln(), (self.slope * self.half_width).abs());
        if t < 1e-6 { ln_width } else { ln_width + t + ((1.0 - (-2.0 * t).exp()) / (2.0 * t)).ln() }
    }

    /// The integral of e^(slope v) phi(u - v) over the range is e^[`Range::ln_tilt`] times the
    /// probability that a unit Gaussian about u + slope lies in the range: its ends relative to
    /// that mean, the near one first.
    fn ends(self, u: f64) -> [f64; 2] {
        let off = (u + self.slope).abs();
        [off - self.half_width, off + self.half_width]
    }

    fn ln_tilt(self, u: f64) -> f64 {
        self.slope * (u + 0.5 * self.slope)
    }
}

impl Axis {
    fn ln_likelihood(self, u: &[f64], middle: f64) -> f64 {
        let shapes: f64 = u.iter().map(|u| self.ln_shape(u - middle)).sum();
        u.len() as f64 * self.ln_scale() + shapes
    }

    /// ln of the density over e^[`Axis::ln_scale`].
    fn ln_shape(self, u: f64) -> f64 {
        match self {
            Axis::Gaussian(sd) => -0.5 * (u / sd).powi(2),
            Axis::Range(range) => {
                let [beyond, far] = range.ends(u);
                // so far inside, both tails are nothing beside 1, and most examples lie there
                if beyond < -9.0 {
                    return range.ln_tilt(u);
                }
                let mass = (upper_tail(beyond) - upper_tail(far)).max(0.0);
                let ln_mass = match mass > 1e-280 {
                    true => mass.ln(),
                    false => -0.5 * beyond * beyond - (beyond * SQRT_TAU).ln(),
                };
                range.ln_tilt(u) + ln_mass
            }
        }
    }

    fn ln_scale(self) -> f64 {
        match self {
            Axis::Gaussian(sd) => -(sd * SQRT_TAU).ln(),
            Axis::Range(range) => -range.ln_mass(),
        }
    }
}

const SQRT_TAU: f64 = 2.506_628_274_631_000_7;

#[cfg(test)]
mod tests;
