//! Where a filter's zeros make it blind: the frequencies that it hardly lets into the residual, so
//! that a fault which shows there alone is missed. thesis §3-2-1.
//!
//! In, from `detectable`: a filter. Out: ranges, Hz, in which the gain |N L / alpha| is small.

use nalgebra::Complex;

/// `least`: the share of the largest gain that counts as small; `steps`: frequencies, 2 or more.
pub fn blind_ranges(
    generator: &super::ResidualGenerator,
    least: f64,
    steps: usize,
) -> Vec<(f64, f64)> {
    let half_rate_hz = 0.5 / generator.dt_s;
    let hz = |k: usize| half_rate_hz * k as f64 / (steps - 1) as f64;
    let gain = |k: usize| {
        let z = Complex::new(0.0, std::f64::consts::PI * k as f64 / (steps - 1) as f64).exp();
        let at = |p: &[f64]| {
            p.iter().fold(Complex::new(0.0, 0.0), |v, &c| v * z + Complex::new(c, 0.0)).norm()
        };
        // an undamped pair's gain has no bound: the grid or this floor sets it
        at(&generator.numerator) / at(&generator.denominator).max(1e-6)
    };
    let gains: Vec<f64> = (0..steps).map(gain).collect();
    let largest = gains.iter().copied().fold(0.0, f64::max);
    let is_blind = |k: &usize| gains[*k] < least * largest;

    let frequencies: Vec<usize> = (0..steps).collect();
    let ranges = frequencies.chunk_by(|j, k| is_blind(j) == is_blind(k));
    ranges.filter(|of| is_blind(&of[0])).map(|of| (hz(of[0]), hz(of[of.len() - 1]))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::ResidualGenerator;

    #[test]
    fn the_filter_is_blind_at_an_offset_and_not_at_its_own_resonance() {
        let filter = ResidualGenerator::of_nominal(4.06e5);
        let blind = blind_ranges(&filter, 1e-6, 4096);
        assert_eq!(blind[0].0, 0.0);
        assert!(blind.iter().all(|(from, to)| !(*from..=*to).contains(&64.6e3)));
        assert!(blind_ranges(&filter, 0.0, 4096).is_empty());
    }
}
