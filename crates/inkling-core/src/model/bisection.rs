//! Bisection, for the whole program.

/// What is left of the interval from `low` to `high` after so many halvings: its ends, of which `is_below`
/// holds at the first and ceases to hold before the second.
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
