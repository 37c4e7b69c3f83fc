//! Whether the misfit that a signal leaves beside its ring is usual in a class: a signal with a
//! larger misfit is no ring of the class and does not get its name.
//!
//! In: the misfits of labelled signals of every class beside their rings (N, in standard deviations
//! of the noise). Out: [`Typical`], which a design stores: a few principal directions of these
//! misfits, how much each class scatters along each of them, and per class a bound.
//!
//! Faults leave misfits of particular shapes, which grow with the ring. Along the directions the
//! variance of a class's misfit is 1 + spread in units of the noise's, elsewhere 1. With that
//! covariance the squared Mahalanobis distance per sample is about 1 for a signal of the class
//! ([`Typical::misfit_of`]).

use crate::model::inner_product::dot;
use crate::model::student::next_exceeds;
use crate::numbers::LEAST_RATE;
use serde::{Deserialize, Serialize};

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Typical {
    /// Principal directions of the misfits of all classes together; rows of N, orthonormal.
    pub directions: Vec<Vec<f64>>,
    /// Per class the variance of the misfit along each direction beyond the noise's, in units of
    /// the noise's, for a ring of the healthy amplitude: classes x directions.
    pub spread: Vec<Vec<f64>>,
    /// Per class the largest usual value of [`Typical::misfit_of`].
    pub misfit: Vec<f64>,
}

impl Typical {
    /// Mean square of a misfit (N, in standard deviations of a sample's noise), in which what is
    /// usual in class `k` counts less. `size`: amplitude of the ring over the healthy one at the
    /// reference drive, each in units of its own noise; the usual misfit is proportional to it.
    pub fn misfit_of(&self, misfit: &[f64], size: f64, k: usize) -> f64 {
        let mut square = dot(misfit, misfit);
        for (direction, spread) in self.directions.iter().zip(&self.spread[k]) {
            // along² / (1 + spread) for along²: a rank-one update of the inverse covariance
            let (along, spread) = (dot(direction, misfit), spread * size * size);
            square -= along * along * spread / (1.0 + spread);
        }
        square / misfit.len() as f64
    }
}

/// Upper bound on [`Typical::misfit_of`] of a further signal of a class, exceeded with probability
/// `least_rate`. `misfits`: of some signals, taken for lognormal; infinity if fewer than two.
pub fn misfit_bound(misfits: &[f64]) -> f64 {
    let ln: Vec<f64> = misfits.iter().map(|v| v.max(f64::MIN_POSITIVE).ln()).collect();
    next_exceeds(&ln, LEAST_RATE).exp()
}

/// Principal directions of `rows` that exceed unit noise, largest variance first, orthonormal; at
/// most `most`: eigenvectors of rows' rows by subspace iteration. Kept are those whose eigenvalue
/// exceeds by a fifth the largest that noise alone would have, (sqrt n + sqrt N)² for n rows of N
/// (Marchenko and Pastur 1967).
pub fn directions(rows: &[Vec<f64>], most: usize) -> Vec<Vec<f64>> {
    const ROUNDS: usize = 30;
    let Some(samples) = rows.first().map(Vec::len) else { return Vec::new() };
    let most = most.min(samples).min(rows.len());
    // start vectors of no particular shape, the same in every run
    let mut basis: Vec<Vec<f64>> = (0..most)
        .map(|j| (0..samples).map(|k| ((k * (2 * j + 3) + j) as f64 * 0.37).sin()).collect())
        .collect();
    orthonormalise(&mut basis);
    let mut sizes = Vec::new();
    for _ in 0..ROUNDS {
        // times rows^T rows; the lengths after the product converge to the eigenvalues
        let mut next = vec![vec![0.0; samples]; basis.len()];
        for row in rows {
            for (next, direction) in next.iter_mut().zip(&basis) {
                let along = dot(row, direction);
                next.iter_mut().zip(row).for_each(|(n, v)| *n += along * v);
            }
        }
        sizes = next.iter().map(|n| dot(n, n).sqrt()).collect();
        orthonormalise(&mut next);
        basis = next;
    }
    let edge = 1.2 * ((rows.len() as f64).sqrt() + (samples as f64).sqrt()).powi(2);
    basis.into_iter().zip(sizes).filter(|(_, size)| *size > edge).map(|(d, _)| d).collect()
}

/// Makes vectors orthonormal by Gram-Schmidt, twice for accuracy; dependent ones are dropped.
fn orthonormalise(basis: &mut Vec<Vec<f64>>) {
    let mut done: Vec<Vec<f64>> = Vec::with_capacity(basis.len());
    for mut v in basis.drain(..) {
        let before = dot(&v, &v).sqrt();
        for _ in 0..2 {
            for d in &done {
                let along = dot(d, &v);
                v.iter_mut().zip(d).for_each(|(v, d)| *v -= along * d);
            }
        }
        let norm = dot(&v, &v).sqrt();
        if norm > 1e-9 * before && norm > 0.0 {
            v.iter_mut().for_each(|x| *x /= norm);
            done.push(v);
        }
    }
    *basis = done;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_class_leaves_is_forgiven_of_that_class_alone_and_grows_with_the_ring() {
        let along =
            |sd: f64| -> Vec<f64> { (0..8).map(|k| if k < 4 { sd } else { 0.0 }).collect() };
        let typical = Typical {
            directions: vec![along(0.5)],
            spread: vec![vec![1e6], vec![0.0]],
            misfit: vec![1.0; 2],
        };
        let left = along(30.0);
        let of = |k: usize, size: f64| typical.misfit_of(&left, size, k);
        // 4 of 8 samples of 900 variances: 450 in the mean
        assert!((of(1, 1.0) - 450.0).abs() < 1e-9);
        assert!(of(0, 1.0) < 1e-3, "{}", of(0, 1.0));
        assert!((of(0, 1e-3) - 225.0).abs() < 1e-9, "{}", of(0, 1e-3));
    }

    #[test]
    fn directions_are_those_that_stand_out_of_the_noise_the_widest_first() {
        let mut normal = crate::model::normal::draws(5);
        let (n, samples) = (300, 24);
        let wave = |k: usize, turns: usize| {
            let angle = std::f64::consts::TAU * (turns * k) as f64 / samples as f64;
            angle.sin() * (2.0 / samples as f64).sqrt()
        };
        let mut rows = |sds: [f64; 2]| -> Vec<Vec<f64>> {
            let mut row = || -> Vec<f64> {
                let sizes = sds.map(|sd| sd * normal());
                let of = |k| sizes[0] * wave(k, 2) + sizes[1] * wave(k, 3) + normal();
                (0..samples).map(of).collect()
            };
            (0..n).map(|_| row()).collect()
        };
        let found = directions(&rows([5.0, 10.0]), 6);
        assert_eq!(found.len(), 2);
        for (direction, turns) in found.iter().zip([3, 2]) {
            let truth: Vec<f64> = (0..samples).map(|k| wave(k, turns)).collect();
            let along = dot(direction, &truth).abs();
            assert!(along > 0.98 && (dot(direction, direction) - 1.0).abs() < 1e-9, "{along}");
        }
        assert!(dot(&found[0], &found[1]).abs() < 1e-9);
        assert_eq!(directions(&rows([5.0, 10.0]), 1).len(), 1, "no more than asked for");
        assert!(directions(&rows([0.0; 2]), 6).is_empty(), "noise alone has none");
        assert!(directions(&[], 6).is_empty());
    }
}
