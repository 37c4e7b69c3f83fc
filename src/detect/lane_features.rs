//! First-order features of many signals at once, in f32, straight from a burst's int16 rows.
//!
//! In: rows, the expected signal of their drive and temperature. Out: four inner products of each deviation. The
//! arithmetic is that of [`super::row_projection`]; its rounding, some 1e-6 of a feature's noise, decides nothing: a
//! signal near a threshold is fitted.

use super::lane_sensitivity::RowCondition;
use super::row_projection::{Rows, in_phases};
use super::tile::{Instructions, LANES, Phases, Sample};

/// ln amplitude, ln damping, ln frequency, phase.
const FEATURES: usize = 4;

#[derive(Clone, Debug)]
pub struct LaneFeatures {
    samples: usize,
    projections: Vec<[Phases; FEATURES]>,
}

impl LaneFeatures {
    /// `projection`: four rows of N, 1/counts. `None`: they are not four.
    pub fn new(projection: &[Vec<f64>]) -> Option<LaneFeatures> {
        let rows: &[Vec<f64>; FEATURES] = projection.try_into().ok()?;
        let of = rows.each_ref().map(|row| in_phases(row.iter().map(|&p| p as f32)));
        let group = |i: usize| std::array::from_fn(|k| of[k][i]);
        Some(LaneFeatures {
            samples: rows[0].len(),
            projections: (0..of[0].len()).map(group).collect(),
        })
    }

    /// Of [`LANES`] consecutive channel-major int16 signals under one condition, feature by feature, relative to the
    /// reference drive.
    pub fn of_rows(
        &self,
        samples: &[u8],
        condition: &RowCondition,
        instructions: Instructions,
    ) -> [Sample; FEATURES] {
        let rows = Rows { samples, n: self.samples, expected: &condition.expected };
        let (mut products, mut squares) = ([[0.0; LANES]; FEATURES], [0.0; LANES]);
        instructions.project_rows(rows, &self.projections, &mut products, &mut squares);
        products.map(|of| of.map(|product| product / condition.drive))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::lane_expectation::LaneExpectation;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn features_are_inner_products_whatever_the_instructions() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(12);
        for n in [128, 77, 16] {
            let mut numbers = |by: f64| -> Vec<f64> {
                (0..n).map(|_| by * rng.random_range(-1.0..1.0)).collect()
            };
            let projection: Vec<Vec<f64>> = (0..FEATURES).map(|_| numbers(1e-3)).collect();
            let expected = numbers(900.0);
            let signals: Vec<Vec<i16>> = (0..LANES)
                .map(|_| numbers(2000.0).into_iter().map(|y| y as i16).collect())
                .collect();
            let samples: Vec<u8> = signals.iter().flatten().flat_map(|y| y.to_le_bytes()).collect();
            let drive = 0.8;
            let condition = RowCondition {
                drive: drive as f32,
                warmer: 0.0,
                expected: LaneExpectation::new(&expected, None).unwrap().at(drive as f32, 0.0),
            };
            let lanes = LaneFeatures::new(&projection).unwrap();
            let mut same = Vec::new();
            for instructions in Instructions::available() {
                let found = lanes.of_rows(&samples, &condition, instructions);
                for (lane, y) in signals.iter().enumerate() {
                    for (row, found) in projection.iter().zip(&found) {
                        let d = y.iter().zip(&expected).map(|(&y, e)| f64::from(y) - drive * e);
                        let want = d.zip(row).map(|(d, p)| d * p).sum::<f64>() / drive;
                        assert!((f64::from(found[lane]) - want).abs() < 1e-4, "{want}");
                    }
                }
                same.push(found.map(|of| of.map(f32::to_bits)));
            }
            assert!(same.windows(2).all(|w| w[0] == w[1]), "bits depend on the instructions");
        }
        assert!(LaneFeatures::new(&[vec![0.0; 4], vec![0.0; 4]]).is_none());
    }
}
