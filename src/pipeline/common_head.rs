//! A printhead whose channels all move alike, sweep by sweep, where no state is kept of it: healthy windows come too late
//! for ink that warms up unrecorded, for a supply that sags.
//!
//! In: its sweeps, with the judge that the windows gave them. Out: the same judge, moved to where most of the channels
//! are ([`inkling_core::identify::common_change`]); a warning where it moved beyond the bounds of `[identify]`. Models,
//! thresholds and what is written of them stay.

use super::batches::AssignedJudge;
use super::head::{Judging, LookBuffers, Watched};
use super::head_movement::HeadMovement;
use super::level_history::LevelHistory;
use super::moved_judge::{MovedJudge, in_sds, is_beyond};
use super::sweep::{Sweep, channels};
use inkling_core::burst::Burst;
use inkling_core::design::{HealthyModel, Judge, OwnChannels, farthest_leap};
use inkling_core::identify::common_change::{Change, CommonChange, Leaps};
use inkling_core::model::median::median;
use inkling_core::verdict::{Reason, unusable_signal};
use std::sync::Arc;

/// Of the bounds, what all channels may leap by at once and still be moved by ink, where bursts hold faults alone.
const LEAP_AMONG_FAULTS: f64 = 1.5;
/// So far (ln amplitude, ln damping, ln frequency, phase) ink and supply may move all channels together; beyond,
/// they are no longer what the models know.
const FARTHEST: [f64; 4] = [0.5, 0.5, 0.05, 0.5];
/// After so many sweeps without a common change signals far from the model are no longer fitted: they are faults.
const MOST_UNKNOWN: u32 = 64;
/// So many channels at least, and this share of those that are looked at, must agree on a place beyond the bounds to within so
/// many healthy standard deviations, in so many sweeps in a row: then it is another head, and its signals are rejected. Tried on
/// heads whose frequency was 1.5 to 12 % off: a share of .8 does not tell one of those of 3 %.
const FEWEST: usize = 5;
const MOST_ALIKE: f64 = 0.6;
const AGREE: f64 = 4.0;
const IN_A_ROW: u32 = 8;

#[derive(Debug)]
pub(super) struct CommonHead {
    change: CommonChange,
    /// Looks at the sweep in hand, from the base; and sweeps in a row in which they agreed on a place that no ink and no supply
    /// brings them to.
    looks: Vec<Change>,
    sweeps_far_off: u32,
    /// What its features are measured from, and how far that lies from where the bounds are.
    base: Arc<Judge>,
    base_at: Change,
    /// The judge in use, and the features of its window's ring from the base's.
    judge: MovedJudge,
    window_at: Change,
    /// Common changes of late, and their mean in that window: what counts is how far they are from there.
    history: LevelHistory,
    in_window: Change,
    /// Sweeps since a common change was known.
    unknown: u32,
    pub movement: HeadMovement,
}

impl CommonHead {
    /// `named`: the design's model of it. `None`: its channels cannot be followed.
    pub fn meet(
        printhead: Arc<str>,
        named: Option<&HealthyModel>,
        history: LevelHistory,
        judge: &Arc<Judge>,
        bounds: [f64; 2],
    ) -> Option<CommonHead> {
        let healthy_sd = judge.healthy_sd()?;
        let most = farthest_leap(bounds);
        let [damping, frequency] = bounds.map(|bound| LEAP_AMONG_FAULTS * bound.ln_1p());
        let leaps = Leaps { most, among_faults: Change::new(damping, damping, frequency, most[3]) };
        let base_at = named.and_then(|of| judge.model.features_from(of)).unwrap_or_default();
        Some(CommonHead {
            change: CommonChange::new(history.window_of(&judge.model), healthy_sd, leaps),
            looks: Vec::new(),
            sweeps_far_off: 0,
            base: judge.clone(),
            base_at,
            judge: MovedJudge::new(judge.clone()),
            window_at: Change::zeros(),
            history,
            in_window: Change::zeros(),
            unknown: 0,
            movement: HeadMovement::new(printhead),
        })
    }

    /// A sweep is over: judged about where it shows most channels.
    pub fn close(&mut self, sweep: &Sweep, watched: &Watched, by: &mut Judging) -> AssignedJudge {
        if self.judge.window.index != sweep.judge.index {
            self.window_is(&sweep.judge);
        }
        self.looks.clear();
        sweep.bursts().into_iter().for_each(|burst| self.look(burst, watched, by));
        let judge = self.judged_by(sweep.to_ns(), by);
        let frozen = watched.frozen.channels();
        let own = (!frozen.is_empty()).then(|| Arc::new(OwnChannels::of_frozen(frozen)));
        let judge = if self.is_another() { Err(Reason::HeadChanged) } else { Ok(judge) };
        AssignedJudge { judge, own }
    }

    /// Whether most channels have been for a while where no ink and no supply brings them.
    fn is_another(&self) -> bool {
        self.sweeps_far_off >= IN_A_ROW
    }

    fn window_is(&mut self, judge: &Arc<Judge>) {
        self.judge = MovedJudge::new(judge.clone());
        if self.change.is_lost() && !self.is_another() {
            // where most channels are by now is what this window says
            let (window, healthy) = (self.history.window_of(&judge.model), self.change.healthy());
            self.change = self.change.anew(window, healthy);
            let from_base = judge.model.features_from(&self.base.model);
            self.base_at += from_base.unwrap_or_default();
            (self.base, self.window_at) = (judge.clone(), Change::zeros());
            (self.history, self.in_window) = (self.history.emptied(), Change::zeros());
            return;
        }
        // a judge whose ring is unknown stays where it is
        let at = judge.model.features_from(&self.base.model);
        self.window_at = at.unwrap_or(self.window_at);
        let in_window = judge.model.valid_from_ns.and_then(|to_ns| self.history.mean_before(to_ns));
        self.in_window = in_window.unwrap_or(self.window_at);
    }

    /// Looks at some of a burst's channels, always the same ones.
    fn look(&mut self, burst: &Burst, watched: &Watched, by: &mut Judging) {
        let Judging { rails, work: LookBuffers { signal, expected, work }, .. } = by;
        let mut looked_at = watched.channels.of(channels(burst), 0).peekable();
        if looked_at.peek().is_none() {
            return;
        }
        let (at, judge) = (self.window_at + self.judge.by(), self.judge.now().clone());
        let n = burst.samples_per_channel as usize;
        signal.resize(n, 0.0);
        expected.resize(n, 0.0);
        judge.expect(burst, expected);
        let drive = judge.drive(burst);
        let far = self.unknown < MOST_UNKNOWN || self.is_another();
        for channel in looked_at {
            let row = (channel - burst.first_channel) as usize;
            burst.copy_signal(row, signal);
            if unusable_signal(signal, *rails).is_some() {
                continue;
            }
            if watched.frozen.is_frozen(channel) {
                continue;
            }
            judge.deviate(burst, row, expected, signal);
            let found = judge
                .features(signal, drive, far, work)
                .filter(|x| x.iter().all(|v| v.is_finite()));
            if let Some(features) = found {
                self.change.look(burst.t_acq_ns, channel, features + at);
                self.looks.push(features + at);
            }
        }
    }

    /// Where most looks at a sweep agree to be, if that is beyond the bounds and not where all channels were `followed` to.
    fn far_off(&self, followed: Option<Change>, bounds: [f64; 2]) -> Option<Change> {
        if self.looks.len() < FEWEST {
            return None;
        }
        let healthy_sd = self.change.healthy();
        let column = |k: usize| self.looks.iter().map(|look| look[k]).collect::<Vec<f64>>();
        let middle = Change::from_fn(|k, _| median(&mut column(k)));
        let is_near = |look: &Change| in_sds(look - middle, &healthy_sd) < AGREE;
        let near = self.looks.iter().filter(|look| is_near(look)).count();
        let told = middle + self.base_at;
        let is_beyond = (1..3).any(|k| told[k].exp_m1().abs() > bounds[k - 1])
            || [0, 3].into_iter().any(|k| told[k].abs() > FARTHEST[k]);
        let agree = near as f64 >= MOST_ALIKE * self.looks.len() as f64;
        let is_there = |at: &Change| is_near(at) && (at[3] - middle[3]).abs() <= FARTHEST[3];
        (agree && is_beyond && !followed.as_ref().is_some_and(is_there)).then_some(told)
    }

    /// The judge of a sweep whose channels were looked at.
    fn judged_by(&mut self, t_ns: i64, by: &mut Judging) -> Arc<Judge> {
        let bounds = by.bounds;
        let change = self.change.change(t_ns);
        match self.far_off(change, bounds) {
            Some(told) => {
                self.sweeps_far_off = self.sweeps_far_off.saturating_add(1);
                if self.is_another() {
                    self.movement.is_strange(t_ns, told);
                }
            }
            None => self.sweeps_far_off = 0,
        }
        let Some(change) = change else {
            self.judge.back();
            self.unknown = self.unknown.saturating_add(1);
            return self.judge.window.clone();
        };
        self.unknown = 0;
        self.history.push(t_ns, change);
        let (told, sd) = (change + self.base_at, self.change.sd());
        if (1..3).any(|k| is_beyond(told[k], sd[k], bounds[k - 1])) {
            self.movement.is_beyond(t_ns);
        }
        if (0..4).any(|k| change[k].abs() > FARTHEST[k]) {
            return self.judge.window.clone();
        }
        self.movement.reaches(&told);
        let wanted = change - self.in_window;
        self.judge.follow(wanted, sd, &self.change.healthy(), &mut by.moves);
        self.movement.bursts += u64::from(self.judge.is_moved());
        self.judge.now().clone()
    }
}
