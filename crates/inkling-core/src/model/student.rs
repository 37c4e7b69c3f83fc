//! Student's t: bounds from few values, whose standard deviation is itself estimated.

use super::normal::normal_quantile;

/// The quantile for 0.5 <= p < 1: closed forms for 1 and 2 degrees of freedom (to which fractions
/// are rounded), else Cornish and Fisher's expansion (Abramowitz and Stegun 26.7.5, without terms
/// from 1 / freedom^4 on), which is rough in the far tail of few degrees of freedom.
pub fn student_quantile(p: f64, freedom: f64) -> f64 {
    if freedom < 1.5 {
        return (std::f64::consts::PI * (p - 0.5)).tan();
    }
    if freedom < 2.5 {
        let d = 2.0 * p - 1.0;
        return d * (2.0 / (1.0 - d * d)).sqrt();
    }
    let z = normal_quantile(p);
    let terms = [
        (z.powi(3) + z) / 4.0,
        (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / 96.0,
        (3.0 * z.powi(7) + 19.0 * z.powi(5) + 17.0 * z.powi(3) - 15.0 * z) / 384.0,
    ];
    terms.iter().rev().fold(0.0, |sum, t| (sum + t) / freedom) + z
}

/// The bound that the next Gaussian value exceeds with probability `share` at most: mean + t sd
/// sqrt(1 + 1/n), or the largest of `values` if that is more; infinite for fewer than two.
pub fn next_exceeds(values: &[f64], share: f64) -> f64 {
    let n = values.len() as f64;
    if values.len() < 2 {
        return f64::INFINITY;
    }
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let bound = mean + student_quantile(1.0 - share, n - 1.0) * (variance * (1.0 + 1.0 / n)).sqrt();
    values.iter().copied().fold(bound, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::normal::draws;

    #[test]
    fn quantiles_agree_with_tables() {
        let tables = [(0.95, 1.0, 6.314), (0.95, 2.0, 2.920), (0.975, 10.0, 2.228)];
        for (p, freedom, t) in tables {
            assert!((student_quantile(p, freedom) / t - 1.0).abs() < 2e-3, "{p} {freedom}");
        }
    }

    #[test]
    fn the_next_value_exceeds_its_bound_as_rarely_as_stated() {
        let mut normal = draws(9);
        for n in [4, 30] {
            let exceeded = (0..20_000)
                .filter(|_| {
                    let seen: Vec<f64> = (0..n).map(|_| normal()).collect();
                    normal() > next_exceeds(&seen, 0.05)
                })
                .count();
            // of few values the largest may lie above the bound
            assert!((500..=1100).contains(&exceeded), "{exceeded} of 20000, {n} values");
        }
        assert_eq!(next_exceeds(&[1.0], 0.1), f64::INFINITY);
    }
}
