//! The streaming kernel of `detect.method` = `residual-energy`: residual energies of many signals
//! at once in f32, one signal in each SIMD lane. thesis r(y), e(r).
//!
//! In: a [`Tile`] of signals, and a [`LaneFilter`] that holds the filter and the expected signal.
//! Out: per lane the energy, and whether it is *settled*: proved, by the bound below, to lie below
//! the threshold by the f64 reference, [`ResidualGenerator::energy`], too. All other signals are
//! judged again by the reference, so that every verdict is the reference's.
//!
//! # One number, whatever the machine
//!
//! Every lane and instruction set runs the same sequence of IEEE f32 operations: nothing is fused or
//! summed across lanes. So an energy depends on no neighbour, number of workers or processor.
//!
//! # The bound
//!
//! u = 2^-24. d^ and r^ are what f32 computes of the deviation d and of the residual r. B and A are
//! the filter's numerator and denominator. With the local rounding errors eta the recursion is
//! exactly A r^ = B d^ + eta, hence for r of the exact recursion on the exact deviation d
//!
//! ```text
//! |r^ - r| <= |B/A| |d^ - d| + |1/A| |eta|                          (norms over N samples)
//! |eta|    <= u (beta |d^| + alpha |r^|)
//! beta  = 2 |b_0| + sum_k (4 |b_k| + 2 sum_{i > k} |b_i|)           k = 1 .. order
//! alpha = 1       + sum_k (3 |a_k| + 2 sum_{i > k} |a_i|)
//! |d^ - d| <= u |d^| + 6 u drive (|y_hat| + |dT| |response|)
//! ```
//!
//! because computing r^ rounds by 2 u |b_0 d^| + u |r^|, the update of state k by 2 u of each
//! product and by u of each of its two sums, and a state is a finite sum of terms b_i d^ and a_i r^.
//! y_hat is the expected signal, response its change per K, dT the temperature above the reference.
//!
//! |B/A| and |1/A| are at most the sums of the magnitudes of the impulse responses, which are finite
//! over N samples for marginally stable poles, too. |r^| and |d^| are measured along with the energy
//! (their sums cost (N + 2) u). 1 % on top covers second order and the reference's own rounding.

use super::ResidualGenerator;
use super::lane_expectation::{Deviation, LEAST, LaneExpectation, SLACK, U, fits, twin};
use super::row_projection::LANES;
use super::tile::{self, Tile};

pub const MOST_ORDER: usize = 8;

#[derive(Clone, Debug)]
pub struct LaneFilter {
    /// The coefficients b_0 .. b_order and a_1 .. a_order (a_0 is 1).
    numerator: Vec<f32>,
    denominator: Vec<f32>,
    dt_s: f64,
    expectation: LaneExpectation,
    /// |r^ - r| <= of_deviation |d^| + of_residual |r^| + of_expectation |error of y_hat|.
    of_deviation: f64,
    of_residual: f64,
    of_expectation: f64,
}

#[derive(Clone, Copy, Debug)]
pub struct LaneStatistics {
    /// The residual energy, counts²·s, or a squared distance. NaN in lanes without a signal,
    /// and where a distance has no metric at the condition.
    pub statistic: [f64; LANES],
    /// Square norm of the deviation's part orthogonal to the sensitivities, counts². NaN with the
    /// residual energy, and where a lane's statistic is not near its threshold.
    pub unexplained: [f64; LANES],
    /// Whether the reference is proved to decide as these do, and no sample is saturated.
    pub settled: [bool; LANES],
}

impl LaneStatistics {
    pub fn unknown() -> LaneStatistics {
        let nothing = [f64::NAN; LANES];
        LaneStatistics { statistic: nothing, unexplained: nothing, settled: [false; LANES] }
    }
}

impl LaneFilter {
    /// The filter in f32. `expected`: at the reference, N, counts; `response`: its change with
    /// temperature, N, counts/K. `None`: the degree is 0 or beyond [`MOST_ORDER`], a number is
    /// beyond f32's range, there are no samples, or the lengths differ.
    pub fn new(
        generator: &ResidualGenerator,
        expected: &[f64],
        response: Option<&[f64]>,
    ) -> Option<LaneFilter> {
        let (b, a) = (&generator.numerator, &generator.denominator);
        let order = generator.degree();
        let n = expected.len();
        let expectation = LaneExpectation::new(expected, response)?;
        if !((1..=MOST_ORDER).contains(&order) && fits(b) && fits(a)) {
            return None;
        }

        // the bounds on |B/A| and |1/A|
        let mut all_pole = generator.clone();
        all_pole.numerator.fill(0.0);
        all_pole.numerator[0] = 1.0;
        let l1 = |h: Vec<f64>| h.iter().map(|h| h.abs()).sum::<f64>();
        let (f_norm, g_norm) =
            (l1(generator.impulse_response(n)), l1(all_pole.impulse_response(n)));

        // `after`: the sum over i > k; `own`: the factor of the k-th coefficient
        let after = |p: &[f64], k: usize| p[k + 1..].iter().map(|c| c.abs()).sum::<f64>();
        let local = |p: &[f64], own: f64| -> f64 {
            (1..=order).map(|k| own * p[k].abs() + 2.0 * after(p, k)).sum()
        };
        let beta = 2.0 * b[0].abs() + local(b, 4.0);
        let alpha = 1.0 + local(a, 3.0);

        // `sums`: relative error of the measured |r^| and |d^|
        let sums = (n as f64 + 2.0) * U;
        let filter = LaneFilter {
            numerator: twin(b),
            denominator: twin(&a[1..]),
            dt_s: generator.dt_s,
            expectation,
            of_deviation: SLACK * (1.0 + sums) * U * (f_norm + g_norm * beta),
            of_residual: SLACK * (sums + U * g_norm * alpha),
            of_expectation: SLACK * f_norm,
        };
        let bound = filter.of_deviation + filter.of_residual + filter.of_expectation;
        bound.is_finite().then_some(filter)
    }

    pub fn samples(&self) -> usize {
        self.expectation.samples()
    }

    /// Judges the signals of `tile`, whose values become deviations. `threshold`: counts²·s.
    /// `rails`: the least and the greatest count of the converter; the first is negative.
    pub fn judge(&self, tile: &mut Tile, threshold: f64, rails: [f64; 2]) -> LaneStatistics {
        tile::subtract(tile, &self.expectation.expected, &self.expectation.response);
        let sums = self.square_sums(tile);
        let mut judged = LaneStatistics::unknown();
        for (lane, residual2) in sums.into_iter().enumerate().take(tile.lanes) {
            judged.statistic[lane] = self.dt_s * f64::from(residual2);
            // no norm that can be trusted, or a sample may be saturated: the lane stays unsettled
            let Some(deviation) = self.expectation.deviation(tile, lane, rails) else { continue };
            let r = f64::from(residual2).sqrt();
            let most = r + self.bound(deviation, r);
            judged.settled[lane] = residual2 > LEAST && self.dt_s * most * most < threshold;
        }
        judged
    }

    pub fn square_sums(&self, tile: &Tile) -> [f32; LANES] {
        let mut sums = [0.0; LANES];
        tile::energies(&self.numerator, &self.denominator, &tile.values, &mut sums);
        sums
    }

    fn bound(&self, deviation: Deviation, residual: f64) -> f64 {
        self.of_deviation * deviation.norm
            + self.of_residual * residual
            + self.of_expectation * deviation.error
    }
}

#[cfg(test)]
#[path = "kernel_tests.rs"]
mod tests;
