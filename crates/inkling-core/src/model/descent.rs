//! The descent of Levenberg and Marquardt: steps that are damped the more, the less they succeed.
//!
//! In: a start; what a point costs, the slope there (gradient and curvature), and the step that a slope and a
//! damping ask for. Out: the best point that was met, which is never worse than the start.

/// How the damping of steps changes.
pub struct Damping {
    /// Damping of the first step.
    pub first: f64,
    /// Factor after a step that went down, and the least damping.
    pub down: f64,
    pub least: f64,
    /// Factor after a step that did not go down, and the largest damping: beyond it, none will.
    pub up: f64,
    pub most: f64,
}

/// Descends from `start`, and returns the end with its cost.
///
/// `cost` also returns what it has seen at a point, which `slope` is computed from where the point is kept;
/// `None` ends the descent. `step` returns the point that is tried next; `None`: there is none at this damping.
/// `rests` is asked after each step that was taken, by how much it lowered the cost and to what, whether this was the last.
pub fn descend<Point, Seen, Slope>(
    start: Point,
    Damping { first, down, least, up, most }: Damping,
    trials: usize,
    mut cost: impl FnMut(&Point) -> (f64, Seen),
    mut slope: impl FnMut(&Point, Seen) -> Option<Slope>,
    step: impl Fn(&Point, &Slope, f64) -> Option<Point>,
    mut rests: impl FnMut(f64, f64) -> bool,
) -> (Point, f64) {
    let (mut best, seen) = cost(&start);
    let (mut here, mut damping) = (start, first);
    let Some(mut now) = slope(&here, seen) else { return (here, best) };
    for _ in 0..trials {
        let tried = step(&here, &now, damping).map(|trial| (cost(&trial), trial));
        let lower = tried.filter(|((value, _), _)| value.is_finite() && *value <= best);
        let Some(((value, seen), trial)) = lower else {
            damping *= up;
            if damping > most {
                break;
            }
            continue;
        };
        let gained = best - value;
        (best, here) = (value, trial);
        damping = (damping * down).max(least);
        if rests(gained, best) {
            break;
        }
        let Some(next) = slope(&here, seen) else { break };
        now = next;
    }
    (here, best)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: Damping = Damping { first: 1e-3, down: 0.1, least: 1e-12, up: 10.0, most: 1e12 };

    /// ln (1 + x²) bends down far from its minimum: a plain Newton step from there would go the wrong way.
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
        let rests = |gained: f64, now: f64| {
            assert!(gained >= 0.0 && now <= last);
            last = now;
            gained < 1e-15
        };
        let (x, value) = descend(3.0, PLAIN, 200, cost, slope, step, rests);
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
