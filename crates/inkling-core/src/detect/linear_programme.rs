//! The filter's numerator by (3-3b) as the linear programme that the thesis speaks of before it
//! takes the null space alone (`detect.denominator` = `lp`).
//!
//! In: a healthy channel, the same channel with a fault, the sample period, and a degree. Out: the
//! M(z) for which the numerator M p3 lets the fault through most, where p3 is the numerator of the
//! observable order 3. thesis §3-2 (3-3), after Mohajerin Esfahani and Lygeros (2016).
//!
//! The programme maximises over N-bar the largest coefficient of N(z) F(z), subject to N-bar
//! H-bar = 0 and to no coefficient of N-bar exceeding 1 in size, with F = [A_f - A; 0]. The largest
//! of several linear forms is not linear, so each form has a programme of its own:
//!
//! 1. A basis of the null space of H-bar: N-bar is a weighted sum of its rows.
//! 2. For each coefficient of N(z) F(z), a linear form of the weights, maximise it (`largest`).
//! 3. Take the best, read N(z) L off N-bar, and divide it by p3.

use super::DetectError;
use super::null_space::{h_bar, left_null_space, numerator_of};
use crate::model::InkChannel;
use crate::model::programme::minimise;
use crate::model::ring_down::{discretise, in_microseconds};
use nalgebra::{DMatrix, DVector};

/// M(z), descending powers, its largest coefficient scaled to 1. `degree`: of M p3, 3 or more.
pub fn most_sensitive(
    healthy: &InkChannel,
    faulty: &InkChannel,
    dt_s: f64,
    degree: usize,
) -> Result<Vec<f64>, DetectError> {
    const OBSERVABLE_ORDER: usize = 3;
    let p3 = numerator_of(healthy, dt_s, OBSERVABLE_ORDER)?;

    // the null space of H-bar as in `null_space`, and B_f = A_f - A, both discrete (e^{A dt} for A)
    let (a_us, c) = in_microseconds(&healthy.a(), &healthy.c());
    let (a_f_us, _) = in_microseconds(&faulty.a(), &faulty.c());
    let [a_d, a_f] = [a_us, a_f_us].map(|a| discretise(&(a * 1e6), dt_s));
    let space = left_null_space(&h_bar(&a_d, &c, degree + 1))?;
    let b_f = a_f - &a_d;
    let (n, block) = (b_f.nrows(), b_f.nrows() + 1);

    // entry j of N_k B_f: N_k is block k of a row, of which the first n entries meet the states
    let forms = (0..=degree).flat_map(|k| (0..n).map(move |j| (k, j))).map(|(k, j)| {
        let of_block = space.columns(k * block, n);
        of_block * b_f.column(j)
    });
    let mut best = (f64::NEG_INFINITY, DVector::zeros(space.nrows()));
    for form in forms {
        let weights = largest(&space, &form)?;
        let value = form.dot(&weights);
        if value > best.0 {
            best = (value, weights);
        }
    }

    let (_, weights) = best;
    let n_bar = space.tr_mul(&weights);
    let mut rest: Vec<f64> = (0..=degree).rev().map(|k| n_bar[(k + 1) * block - 1]).collect();
    // every element of the null space is a multiple of p3: the rest of the division is 0
    let m: Vec<f64> = (0..=degree - OBSERVABLE_ORDER)
        .map(|k| {
            let quotient = rest[k] / p3[0];
            p3.iter().enumerate().for_each(|(i, p)| rest[k + i] -= quotient * p);
            quotient
        })
        .collect();
    let largest = m.iter().fold(0.0, |most: f64, v| if v.abs() > most.abs() { *v } else { most });
    Ok(m.iter().map(|v| v / largest).collect())
}

/// The weights of `space`'s rows that maximise `form`. An error if the solver does not converge.
fn largest(space: &DMatrix<f64>, form: &DVector<f64>) -> Result<DVector<f64>, DetectError> {
    let (rows, columns) = space.shape();
    let size = form.amax().max(f64::MIN_POSITIVE);
    let linear: Vec<f64> = form.iter().map(|v| -v / size).collect();
    // two inequalities per coefficient: N-bar <= 1 and -N-bar <= 1
    let bounds = |sign: f64| {
        space.column_iter().map(move |of| of.iter().map(|v| sign * v).collect::<Vec<f64>>())
    };
    let limits: Vec<Vec<f64>> = bounds(1.0).chain(bounds(-1.0)).collect();
    match minimise(&[], &linear, &limits, &vec![1.0; 2 * columns]) {
        Some((weights, true)) => Ok(DVector::from_vec(weights)),
        _ => Err(DetectError::Decomposition { rows, columns }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::null_space::tests::{DT_S, INK, decay, left_by};
    use crate::detect::numerator::product;
    use crate::model::faults;

    /// Compares the programme's optimum with every direction of a null space of two rows.
    #[test]
    fn no_direction_of_the_null_space_has_a_larger_form_within_the_bounds() {
        let (a_us, c) = in_microseconds(&INK.a(), &INK.c());
        let a_d = discretise(&(a_us * 1e6), DT_S);
        let space = left_null_space(&h_bar(&a_d, &c, 5)).unwrap();
        assert_eq!(space.nrows(), 2);
        for form in [nalgebra::dvector![1.0, 0.3], nalgebra::dvector![-0.2, 5.0]] {
            let best = largest(&space, &form).unwrap();
            assert!(space.tr_mul(&best).amax() <= 1.0 + 1e-6);
            for k in 0..3600 {
                let angle = f64::from(k).to_radians() / 10.0;
                let direction = nalgebra::dvector![angle.cos(), angle.sin()];
                let within = &direction / space.tr_mul(&direction).amax();
                assert!(form.dot(&within) <= form.dot(&best) + 1e-5, "at {angle}");
            }
        }
    }

    #[test]
    fn what_it_finds_rejects_healthy_signals_and_is_unique_at_the_observable_order() {
        let dried = faults::apply("SDN", 1.3, &INK).unwrap();
        assert_eq!(most_sensitive(&INK, &dried, DT_S, 3).unwrap(), [1.0]);
        let y = decay(&INK);
        for degree in [4, 5, 6] {
            let m = most_sensitive(&INK, &dried, DT_S, degree).unwrap();
            let p3 = numerator_of(&INK, DT_S, 3).unwrap();
            let n = product(&m, &p3);
            assert_eq!(n.len(), degree + 1);
            assert!(left_by(&n, &y) < 1e-11, "degree {degree}: {}", left_by(&n, &y));
        }
    }
}
