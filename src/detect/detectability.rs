//! Which faults a filter can see before one is designed, and where its zeros make it blind.
//!
//! In: a model with inputs of faults and disturbances, or a filter. Out: per fault detectable, strongly
//! detectable; of the filter the frequencies at which it is blind. thesis (2-1), (3-3b), §3-2-1.
//!
//! A fault is detectable if some filter that rejects the state and the disturbances answers to it
//! at all; strongly, if the answer to a constant fault stays (Nyberg 2002). At a frequency the same
//! question is asked of a fault that oscillates with it.

use super::DetectError;
use nalgebra::{Complex, DMatrix};

/// Singular values below this, relative to the largest, are zero.
const ZERO: f64 = 1e-9;

/// x' = A x + B_f f + B_d d, y = C x + D_f f + D_d d, thesis (2-1) with the fault as an input.
/// Departs: in (2-1) a fault multiplies the state, B_f f x; about a decay that is expected, B_f x is
/// an input of known shape.
#[derive(Clone, Debug)]
pub struct FaultyModel {
    pub a: DMatrix<f64>,
    pub c: DMatrix<f64>,
    pub b_f: DMatrix<f64>,
    pub d_f: DMatrix<f64>,
    pub b_d: DMatrix<f64>,
    pub d_d: DMatrix<f64>,
}

/// What can be known of each fault.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Detectability {
    pub detectable: Vec<bool>,
    pub strongly: Vec<bool>,
}

impl FaultyModel {
    /// Per fault: whether it reaches the outputs beyond what states and disturbances can explain, at almost all
    /// frequencies (detectable) and at frequency 0 (strongly detectable).
    pub fn detectability(&self) -> Result<Detectability, DetectError> {
        self.check()?;
        let scale = self.a.norm().max(1.0);
        // at a frequency that no zero has by chance, the rank is the normal one
        let generic = Complex::new(0.618_034 * scale, 1.324_718 * scale);
        Ok(Detectability {
            detectable: self.seen_at(generic)?,
            strongly: self.seen_at(Complex::new(0.0, 0.0))?,
        })
    }

    /// Per fault: whether the same holds at s, 1/s.
    pub fn seen_at(&self, s: Complex<f64>) -> Result<Vec<bool>, DetectError> {
        self.check()?;
        let (n, m) = (self.a.nrows(), self.c.nrows());
        let complex = |m: &DMatrix<f64>| m.map(|v| Complex::new(v, 0.0));
        let scale = self.a.norm().max(1.0);
        // [A - sI, B_d; C, D_d]: what states and disturbances can do
        let known = self.b_d.ncols();
        let mut p = DMatrix::zeros(n + m, n + known);
        let shifted = complex(&self.a) - DMatrix::identity(n, n) * s;
        p.view_mut((0, 0), (n, n)).copy_from(&(shifted / Complex::new(scale, 0.0)));
        p.view_mut((0, n), (n, known)).copy_from(&complex(&unit_columns(&self.b_d, &self.d_d).0));
        p.view_mut((n, 0), (m, n)).copy_from(&complex(&self.c));
        p.view_mut((n, n), (m, known)).copy_from(&complex(&unit_columns(&self.b_d, &self.d_d).1));
        let before = rank(&p)?;
        let (b_f, d_f) = unit_columns(&self.b_f, &self.d_f);
        (0..b_f.ncols())
            .map(|i| {
                let mut with = p.clone().insert_column(n + known, Complex::new(0.0, 0.0));
                for k in 0..n {
                    with[(k, n + known)] = Complex::new(b_f[(k, i)], 0.0);
                }
                for k in 0..m {
                    with[(n + k, n + known)] = Complex::new(d_f[(k, i)], 0.0);
                }
                Ok(rank(&with)? > before)
            })
            .collect()
    }

    fn check(&self) -> Result<(), DetectError> {
        let (n, m) = (self.a.nrows(), self.c.nrows());
        let fits = n > 0
            && self.a.ncols() == n
            && self.c.ncols() == n
            && m > 0
            && self.b_f.nrows() == n
            && self.b_d.nrows() == n
            && self.d_f.shape() == (m, self.b_f.ncols())
            && self.d_d.shape() == (m, self.b_d.ncols());
        if !fits {
            return Err(DetectError::WrongShape {
                a_rows: n,
                a_columns: self.a.ncols(),
                c_rows: m,
                c_columns: self.c.ncols(),
            });
        }
        for (what, matrix) in [
            ("A", &self.a),
            ("C", &self.c),
            ("B_f", &self.b_f),
            ("D_f", &self.d_f),
            ("B_d", &self.b_d),
            ("D_d", &self.d_d),
        ] {
            if let Some(index) = matrix.iter().position(|v| !v.is_finite()) {
                return Err(DetectError::NotFinite { what, index });
            }
        }
        Ok(())
    }
}

/// Columns [b; d] of unit length.
fn unit_columns(b: &DMatrix<f64>, d: &DMatrix<f64>) -> (DMatrix<f64>, DMatrix<f64>) {
    let (mut b, mut d) = (b.clone(), d.clone());
    for k in 0..b.ncols() {
        let size = b.column(k).norm().hypot(d.column(k).norm());
        if size > 0.0 {
            b.column_mut(k).unscale_mut(size);
            d.column_mut(k).unscale_mut(size);
        }
    }
    (b, d)
}

fn rank(m: &DMatrix<Complex<f64>>) -> Result<usize, DetectError> {
    let (rows, columns) = m.shape();
    let svd = m
        .clone()
        .try_svd(false, false, f64::EPSILON, 10_000)
        .ok_or(DetectError::Decomposition { rows, columns })?;
    let largest = svd.singular_values.amax();
    Ok(svd.singular_values.iter().filter(|s| **s > ZERO * largest).count())
}

/// Frequencies, Hz, at which the filter M N L / alpha answers less than `least` of its largest gain
/// over 0 .. half the sample rate: where it is blind. As ranges.
pub fn blind_ranges(
    generator: &super::ResidualGenerator,
    least: f64,
    steps: usize,
) -> Vec<(f64, f64)> {
    let steps = steps.clamp(2, 1 << 20);
    let half_rate_hz = 0.5 / generator.dt_s;
    let hz = |k: usize| half_rate_hz * k as f64 / (steps - 1) as f64;
    let gain = |k: usize| {
        let z = Complex::new(0.0, std::f64::consts::PI * k as f64 / (steps - 1) as f64).exp();
        let at = |p: &[f64]| {
            p.iter().fold(Complex::new(0.0, 0.0), |v, &c| v * z + Complex::new(c, 0.0)).norm()
        };
        // a marginal pair answers without bound: as far as rounding lets it
        at(&generator.numerator) / at(&generator.denominator).max(1e-6)
    };
    let gains: Vec<f64> = (0..steps).map(gain).collect();
    let largest = gains.iter().copied().fold(0.0, f64::max);
    let mut ranges: Vec<(f64, f64)> = Vec::new();
    let mut open: Option<usize> = None;
    for (k, g) in gains.iter().enumerate() {
        let blind = *g < least * largest;
        match (blind, open) {
            (true, None) => open = Some(k),
            (false, Some(from)) => {
                ranges.push((hz(from), hz(k - 1)));
                open = None;
            }
            _ => {}
        }
    }
    if let Some(from) = open {
        ranges.push((hz(from), half_rate_hz));
    }
    ranges
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::dmatrix;

    /// Two tanks in a row, the second one measured (or both).
    fn tanks(outputs: usize) -> FaultyModel {
        let c = if outputs == 1 { dmatrix![0.0, 1.0] } else { dmatrix![1.0, 0.0; 0.0, 1.0] };
        let m = c.nrows();
        FaultyModel {
            a: dmatrix![-1.0, 0.0; 1.0, -2.0],
            c,
            b_f: dmatrix![1.0, 0.0; 0.0, 1.0],
            d_f: DMatrix::zeros(m, 2),
            b_d: DMatrix::zeros(2, 0),
            d_d: DMatrix::zeros(m, 0),
        }
    }

    #[test]
    fn a_disturbance_hides_the_fault_that_acts_like_it_and_a_second_output_tells_them_apart() {
        let plain = tanks(1).detectability().unwrap();
        assert_eq!(plain.detectable, [true, true]);
        assert_eq!(plain.strongly, [true, true]);
        let disturbed = |outputs| FaultyModel { b_d: dmatrix![1.0; 0.0], ..tanks(outputs) };
        let one = FaultyModel { d_d: DMatrix::zeros(1, 1), ..disturbed(1) };
        assert_eq!(one.detectability().unwrap().detectable, [false, false]);
        let two = FaultyModel { d_d: DMatrix::zeros(2, 1), ..disturbed(2) };
        assert_eq!(two.detectability().unwrap().detectable, [false, true]);
    }

    #[test]
    fn a_fault_behind_a_differentiator_is_detectable_but_not_strongly() {
        // y = x' = -x + f: from f to y s/(s+1)
        let model = FaultyModel {
            a: dmatrix![-1.0],
            c: dmatrix![-1.0],
            b_f: dmatrix![1.0],
            d_f: dmatrix![1.0],
            b_d: DMatrix::zeros(1, 0),
            d_d: DMatrix::zeros(1, 0),
        };
        let found = model.detectability().unwrap();
        assert_eq!((found.detectable, found.strongly), (vec![true], vec![false]));
    }

    #[test]
    fn the_filter_is_blind_at_an_offset_and_not_at_its_own_resonance() {
        use crate::detect::{ResidualGenerator, null_space, poles};
        use crate::model::InkChannel;
        let ink = InkChannel::NOMINAL;
        let dt_s = 0.78125e-6;
        let n = null_space::numerator(&ink.a(), &ink.c(), dt_s, 4).unwrap();
        let alpha = poles::resonance(4.06e5, &[2e5, 2e5], dt_s).unwrap();
        let filter = ResidualGenerator::new(n, alpha, dt_s).unwrap();
        let blind = blind_ranges(&filter, 1e-6, 4096);
        assert_eq!(blind[0].0, 0.0);
        assert!(blind.iter().all(|(from, to)| !(*from..=*to).contains(&64.6e3)));
        assert!(blind_ranges(&filter, 0.0, 4096).is_empty());
    }

    #[test]
    fn matrices_that_do_not_fit_are_errors() {
        let wrong = FaultyModel { d_f: DMatrix::zeros(3, 1), ..tanks(1) };
        assert!(matches!(wrong.detectability(), Err(DetectError::WrongShape { .. })));
        let nan = FaultyModel { b_f: dmatrix![f64::NAN, 0.0; 0.0, 1.0], ..tanks(1) };
        assert!(matches!(nan.detectability(), Err(DetectError::NotFinite { .. })));
    }
}
