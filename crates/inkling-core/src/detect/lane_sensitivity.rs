//! The streaming kernel of the default detection method: [`Sensitivity`] for many signals at once,
//! one signal in each lane, from inner products in f32.
//!
//! In: signals of one drive and temperature (a [`Condition`]), projected on three columns by
//! [`super::row_projection`]. Out: per lane the squared distance to first order, the square norm
//! orthogonal to the sensitivities, and whether the lane is *settled*: proved, by [`Limits`], to be
//! judged alike by the f64 reference ([`Sensitivity::distance`]) without fitting a ring.
//!
//! # The bound
//!
//! P_k is row k of the projection, c_k = P_k d its product with the deviation, u = 2^-24, and a hat
//! marks what f32 computes. Then |c^_k - c_k| <= |P_k| ((N + 4) u |d^| + |d^ - d|), the last term
//! as in [`super::lane_expectation`]; the drive that divides c is rounded once, and so is its square in the
//! metric M. The distance sqrt(x^T M x) is a norm of x = c / drive - mean, which an error of x
//! moves by at most sum_k sqrt(M_kk) |error of x_k|.
//!
//! The square norm orthogonal to the three columns t_k of the tangent is |d|² - c^T Gram c. Its
//! first term is wrong by at most (N + 4) u |d^|² + 2 |d^| |d^ - d|; its second by
//! 2 sum_k |(Gram c)_k| |error of c_k|, and (Gram c)_k is the product of d with t_k, at most
//! |t_k| |d|.

use super::lane_expectation::{LEAST, LaneExpectation, SLACK, U, fits, norm};
use super::row_projection::{Columns, LANES, Phases, Projections};
use super::sensitivity::{Sensitivity, rows};
use crate::processor::for_processor;
use std::ops::Range;

#[derive(Clone, Debug)]
pub struct LaneSensitivity {
    expectation: LaneExpectation,
    /// The three rows P_k of the projection, on which signals are projected, and their norms.
    pub columns: Columns<3>,
    norms: [f64; 3],
    /// sum_k |t_k| |P_k|, which bounds the error of the part along the sensitivities.
    condition: f64,
    /// T'T, counts², see [`Sensitivity::gram`].
    gram: [[f64; 3]; 3],
    sensitivity: Sensitivity,
}

/// A signal is settled if its squared distance is below `near` and its square norm orthogonal to
/// the sensitivities below `unexplained`, counts² (healthy), or if it is beyond `far` (faulty).
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    pub near: f64,
    pub far: f64,
    pub unexplained: f64,
}

#[derive(Clone, Debug)]
pub struct Condition {
    pub drive: f32,
    pub warmer: f32,
    /// The expected signal under this condition, N, counts, in groups of sixteen samples.
    pub expected: Vec<Phases>,
    limit: Option<Limit>,
}

#[derive(Clone, Copy, Debug)]
struct Limit {
    limits: Limits,
    metric: [[f64; 3]; 3],
    /// sqrt(M_kk), by which an error of feature k moves the distance at most.
    roots: [f64; 3],
    scale: f64,
    error: f64,
    room: f64,
}

#[derive(Clone, Copy, Debug)]
pub struct LaneStatistics {
    /// The squared distance. NaN in lanes without a signal, and where the condition has no metric.
    pub statistic: [f64; LANES],
    /// Square norm of the deviation's part orthogonal to the sensitivities, counts². NaN where a
    /// lane's statistic is not near its threshold.
    pub unexplained: [f64; LANES],
    /// Whether the reference is proved to decide as these do, and no sample is saturated.
    pub settled: [bool; LANES],
}

impl LaneStatistics {
    fn unknown() -> LaneStatistics {
        let nothing = [f64::NAN; LANES];
        LaneStatistics { statistic: nothing, unexplained: nothing, settled: [false; LANES] }
    }
}

impl LaneSensitivity {
    /// `expected`: at the reference, N, counts; `response`: its change with temperature, N, counts/K.
    /// `None`: a number is out of f32's range, lengths differ, or the sensitivities are dependent.
    pub fn new(
        sensitivity: &Sensitivity,
        expected: &[f64],
        response: Option<&[f64]>,
    ) -> Option<LaneSensitivity> {
        let expectation = LaneExpectation::new(expected, response)?;
        let projection: &[Vec<f64>; 3] = sensitivity.projection.as_slice().try_into().ok()?;
        if !projection.iter().all(|v| v.len() == expected.len() && fits(v)) {
            return None;
        }
        let gram = sensitivity.gram()?;
        let norms = projection.each_ref().map(|v| norm(v));
        Some(LaneSensitivity {
            expectation,
            columns: Columns::new(projection),
            condition: (0..3).map(|k| gram[(k, k)].sqrt() * norms[k]).sum(),
            gram: rows(&gram),
            norms,
            sensitivity: sensitivity.clone(),
        })
    }

    pub fn samples(&self) -> usize {
        self.expectation.samples()
    }

    /// `warmer`: K above the reference; `rails`: the least and the greatest count of the converter.
    pub fn condition(&self, drive: f64, warmer: f64, limits: Limits, rails: [f64; 2]) -> Condition {
        let (drive, warmer) = (drive as f32, warmer as f32);
        let limit = self.sensitivity.metric(drive.into()).map(|metric| Limit {
            limits,
            metric: rows(&metric),
            roots: std::array::from_fn(|k| metric[(k, k)].sqrt()),
            scale: 1.0 / f64::from(drive),
            error: self.expectation.error_at(drive, warmer),
            room: self.expectation.room(drive, warmer, rails),
        });
        Condition { drive, warmer, expected: self.expectation.at(drive, warmer), limit }
    }

    /// Judges the first `lanes` lanes; the others stay unknown. `products`: of one condition.
    pub fn judge(&self, at: &Condition, products: &Projections<3>, lanes: usize) -> LaneStatistics {
        let mut judged = LaneStatistics::unknown();
        if let Some(limit) = &at.limit {
            judge((self, limit), products, 0..lanes, &mut judged);
        }
        judged
    }
}

for_processor! {
    fn judge(
        of: (&LaneSensitivity, &Limit),
        sums: &Projections<3>,
        lanes: Range<usize>,
        judged: &mut LaneStatistics,
    ) {
        let (by, of) = of;
        let (m, scale, mean) = (&of.metric, of.scale, by.sensitivity.mean);
        let summing = (by.samples() as f64 + 4.0) * U;
        let squares = &sums.squares[lanes.clone()];
        let [p, q, r] = sums.products.each_ref().map(|of| &of[lanes.clone()]);
        let statistic = &mut judged.statistic[lanes.clone()];
        let unexplained = &mut judged.unexplained[lanes.clone()];
        let settled = &mut judged.settled[lanes.clone()];
        for i in 0..lanes.len() {
            let norm = f64::from(squares[i]).sqrt();
            // comparisons with NaN are false and settle nothing; `inside`: no sample is saturated
            let trusted = (squares[i] > LEAST) & (squares[i] < f32::INFINITY);
            let inside = SLACK * norm + 1.0 < of.room;

            // the features less their mean (d), and a bound on the error of sqrt(x^T M x)
            let c = [p[i], q[i], r[i]];
            let (mut d, mut error) = ([0.0; 3], 0.0);
            for k in 0..3 {
                let x = f64::from(c[k]) * scale;
                let of_product = by.norms[k] * (summing * norm + of.error);
                error += of.roots[k] * (of_product * scale.abs() + 2.0 * U * x.abs());
                d[k] = x - mean[k];
            }
            let along = |row: &[f64; 3]| row[0] * d[0] + row[1] * d[1] + row[2] * d[2];
            let distance = d[0] * along(&m[0]) + d[1] * along(&m[1]) + d[2] * along(&m[2]);

            // near or far for certain; 4 u: the rounding of the drive's square in the metric
            let (root, error) = (distance.sqrt(), SLACK * error);
            let most = SLACK * (root * (1.0 + 4.0 * U) + error);
            let least = root * (1.0 - 4.0 * U) - SLACK * error;
            let near = most * most < of.limits.near;
            let far = (least > 0.0) & (least * least > SLACK * of.limits.far);

            let g = &by.gram;
            let c = c.map(f64::from);
            let of_c = |row: &[f64; 3]| row[0] * c[0] + row[1] * c[1] + row[2] * c[2];
            let along = c[0] * of_c(&g[0]) + c[1] * of_c(&g[1]) + c[2] * of_c(&g[2]);
            let beside = f64::from(squares[i]) - along;
            let of_sums = 2.0 * norm * (summing * norm + of.error);
            let beside_most = beside + SLACK * of_sums * (1.0 + by.condition);
            let near = near & (beside_most < of.limits.unexplained);
            statistic[i] = distance;
            unexplained[i] = if near { beside } else { f64::NAN };
            settled[i] = trusted & inside & (near | far);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::burst::{Burst, Format, Layout};
    use crate::detect::row_projection::Room;
    use crate::processor::with_each_set;
    use nalgebra::DMatrix;
    use rand::{RngExt, SeedableRng};

    const N: usize = 61;
    const RAILS: [f64; 2] = [-32768.0, 32767.0];

    #[test]
    fn property_lanes_settle_as_the_reference_judges_and_most_of_them() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let tangent = DMatrix::from_fn(N, 3, |i, j| 300.0 * ((i * (j + 2)) as f64 * 0.1).sin());
        let mut sensitivity = Sensitivity::new(&tangent, 5.0).unwrap();
        sensitivity.mean = [0.002, -0.01, 0.001];
        sensitivity.spread = [[1e-4, 2e-5, 0.0], [2e-5, 4e-4, 0.0], [0.0, 0.0, 1e-6]];
        let expected: Vec<f64> = (0..N).map(|k| 400.0 * (0.3 * k as f64).cos()).collect();
        let response: Vec<f64> = (0..N).map(|k| 2.0 * (0.3 * k as f64).sin()).collect();
        let lanes = LaneSensitivity::new(&sensitivity, &expected, Some(&response)).unwrap();
        let (mut settled, mut beside, mut closest) = (0, 0, 0.0f64);
        for round in 0..300 {
            let drive = if round % 3 == 0 { 0.8 } else { 1.0 };
            let warmer = rng.random_range(-3.0..3.0);
            let theta: [f64; 3] = std::array::from_fn(|_| rng.random_range(-0.02..0.02));
            let y_hat: Vec<f64> =
                (0..N).map(|k| drive * (expected[k] + warmer * response[k])).collect();
            let metric = sensitivity.metric(drive).unwrap();
            let (mut signals, mut reference) = (Vec::new(), Vec::new());
            for lane in 0..LANES {
                let size = drive * lane as f64 / 16.0;
                let mut sample = |k: usize| {
                    let moved: f64 = (0..3).map(|j| tangent[(k, j)] * theta[j]).sum();
                    (y_hat[k] + size * moved + 8.0 * rng.random_range(-1.0..1.0)).round() as f32
                };
                let y: Vec<f32> = (0..N).map(&mut sample).collect();
                let d: Vec<f64> = y.iter().zip(&y_hat).map(|(&y, e)| f64::from(y) - e).collect();
                reference.push(sensitivity.distance(&metric, &sensitivity.features(&d, drive)));
                signals.push(y);
            }
            let burst = Burst {
                drive_voltage_v: Some(drive),
                ..Burst::of(&signals, 1e-6, Format::S16Le, Layout::ChannelMajor)
            };
            // a limit that is some signal's own distance, or just beside it
            let limit = reference[rng.random_range(0..LANES)] * rng.random_range(0.999..1.001);
            let limits = Limits { near: limit, far: 1.1 * limit, unexplained: f64::INFINITY };
            let condition = lanes.condition(drive, warmer, limits, RAILS);
            let mut same = Vec::new();
            with_each_set(|| {
                let (mut products, mut room) = (Projections::default(), Room::default());
                let rows = (&burst, 0..LANES);
                lanes.columns.project(rows, &condition.expected, &mut products, &mut room);
                let judged = lanes.judge(&condition, &products, LANES);
                same.push((judged.statistic.map(f64::to_bits), judged.settled));
                for (lane, reference) in reference.iter().enumerate() {
                    let off = judged.statistic[lane] / reference - 1.0;
                    assert!(off.abs() < 1e-3, "{off}");
                    let outside = *reference <= limits.near || *reference > limits.far;
                    assert!(!judged.settled[lane] || outside);
                    if judged.settled[lane] && *reference <= limits.near {
                        closest = closest.max(reference / limits.near);
                    }
                    settled += usize::from(judged.settled[lane]);
                    beside += usize::from(outside);
                }
            });
            assert!(same.windows(2).all(|w| w[0] == w[1]), "bits depend on the instructions");
        }
        assert!(settled as f64 > 0.9 * beside as f64, "{settled} of {beside} settled");
        assert!(closest > 0.95, "the bound is too wide: {closest}");
    }
}
