//! The normal distribution by published approximations, whose errors stand at each function.

use super::bisection::bisected;

/// Coefficients c_j of ln(erfc(z) e^{z²} / t) = sum c_j t^j with t = 1 / (1 + z/2): the Chebyshev
/// fit of Numerical Recipes (erfcc).
const ERFC: [f64; 10] = [
    -1.265_512_23,
    1.000_023_68,
    0.374_091_96,
    0.096_784_18,
    -0.186_288_06,
    0.278_868_07,
    -1.135_203_98,
    1.488_515_87,
    -0.822_152_23,
    0.170_872_77,
];

/// 1 - Phi(x) = erfc(x / sqrt 2) / 2, with a relative error of at most 1.2e-7 everywhere.
pub fn upper_tail(x: f64) -> f64 {
    let (t, exponent) = half_erfc(x.abs());
    let erfc = t * exponent.exp();
    if x >= 0.0 { erfc / 2.0 } else { 1.0 - erfc / 2.0 }
}

/// ln (1 - Phi(x)), also where 1 - Phi(x) is too small for a floating-point number.
pub fn ln_upper_tail(x: f64) -> f64 {
    let (t, exponent) = half_erfc(x.abs());
    if x >= 0.0 { (t / 2.0).ln() + exponent } else { (-upper_tail(-x)).ln_1p() }
}

/// Upper quantile of chi-squared with three degrees of freedom: 2 Q(sqrt x) + sqrt(2 x / pi)
/// e^(-x/2) with the upper tail Q of the normal distribution is `rate` there.
pub fn chi_squared_3(rate: f64) -> f64 {
    let beyond = |x: f64| {
        2.0 * upper_tail(x.sqrt()) + (2.0 * x / std::f64::consts::PI).sqrt() * (-x / 2.0).exp()
    };
    let [_, high] = bisected(0.0, 200.0, 60, |x| beyond(x) > rate);
    high
}

/// erfc(x / sqrt 2) of an x that is not negative, as (t, exponent): it is t e^exponent.
#[inline(always)] // compiled once per instruction set
pub(crate) fn half_erfc(x: f64) -> (f64, f64) {
    let z = x / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.5 * z);
    let exponent = ERFC.iter().rev().fold(0.0, |sum, c| sum * t + c);
    (t, -z * z + exponent)
}

/// The standard normal quantile, the x with Phi(x) = p, for 0.5 <= p < 1, to 4.5e-4 (Abramowitz and
/// Stegun 26.2.23). At p = 1, where the quantile is infinite, it is 0.
pub fn normal_quantile(p: f64) -> f64 {
    let t = (-2.0 * (1.0 - p).ln()).sqrt();
    let over = 2.515517 + t * (0.802853 + t * 0.010328);
    let under = 1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308));
    (t - over / under).max(0.0)
}

#[cfg(test)]
pub fn draws(seed: u64) -> impl FnMut() -> f64 {
    use rand::{RngExt, SeedableRng};
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    move || rng.sample(rand_distr::StandardNormal)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chi_squared_agrees_with_tables() {
        for (rate, x) in [(0.5, 2.366), (0.05, 7.815), (0.01, 11.345), (0.001, 16.266)] {
            assert!((chi_squared_3(rate) / x - 1.0).abs() < 1e-4, "{rate}");
        }
    }

    #[test]
    fn upper_tail_agrees_with_tables() {
        for (x, p) in [(0.0, 0.5), (1.0, 0.158_655_25), (3.0, 1.349_898e-3), (6.0, 9.865_876e-10)] {
            assert!((upper_tail(x) / p - 1.0).abs() < 1e-6, "{x}");
            assert!((upper_tail(-x) - (1.0 - p)).abs() < 1e-7);
            assert!((ln_upper_tail(x) - p.ln()).abs() < 1e-6, "{x}");
            assert!((ln_upper_tail(-x) - (1.0 - p).ln()).abs() < 1e-6, "{x}");
        }
    }

    #[test]
    fn the_logarithm_of_a_tail_goes_on_where_the_tail_is_no_number() {
        // the first terms of the asymptotic series
        let x: f64 = 60.0;
        let series = -x * x / 2.0 - (x * std::f64::consts::TAU.sqrt()).ln() - 1.0 / (x * x);
        assert!((ln_upper_tail(x) - series).abs() < 1e-5, "{}", ln_upper_tail(x));
    }

    #[test]
    fn quantiles_agree_with_tables() {
        for (p, z) in [(0.95, 1.6449), (0.975, 1.96), (0.999, 3.0902)] {
            assert!((normal_quantile(p) - z).abs() < 5e-4, "{p}");
        }
    }
}
