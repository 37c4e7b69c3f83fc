//! Small statistical tools of this room: how surprising a statistic is and must be; intervals by resampling;
//! and where a likelihood is largest, and how wide it is there.
//!
//! A *surprise* is -ln of the probability by chance, corrected for the number of tries, and at least 0. It is
//! used in place of the probability, which may be too small for a floating-point number.

use inkling_core::model::bisection::bisected;
use inkling_core::model::normal::ln_upper_tail;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// -ln of the probability that one candidate passes on data of the model itself: once in 4000. So one of 22
/// independent candidates passes in about half a per cent of such data.
pub const THRESHOLD: f64 = 8.3;
/// Below this surprise a candidate is not examined further.
pub const HINT: f64 = THRESHOLD / 2.0;
/// The same of the tests without the catalogue, all of one kind together: one in 1000.
const WITHOUT_A_NAME: f64 = 6.9;
/// The normal deviate whose magnitude is exceeded once in 100.
pub const ONCE_IN_100: f64 = 2.576;
/// Noncentrality of a chi-squared statistic at one detection limit: it is found with a probability of 90 % by
/// a test of one degree of freedom and size 0.001.
pub const DETECTION_LIMIT: f64 = 20.9;

/// -ln p of a chi-squared statistic with so many `degrees` of freedom, where p is multiplied by the number of
/// independent tries, `tried`. `dof`: degrees of freedom with which the statistic's scale was estimated, so
/// that it is a squared Student's t; infinite where the scale is known.
pub fn surprise(statistic: f64, degrees: usize, tried: f64, dof: f64) -> f64 {
    let x = statistic.max(0.0);
    let x = if dof.is_finite() {
        // t² with dof degrees of freedom as the chi-squared of the same probability, Wallace 1959
        dof * (1.0 + x / dof).ln() * ((dof - 0.5) / dof).max(0.1)
    } else {
        x
    };
    let ln_p = match degrees {
        1 => ln_upper_tail(x.sqrt()) + 2f64.ln(),
        2 => -x / 2.0,
        q => ln_upper_tail(normal_deviate(x / q as f64, q as f64)),
    };
    (-ln_p - tried.ln()).max(0.0)
}

/// Chi-squared over its degrees of freedom as a normal deviate: the cube root is nearly normal (Wilson and Hilferty
/// 1931).
pub fn normal_deviate(ratio: f64, degrees: f64) -> f64 {
    let third = 2.0 / (9.0 * degrees);
    (ratio.max(1e-9).cbrt() - (1.0 - third)) / third.sqrt()
}

/// -ln of the probability of `found` or more cases where fewer are expected, by the largest term of Poisson's
/// sum, e^-expected expected^found / found!; 0 where as many or more are expected.
pub fn surprise_of_count(found: f64, expected: f64) -> f64 {
    let ln_factorial: f64 = (1..=found as u32).map(|k| f64::from(k).ln()).sum();
    if found > expected { expected - found * expected.ln() + ln_factorial } else { 0.0 }
}

/// How surprising one of `looks` tests without the catalogue must be.
pub fn without_a_name(looks: f64) -> f64 {
    WITHOUT_A_NAME + looks.max(1.0).ln()
}

/// The statistic at which `surprise`, which must grow with the statistic, reaches `asked`, by bisection.
pub fn statistic_of(asked: f64, surprise: impl Fn(f64) -> f64) -> f64 {
    let reaches = |statistic: f64| surprise(statistic) > asked;
    let [_, high] = bisected(0.0, 4.0 * asked + 2000.0, 60, |statistic| !reaches(statistic));
    high
}

/// Interval that holds 95 % of the values, which it sorts.
pub fn interval(values: &mut [f64]) -> Option<[f64; 2]> {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
    (!values.is_empty()).then(|| [at(0.025), at(0.975)])
}

const RESAMPLINGS: usize = 200;

/// What `of` makes of all groups' members together, and (bootstrap) of each drawing of as many groups as there
/// are, with repetition.
pub fn resampled<T>(groups: &[Vec<usize>], seed: u64, of: impl Fn(&[usize]) -> T) -> (T, Vec<T>) {
    let of_groups = |chosen: &[usize]| {
        of(&chosen.iter().flat_map(|k| &groups[*k]).copied().collect::<Vec<usize>>())
    };
    let all: Vec<usize> = (0..groups.len()).collect();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut draw = || all.iter().map(|_| rng.random_range(0..groups.len())).collect::<Vec<usize>>();
    (of_groups(&all), (0..RESAMPLINGS).map(|_| of_groups(&draw())).collect())
}

/// The 95 % interval of one of several figures that were computed from the same drawings.
pub fn interval_of<const N: usize>(drawn: &[[f64; N]], which: usize) -> Option<[f64; 2]> {
    interval(&mut drawn.iter().map(|of| of[which]).collect::<Vec<f64>>())
}

/// Where a function that is unimodal within `reach` of `near` is largest, by golden section.
pub fn maximum(f: impl Fn(f64) -> f64, near: f64, reach: f64) -> f64 {
    let golden = 0.618_034;
    let (mut low, mut high) = (near - reach, near + reach);
    let (mut p, mut q) = (high - golden * (high - low), low + golden * (high - low));
    let (mut fp, mut fq) = (f(p), f(q));
    for _ in 0..18 {
        if fp > fq {
            (high, q, fq) = (q, p, fp);
            p = high - golden * (high - low);
            fp = f(p);
        } else {
            (low, p, fp) = (p, q, fq);
            q = low + golden * (high - low);
            fq = f(q);
        }
    }
    0.5 * (low + high)
}

/// Standard deviation of a parameter, from the curvature of twice the log-likelihood `f` at its maximum `at`:
/// a normal likelihood falls in `f` by (h/sd)² at the distance h. `step`: the first h that is tried; it is
/// adapted until the drop lies between .5 and 4, in 12 trials at most.
pub fn width(f: impl Fn(f64) -> f64, at: f64, step: f64) -> f64 {
    let mut h = step;
    let top = f(at);
    for _ in 0..12 {
        let drop = top - 0.5 * (f(at - h) + f(at + h));
        if drop > 0.5 && drop < 4.0 {
            return h / drop.sqrt();
        }
        h *= if drop <= 0.5 { 1.7 } else { 0.5 };
    }
    h
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surprise_is_minus_the_logarithm_of_known_probabilities() {
        for (statistic, degrees, dof, p, within) in [
            // two-sided normal, and chi-squared with 2 degrees of freedom
            (1.96_f64.powi(2), 1, f64::INFINITY, 0.05_f64, 1e-3),
            (3.2905_f64.powi(2), 1, f64::INFINITY, 0.001, 2e-3),
            (9.21, 2, f64::INFINITY, 0.01, 1e-3),
            // Student's t with 20 degrees of freedom
            (2.086_f64.powi(2), 1, 20.0, 0.05, 0.05),
            (3.850_f64.powi(2), 1, 20.0, 0.001, 0.12),
        ] {
            let off = surprise(statistic, degrees, 1.0, dof) + p.ln();
            assert!(off.abs() < within, "{statistic}: {off}");
        }
    }
}
