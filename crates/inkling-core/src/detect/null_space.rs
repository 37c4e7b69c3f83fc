//! Numerators of the FD filter that no healthy signal excites: the left null space of H-bar.
//!
//! In: the healthy model (A, C) with one output, the sample period, and a degree. Out: N-bar, and
//! the polynomial N(z)L(z), the filter's numerator. thesis (3-2) and the display of H-bar after it.
//!
//! A healthy signal is y_k = C A_d^k x_a with A_d = e^{A dt}, and x_(k+1) = A_d x_k. Written as a
//! pencil, H(z) X(z) and L Y(z) with H(z) = H_0 + H_1 z and L = [0; -I] cancel each other but for
//! x_a. A row polynomial N(z) with N(z) H(z) = 0 leaves N(z) L y = 0 from sample `degree` on,
//! whatever x_a is. With N(z) = sum of N_k z^k the condition is linear: [N_0 N_1 ..] H-bar = 0,
//! where H-bar repeats [H_0 H_1] on its diagonal.
//!
//! The steps: scale the states (`balanced`), build H-bar (`h_bar`), take its left null space, check
//! that against the observable order, and choose one element ([`NullSpace::offset_rejection`]).
//!
//! Departs: the thesis designs in s and discretises later; here H(z) = [-zI + e^{A dt}; C] is exact
//! at the samples.
//! Departs: the text's d_N block rows give degree d_N - 1 while its sum runs to d_N, and it declares
//! N-bar a column but uses a row. Here `degree` is the degree of a row.

use super::DetectError;
use crate::model::InkChannel;
use crate::model::ring_down::{discretise, in_microseconds};
use nalgebra::{DMatrix, DVector};

/// The largest degree: a larger one, of a stored filter, is a mistake, and would make H-bar large.
const MAX_DEGREE: usize = 64;
/// A direction of the state is observable if what is new in it is larger than this, relative to the
/// one-sample change of the state.
const OBSERVABLE: f64 = 1e-10;
/// Singular values of H-bar up to this, relative to the largest, count as zero.
const ZERO: f64 = 1e-12;
/// How large an entry of N H-bar may be that should be 0, relative to the largest of H-bar.
const REPAIRED: f64 = 1e-14;

#[derive(Clone, Debug, PartialEq)]
pub struct NullSpace {
    /// N-bar = [N_0 ... N_degree], nullity x (degree + 1)(n + 1), orthonormal, in scaled states.
    pub n_bar: DMatrix<f64>,
    /// Rank of the observability matrix: how many poles show in the output. 3 for an ink channel.
    pub observable_order: usize,
    pub degree: usize,
}

/// The left null space of H-bar, thesis (3-2). `a`: n x n, in 1/s for states in any SI unit. `c`: 1
/// x n. `dt_s`: sample period, s. Its dimension must be degree + 1 - observable order.
///
/// Departs: thesis §3-2 says "only one solution". That holds for degree = observable order alone.
pub fn annihilator(
    a: &DMatrix<f64>,
    c: &DMatrix<f64>,
    dt_s: f64,
    degree: usize,
) -> Result<NullSpace, DetectError> {
    if degree > MAX_DEGREE {
        return Err(DetectError::DegreeTooLarge { degree, max: MAX_DEGREE });
    }
    let (a_d, c) = balanced(a, c, dt_s)?;
    let observable_order = observable_order(&a_d, &c);
    let expected = (degree + 1).saturating_sub(observable_order);
    if expected == 0 {
        return Err(DetectError::DegreeTooSmall { degree, observable_order });
    }
    let n_bar = left_null_space(&h_bar(&a_d, &c, degree + 1))?;
    if n_bar.nrows() != expected {
        let found = n_bar.nrows();
        return Err(DetectError::WrongNullity { found, expected, degree, observable_order });
    }
    Ok(NullSpace { n_bar, observable_order, degree })
}

/// The monic numerator N(z)L(z) of an ink channel, descending powers of z. At the observable order its
/// roots are e^{pole dt}; at a higher degree it is [`NullSpace::offset_rejection`].
pub fn numerator_of(
    channel: &InkChannel,
    dt_s: f64,
    degree: usize,
) -> Result<Vec<f64>, DetectError> {
    annihilator(&channel.a(), &channel.c(), dt_s, degree)?.offset_rejection()
}

impl NullSpace {
    /// N(z)L(z) of each row of N-bar, up to the sign: nullity x (degree + 1), ascending powers.
    pub fn polynomials(&self) -> DMatrix<f64> {
        let block = self.n_bar.ncols() / (self.degree + 1);
        DMatrix::from_fn(self.n_bar.nrows(), self.degree + 1, |i, k| {
            self.n_bar[(i, (k + 1) * block - 1)]
        })
    }

    /// That monic element N(z)L(z), descending powers, which has a root of multiplicity nullity - 1 at
    /// z = 1. At degree 4 this is (z - 1) p3(z), the image of det(A - sI) = s p3(s) of thesis §3-2-1 II,
    /// which rejects a constant sensor offset.
    pub fn offset_rejection(&self) -> Result<Vec<f64>, DetectError> {
        let q = self.polynomials();
        let nullity = q.nrows();
        let weights = if nullity == 1 {
            DMatrix::identity(1, 1)
        } else {
            // Taylor coefficients at z = 1: that of (z - 1)^j in z^k is the binomial coefficient k
            // over j. The root has that multiplicity if those of j = 0 .. nullity - 2 vanish.
            let binomial = |k: usize, j: usize| {
                (0..j).fold(1.0, |v, i| v * (k as f64 - i as f64) / (i as f64 + 1.0))
            };
            let taylor = DMatrix::from_fn(q.ncols(), nullity - 1, binomial);
            let at_one = &q * taylor;
            // where all are zero but for rounding, no combination is singled out
            let conditions = at_one.map(|v| if v.abs() <= ZERO { 0.0 } else { v });
            left_null_space(&conditions)?
        };
        let (degree, observable_order) = (self.degree, self.observable_order);
        if weights.nrows() != 1 {
            return Err(DetectError::AmbiguousNumerator { degree, observable_order });
        }

        let p = weights * q;
        let lead = p[(0, degree)];
        // a leading coefficient of zero means a lower degree, which the nullity rules out
        if lead.abs() <= ZERO * p.amax() {
            return Err(DetectError::AmbiguousNumerator { degree, observable_order });
        }
        Ok((0..=degree).rev().map(|k| p[(0, k)] / lead).collect())
    }
}

/// (A_d, C) with A_d = e^{A dt} and states scaled so that its entries are of similar size (in SI units
/// they differ by 12 decades, and every rank would be wrong). C is scaled to length 1.
fn balanced(
    a: &DMatrix<f64>,
    c: &DMatrix<f64>,
    dt_s: f64,
) -> Result<(DMatrix<f64>, DMatrix<f64>), DetectError> {
    // balancing numbers that are not finite might never end
    if let Some(index) = a.iter().position(|v| !v.is_finite()) {
        return Err(DetectError::NotFinite { what: "A", index });
    }
    let (mut balanced, c_us) = in_microseconds(a, c);
    let d: DVector<f64> = nalgebra::linalg::balancing::balance_parlett_reinsch(&mut balanced);
    let mut c_b = DMatrix::from_fn(c.nrows(), c.ncols(), |i, j| c_us[(i, j)] * d[j]);
    let a_d = discretise(&(balanced * 1e6), dt_s);
    if let Some(index) = a_d.iter().position(|v| !v.is_finite()) {
        return Err(DetectError::NotFinite { what: "e^{A dt}", index });
    }
    c_b /= c_b.norm();
    Ok((a_d, c_b))
}

/// Rank of the observability matrix [C; C A_d; C A_d²; ..]: each new direction, orthogonal to those
/// before, is multiplied by (A_d - I) over its norm, and the product is tried next: the same space as
/// powers of A_d give, with eigenvalues farther apart.
fn observable_order(a_d: &DMatrix<f64>, c: &DMatrix<f64>) -> usize {
    let n = a_d.nrows();
    let mut f = a_d - DMatrix::identity(n, n);
    let size = f.norm();
    if size > 0.0 {
        f /= size;
    }
    let mut basis: Vec<DVector<f64>> = Vec::with_capacity(n);
    let mut v = c.row(0).transpose();
    while basis.len() < n {
        // Gram-Schmidt, twice against rounding, which is enough (Kahan, Parlett)
        for _ in 0..2 {
            for b in &basis {
                let along = b.dot(&v);
                v.axpy(-along, b, 1.0);
            }
        }
        let rest = v.norm();
        if rest <= OBSERVABLE {
            break;
        }
        v /= rest;
        let next = f.tr_mul(&v);
        basis.push(std::mem::replace(&mut v, next));
    }
    basis.len()
}

/// H-bar, thesis after (3-3b), with H_0 = [A_d; C] and H_1 = [-I; 0], both (n + 1) x n.
pub(super) fn h_bar(a_d: &DMatrix<f64>, c: &DMatrix<f64>, block_rows: usize) -> DMatrix<f64> {
    let n = a_d.nrows();
    let shape = (n + 1, n);
    let h0 = DMatrix::from_fn(n + 1, n, |i, j| if i < n { a_d[(i, j)] } else { c[(0, j)] });
    let h1 = DMatrix::from_fn(n + 1, n, |i, j| if i == j { -1.0 } else { 0.0 });
    let mut h_bar = DMatrix::zeros(block_rows * (n + 1), (block_rows + 1) * n);
    for b in 0..block_rows {
        h_bar.view_mut((b * (n + 1), b * n), shape).copy_from(&h0);
        h_bar.view_mut((b * (n + 1), (b + 1) * n), shape).copy_from(&h1);
    }
    h_bar
}

/// Orthonormal rows N, a basis of all with N M = 0. An error if N M does not vanish.
pub(super) fn left_null_space(m: &DMatrix<f64>) -> Result<DMatrix<f64>, DetectError> {
    let (rows, columns) = m.shape();
    let failed = DetectError::Decomposition { rows, columns };
    // nalgebra's U has only as many columns as M: zeros up to a square matrix make it complete
    let square = m.clone().resize_horizontally(columns.max(rows), 0.0);
    let svd = square.try_svd(true, true, f64::EPSILON, 10_000).ok_or(failed.clone())?;
    let (u, v_t) = svd.u.zip(svd.v_t).ok_or(failed.clone())?;
    let sigma = &svd.singular_values;
    let bound = ZERO * sigma.max();
    let (null, range): (Vec<usize>, Vec<usize>) = (0..rows).partition(|&i| sigma[i] <= bound);
    let mut n = DMatrix::from_fn(null.len(), rows, |i, j| u[(j, null[i])]);

    // good to 1e-12 at times: what is left of N M is taken back through the pseudo-inverse
    for _ in 0..2 {
        let left = &n * m;
        for &k in &range {
            let v = v_t.row(k).columns(0, columns).transpose();
            let along = (&left * v) / sigma[k];
            n -= along * u.column(k).transpose();
        }
        n = n.transpose().qr().q().transpose();
    }
    let left = (&n * m).amax();
    // not `>`, so that NaN fails, too
    if left <= REPAIRED * m.amax() { Ok(n) } else { Err(failed) }
}

#[cfg(test)]
pub(super) mod tests;
