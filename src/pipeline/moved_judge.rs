//! The judge of a printhead's windows, moved to where most of its channels are.
//!
//! In: where these are from the window's ring, and how well that is known. Out: the judge that is in use. It moves in
//! steps, since each move costs a judge.

use inkling_core::design::Judge;
use inkling_core::state::Features;
use std::sync::Arc;

/// Healthy standard deviations that a judge may lie off before it is moved for the first time, and between
/// two moves. The level's own noise is .1 of each feature's.
const FIRST_MOVE: f64 = 0.4;
const NEXT_MOVE: f64 = 0.2;
/// Of its noise, a level lies beyond a bound by at least that much, and a head is moved for the first time.
const SURE_SDS: f64 = 4.0;

#[derive(Debug)]
pub(super) struct MovedJudge {
    /// Of the windows.
    pub window: Arc<Judge>,
    /// By how much it was moved, and what it became.
    moved: Option<(Features, Arc<Judge>)>,
}

impl MovedJudge {
    pub fn new(window: Arc<Judge>) -> MovedJudge {
        MovedJudge { window, moved: None }
    }

    /// The judge in use.
    pub fn now(&self) -> &Arc<Judge> {
        self.moved.as_ref().map_or(&self.window, |(_, judge)| judge)
    }

    pub fn is_moved(&self) -> bool {
        self.moved.is_some()
    }

    /// By how much the judge in use was moved.
    pub fn by(&self) -> Features {
        self.moved.as_ref().map_or(Features::zeros(), |(by, _)| *by)
    }

    /// `wanted`: where most channels are from the window's ring; `sd`: of its noise; `healthy_sd`: of healthy channels;
    /// `moves`: of all judges.
    pub fn follow(
        &mut self,
        wanted: Features,
        sd: Features,
        healthy_sd: &Features,
        moves: &mut u32,
    ) {
        let off = wanted - self.by();
        let is_off = match self.moved {
            Some(_) => in_sds(off, healthy_sd) > NEXT_MOVE,
            None => in_sds(off, healthy_sd) > FIRST_MOVE && (off.abs() - SURE_SDS * sd).max() > 0.0,
        };
        if is_off {
            *moves = moves.wrapping_add(1);
            let judge = self.window.moved(wanted, *moves).map(Arc::new);
            self.moved = judge.map(|judge| (wanted, judge));
        }
    }
}

/// How far features lie off, by the healthy ones' spread.
pub(super) fn in_sds(off: Features, healthy_sd: &Features) -> f64 {
    // the phase goes with the others, or is no matter of ink
    off.component_div(healthy_sd).fixed_rows::<3>(0).norm()
}

/// Whether a logarithm lies surely beyond a relative bound. `sd`: of its noise.
pub(super) fn is_beyond(level: f64, sd: f64, bound: f64) -> bool {
    let surely = (level.abs() - SURE_SDS * sd).max(0.0);
    surely.copysign(level).exp_m1().abs() > bound
}
