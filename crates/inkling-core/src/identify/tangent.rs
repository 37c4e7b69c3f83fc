//! The model's own sensitivities, and the effect of temperature along them.
//!
//! In: an identified model and the signals of its window. Out: the tangent space of the model's
//! decays (N x 6: 3 pole directions, 3 state directions); what one Kelvin does to the expected
//! signal, as a direction in that space (counts per K); and by how much a direction changes damping
//! and frequency. `design/learn.rs` calls all three and stores the results in the healthy model.
//!
//! The temperature response is a weighted linear regression: of all signals at one recorded
//! temperature the mean deviation from the expected signal is projected on the tangent space, and
//! the six coordinates are regressed on the temperature.

use super::averaging::SignalSet;
use super::cubic::{self, cubic_per_us, to_microseconds};
use super::identification::Identification;
use super::tuned;
use crate::numbers::tuned::few;
use nalgebra::{DMatrix, DVector, Matrix6, Vector3, Vector6};

/// The derivatives dy/d(p2, p1, p0, y, y', y''), N x 6, in units per µs: every small change of a
/// decay that leaves it a decay of the model.
pub fn tangent(fit: &Identification, dt_s: f64, samples: usize) -> DMatrix<f64> {
    let state = Vector3::from(to_microseconds(fit.output_state));
    cubic::tangent(cubic_per_us(fit.cubic), state, dt_s * 1e6, samples)
}

/// d y_hat / d temperature, N counts per K at the reference drive, projected on the tangent space,
/// so that 6 numbers are estimated and not N.
///
/// `expected`: the model's signal at `reference_c`, N counts; `tangent`: N x 6, by [`tangent`].
/// `None`: the temperature of some signal was not recorded; it hardly varied (`least_spread_k`);
/// there are fewer than `few` different temperatures; or temperature has no significant effect. An
/// effect is significant if the statistic of `regress` exceeds a fixed bound. From 30 different
/// temperatures on chance exceeds the bound in about 5e-6 of the cases or fewer. With few
/// temperatures the bound is far too low: chance exceeds it in 2e-3 of the cases with 16
/// temperatures, in 2.5 % with 12, and in nearly half with 8.
pub fn temperature_response(
    set: &SignalSet,
    expected: &[f64],
    tangent: &DMatrix<f64>,
    reference_c: f64,
) -> Option<Vec<f64>> {
    // every temperature is known, and they differ
    let deviation = |i: usize| set.temperature_c[i] - reference_c;
    if set.temperature_c.iter().any(|t| !t.is_finite()) {
        return None;
    }
    let spread = (0..set.len()).map(|i| deviation(i).powi(2)).sum::<f64>() / set.len() as f64;
    if spread.sqrt() < tuned::least_spread_k() {
        return None;
    }

    // One point of the regression per recorded temperature: the signals of a burst share theirs, so
    // only bursts are independent.
    let mut order: Vec<usize> = (0..set.len()).collect();
    order.sort_by(|&i, &j| set.temperature_c[i].total_cmp(&set.temperature_c[j]));
    let looks: Vec<&[usize]> =
        order.chunk_by(|&i, &j| set.temperature_c[i] == set.temperature_c[j]).collect();
    if looks.len() < few() {
        return None;
    }

    // coordinates of a deviation on the tangent space, by least squares on columns scaled to unit
    // length
    let scaled = DMatrix::from_fn(tangent.nrows(), 6, |i, j| {
        tangent[(i, j)] / tangent.column(j).norm().max(f64::MIN_POSITIVE)
    });
    let gram: Matrix6<f64> = Matrix6::from_fn(|i, j| scaled.column(i).dot(&scaled.column(j)));
    let inverse = gram.try_inverse()?;

    // for each temperature: its deviation from the reference in K, its weight (the sum of square
    // drives), and the coordinates of the mean deviation per unit drive
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

    // The 99.9999 % point of F(6, n) falls from 13 (n = 30) to 6.4 (n = inf), and 14 is above both.
    // For n below 30 the point is higher, and the statistic is larger than F (see above).
    let (slope, statistic) = regress(&coordinates)?;
    (statistic > 14.0)
        .then(|| (scaled * DVector::from_row_slice(slope.as_slice())).as_slice().to_vec())
}

/// Weighted linear regression of v on x, for points (x, weight, v): the slope, and its Hotelling
/// statistic T² over 6. If there is no effect and there are many points, that is about
/// F-distributed with 6 and n = points - 2 degrees of freedom; exactly, (n - 5) / n times it is
/// F-distributed with 6 and n - 5. `None`: the scatter about the line has no inverse.
fn regress(points: &[(f64, f64, Vector6<f64>)]) -> Option<(Vector6<f64>, f64)> {
    let w: f64 = points.iter().map(|p| p.1).sum();
    let x_mean = points.iter().map(|p| p.1 * p.0).sum::<f64>() / w;
    let v_mean = points.iter().fold(Vector6::zeros(), |sum, p| sum + p.2 * p.1) / w;
    let sxx: f64 = points.iter().map(|p| p.1 * (p.0 - x_mean).powi(2)).sum();
    let slope = points
        .iter()
        .fold(Vector6::zeros(), |sum, p| sum + (p.2 - v_mean) * (p.1 * (p.0 - x_mean)))
        / sxx;

    // covariance of a point of weight 1 about the line, and the slope's square distance from 0 by
    // it
    let mut scatter = Matrix6::zeros();
    for (x, w, v) in points {
        let rest = v - v_mean - slope * (x - x_mean);
        scatter += rest * rest.transpose() * *w;
    }
    scatter /= (points.len().max(3) - 2) as f64;
    let statistic = slope.dot(&(scatter.try_inverse()? * slope)) * sxx / 6.0;
    Some((slope, statistic))
}

/// Relative change of (damping, frequency) where the expected signal changes by `direction` (N
/// counts; per K if the direction is a temperature response). The direction's coordinates on the
/// tangent space, by least squares, say how the cubic changes; the poles of the cubic a thousandth
/// of that to either side give the derivative. `None`: the decomposition failed, or the changed
/// model does not ring.
pub fn pole_changes(
    fit: &Identification,
    tangent: &DMatrix<f64>,
    direction: &[f64],
) -> Option<(f64, f64)> {
    let svd = tangent.clone().try_svd(true, true, f64::EPSILON, 10_000)?;
    let scale = svd.singular_values.amax();
    let x = svd.solve(&DVector::from_row_slice(direction), 1e-12 * scale).ok()?;
    let si = [1e6, 1e12, 1e18];
    let h = 1e-3;
    let moved = |sign: f64| {
        super::cubic::poles_of(std::array::from_fn(|k| fit.cubic[k] + sign * h * x[k] * si[k]))
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
    use super::*;
    use crate::model::InkChannel;
    use crate::model::ring_down::ring_down;

    #[test]
    fn a_change_of_the_rates_is_found_in_the_poles_that_it_moves() {
        const DT_S: f64 = 0.8e-6;
        const CHANNEL: InkChannel =
            InkChannel { a_per_s2: 6.1e10, b_per_s2: 1.02e11, g_per_s: 1.9e4, d_per_s: 7.1e4 };
        let start = DVector::from_row_slice(&[3e-4, 1e-4, 150.0, 240.0]);
        let decay = |channel: &InkChannel| ring_down(channel, &start, DT_S, 128);
        let fit = identify(&decay(&CHANNEL), DT_S, 1.0, &GreyBoxSettings::default(), None).unwrap();
        let tangent = tangent(&fit, DT_S, 128);
        const BY: f64 = 1e-4;
        let more = |rate: f64| rate * (1.0 + BY);
        for moved in [
            InkChannel { a_per_s2: more(CHANNEL.a_per_s2), ..CHANNEL },
            InkChannel { b_per_s2: more(CHANNEL.b_per_s2), ..CHANNEL },
            InkChannel { g_per_s: more(CHANNEL.g_per_s), ..CHANNEL },
            InkChannel { d_per_s: more(CHANNEL.d_per_s), ..CHANNEL },
        ] {
            let (was, now) = (CHANNEL.poles().unwrap(), moved.poles().unwrap());
            let direction: Vec<f64> =
                decay(&moved).iter().zip(&decay(&CHANNEL)).map(|(z, y)| (z - y) / BY).collect();
            let (damping, frequency) = pole_changes(&fit, &tangent, &direction).unwrap();
            let true_damping = (now.damping_per_s / was.damping_per_s - 1.0) / BY;
            let true_frequency = (now.frequency_hz / was.frequency_hz - 1.0) / BY;
            assert!((damping - true_damping).abs() < 0.01, "{damping}, not {true_damping}");
            assert!((frequency - true_frequency).abs() < 0.01, "{frequency}, not {true_frequency}");
        }
    }
}
