//! What a signal contains beside its ring: the part of its misfit that is orthogonal to the ring's
//! sensitivities, which the second test of detection judges (`detect/misfit.rs`).
//!
//! In: a signal (N samples, counts) and the ring fitted to it. Out: d - J (J'J)^-1 J'd, N counts,
//! where d is the signal less the ring. J has five columns: the derivatives by ln amplitude, ln
//! damping, ln frequency and phase, and the real pole's decay e^(-lambda t). Its rate lambda is
//! held: were it free, the tangent space would take up any slow drift of the sensor, too.

use super::inner_product::dot;
use super::ring::Ring;
use super::ring_fit::{Features, RingFitter};
use nalgebra::{Cholesky, Const, DMatrix, SMatrix, SVector};

const COLUMNS: usize = 5;

#[derive(Clone, Debug)]
pub struct BesideRing {
    /// e^(-lambda t), scaled to unit norm, N.
    real: Vec<f64>,
}

impl BesideRing {
    pub fn new(ring: &Ring, dt_s: f64, samples: usize) -> BesideRing {
        let lambda_dt = ring.lambda_per_s * dt_s;
        let column: Vec<f64> = (0..samples).map(|k| (-lambda_dt * k as f64).exp()).collect();
        let norm = dot(&column, &column).sqrt().max(f64::MIN_POSITIVE);
        BesideRing { real: column.into_iter().map(|v| v / norm).collect() }
    }

    /// The signal's misfit beside its ring, N, counts. `y`: N, counts; `at`: the features of its
    /// fitted ring, the phase free; `fitter`: of the same ring, sample period and N.
    pub fn misfit(&self, fitter: &RingFitter, y: &[f64], at: &Features) -> Vec<f64> {
        let tangent_space = self.tangent_space(fitter, at);
        let ring = tangent_space.columns()[0];
        let deviation = y.iter().zip(ring).map(|(y, ring)| y - ring).collect();
        tangent_space.without(deviation)
    }

    pub fn tangent_space(&self, fitter: &RingFitter, at: &Features) -> TangentSpace<'_> {
        let (pair, real) = (fitter.tangent(at), &self.real[..]);
        let mut of = TangentSpace { pair, real, scale: [0.0; COLUMNS], gram: None };
        let columns = of.columns();

        // only the lower triangle of the inner products, which is all that the factorisation reads
        let products = SMatrix::<f64, COLUMNS, COLUMNS>::from_fn(|i, j| {
            if j <= i { dot(columns[i], columns[j]) } else { 0.0 }
        });
        let scale: [f64; COLUMNS] =
            std::array::from_fn(|i| 1.0 / products[(i, i)].sqrt().max(f64::MIN_POSITIVE));

        // The Gram matrix of columns of unit norm, plus a ridge: where two columns are nearly
        // parallel, their difference explains nothing, instead of noise.
        let regularised = SMatrix::<f64, COLUMNS, COLUMNS>::from_fn(|i, j| {
            products[(i, j)] * (scale[i] * scale[j]) + if i == j { 1e-9 } else { 0.0 }
        });
        (of.scale, of.gram) = (scale, regularised.cholesky());
        of
    }
}

#[derive(Clone, Debug)]
pub struct TangentSpace<'a> {
    /// Columns of `RingFitter::tangent`, N x 4.
    pair: DMatrix<f64>,
    real: &'a [f64],
    /// One over the norm of each column.
    scale: [f64; COLUMNS],
    /// Factorised Gram matrix of the columns of unit norm; `None`: it is not positive definite.
    gram: Option<Cholesky<f64, Const<COLUMNS>>>,
}

impl TangentSpace<'_> {
    fn columns(&self) -> [&[f64]; COLUMNS] {
        let n = self.pair.nrows();
        let column = |k: usize| &self.pair.as_slice()[k * n..(k + 1) * n];
        [column(0), column(1), column(2), column(3), self.real]
    }

    /// The part of a deviation beside the tangent space, N, counts; all of it without `gram`.
    pub fn without(&self, mut deviation: Vec<f64>) -> Vec<f64> {
        let columns = self.columns();
        let product =
            SVector::<f64, COLUMNS>::from_fn(|i, _| self.scale[i] * dot(columns[i], &deviation));
        if let Some(of) = self.gram.as_ref().map(|gram| gram.solve(&product)) {
            let [a, b, c, d, e]: [f64; COLUMNS] = std::array::from_fn(|i| self.scale[i] * of[i]);
            let [p, q, r, s, t] = columns;
            let n = deviation.len();
            let (p, q, r, s, t) = (&p[..n], &q[..n], &r[..n], &s[..n], &t[..n]);
            for (k, left) in deviation.iter_mut().enumerate() {
                *left -= (a * p[k] + b * q[k]) + (c * r[k] + d * s[k]) + e * t[k];
            }
        }
        deviation
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RING: Ring = Ring {
        amplitude: 300.0,
        phase_rad: 0.3,
        damping_per_s: 2.5e4,
        frequency_hz: 61e3,
        real_share: 0.05,
        lambda_per_s: 4e4,
    };

    #[test]
    fn a_ring_and_its_real_pole_leave_nothing_and_an_offset_most_of_itself() {
        let (dt_s, n) = (0.9e-6, 120);
        let fitter = RingFitter::new(RING, dt_s, n);
        let beside = BesideRing::new(&RING, dt_s, n);
        let at =
            Features { ln_amplitude: 0.1, ln_damping: 0.2, ln_frequency: -0.05, phase_rad: 0.2 };
        let ring: Vec<f64> = fitter.tangent(&at).column(0).iter().copied().collect();
        let square = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>();
        assert!(square(&beside.misfit(&fitter, &ring, &at)) < 1e-12 * square(&ring));
        let with = |extra: &dyn Fn(usize) -> f64| -> f64 {
            let y: Vec<f64> = ring.iter().enumerate().map(|(k, r)| r + extra(k)).collect();
            square(&beside.misfit(&fitter, &y, &at))
        };
        let decay = |k: usize| 20.0 * (-4e4 * k as f64 * dt_s).exp();
        assert!(with(&decay) < 1e-6);
        let offset = with(&|_| 5.0);
        assert!(offset > 0.5 * 25.0 * n as f64 && offset < 25.0 * n as f64, "{offset}");
        let spike = with(&|k| if k == 60 { 50.0 } else { 0.0 });
        assert!(spike > 0.9 * 2500.0, "{spike}");
    }
}
