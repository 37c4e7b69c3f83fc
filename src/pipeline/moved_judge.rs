//! The judge that a printhead's window gave, moved to where most of the printhead's channels are.
//!
//! In: where the channels lie from the ring of the window's model, and the standard deviation of that. Out:
//! the judge in use. It moves in steps, since each move makes a new judge, which costs time.

use inkling_core::design::Judge;
use inkling_core::state::Features;
use std::sync::Arc;

/// Distance, in standard deviations of healthy channels, at which a judge is moved for the first time, and at
/// which it is moved again. The level's own noise is .1 of each feature's.
const FIRST_MOVE: f64 = 0.4;
const NEXT_MOVE: f64 = 0.2;
/// A level counts as surely off if it is off by more than this many standard deviations of its noise: for the
/// first move of a judge, and for a level beyond a bound.
const SURE_SDS: f64 = 4.0;

#[derive(Debug)]
pub(super) struct MovedJudge {
    /// The judge as the window gave it.
    pub window: Arc<Judge>,
    /// The judge in use: the window's, or a moved one.
    pub now: Arc<Judge>,
    /// The features by which the judge in use was moved from the window's ring; 0 if it was not.
    pub by: Features,
}

impl MovedJudge {
    pub fn new(window: Arc<Judge>) -> MovedJudge {
        MovedJudge { now: window.clone(), window, by: Features::zeros() }
    }

    pub fn is_moved(&self) -> bool {
        !Arc::ptr_eq(&self.now, &self.window)
    }

    /// Moves the judge to `wanted` if it is far enough off. `wanted`: where most channels lie from the
    /// window's ring; `sd`: standard deviations of its noise; `healthy_sd`: those of healthy channels;
    /// `moves`: number of moves over all judges of the run, which counts on with this one.
    pub fn follow(
        &mut self,
        wanted: Features,
        sd: Features,
        healthy_sd: &Features,
        moves: &mut u32,
    ) {
        let off = wanted - self.by;
        let is_off = match self.is_moved() {
            true => in_sds(off, healthy_sd) > NEXT_MOVE,
            false => {
                in_sds(off, healthy_sd) > FIRST_MOVE && (off.abs() - SURE_SDS * sd).max() > 0.0
            }
        };
        if is_off {
            *moves = moves.wrapping_add(1);
            // always from the window's judge, so that errors do not add up; where it
            // cannot follow, it is used unmoved
            (self.now, self.by) = match self.window.moved(wanted, *moves) {
                Some(judge) => (Arc::new(judge), wanted),
                None => (self.window.clone(), Features::zeros()),
            };
        }
    }
}

/// Distance of features in standard deviations of healthy channels, over amplitude, damping and frequency.
pub(super) fn in_sds(off: Features, healthy_sd: &Features) -> f64 {
    // the phase goes with the others, or is no matter of ink
    off.component_div(healthy_sd).fixed_rows::<3>(0).norm()
}

/// Whether a level, a natural logarithm, surely lies beyond a relative bound. `sd`:
/// standard deviation of its noise.
pub(super) fn is_beyond(level: f64, sd: f64, bound: f64) -> bool {
    let surely = (level.abs() - SURE_SDS * sd).max(0.0);
    surely.copysign(level).exp_m1().abs() > bound
}
