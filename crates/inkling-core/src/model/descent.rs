//! The descent of Levenberg and Marquardt, for any problem: steps that are damped the more, the
//! less they succeed. (3-1) has a search of its own (`identify/rate_search.rs`), because of its
//! bounds.
//!
//! In: a start, and functions of the caller: the cost, the slope (whatever the caller needs for a
//! step), the step that a slope and a damping ask for, and when to stop. Out: the last accepted
//! point with its cost, which is never above the start's. A step whose cost is not higher is
//! accepted, and the next one is damped less; any other is discarded, and the same slope is tried
//! again with more damping.

/// How the damping of steps changes. What a damping of 1 means is up to the caller's `step`.
pub struct Damping {
    pub first: f64,
    /// Factor on the damping after an accepted step, below 1, and the least damping.
    pub down: f64,
    pub least: f64,
    /// Factor on the damping after a discarded step, above 1, and the largest damping, beyond which
    /// no step is expected to go down any more: the descent ends.
    pub up: f64,
    pub most: f64,
}

/// `trials` is the largest number of steps that are tried, discarded ones included.
///
/// * `cost`: the cost of a point, and what of its computation serves the slope. A cost that is not
///   finite discards the step.
/// * `slope`: called once for each accepted point. `None` ends the descent.
/// * `step`: the point to try. `None` counts as a discarded step.
/// * `has_converged`: called after each accepted step with the decrease of the cost and the cost.
pub fn descend<Point, Evaluation, Slope>(
    start: Point,
    Damping { first, down, least, up, most }: Damping,
    trials: usize,
    mut cost: impl FnMut(&Point) -> (f64, Evaluation),
    mut slope: impl FnMut(&Point, Evaluation) -> Option<Slope>,
    step: impl Fn(&Point, &Slope, f64) -> Option<Point>,
    mut has_converged: impl FnMut(f64, f64) -> bool,
) -> (Point, f64) {
    let (mut best, evaluation) = cost(&start);
    let (mut here, mut damping) = (start, first);
    let Some(mut now) = slope(&here, evaluation) else { return (here, best) };
    for _ in 0..trials {
        let tried = step(&here, &now, damping).map(|trial| (cost(&trial), trial));
        let lower = tried.filter(|((value, _), _)| value.is_finite() && *value <= best);
        let Some(((value, evaluation), trial)) = lower else {
            damping *= up;
            if damping > most {
                break;
            }
            continue;
        };

        let gained = best - value;
        (best, here) = (value, trial);
        damping = (damping * down).max(least);
        if has_converged(gained, best) {
            break;
        }
        let Some(next) = slope(&here, evaluation) else { break };
        now = next;
    }
    (here, best)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: Damping = Damping { first: 1e-3, down: 0.1, least: 1e-12, up: 10.0, most: 1e12 };

    /// ln (1 + x²) bends down far from its minimum: a plain Newton step from there would go the
    /// wrong way.
    #[test]
    fn it_comes_to_the_minimum_and_never_up() {
        let cost = |x: &f64| ((1.0 + x * x).ln(), ());
        let slope = |x: &f64, ()| {
            let curved = 2.0 * (1.0 - x * x) / (1.0 + x * x).powi(2);
            Some((2.0 * x / (1.0 + x * x), curved.abs()))
        };
        let step = |x: &f64, (gradient, curvature): &(f64, f64), damping: f64| {
            Some(x - gradient / (curvature * (1.0 + damping)))
        };
        let mut last = f64::INFINITY;
        let has_converged = |gained: f64, now: f64| {
            assert!(gained >= 0.0 && now <= last);
            last = now;
            gained < 1e-15
        };
        let (x, value) = descend(3.0, PLAIN, 200, cost, slope, step, has_converged);
        assert!(x.abs() < 1e-6 && value < 1e-12, "{x} {value}");
    }

    #[test]
    fn without_a_slope_a_step_or_a_trial_the_start_is_the_end() {
        let cost = |x: &f64| (x * x, ());
        let downhill = |x: &f64, _: &(), _: f64| Some(0.5 * x);
        let no_step = |_: &f64, _: &(), _: f64| None;
        let never = |_, _| false;
        let some = |_: &f64, ()| Some(());
        let none = |_: &f64, ()| None;
        assert_eq!(descend(3.0, PLAIN, 9, cost, none, downhill, never), (3.0, 9.0));
        assert_eq!(descend(3.0, PLAIN, 9, cost, some, no_step, never), (3.0, 9.0));
        assert_eq!(descend(3.0, PLAIN, 0, cost, some, downhill, never), (3.0, 9.0));
        assert_eq!(descend(3.0, PLAIN, 1, cost, some, downhill, never), (1.5, 2.25));
    }
}
