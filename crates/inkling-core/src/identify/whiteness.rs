//! Whether the misfit of the average is white: the portmanteau test of Ljung and Box (1978).
//! In: what the identified model leaves of the average (N samples, counts). Out: Q = n (n + 2) sum
//! over lags k of r_k² / (n - k), where r_k is the misfit's autocorrelation at lag k, and its p
//! value. In thesis §3-1 the fit is judged by eye, Fig. 3-3.

use crate::model::normal::upper_tail;
use serde::{Deserialize, Serialize};

const MOST_LAGS: usize = 20;

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Whiteness {
    pub ljung_box: f64,
    pub lags: usize,
    /// Probability of so large a Q if the misfit were white.
    pub p_value: f64,
}

/// `fitted`: number of parameters. `None`: the misfit is too short, zero, constant, or not finite.
pub fn whiteness(misfit: &[f64], fitted: usize) -> Option<Whiteness> {
    let n = misfit.len();
    let lags = MOST_LAGS.min(n / 4);
    if lags <= fitted {
        return None;
    }
    let mean = misfit.iter().sum::<f64>() / n as f64;
    let square: f64 = misfit.iter().map(|v| (v - mean).powi(2)).sum();
    if !(square > 0.0 && square.is_finite()) {
        return None;
    }
    let r = |k: usize| -> f64 {
        let products = misfit[k..].iter().zip(misfit).map(|(a, b)| (a - mean) * (b - mean));
        products.sum::<f64>() / square
    };
    let length = n as f64;
    let ljung_box =
        length * (length + 2.0) * (1..=lags).map(|k| r(k).powi(2) / (n - k) as f64).sum::<f64>();
    Some(Whiteness { ljung_box, lags, p_value: chi_square_tail(ljung_box, lags - fitted) })
}

/// P(chi² > q) by Wilson and Hilferty's approximation (1931): the cube root is about normal.
fn chi_square_tail(q: f64, freedom: usize) -> f64 {
    let v = 2.0 / (9.0 * freedom as f64);
    upper_tail(((q / freedom as f64).cbrt() - (1.0 - v)) / v.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::normal::draws;

    #[test]
    fn chi_square_tails_are_the_tables() {
        for (q, freedom, p) in [(31.41, 20, 0.05), (23.68, 14, 0.05), (29.14, 14, 0.01)] {
            let found = chi_square_tail(q, freedom);
            assert!((found - p).abs() < 0.02 * p, "{q} {freedom}: {found}");
        }
    }

    #[test]
    fn white_noise_is_refused_as_often_as_its_p_value_says_and_a_tone_is_always() {
        let mut normal = draws(1);
        let (mut refused, runs) = (0, 1000);
        for _ in 0..runs {
            let mut y: Vec<f64> = (0..128).map(|_| normal()).collect();
            refused += usize::from(whiteness(&y, 0).unwrap().p_value < 0.05);
            y.iter_mut().enumerate().for_each(|(k, v)| *v += 1.5 * (0.4 * k as f64).sin());
            assert!(whiteness(&y, 0).unwrap().p_value < 1e-3);
        }
        // binomial: 50 +- 7; the approximation is a little liberal at 128 samples
        assert!((25..90).contains(&refused), "{refused}");
        assert!(whiteness(&[0.0; 128], 0).is_none() && whiteness(&[1.0, 2.0], 0).is_none());
    }
}
