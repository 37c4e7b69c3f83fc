//! Whether a signal lies where signals of a class lie: before it is named, not only compared.
//!
//! In: what labelled signals of every class leave beside their rings, and how likely their features are
//! in their own class. Out: bounds that the next signal of the class exceeds rarely. The largest of nine
//! densities is some class's, whatever the signal; a name needs more than that.

use crate::model::inner_product::dot;
use crate::model::student::next_exceeds;
use serde::{Deserialize, Serialize};

/// Share of a class's signals that may lie beyond each of its two bounds.
const MISSED: f64 = 0.0015;

/// Bounds of every class.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Typical {
    /// Directions in which signals of known classes leave more than noise beside their rings; rows of N,
    /// orthonormal.
    pub directions: Vec<Vec<f64>>,
    /// Per class: variance along each, of a ring as large as the healthy one, over the noise's.
    pub spread: Vec<Vec<f64>>,
    /// Per class: most that a signal leaves, over what noise leaves.
    pub misfit: Vec<f64>,
}

/// What one signal leaves beside its ring.
#[derive(Clone, Copy, Debug)]
pub struct Beside<'a> {
    /// N, in units of the noise of a sample.
    pub left: &'a [f64],
    /// Amplitude of its ring over the healthy one's at the reference drive.
    pub size: f64,
}

impl Typical {
    /// Mean square of what is left, over noise's, less what signals of class `k` leave.
    pub fn misfit_of(&self, beside: Beside, k: usize) -> f64 {
        let Beside { left, size } = beside;
        let mut square = dot(left, left);
        for (direction, spread) in self.directions.iter().zip(&self.spread[k]) {
            let (along, spread) = (dot(direction, left), spread * size * size);
            square -= along * along * spread / (1.0 + spread);
        }
        square / left.len() as f64
    }

    /// Refused if it could not have been learned.
    pub fn check(&self, classes: usize, samples: usize) -> Result<(), String> {
        let finite = |v: &[f64]| v.iter().all(|x| x.abs() <= 1e30);
        let whole = self.misfit.len() == classes
            && self.spread.len() == classes
            && self.spread.iter().all(|of| of.len() == self.directions.len())
            && self.spread.iter().flatten().all(|v| (0.0..=1e30).contains(v))
            && self.directions.iter().all(|d| d.len() == samples && finite(d))
            && self.misfit.iter().all(|v| *v > 0.0);
        if whole { Ok(()) } else { Err(format!("`typical` is not of {classes} classes")) }
    }
}

/// Bound on what the next signal of a class leaves, from what some did.
pub fn misfit_bound(left: &[f64]) -> f64 {
    let ln: Vec<f64> = left.iter().map(|v| v.max(f64::MIN_POSITIVE).ln()).collect();
    next_exceeds(&ln, MISSED).exp()
}

/// Bound on the squared distance of the next signal of a class from where it should lie.
pub fn distance_bound(distances: &[f64]) -> f64 {
    let roots: Vec<f64> = distances.iter().map(|d| d.max(0.0).cbrt()).collect();
    next_exceeds(&roots, MISSED).powi(3)
}

/// Least ln density of the next signal of a class, from held-out ones. About half a squared distance
/// below the highest, whose cube root is about Gaussian (Wilson and Hilferty 1931).
pub fn ln_density_bound(held_out: &[f64]) -> f64 {
    let highest = held_out.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let below: Vec<f64> = held_out.iter().map(|v| (highest - v).max(0.0).cbrt()).collect();
    highest - next_exceeds(&below, MISSED).powi(3)
}

/// The directions in which rows hold more than unit noise, largest first, orthonormal; at most `most`.
/// By subspace iteration; what counts lies beyond the largest eigenvalue that noise alone has
/// (sqrt n + sqrt N)² (Marchenko and Pastur 1967), with a fifth to spare.
pub fn directions(rows: &[Vec<f64>], most: usize) -> Vec<Vec<f64>> {
    const ROUNDS: usize = 30;
    let Some(samples) = rows.first().map(Vec::len) else { return Vec::new() };
    let most = most.min(samples).min(rows.len());
    let mut basis: Vec<Vec<f64>> = (0..most)
        .map(|j| (0..samples).map(|k| ((k * (2 * j + 3) + j) as f64 * 0.37).sin()).collect())
        .collect();
    orthonormalise(&mut basis);
    let mut sizes = Vec::new();
    for _ in 0..ROUNDS {
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

/// Gram and Schmidt, twice; what is no direction of its own is dropped.
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
        typical.check(2, 8).unwrap();
        assert!(typical.check(1, 8).is_err());
        let left = along(30.0);
        let of = |k: usize, size: f64| typical.misfit_of(Beside { left: &left, size }, k);
        // 4 of 8 samples of 900 variances: 450 in the mean
        assert!((of(1, 1.0) - 450.0).abs() < 1e-9);
        assert!(of(0, 1.0) < 1e-3, "{}", of(0, 1.0));
        assert!((of(0, 1e-3) - 225.0).abs() < 1e-9, "{}", of(0, 1e-3));
    }
}
