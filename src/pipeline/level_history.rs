//! Remembers how far a printhead's channels had moved together in the recent past.
//!
//! In: the level, sweep by sweep. Out: its mean over the time of a window, which says where the window's
//! model lies where the model itself cannot.

use inkling_core::state::Features;
use std::collections::VecDeque;

/// Number of stretches that the length of a window is divided into; levels are averaged within each.
const STRETCHES: i64 = 16;

#[derive(Clone, Debug)]
pub(super) struct LevelHistory {
    window_ns: i64,
    /// In the order of time; the last one is still filled.
    stretches: VecDeque<Stretch>,
}

#[derive(Clone, Copy, Debug)]
struct Stretch {
    from_ns: i64,
    sum: Features,
    /// Number of levels in `sum`.
    bursts: f64,
}

impl LevelHistory {
    pub(super) fn new(window_s: f64) -> LevelHistory {
        let window_ns = ((1e9 * window_s) as i64).max(STRETCHES);
        LevelHistory { window_ns, stretches: VecDeque::new() }
    }

    /// Adds the level of a sweep at `t_ns`.
    pub(super) fn push(&mut self, t_ns: i64, change: Features) {
        let open = |s: &&mut Stretch| t_ns.saturating_sub(s.from_ns) < self.window_ns / STRETCHES;
        match self.stretches.back_mut().filter(open) {
            Some(last) => {
                last.sum += change;
                last.bursts += 1.0;
            }
            None => self.stretches.push_back(Stretch { from_ns: t_ns, sum: change, bursts: 1.0 }),
        }
        // a window's model is known only some bursts after the window's end, so twice its length is kept
        while self.stretches.len() > 2 * STRETCHES as usize {
            self.stretches.pop_front();
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.stretches.is_empty()
    }

    /// Mean level over the window that ended at `to_ns`. `None`: no level was known in it.
    pub(super) fn mean_before(&self, to_ns: i64) -> Option<Features> {
        let from_ns = to_ns.saturating_sub(self.window_ns);
        let within = self.stretches.iter().filter(|s| (from_ns..to_ns).contains(&s.from_ns));
        let (sum, bursts) = within
            .fold((Features::zeros(), 0.0), |(sum, bursts), s| (sum + s.sum, bursts + s.bursts));
        (bursts > 0.0).then(|| sum / bursts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_is_that_of_the_window() {
        let mut history = LevelHistory::new(20.0);
        let second = 1_000_000_000;
        // sweeps a tenth of a second apart, with a level that grows by 1 per second
        for t in 0..1000 {
            let t_s = f64::from(t) / 10.0;
            history.push(i64::from(t) * second / 10, Features::new(t_s, 0.0, -t_s, 0.0));
        }
        let mean = history.mean_before(90 * second).unwrap();
        assert!((mean[0] - 80.0).abs() < 0.7 && (mean[2] + 80.0).abs() < 0.7, "{mean}");
        assert!(history.mean_before(40 * second).is_none());
        assert!(history.stretches.len() <= 2 * STRETCHES as usize);
    }
}
