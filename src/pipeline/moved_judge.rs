//! The judge of a printhead, moved to where most of the printhead's channels are, for `head`, once per sweep.
//!
//! In: where the channels lie from the ring of the judge's model, and the standard deviation of that. Out: the judge
//! in use. It moves in steps, since each move makes a new judge, which costs time: for the first time beyond
//! `FIRST_MOVE` and surely, then whenever it is off by more than `NEXT_MOVE`.

use inkling_core::design::Judge;
use inkling_core::state::Features;
use std::sync::Arc;

/// Distance, in standard deviations of healthy channels, at which a judge is moved for the first time, and at
/// which it is moved again. The level's own noise is about .1 of each feature's. Heuristic.
const FIRST_MOVE: f64 = 0.4;
const NEXT_MOVE: f64 = 0.2;
/// A level counts as surely off if it is off by more than this many standard deviations of its noise.
const SURE_SDS: f64 = 4.0;

#[derive(Debug)]
pub(super) struct MovedJudge {
    pub unmoved: Arc<Judge>,
    /// The judge in use.
    pub now: Arc<Judge>,
    /// The features by which the judge in use was moved from its model's ring; 0 if it was not.
    pub by: Features,
    /// Standard deviations of healthy channels' features: the unit in which a move is decided.
    healthy_sd: Features,
}

impl MovedJudge {
    pub fn new(unmoved: Arc<Judge>, healthy_sd: Features) -> MovedJudge {
        MovedJudge { now: unmoved.clone(), unmoved, by: Features::zeros(), healthy_sd }
    }

    pub fn is_moved(&self) -> bool {
        !Arc::ptr_eq(&self.now, &self.unmoved)
    }

    /// Moves the judge to `wanted`, where most channels lie from the model's ring, if it is far enough off.
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
            (self.now, self.by) = match self.unmoved.moved(wanted, *moves) {
                Some(judge) => (Arc::new(judge), wanted),
                None => (self.unmoved.clone(), Features::zeros()),
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
