//! How channels differ, and how a channel's signals differ from burst to burst: estimated with the noise, by EM.
//!
//! In: a model about which signals are linearised. Out: its covariances `between` and `within`, its noise and
//! its mean, moved.

use super::covariates::Covariates;
use super::model::{Linear, Matrix5, Model, Vector5, free_products};
use super::observations::Observations;
use crate::model::free_decay::FREE;

impl Model {
    /// Estimates noise, scatter and mean given the linearisation; `steps` of EM.
    pub fn estimate_scatter(&mut self, data: &Observations, beside: &Covariates, steps: usize) {
        let scale = self.scale();
        let mut linear = Linear::default();
        // per signal: information and score about the unit's parameters, per noise variance 1
        let mut signals: Vec<(usize, Matrix5, Vector5)> = Vec::with_capacity(data.len());
        let mut left = Vec::with_capacity(data.len());
        for i in 0..data.len() {
            self.linearise(i, data, beside, &mut linear);
            let (gram, product) = free_products(&linear, &scale);
            let square: f64 = linear.residual.iter().map(|r| r * r).sum();
            let ridge = gram + Matrix5::identity() * (1e-9 * gram.trace());
            let explained =
                ridge.cholesky().map_or(0.0, |c| product.dot(&c.solve(&product))).min(square);
            left.push((square - explained) / (data.samples - FREE).max(1) as f64);
            let own = self.each[i].fixed_rows::<FREE>(0).component_div(&scale);
            // about the channel, not about the signal's own parameters
            signals.push((data.rows[i].unit, gram, product + gram * own));
        }
        // the mean over all but the noisiest signals
        let mut sorted = left.clone();
        sorted.sort_by(f64::total_cmp);
        let kept = &sorted[..(sorted.len() * 99).div_ceil(100)];
        self.noise_var = (kept.iter().sum::<f64>() / kept.len() as f64).max(1e-300);
        let v = self.noise_var;
        signals.iter_mut().for_each(|(_, gram, product)| {
            *gram /= v;
            *product /= v;
        });
        let repeated = data.len() > data.units;
        let offset: Vec<Vector5> = self
            .units
            .iter()
            .map(|u| (u - self.mean).fixed_rows::<FREE>(0).component_div(&scale))
            .collect();
        let mut mean = Vector5::zeros();
        let mut between = scaled(&self.between, &scale);
        let mut within = scaled(&self.within, &scale);
        if self.within_is_new() {
            (between, within) = self.moments(&signals, &offset, data.units);
        }
        for _ in 0..steps {
            if !repeated {
                within = Matrix5::zeros();
            }
            let (precision_b, precision_w) = (inverse(&between), inverse(&within));
            let mut info = vec![Matrix5::zeros(); data.units];
            let mut score = vec![Vector5::zeros(); data.units];
            let mut each = Vec::with_capacity(signals.len());
            for (unit, gram, product) in &signals {
                let q = product + gram * (offset[*unit] - mean);
                let d = if repeated {
                    (precision_w + gram).try_inverse().unwrap_or_else(Matrix5::zeros)
                } else {
                    Matrix5::zeros()
                };
                info[*unit] += gram - gram * d * gram;
                score[*unit] += q - gram * (d * q);
                each.push((q, d));
            }
            let mut sum_b = Matrix5::zeros();
            let mut sum_w = Matrix5::zeros();
            let mut centre = Vector5::zeros();
            let mut posterior = Vec::with_capacity(data.units);
            for unit in 0..data.units {
                let c = (precision_b + info[unit]).try_inverse().unwrap_or_else(Matrix5::zeros);
                let b = c * score[unit];
                sum_b += b * b.transpose() + c;
                centre += b;
                posterior.push((b, c));
            }
            for ((unit, gram, _), (q, d)) in signals.iter().zip(&each) {
                let (b, c) = posterior[*unit];
                let w = d * (q - gram * b);
                let dg = d * gram;
                sum_w += w * w.transpose() + d + dg * c * dg.transpose();
            }
            let units = data.units as f64;
            centre /= units;
            between = (sum_b / units - centre * centre.transpose())
                * if units > 1.0 { units / (units - 1.0) } else { 1.0 };
            if repeated {
                within = sum_w / signals.len() as f64;
            }
            mean += centre;
        }
        let back = |m: &Matrix5| Matrix5::from_fn(|i, j| m[(i, j)] * scale[i] * scale[j]);
        self.between = back(&floored(&between));
        self.within = if repeated { back(&floored(&within)) } else { Matrix5::zeros() };
        for j in 0..FREE {
            self.mean[j] += mean[j] * scale[j];
        }
    }

    fn within_is_new(&self) -> bool {
        self.within[(1, 1)] == self.between[(1, 1)] * 1e-6
    }

    /// Scatter by moments: where EM starts.
    fn moments(
        &self,
        signals: &[(usize, Matrix5, Vector5)],
        offset: &[Vector5],
        units: usize,
    ) -> (Matrix5, Matrix5) {
        let mut sums = vec![(Vector5::zeros(), 0.0_f64); units];
        let estimates: Vec<(usize, Vector5, Matrix5)> = signals
            .iter()
            .map(|(unit, gram, product)| {
                let ridge = gram + Matrix5::identity() * 1e2;
                let inverse = ridge.try_inverse().unwrap_or_else(Matrix5::zeros);
                (*unit, inverse * product + offset[*unit], inverse)
            })
            .collect();
        for (unit, x, _) in &estimates {
            sums[*unit].0 += x;
            sums[*unit].1 += 1.0;
        }
        let means: Vec<Vector5> = sums.iter().map(|(sum, n)| sum / f64::max(*n, 1.0)).collect();
        let mut within = Matrix5::zeros();
        let mut noise = Matrix5::zeros();
        for (unit, x, covariance) in &estimates {
            let d = x - means[*unit];
            within += d * d.transpose();
            noise += covariance;
        }
        let (count, units) = (estimates.len() as f64, units as f64);
        noise /= count;
        within = within / (count - units).max(1.0) - noise;
        let centre = means.iter().sum::<Vector5>() / units;
        let mut between = Matrix5::zeros();
        for mean in &means {
            let d = mean - centre;
            between += d * d.transpose() / (units - 1.0).max(1.0);
        }
        between -= (noise + within) * (units / count);
        (floored(&between), floored(&within))
    }
}

/// Scatter below this share, squared, is none: it keeps covariances invertible.
const LEAST_SCATTER: f64 = 1e-10;

fn floored(m: &Matrix5) -> Matrix5 {
    let eigen = ((m + m.transpose()) * 0.5).symmetric_eigen();
    let values = eigen.eigenvalues.map(|v| v.max(LEAST_SCATTER));
    eigen.eigenvectors * Matrix5::from_diagonal(&values) * eigen.eigenvectors.transpose()
}

pub fn inverse(m: &Matrix5) -> Matrix5 {
    floored(m).try_inverse().unwrap_or_else(Matrix5::zeros)
}

pub fn scaled(m: &Matrix5, scale: &Vector5) -> Matrix5 {
    Matrix5::from_fn(|i, j| m[(i, j)] / (scale[i] * scale[j]))
}
