//! Denominators alpha(z) of the residual generator: methods I and II of thesis §3-2-1.
//!
//! In: poles in 1/s (or a fault's model), and the sample period, s. Out: alpha(z) as a monic
//! polynomial in z, coefficients in descending powers. Each pole s of the thesis's alpha(s) becomes
//! a root z = e^{s dt}, which is exact at the samples.
//!
//! * Method I: an undamped pair at +-j omega_r, so that a residual once excited keeps ringing; the
//!   other poles are real and fast.
//! * Method II: the poles of a faulty channel, so that the filter answers most to that fault's ring.

use super::DetectError;
use crate::model::InkChannel;
use crate::model::ring_down::in_microseconds;
use nalgebra::{Complex, ComplexField};

/// An eigenvalue smaller than this, relative to the largest, counts as the unobservable pole at 0.
const AT_ZERO: f64 = 1e-9;

/// Method I: alpha(s) = (s^2 + omega_r^2) prod (s + p_i), thesis §3-2-1 I, mapped to z.
/// `omega_r_rad_s`: above 0 and below pi / dt. `other_poles_per_s`: p_i, all positive.
pub fn resonance(
    omega_r_rad_s: f64,
    other_poles_per_s: &[f64],
    dt_s: f64,
) -> Result<Vec<f64>, DetectError> {
    // beyond half the sample rate the pair would alias to another frequency
    if !(omega_r_rad_s > 0.0 && omega_r_rad_s * dt_s < std::f64::consts::PI) {
        let must = "above 0 and below half the sample rate (pi / dt)";
        return Err(DetectError::BadNumber { what: "omega_r_rad_s", value: omega_r_rad_s, must });
    }
    let pair = [omega_r_rad_s, -omega_r_rad_s].map(|omega| Complex::new(0.0, omega));
    let others = other_poles_per_s.iter().map(|&p| Complex::new(-p, 0.0));
    Ok(from_poles(&pair.into_iter().chain(others).collect::<Vec<_>>(), dt_s))
}

/// The omega_r, rad/s, of n_o = `oscillations` within a signal: 2 pi n_o / T with T = samples * dt,
/// thesis §3-2-1 I. Departs: the text has n_o / T, which lacks the 2 pi.
pub fn resonance_of_oscillations(oscillations: f64, samples: usize, dt_s: f64) -> f64 {
    2.0 * std::f64::consts::PI * oscillations / (samples as f64 * dt_s)
}

/// The n_o of the healthy resonance. Departs: the thesis has n_o chosen by hand.
pub fn healthy_oscillations(frequency_hz: f64, samples: usize, dt_s: f64) -> f64 {
    frequency_hz * samples as f64 * dt_s
}

/// alpha(s) = det(A_f - sI), thesis §3-2-1 II, mapped to z: the slowest poles that the degree has
/// room for, without tearing a pair apart; what is missing is filled with poles at -`filler_per_s`.
///
/// Departs: a filler takes the place of the pole at 0, which is not observable in the output.
pub fn eigenvalues(
    fault: &InkChannel,
    filler_per_s: f64,
    degree: usize,
    dt_s: f64,
) -> Result<Vec<f64>, DetectError> {
    // computed in 1/us, where the matrix is well scaled
    let (a_us, _) = in_microseconds(&fault.a(), &fault.c());
    let failed = DetectError::Decomposition { rows: a_us.nrows(), columns: a_us.ncols() };
    let schur = nalgebra::Schur::try_new(a_us, f64::EPSILON, 10_000).ok_or(failed)?;
    let mut found: Vec<Complex<f64>> =
        schur.complex_eigenvalues().iter().map(|s| s * 1e6).collect();
    let largest = found.iter().map(|s| s.norm()).fold(0.0, f64::max);

    // one of each pair (im >= 0), the slowest (least damped) first
    found.retain(|s| s.norm() > AT_ZERO * largest && s.im >= 0.0);
    found.sort_by(|p, q| q.re.total_cmp(&p.re).then(p.im.total_cmp(&q.im)));
    let mut poles = Vec::with_capacity(degree);
    for s in found {
        let both = if s.im > 0.0 { vec![s, s.conj()] } else { vec![s] };
        if poles.len() + both.len() <= degree {
            poles.extend(both);
        }
    }
    poles.resize(degree, Complex::new(-filler_per_s, 0.0));
    Ok(from_poles(&poles, dt_s))
}

/// The monic polynomial prod (z - e^{s_i dt}), descending powers. `poles`: 1/s, with conjugates.
pub fn from_poles(poles: &[Complex<f64>], dt_s: f64) -> Vec<f64> {
    monic(poles.iter().map(|s| (s * dt_s).exp())).iter().map(|v| v.re).collect()
}

pub(super) fn monic<T: ComplexField>(roots: impl Iterator<Item = T>) -> Vec<T> {
    let mut p = vec![T::one()];
    for z in roots {
        p.push(T::zero());
        for k in (1..p.len()).rev() {
            let before = p[k - 1].clone();
            p[k] -= z.clone() * before;
        }
    }
    p
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::InkChannel;

    const DT_S: f64 = 0.78125e-6;

    fn value_at(p: &[f64], z: Complex<f64>) -> f64 {
        p.iter().fold(Complex::new(0.0, 0.0), |v, &c| v * z + c).norm()
    }

    #[test]
    fn resonance_has_exactly_the_poles_asked_for() {
        let alpha = resonance(4.0e5, &[1.0e5, 3.0e5], DT_S).unwrap();
        assert_eq!((alpha.len(), alpha[0]), (5, 1.0));
        for s in [(0.0, 4.0e5), (0.0, -4.0e5), (-1.0e5, 0.0), (-3.0e5, 0.0)] {
            let z = (Complex::new(s.0, s.1) * DT_S).exp();
            assert!(value_at(&alpha, z) < 1e-14, "{s:?}");
        }
    }

    #[test]
    fn the_undamped_pair_completes_the_oscillations_asked_for() {
        // 1 / (z^2 - 2 cos(w dt) z + 1) repeats itself after N / n_o samples.
        let omega = resonance_of_oscillations(8.0, 128, DT_S);
        let alpha = resonance(omega, &[], DT_S).unwrap();
        let mut h = vec![0.0, 1.0];
        for k in 2..130 {
            h.push(-alpha[1] * h[k - 1] - alpha[2] * h[k - 2]);
        }
        for k in 0..112 {
            assert!((h[k + 16] - h[k]).abs() < 1e-11);
        }
        assert_eq!(healthy_oscillations(6.47e4, 128, DT_S), 6.47e4 * 128.0 * DT_S);
    }

    #[test]
    fn a_faults_own_poles_are_the_denominators_roots_and_its_pole_at_0_is_not() {
        let blocked =
            InkChannel { a_per_s2: 5.6e10, b_per_s2: 4.44e10, g_per_s: 1.6e4, d_per_s: 2e5 };
        let [p2, p1, p0] = blocked.cubic();
        let alpha = eigenvalues(&blocked, 2.0e5, 4, DT_S).unwrap();
        // The cubic's roots by another route: its own companion matrix, in 1/us.
        let cubic = nalgebra::dmatrix![
            -p2 * 1e-6, -p1 * 1e-12, -p0 * 1e-18; 1.0, 0.0, 0.0; 0.0, 1.0, 0.0];
        for s in cubic.complex_eigenvalues().iter() {
            assert!(value_at(&alpha, (s * 1e6 * DT_S).exp()) < 1e-13);
        }
        assert!(value_at(&alpha, Complex::new((-2.0e5 * DT_S).exp(), 0.0)) < 1e-13);
        assert!(value_at(&alpha, Complex::new(1.0, 0.0)) > 1e-4);
    }

    #[test]
    fn eigenvalues_meet_any_degree_without_tearing_a_pair() {
        let a = InkChannel::NOMINAL;
        for degree in 0..8 {
            let alpha = eigenvalues(&a, 2.0e5, degree, DT_S).unwrap();
            assert_eq!(alpha.len(), degree + 1);
            assert!(alpha.iter().all(|v| v.is_finite()));
        }
        let one = eigenvalues(&a, 2.0e5, 1, DT_S).unwrap();
        assert!((one[1] + (-3.77e4 * DT_S).exp()).abs() < 1e-3, "the real pole alone: {one:?}");
    }

    #[test]
    fn frequencies_out_of_range_are_errors() {
        assert!(resonance(0.0, &[], DT_S).is_err());
        assert!(resonance(4.1e6, &[], DT_S).is_err(), "beyond half the sample rate");
    }
}
