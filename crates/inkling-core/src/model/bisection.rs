//! Bisection: the place where a condition ceases to hold.

/// Halves the interval from `low` to `high` so many times. `is_below` has to hold at `low`, not to hold at
/// `high`, and to change once between them; then it holds at the first of the ends that are returned and not
/// at the second. If it does not change, one of the ends is still the given one.
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
