//! Disturbances of known shape (an offset, a drift), which are kept out of the residual
//! (`detect.decouple`). thesis (2-1), d.
//!
//! In: the disturbances, and the sensitivities T of the model's ring. Out: [`KnownShapes`], a
//! linear map that is applied to every deviation before the FD filter.
//!
//! A deviation d is fitted by least squares with the shapes D and the sensitivities T together, and
//! becomes d - D G d with the rows G of the solution that belong to D. So a disturbance vanishes
//! whatever its size, and a change of the ring is not taken for one.
//!
//! Departs: thesis (3-2) decouples disturbances of any shape in the null space of H-bar, of which
//! nothing is left with one output. A root at z = 1 in the numerator leaves a step at the beginning.
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Disturbance {
    Offset,
    /// A straight line that begins at 0 at the first sample.
    Drift,
}

/// Removes disturbances of known shape from a deviation d, d - D G d, with G D = I and G T = 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct KnownShapes {
    /// Columns of D, the shapes, of unit length.
    shapes: Vec<Vec<f64>>,
    /// Rows of G, which estimate how much of each shape there is.
    estimators: Vec<Vec<f64>>,
}

impl KnownShapes {
    /// The map. `tangent`: T, N x any number. `None`: the columns are linearly dependent.
    pub fn new(disturbances: &[Disturbance], tangent: &DMatrix<f64>) -> Option<KnownShapes> {
        let (n, of_ring) = tangent.shape();
        let shape = |i: usize, disturbance: Disturbance| match disturbance {
            Disturbance::Offset => 1.0,
            Disturbance::Drift => i as f64,
        };
        let mut all = DMatrix::from_fn(n, of_ring + disturbances.len(), |i, k| {
            if k < of_ring { tangent[(i, k)] } else { shape(i, disturbances[k - of_ring]) }
        });
        for mut column in all.column_iter_mut() {
            column.normalize_mut();
        }

        let g = all.tr_mul(&all).try_inverse()? * all.transpose();
        let last = of_ring..all.ncols();
        let known = KnownShapes {
            shapes: last.clone().map(|k| all.column(k).iter().copied().collect()).collect(),
            estimators: last.map(|k| g.row(k).iter().copied().collect()).collect(),
        };
        // shapes that are nearly a ring have estimators beyond all numbers
        known.estimators.iter().flatten().all(|v| v.abs() < 1e6).then_some(known)
    }

    pub fn take_off(&self, deviation: &mut [f64]) {
        subtract(&self.shapes, &self.estimators, deviation);
    }

    /// The transposed map, x - G' D' x, in place, for projecting residuals without computing them.
    pub fn take_off_transposed(&self, x: &mut [f64]) {
        subtract(&self.estimators, &self.shapes, x);
    }
}

fn subtract(directions: &[Vec<f64>], rows: &[Vec<f64>], v: &mut [f64]) {
    let much: Vec<f64> =
        rows.iter().map(|row| row.iter().zip(&*v).map(|(p, q)| p * q).sum()).collect();
    for (direction, much) in directions.iter().zip(much) {
        v.iter_mut().zip(direction).for_each(|(v, d)| *v -= much * d);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::ResidualGenerator;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn known_shapes_reach_no_residual_and_rings_reach_it_whole() {
        let (n, dt_s) = (128, 0.78125e-6);
        let filter = ResidualGenerator::of_nominal(4.06e5);
        let tangent = DMatrix::from_fn(n, 3, |i, j| {
            let t = i as f64 * dt_s;
            300.0 * (-3e4 * t).exp() * (4.06e5 * t + j as f64).cos() * (1.0 + (j * i) as f64 / 64.0)
        });
        let known = KnownShapes::new(&[Disturbance::Offset, Disturbance::Drift], &tangent).unwrap();
        let energy = |d: &[f64]| {
            let mut d = d.to_vec();
            known.take_off(&mut d);
            filter.energy(&d)
        };
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut draw = || (0..n).map(|_| rng.random_range(-30.0..30.0)).collect::<Vec<f64>>();
        let (d, x) = (draw(), draw());
        let line = |offset: f64, slope: f64| -> Vec<f64> {
            d.iter().enumerate().map(|(k, d)| d + offset + slope * k as f64).collect()
        };
        for disturbed in [line(40.0, 0.0), line(-20.0, 0.5)] {
            assert!((energy(&disturbed) / energy(&d) - 1.0).abs() < 1e-9);
        }
        // a root at z = 1 alone does not remove an offset: the step at the beginning rings on
        let plain = filter.energy(&line(200.0, 0.0)) / filter.energy(&d);
        assert!(plain > 1.5, "{plain}");
        for column in tangent.column_iter() {
            let ring: Vec<f64> = column.iter().copied().collect();
            assert!((energy(&ring) / filter.energy(&ring) - 1.0).abs() < 1e-9);
        }
        let (mut left, mut right) = (d.clone(), x.clone());
        known.take_off(&mut left);
        known.take_off_transposed(&mut right);
        let dot = |p: &[f64], q: &[f64]| p.iter().zip(q).map(|(p, q)| p * q).sum::<f64>();
        assert!((dot(&x, &left) - dot(&right, &d)).abs() < 1e-9 * dot(&x, &x).max(dot(&d, &d)));
    }
}
