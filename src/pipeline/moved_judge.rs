//! The judge of a printhead, moved to where most of the printhead's channels are and to their temperature, for `head`,
//! once per sweep.
//!
//! In: where the channels lie from the ring of the judge's model, the standard deviation of that, and the recorded
//! temperature. Out: the judge in use. It moves in steps, since each move makes a new judge, which costs time: for the
//! first time beyond `FIRST_MOVE` and surely, then whenever it is off by more than `NEXT_MOVE`; and whenever temperature
//! has moved the ring by more than `WARMER_MOVE`, up to which its linear effect suffices.

use inkling_core::design::Judge;
use inkling_core::state::Features;
use std::sync::Arc;

/// Distance, in standard deviations of healthy channels, at which a judge is moved for the first time, and at
/// which it is moved again. The level's own noise is about .1 of each feature's. Heuristic.
const FIRST_MOVE: f64 = 0.4;
const NEXT_MOVE: f64 = 0.2;
/// The same for what a temperature does that was recorded. By the figures of `moved_model.rs`, a channel that lies one
/// standard deviation off in frequency is then read a fifth of one off in damping. Heuristic.
const WARMER_MOVE: f64 = 1.0;
/// A level counts as surely off if it is off by more than this many standard deviations of its noise.
const SURE_SDS: f64 = 4.0;

#[derive(Debug)]
pub(super) struct MovedJudge {
    pub unmoved: Arc<Judge>,
    /// The judge in use.
    pub now: Arc<Judge>,
    /// The features by which the judge in use was moved from its model's ring; 0 if it was not.
    pub by: Features,
    /// How many K above its model's reference temperature the judge in use lies, and what a K changes.
    warmer: f64,
    per_k: Features,
    /// Standard deviations of healthy channels' features: the unit in which a move is decided.
    healthy_sd: Features,
}

impl MovedJudge {
    pub fn new(unmoved: Arc<Judge>, healthy_sd: Features) -> MovedJudge {
        let per_k = unmoved.features_per_k();
        let by = Features::zeros();
        MovedJudge { now: unmoved.clone(), unmoved, by, warmer: 0.0, per_k, healthy_sd }
    }

    /// Whether its channels, and not only their temperature, have moved it.
    pub fn is_moved(&self) -> bool {
        self.by != Features::zeros()
    }

    /// Moves the judge to `warmer` K above its model's reference temperature, if it is far enough from there.
    /// `moves`: number of moves of all judges of the run.
    pub fn heat(&mut self, warmer: f64, moves: &mut u32) {
        if self.sds((warmer - self.warmer) * self.per_k) > WARMER_MOVE {
            self.move_to(self.by, warmer, moves);
        }
    }

    /// Moves the judge to `wanted`, where most channels lie from the model's ring, if it is far enough off.
    /// `sd`: standard deviations of the noise of `wanted`; `moves`: number of moves of all judges of the run.
    pub fn follow(&mut self, wanted: Features, sd: Features, moves: &mut u32) {
        let off = wanted - self.by;
        // once moved, the judge follows smaller changes, so that it does not jump at the first bound
        let is_off = match self.is_moved() {
            true => self.sds(off) > NEXT_MOVE,
            false => self.sds(off) > FIRST_MOVE && (off.abs() - SURE_SDS * sd).max() > 0.0,
        };
        if is_off {
            self.move_to(wanted, self.warmer, moves);
        }
    }

    /// The size of a change in standard deviations of healthy channels. The phase is left out: it changes with the
    /// others, or by something else than ink.
    fn sds(&self, off: Features) -> f64 {
        off.component_div(&self.healthy_sd).fixed_rows::<3>(0).norm()
    }

    /// Always from the model's own judge, so that errors do not add up; where it cannot, the judge is unmoved.
    fn move_to(&mut self, by: Features, warmer: f64, moves: &mut u32) {
        *moves = moves.wrapping_add(1);
        (self.now, self.by, self.warmer) = match self.unmoved.moved(by, warmer, *moves) {
            Some(judge) => (Arc::new(judge), by, warmer),
            None => (self.unmoved.clone(), Features::zeros(), 0.0),
        };
    }
}

/// Whether a level, a natural logarithm of a ratio, surely lies beyond a relative bound, that is even if its
/// noise made it `SURE_SDS` too large. `sd`: standard deviation of the noise.
pub(super) fn is_beyond(level: f64, sd: f64, bound: f64) -> bool {
    let surely = (level.abs() - SURE_SDS * sd).max(0.0);
    surely.copysign(level).exp_m1().abs() > bound
}
