//! The model's own sensitivities, and the effect of temperature along them.
//!
//! In: an identified model and the signals of its window. Out: the tangent space of the model's
//! decays (N x 6: 3 pole directions, 3 state directions); what one Kelvin does to the expected
//! signal, as a direction in that space (counts per K); and by how much a direction changes damping
//! and frequency.
//!
//! The temperature response is a weighted linear regression: of all signals at one recorded
//! temperature the mean deviation from the expected signal is projected on the tangent space, and
//! the six coordinates are regressed on the temperature.

use super::SignalSet;
use super::cubic::{self, PER_S, cubic_per_us, per_us};
use super::identification::Identification;
use crate::numbers::FEW;
use nalgebra::{DMatrix, DVector, Matrix6, Vector3, Vector6};

/// The derivatives dy/d(p2, p1, p0, y, y', y''), N x 6, per µs.
pub fn tangent(fit: &Identification, dt_s: f64, samples: usize) -> DMatrix<f64> {
    let state = Vector3::from(per_us(fit.output_state));
    cubic::tangent(cubic_per_us(fit.cubic), state, dt_s * 1e6, samples)
}

/// d y_hat / d temperature, N counts per K, projected on the tangent space, so that 6 numbers are
/// estimated. `expected`: the model's signal at `reference_c`; `tangent`: by [`tangent`]. `None`:
/// fewer than `FEW` recorded temperatures differ; or the effect is not significant
/// (Hotelling's test, size 1e-6: few temperatures have to show a large effect).
pub fn temperature_response(
    set: &SignalSet,
    expected: &[f64],
    tangent: &DMatrix<f64>,
    reference_c: f64,
) -> Option<Vec<f64>> {
    let deviation = |i: usize| set.temperature_c[i] - reference_c;
    // a point of the regression per temperature: only bursts, which share theirs, are independent
    let mut order: Vec<usize> = (0..set.len()).filter(|i| deviation(*i).is_finite()).collect();
    order.sort_by(|&i, &j| set.temperature_c[i].total_cmp(&set.temperature_c[j]));
    let looks: Vec<&[usize]> =
        order.chunk_by(|&i, &j| set.temperature_c[i] == set.temperature_c[j]).collect();
    if looks.len() < FEW {
        return None;
    }

    let scaled = DMatrix::from_fn(tangent.nrows(), 6, |i, j| {
        tangent[(i, j)] / tangent.column(j).norm().max(f64::MIN_POSITIVE)
    });
    let gram: Matrix6<f64> = Matrix6::from_fn(|i, j| scaled.column(i).dot(&scaled.column(j)));
    let inverse = gram.try_inverse()?;

    // K from the reference, the sum of square drives, and coordinates of the mean deviation
    let mut coordinates: Vec<(f64, f64, Vector6<f64>)> = Vec::with_capacity(looks.len());
    for look in looks {
        let (mut mean, mut weight) = (DVector::zeros(set.samples), 0.0);
        for &i in look {
            let s = set.drive[i];
            for (k, &v) in set.signal(i).iter().enumerate() {
                mean[k] += s * (f64::from(v) - s * expected[k]);
            }
            weight += s * s;
        }
        let projected = inverse * Vector6::from_fn(|j, _| scaled.column(j).dot(&mean) / weight);
        coordinates.push((deviation(look[0]), weight, projected));
    }

    let (slope, by_chance) = regress(&coordinates)?;
    let response = || scaled * DVector::from_row_slice(slope.as_slice());
    (by_chance < 1e-6).then(|| response().as_slice().to_vec())
}

/// Tail of F with 6 and `freedom` degrees of freedom (Abramowitz and Stegun 26.6.4).
fn beyond_f6(f: f64, freedom: f64) -> f64 {
    let (half, x) = (freedom / 2.0, freedom / (freedom + 6.0 * f));
    x.powf(half) * (1.0 + half * (1.0 - x) * (1.0 + (half + 1.0) / 2.0 * (1.0 - x)))
}

/// Weighted regression of v on x for points (x, weight, v): the slope, and the probability that
/// chance makes its Hotelling statistic as large. `None`: fewer than 8 points, or singular.
fn regress(points: &[(f64, f64, Vector6<f64>)]) -> Option<(Vector6<f64>, f64)> {
    let w: f64 = points.iter().map(|p| p.1).sum();
    let x_mean = points.iter().map(|p| p.1 * p.0).sum::<f64>() / w;
    let v_mean = points.iter().fold(Vector6::zeros(), |sum, p| sum + p.2 * p.1) / w;
    let sxx: f64 = points.iter().map(|p| p.1 * (p.0 - x_mean).powi(2)).sum();
    let slope = points
        .iter()
        .fold(Vector6::zeros(), |sum, p| sum + (p.2 - v_mean) * (p.1 * (p.0 - x_mean)))
        / sxx;

    // covariance of a point of weight 1 about the line
    let mut scatter = Matrix6::zeros();
    for (x, w, v) in points {
        let rest = v - v_mean - slope * (x - x_mean);
        scatter += rest * rest.transpose() * *w;
    }
    // n points about a line have n - 2 degrees of freedom: in 6 dimensions T^2 is that many times 6
    // / (n - 7) times a variable of F with 6 and n - 7
    let freedom = points.len().checked_sub(7).filter(|left| *left > 0)? as f64;
    scatter /= freedom + 5.0;
    let square = slope.dot(&(scatter.try_inverse()? * slope)) * sxx;
    Some((slope, beyond_f6(square * freedom / (6.0 * (freedom + 5.0)), freedom)))
}

/// Relative change of (damping, frequency) where the expected signal changes by `direction` (N
/// counts, or per K). `None`: the decomposition failed, or the changed model does not ring.
pub fn pole_changes(
    fit: &Identification,
    tangent: &DMatrix<f64>,
    direction: &[f64],
) -> Option<(f64, f64)> {
    let svd = tangent.clone().try_svd(true, true, f64::EPSILON, 10_000)?;
    let scale = svd.singular_values.amax();
    let x = svd.solve(&DVector::from_row_slice(direction), 1e-12 * scale).ok()?;
    let h = 1e-3;
    let moved = |sign: f64| {
        cubic::poles_of(std::array::from_fn(|k| fit.cubic[k] + sign * h * x[k] * PER_S[k]))
    };
    let (up, down) = (moved(1.0)?, moved(-1.0)?);
    Some((
        (up.damping_per_s - down.damping_per_s) / (2.0 * h * fit.poles.damping_per_s),
        (up.frequency_hz - down.frequency_hz) / (2.0 * h * fit.poles.frequency_hz),
    ))
}

#[cfg(test)]
mod tests {
    use super::super::GreyBoxSettings;
    use super::super::grey_box::identify;
    use super::super::rate_search::tests::{DT_S, PLANTED, decay_of as decay};
    use super::*;
    use crate::model::InkChannel;

    /// Temperatures that do nothing are taken for an effect as often as the test says, however few there are.
    #[test]
    fn what_chance_does_is_as_frequent_as_its_probability_says() {
        let mut normal = crate::model::normal::draws(71);
        for n in [8, 11, 20, 60] {
            let mut chances: Vec<f64> = (0..2000)
                .map(|_| {
                    let point = |i| (i as f64, 1.0, Vector6::from_fn(|_, _| normal()));
                    regress(&(0..n).map(point).collect::<Vec<_>>()).unwrap().1
                })
                .collect();
            chances.sort_unstable_by(f64::total_cmp);
            for share in [0.01_f64, 0.1, 0.5] {
                let found = chances[(share * 2000.0) as usize];
                let error = 4.0 * (share * (1.0 - share) / 2000.0).sqrt();
                assert!((found - share).abs() < error, "{n} points: {found}, not {share}");
            }
        }
        // upper 5 % of F(6, 10), as printed in tables: 3.22
        assert!((beyond_f6(3.217, 10.0) - 0.05).abs() < 2e-4);
    }

    #[test]
    fn a_change_of_the_rates_is_found_in_the_poles_that_it_moves() {
        let fit = identify(&decay(&PLANTED), DT_S, 1.0, &GreyBoxSettings::default(), None).unwrap();
        let tangent = tangent(&fit, DT_S, 128);
        const BY: f64 = 1e-4;
        let more = |rate: f64| rate * (1.0 + BY);
        for moved in [
            InkChannel { a_per_s2: more(PLANTED.a_per_s2), ..PLANTED },
            InkChannel { b_per_s2: more(PLANTED.b_per_s2), ..PLANTED },
            InkChannel { g_per_s: more(PLANTED.g_per_s), ..PLANTED },
            InkChannel { d_per_s: more(PLANTED.d_per_s), ..PLANTED },
        ] {
            let (was, now) = (PLANTED.poles().unwrap(), moved.poles().unwrap());
            let direction: Vec<f64> =
                decay(&moved).iter().zip(&decay(&PLANTED)).map(|(z, y)| (z - y) / BY).collect();
            let (damping, frequency) = pole_changes(&fit, &tangent, &direction).unwrap();
            let true_damping = (now.damping_per_s / was.damping_per_s - 1.0) / BY;
            let true_frequency = (now.frequency_hz / was.frequency_hz - 1.0) / BY;
            assert!((damping - true_damping).abs() < 0.01, "{damping}, not {true_damping}");
            assert!((frequency - true_frequency).abs() < 0.01, "{frequency}, not {true_frequency}");
        }
    }
}
