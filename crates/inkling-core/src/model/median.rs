//! The median and the standard deviation that is derived from it, for values of which a minority
//! may be of faulty signals or channels.

/// The median: for an even number of values the upper of the middle two, for none NaN. Reorders
/// `values`. NaNs count as the largest values.
pub fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let mid = values.len() / 2;
    *values.select_nth_unstable_by(mid, f64::total_cmp).1
}

pub fn median_of(values: impl Iterator<Item = f64>) -> f64 {
    median(&mut values.collect::<Vec<f64>>())
}

/// A robust standard deviation of `values` about `middle`: the median of the absolute deviations
/// times 1.4826, which is right for Gaussian values. For no values it is NaN.
pub fn robust_sd(values: &[f64], middle: f64) -> f64 {
    1.4826 * median_of(values.iter().map(|v| (v - middle).abs()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_lies_on_either_side() {
        assert_eq!(median(&mut [5.0, 1.0, 3.0]), 3.0);
        assert_eq!(median(&mut [4.0, 1.0, 3.0, 2.0]), 3.0);
        assert!(median(&mut []).is_nan());
    }
}
