//! The streaming kernel of `detect.method` = `residual-energy`: residual energies of many signals
//! at once in f32, one signal in each SIMD lane. ([`super::lane_sensitivity`] is its counterpart
//! for the default method.)
//!
//! In, from `src/pipeline/statistics.rs`: a [`Tile`] of signals, and a [`LaneFilter`] that holds
//! the filter and the expected signal. Out: per lane the energy, and whether it is *settled*:
//! proved, by the bound below, to lie below the threshold by the f64 reference,
//! [`ResidualGenerator::energy`], too. Signals that are not settled, among them all that lie above
//! the threshold, are judged again by the reference. So every verdict is the reference's, and most
//! healthy signals cost only f32 arithmetic. thesis r(y), e(r).
//!
//! # One number, whatever the machine
//!
//! A lane's arithmetic is the same sequence of IEEE f32 operations in every lane and with every
//! instruction set: a product is rounded before it is added (no fused multiply-add, which some
//! machines lack), nothing is summed across lanes. So an energy depends on its signal alone, and not
//! on its neighbours in the tile, the number of workers, or the processor. `tests` hold the
//! instruction sets to equal bits.
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
//! because eta has these parts: computing r^ rounds by 2 u |b_0 d^| + u |r^|; the update of state k
//! rounds by 2 u of each product (coefficient and product are rounded) and by u of each of its two
//! sums; and a state is a finite sum of terms b_i d^ and a_i r^. y_hat, dT and response are the
//! expected signal, the temperature above the reference and the expected signal's change per K.
//!
//! The operator norms |B/A| and |1/A| are bounded by the sums of the magnitudes of the impulse
//! responses over the N samples, which are finite for marginally stable poles, too. |r^| and |d^|
//! are measured along with the energy (their own sums cost (N + 2) u). 1 % on top covers terms of
//! second order and the reference's own rounding, which is 2^-29 of this; results below f32's
//! normal range are not trusted at all.

use super::ResidualGenerator;
use super::lane_expectation::{LEAST, LaneExpectation, SLACK, U, fits, twin};
use super::row_projection::LANES;
use super::tile::{self, Tile};

/// The highest degree of a filter that has a kernel; for higher degrees the reference does the
/// work.
pub const MOST_ORDER: usize = 8;

/// A residual generator in f32, for signals of one length and one expected shape.
#[derive(Clone, Debug)]
pub struct LaneFilter {
    /// The coefficients b_0 .. b_order and a_1 .. a_order (a_0 is 1).
    numerator: Vec<f32>,
    denominator: Vec<f32>,
    dt_s: f64,
    expectation: LaneExpectation,
    /// Factors of the bound, which collect the constants of the head of this file:
    /// |r^ - r| <= of_deviation |d^| + of_residual |r^| + of_expectation |error of y_hat|.
    of_deviation: f64,
    of_residual: f64,
    of_expectation: f64,
}

/// Detection statistics of up to 32 signals, lane by lane. This file and
/// [`super::lane_sensitivity`] make them.
#[derive(Clone, Copy, Debug)]
pub struct LaneStatistics {
    /// The statistic that is compared with the threshold: the residual energy, counts²·s, or a
    /// squared distance. NaN in lanes without a signal.
    pub statistic: [f64; LANES],
    /// Square norm of the deviation's part orthogonal to the sensitivities, counts². NaN for
    /// residual energies, which have no second test, and where no second test is needed because the
    /// distance is not near.
    pub unexplained: [f64; LANES],
    /// Whether the reference's statistics are proved to lie within limits where they decide as
    /// these do, and whether no sample is saturated. Where false, the reference has to judge.
    pub settled: [bool; LANES],
}

impl LaneStatistics {
    /// Statistics of which no lane is settled.
    pub fn unknown() -> LaneStatistics {
        let nothing = [f64::NAN; LANES];
        LaneStatistics { statistic: nothing, unexplained: nothing, settled: [false; LANES] }
    }
}

impl LaneFilter {
    /// The filter in f32, with the factors of its bound. `expected`: the expected signal at the
    /// reference, N, counts; `response`: its change with temperature, N, counts/K (`None`: 0).
    /// `None`: f32 cannot serve, because the degree is 0 or beyond [`MOST_ORDER`], or numbers are
    /// beyond f32's range.
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

        // 1/A, through which local rounding reaches the residual, and bounds on the norms of B/A
        // and 1/A: the sums of the magnitudes (l1 norms) of the impulse responses
        let all_pole = {
            let mut one = vec![0.0; order + 1];
            one[0] = 1.0;
            ResidualGenerator::new(one, a.clone(), generator.dt_s).ok()?
        };
        let l1 = |h: Vec<f64>| h.iter().map(|h| h.abs()).sum::<f64>();
        let (f_norm, g_norm) =
            (l1(generator.impulse_response(n)), l1(all_pole.impulse_response(n)));

        // alpha and beta of the bound; `after` is the sum over i > k, `own` the factor of the k-th
        // coefficient
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

    /// Number of samples of a signal.
    pub fn samples(&self) -> usize {
        self.expectation.samples()
    }

    /// Judges the signals of `tile`, whose values become deviations from the expected signal.
    /// `threshold`: on the residual energy, counts²·s. `rails`: the least and the greatest count of
    /// the converter, at or beyond which a sample may be saturated; the first is negative.
    pub fn judge(&self, tile: &mut Tile, threshold: f64, rails: [f64; 2]) -> LaneStatistics {
        self.expectation.subtract(tile);
        let sums = self.square_sums(tile);
        let mut judged = LaneStatistics::unknown();
        for (lane, residual2) in sums.into_iter().enumerate().take(tile.lanes) {
            judged.statistic[lane] = self.dt_s * f64::from(residual2);
            // no norm that can be trusted, or a sample may be saturated: the lane stays unsettled
            let Some(deviation) = self.expectation.deviation(tile, lane, rails) else { continue };
            // settled: even with the largest possible error of |r^| the energy is below the
            // threshold
            let r = f64::from(residual2).sqrt();
            let error = self.of_deviation * deviation.norm
                + self.of_residual * r
                + self.of_expectation * deviation.error;
            let most = r + error;
            judged.settled[lane] = residual2 > LEAST && self.dt_s * most * most < threshold;
        }
        judged
    }

    /// Per lane the square sum of the residual of a tile's deviations, counts²; times dt it is the
    /// energy.
    pub fn square_sums(&self, tile: &Tile) -> [f32; LANES] {
        let mut sums = [0.0; LANES];
        tile::energies(&self.numerator, &self.denominator, &tile.values, &mut sums);
        sums
    }

    /// Bound on ||r^| - |r||, given |d^| and |r^|, at the reference drive and temperature; counts.
    #[cfg(test)]
    fn bound(&self, d: f64, r: f64) -> f64 {
        self.of_deviation * d
            + self.of_residual * r
            + self.of_expectation * self.expectation.error()
    }
}

#[cfg(test)]
#[path = "kernel_tests.rs"]
mod tests;
