//! Filters for general (2-1): any outputs, disturbances decoupled where the null space allows it.
//!
//! In: (A, C), how disturbances enter (B_d, D_d), the sample period, a degree. Out: every polynomial
//! row N(z) that neither the state nor a disturbance reaches. thesis (3-2) with d.
//!
//! A disturbance is any sequence that is held over each sample (a zero-order hold); what varies
//! within a sample is decoupled where it acts on the outputs alone (D_d), else approximately.
//!
//! With one output nothing of that kind is left ([`super::detectability`] says so). What can be
//! decoupled there is a disturbance of known shape, [`KnownShapes`]. A numerator with a root at z = 1
//! does not do it: from zero state the first sample of an offset is a step, and rings in the undamped
//! pair to the end.

use super::null_space::{left_null_space, stack};
use super::{DetectError, ResidualGenerator};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// A disturbance of known shape that adds to the output.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Disturbance {
    /// A constant.
    Offset,
    /// A straight line from 0.
    Drift,
}

/// Removes disturbances of known shape from a deviation d by an oblique projection: d - D G d, with G D = I, so
/// that no disturbance reaches the residual, and G T = 0, so that every change of the ring does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct KnownShapes {
    /// Columns of D, of unit length.
    shapes: Vec<Vec<f64>>,
    /// Rows of G.
    estimators: Vec<Vec<f64>>,
}

impl KnownShapes {
    /// G by least squares in the orthogonal complement of T. `tangent`: N x any, T, the ring's sensitivities.
    /// `None`: disturbances and sensitivities depend on each other.
    pub fn new(disturbances: &[Disturbance], tangent: &DMatrix<f64>) -> Option<KnownShapes> {
        let (n, of_ring) = tangent.shape();
        let mut all = DMatrix::zeros(n, of_ring + disturbances.len());
        all.columns_mut(0, of_ring).copy_from(tangent);
        for (k, disturbance) in disturbances.iter().enumerate() {
            for (i, v) in all.column_mut(of_ring + k).iter_mut().enumerate() {
                *v = match disturbance {
                    Disturbance::Offset => 1.0,
                    Disturbance::Drift => i as f64,
                };
            }
        }
        for mut column in all.column_iter_mut() {
            let size = column.norm();
            column /= size;
        }
        let g = all.tr_mul(&all).try_inverse()? * all.transpose();
        let last = of_ring..all.ncols();
        let known = KnownShapes {
            shapes: last.clone().map(|k| all.column(k).iter().copied().collect()).collect(),
            estimators: last.map(|k| g.row(k).iter().copied().collect()).collect(),
        };
        known.check(n).ok().map(|()| known)
    }

    /// d - D G d. `deviation`: N, counts.
    pub fn take_off(&self, deviation: &mut [f64]) {
        subtract(&self.shapes, &self.estimators, deviation);
    }

    /// The transpose, x - G' D' x.
    pub fn take_off_transposed(&self, x: &mut [f64]) {
        subtract(&self.estimators, &self.shapes, x);
    }

    /// Refused if training could not have made it.
    pub fn check(&self, samples: usize) -> Result<(), String> {
        let whole = |rows: &[Vec<f64>]| {
            rows.iter().all(|r| r.len() == samples && r.iter().all(|v| v.abs() < 1e6))
        };
        match self.shapes.len() == self.estimators.len()
            && whole(&self.shapes)
            && whole(&self.estimators)
        {
            true => Ok(()),
            false => Err(format!("`decoupled` must hold finite rows of {samples}")),
        }
    }
}

/// v minus the sum of `directions`, each times the inner product of its row with v.
fn subtract(directions: &[Vec<f64>], rows: &[Vec<f64>], v: &mut [f64]) {
    let much: Vec<f64> =
        rows.iter().map(|row| row.iter().zip(&*v).map(|(p, q)| p * q).sum()).collect();
    for (direction, much) in directions.iter().zip(much) {
        v.iter_mut().zip(direction).for_each(|(v, d)| *v -= much * d);
    }
}

/// Residual generators as polynomials in z: row i has one polynomial per output.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoupled {
    /// Per row, per output: ascending powers, `degree + 1` coefficients.
    pub rows: Vec<Vec<Vec<f64>>>,
    pub degree: usize,
}

/// Left null space of H-bar with H(z) = [A_d - zI, B_dd; C, D_d]. `a`: n x n, 1/s; `c`: m x n;
/// `b_d`: n x n_d, per s; `d_d`: m x n_d.
pub fn decoupled(
    a: &DMatrix<f64>,
    c: &DMatrix<f64>,
    b_d: &DMatrix<f64>,
    d_d: &DMatrix<f64>,
    dt_s: f64,
    degree: usize,
) -> Result<Decoupled, DetectError> {
    super::null_space::check(a, c, dt_s, degree)?;
    let (n, m, disturbances) = (a.nrows(), c.nrows(), b_d.ncols());
    check_disturbances(b_d, d_d, n, m)?;
    // [A B; 0 0] dt: its exponential holds A_d and the held B_dd. Balanced, for SI units differ by
    // decades; disturbances are states there and are balanced with them.
    let mut all = DMatrix::zeros(n + disturbances, n + disturbances);
    all.view_mut((0, 0), (n, n)).copy_from(&(a * dt_s));
    all.view_mut((0, n), (n, disturbances)).copy_from(&(b_d * dt_s));
    let mut outputs = DMatrix::zeros(m, n + disturbances);
    outputs.view_mut((0, 0), (m, n)).copy_from(c);
    outputs.view_mut((0, n), (m, disturbances)).copy_from(d_d);
    let scales = nalgebra::linalg::balancing::balance_parlett_reinsch(&mut all);
    let step = all.exp();
    if let Some(index) = step.iter().position(|v| !v.is_finite()) {
        return Err(DetectError::NotFinite { what: "e^{A dt}", index });
    }
    let mut h0 = DMatrix::zeros(n + m, n + disturbances);
    h0.view_mut((0, 0), (n, n + disturbances)).copy_from(&step.rows(0, n));
    let mut sizes = Vec::with_capacity(m);
    for (i, row) in outputs.row_iter().enumerate() {
        let scaled: Vec<f64> = row.iter().zip(scales.iter()).map(|(c, s)| c * s).collect();
        let size = scaled.iter().map(|v| v * v).sum::<f64>().sqrt();
        let size = if size > 0.0 { size } else { 1.0 };
        for (j, v) in scaled.iter().enumerate() {
            h0[(n + i, j)] = v / size;
        }
        sizes.push(size);
    }
    // columns of disturbances to unit length: their scale is arbitrary
    for j in n..n + disturbances {
        let size = h0.column(j).norm();
        if size > 0.0 {
            h0.column_mut(j).unscale_mut(size);
        }
    }
    let h1 =
        DMatrix::from_fn(n + m, n + disturbances, |i, j| if i == j && i < n { -1.0 } else { 0.0 });
    let n_bar = left_null_space(&stack(&h0, &h1, degree + 1))?;
    if n_bar.nrows() == 0 {
        let observable_order = n + disturbances;
        return Err(DetectError::DegreeTooSmall { degree, observable_order, outputs: m });
    }
    let block = n + m;
    let polynomial = |i: usize, j: usize| {
        (0..=degree).map(|k| n_bar[(i, k * block + n + j)] / sizes[j]).collect()
    };
    let rows = (0..n_bar.nrows()).map(|i| (0..m).map(|j| polynomial(i, j)).collect()).collect();
    Ok(Decoupled { rows, degree })
}

fn check_disturbances(
    b_d: &DMatrix<f64>,
    d_d: &DMatrix<f64>,
    states: usize,
    outputs: usize,
) -> Result<(), DetectError> {
    if b_d.nrows() != states || d_d.shape() != (outputs, b_d.ncols()) {
        let (c_rows, c_columns) = d_d.shape();
        let (a_rows, a_columns) = b_d.shape();
        return Err(DetectError::WrongShape { a_rows, a_columns, c_rows, c_columns });
    }
    for (what, matrix) in [("B_d", b_d), ("D_d", d_d)] {
        if let Some(index) = matrix.iter().position(|v| !v.is_finite()) {
            return Err(DetectError::NotFinite { what, index });
        }
    }
    Ok(())
}

impl Decoupled {
    /// One filter per output for row `row`; the residual is the sum of their outputs.
    /// `denominator`: descending powers, monic, of degree `degree`.
    pub fn generators(
        &self,
        row: usize,
        denominator: &[f64],
        dt_s: f64,
    ) -> Result<Vec<ResidualGenerator>, DetectError> {
        let Some(row) = self.rows.get(row) else { return Ok(Vec::new()) };
        let descending = |p: &Vec<f64>| p.iter().rev().copied().collect();
        row.iter()
            .map(|p| ResidualGenerator::new(descending(p), denominator.to_vec(), dt_s))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::poles::from_poles;
    use nalgebra::{Complex, DVector, dmatrix};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// m outputs of a random stable system with held random disturbances, from a random state.
    fn outputs(
        a: &DMatrix<f64>,
        c: &DMatrix<f64>,
        (b, d): (&DMatrix<f64>, &DMatrix<f64>),
        dt_s: f64,
        rng: &mut ChaCha8Rng,
    ) -> Vec<Vec<f64>> {
        let (n, n_d) = (a.nrows(), b.ncols());
        // many small steps of a Taylor series: another route than the exponential of [A B; 0 0]
        let parts = 64;
        let h = dt_s / f64::from(parts);
        let mut x = DVector::from_fn(n, |_, _| rng.random_range(-1.0..1.0));
        let mut y = vec![Vec::new(); c.nrows()];
        for _ in 0..80 {
            let held = DVector::from_fn(n_d, |_, _| rng.random_range(-1.0..1.0));
            let out = c * &x + d * &held;
            y.iter_mut().zip(out.iter()).for_each(|(y, v)| y.push(*v));
            for _ in 0..parts {
                let mut term = a * &x + b * &held;
                let mut next = x.clone();
                for k in 1..12 {
                    term *= h / f64::from(k);
                    next += &term;
                    term = a * term;
                }
                x = next;
            }
        }
        y
    }

    #[test]
    fn neither_state_nor_disturbance_reaches_the_residual() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut worst: f64 = 0.0;
        for (n, m, n_d) in [(3, 2, 1), (4, 2, 1), (4, 3, 2), (2, 2, 1), (5, 3, 1)] {
            let mut draw =
                |rows, columns| DMatrix::from_fn(rows, columns, |_, _| rng.random_range(-1.0..1.0));
            let dt_s = 1e-6;
            let a = (draw(n, n) - DMatrix::identity(n, n) * 2.0) * 1e5;
            let (c, b, d) = (draw(m, n), draw(n, n_d) * 1e5, draw(m, n_d) * 0.3);
            let found = decoupled(&a, &c, &b, &d, dt_s, n).unwrap();
            assert!(!found.rows.is_empty());
            let y = outputs(&a, &c, (&b, &d), dt_s, &mut rng);
            let size = y.iter().flatten().fold(0.0, |s: f64, v| s.max(v.abs()));
            for row in &found.rows {
                let weight: f64 = row.iter().flatten().map(|p| p.abs()).sum();
                for k in 0..80 - found.degree {
                    let left: f64 = row
                        .iter()
                        .zip(&y)
                        .map(|(p, y)| p.iter().zip(&y[k..]).map(|(p, y)| p * y).sum::<f64>())
                        .sum();
                    worst = worst.max(left.abs() / (weight * size));
                }
            }
        }
        assert!(worst < 1e-11, "{worst}");
    }

    #[test]
    fn the_filters_show_a_fault_that_the_disturbance_does_not_hide() {
        let a = dmatrix![-1e5, 0.0; 1e5, -2e5];
        let c = dmatrix![1.0, 0.0; 0.0, 1.0];
        let b = dmatrix![1e5; 0.0];
        let none = DMatrix::zeros(2, 1);
        let dt_s = 1e-6;
        let found = decoupled(&a, &c, &b, &none, dt_s, 2).unwrap();
        let alpha = from_poles(&[Complex::new(-2e5, 0.0); 2], dt_s);
        // a disturbance on the first state, and the same as a fault on the second
        let fault = dmatrix![0.0; 1e5];
        let (mut hidden, mut seen): (f64, f64) = (0.0, 0.0);
        let run = |input: &DMatrix<f64>| {
            let mut rng = ChaCha8Rng::seed_from_u64(2);
            outputs(&a, &c, (input, &none), dt_s, &mut rng)
        };
        let (disturbed, faulty) = (run(&b), run(&fault));
        for row in 0..found.rows.len() {
            let filters = found.generators(row, &alpha, dt_s).unwrap();
            let residual = |y: &[Vec<f64>]| -> f64 {
                let mut sum = vec![0.0; 80];
                for (filter, y) in filters.iter().zip(y) {
                    let mut r = vec![0.0; 80];
                    filter.filter(y, &mut r);
                    sum.iter_mut().zip(&r).for_each(|(s, r)| *s += r);
                }
                // from rest of the filter's own start
                sum[60..].iter().map(|v| v.abs()).fold(0.0, f64::max)
            };
            hidden = hidden.max(residual(&disturbed));
            seen = seen.max(residual(&faulty));
        }
        assert!(hidden < 1e-4 * seen, "{hidden} {seen}");
    }

    #[test]
    fn known_shapes_reach_no_residual_and_rings_reach_it_whole() {
        use crate::detect::null_space;
        use crate::model::InkChannel;
        let ink = InkChannel::NOMINAL;
        let (n, dt_s) = (128, 0.78125e-6);
        let numerator = null_space::numerator(&ink.a(), &ink.c(), dt_s, 4).unwrap();
        let alpha = crate::detect::poles::resonance(4.06e5, &[2e5, 2e5], dt_s).unwrap();
        let filter = ResidualGenerator::new(numerator, alpha, dt_s).unwrap();
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
        // the root at z = 1 alone does not: the step at the beginning rings on
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

    #[test]
    fn one_output_cannot_decouple_what_enters_like_everything_and_says_so() {
        let a = dmatrix![-1e5];
        let one = dmatrix![1.0];
        let found = decoupled(&a, &one, &dmatrix![1e5], &dmatrix![0.0], 1e-6, 3);
        assert!(matches!(found, Err(DetectError::DegreeTooSmall { .. })), "{found:?}");
        let wrong = decoupled(&a, &one, &DMatrix::zeros(2, 1), &dmatrix![0.0], 1e-6, 3);
        assert!(matches!(wrong, Err(DetectError::WrongShape { .. })));
    }
}
