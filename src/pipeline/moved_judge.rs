//! The judge that a printhead's window gave, moved to where most of the printhead's channels are, for `head`,
//! once per sweep.
//!
//! [`MovedJudge`]. In: where the channels lie from the ring of the window's model, and the standard deviation
//! of that. Out: the judge in use. It moves in steps, since each move makes a new judge, which costs time: for
//! the first time beyond `FIRST_MOVE` and surely, then whenever it is off by more than `NEXT_MOVE`.
//!
//! [`LevelHistory`]. In: the head's level, sweep by sweep. Out: its mean over the time of a window, which says
//! where the window's model lies where the model itself cannot (it does not ring).

use inkling_core::design::Judge;
use inkling_core::state::Features;
use std::collections::VecDeque;
use std::sync::Arc;

/// Distance, in standard deviations of healthy channels, at which a judge is moved for the first time, and at
/// which it is moved again. The level's own noise is about .1 of each feature's. Heuristic.
const FIRST_MOVE: f64 = 0.4;
const NEXT_MOVE: f64 = 0.2;
/// A level counts as surely off if it is off by more than this many standard deviations of its noise.
const SURE_SDS: f64 = 4.0;

#[derive(Debug)]
pub(super) struct MovedJudge {
    pub window: Arc<Judge>,
    /// The judge in use: the window's, or a moved one.
    pub now: Arc<Judge>,
    /// The features by which the judge in use was moved from the window's ring; 0 if it was not.
    pub by: Features,
    /// Standard deviations of healthy channels' features: the unit in which a move is decided.
    healthy_sd: Features,
}

impl MovedJudge {
    pub fn new(window: Arc<Judge>, healthy_sd: Features) -> MovedJudge {
        MovedJudge { now: window.clone(), window, by: Features::zeros(), healthy_sd }
    }

    pub fn take(&mut self, window: Arc<Judge>) {
        *self = MovedJudge::new(window, self.healthy_sd);
    }

    pub fn is_moved(&self) -> bool {
        !Arc::ptr_eq(&self.now, &self.window)
    }

    /// Moves the judge to `wanted`, where most channels lie from the window's ring, if it is far enough off.
    /// `sd`: standard deviations of the noise of `wanted`; `moves`: number of moves of all judges of the run.
    pub fn follow(&mut self, wanted: Features, sd: Features, moves: &mut u32) {
        let off = wanted - self.by;
        // the phase is left out: it changes with the others, or by something else than ink
        let sds = off.component_div(&self.healthy_sd).fixed_rows::<3>(0).norm();
        // once moved, the judge follows smaller changes, so that it does not jump at the first bound
        let is_off = match self.is_moved() {
            true => sds > NEXT_MOVE,
            false => sds > FIRST_MOVE && (off.abs() - SURE_SDS * sd).max() > 0.0,
        };
        if is_off {
            *moves = moves.wrapping_add(1);
            // always from the window's judge, so that errors do not add up; where it cannot, unmoved
            (self.now, self.by) = match self.window.moved(wanted, *moves) {
                Some(judge) => (Arc::new(judge), wanted),
                None => (self.window.clone(), Features::zeros()),
            };
        }
    }
}

/// Whether a level, a natural logarithm of a ratio, surely lies beyond a relative bound, that is even if its
/// noise made it `SURE_SDS` too large. `sd`: standard deviation of the noise.
pub(super) fn is_beyond(level: f64, sd: f64, bound: f64) -> bool {
    let surely = (level.abs() - SURE_SDS * sd).max(0.0);
    surely.copysign(level).exp_m1().abs() > bound
}

/// Number of stretches that the length of a window is divided into; levels are averaged within each.
const STRETCHES: i64 = 16;

/// The levels of a head in the recent past, averaged over stretches of time, so that memory is bounded.
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
    /// Number of levels (one per sweep) in `sum`.
    bursts: f64,
}

impl LevelHistory {
    pub(super) fn new(window_s: f64) -> LevelHistory {
        let window_ns = ((1e9 * window_s) as i64).max(STRETCHES);
        LevelHistory { window_ns, stretches: VecDeque::new() }
    }

    /// Adds the level of a sweep at `t_ns`, counted from the head's base ring.
    pub(super) fn push(&mut self, t_ns: i64, change: Features) {
        let open = |s: &&mut Stretch| t_ns.saturating_sub(s.from_ns) < self.window_ns / STRETCHES;
        match self.stretches.back_mut().filter(open) {
            Some(last) => {
                last.sum += change;
                last.bursts += 1.0;
            }
            None => self.stretches.push_back(Stretch { from_ns: t_ns, sum: change, bursts: 1.0 }),
        }
        // a window's model is known only some time after the window's end: twice its length is kept
        while self.stretches.len() > 2 * STRETCHES as usize {
            self.stretches.pop_front();
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.stretches.is_empty()
    }

    /// Mean level over the window that ended at `to_ns`. `None`: no level was known in the window.
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
