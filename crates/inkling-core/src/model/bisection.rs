//! Bisection: finds the place where a condition ceases to hold.

/// Halves the interval from `low`, where `is_below` should hold, to `high`, where it should not,
/// and returns the ends of what is left. `is_below` is never asked at the given ends: if it holds
/// everywhere between them, the second end is still `high`; if nowhere, the first is still `low`.
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
