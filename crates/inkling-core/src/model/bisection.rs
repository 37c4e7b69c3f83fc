//! Bisection: finds the place where a condition ceases to hold. Thresholds, detection limits and
//! quantiles are found by it.

/// Halves the interval from `low` to `high` `halvings` times, and returns the two ends of the
/// interval that is left; its length is (high - low) / 2^halvings.
///
/// `is_below` should hold at `low`, not hold at `high`, and change once between the two. Then
/// `is_below` holds at the first end that is returned and not at the second. `is_below` is never
/// asked at `low` and `high` themselves: if it holds everywhere between them, the second end is
/// still the given `high`; if it holds nowhere, the first end is still the given `low`.
pub fn bisected(
    mut low: f64,
    mut high: f64,
    halvings: usize,
    is_below: impl Fn(f64) -> bool,
) -> [f64; 2] {
    for _ in 0..halvings {
        let middle = 0.5 * (low + high);
        if is_below(middle) { low = middle } else { high = middle }
    }
    [low, high]
}
