//! Channels' own baselines in passes of their own before the stages: the form that asks nothing of the file's order.
//!
//! In: a recording, its schedule. Out: the baselines in use and those for the next recording; the same as in the
//! stream ([`super::hearing`]), by the same functions.

use super::baseline::{HeardOf, InUse, Learned, Remembered};
use super::beginning;
use super::hearing::Hearing;
use super::schedule::{Assignment, Schedule};
use super::statistics::Statistics;
use super::{Control, PipelineError, visit};
use crate::burst::{Acquisition, Burst};
use crate::io::recording::Recording;

/// Learns from a recording: what the first window says of channels that are not remembered, then what all of it says,
/// judged by both. With a design that has no sensitivities nothing is learned.
pub fn learn(
    remembered: &Remembered,
    recording: &Recording,
    schedule: &mut Schedule,
    rails: [f64; 2],
    control: &Control,
) -> Result<(InUse, Learned), PipelineError> {
    let in_use = InUse::default();
    let starts = beginning::starts(recording, control)?;
    starts.keys().for_each(|printhead| remembered.begin(printhead, &in_use));
    let end =
        |printhead: &str| starts.get(printhead).map_or(i64::MAX, |start| remembered.end_ns(*start));
    let mut pass = Pass { recording, schedule, rails, control, room: remembered.room() };
    let first = pass.hear(&in_use, |burst| burst.t_acq_ns < end(&burst.printhead))?;
    for (printhead, told) in &first {
        remembered.end(printhead, end(printhead), told, &in_use);
    }
    let all = pass.hear(&in_use, |_| true)?;
    let learned = remembered.learn(&all, &in_use);
    Ok((in_use, learned))
}

struct Pass<'a, 's> {
    recording: &'a Recording,
    schedule: &'a mut Schedule<'s>,
    rails: [f64; 2],
    control: &'a Control,
    room: usize,
}

impl Pass<'_, '_> {
    /// Takes the bursts that `want` chooses.
    fn hear(
        &mut self,
        in_use: &InUse,
        want: impl Fn(&Burst) -> bool,
    ) -> Result<HeardOf, PipelineError> {
        let hearing = Hearing::new(in_use, Some(self.room));
        let mut listener = hearing.listener();
        let (mut statistics, mut statistic) = (Statistics::new(self.rails), Vec::new());
        let mut failed = None;
        visit::all(self.recording, self.control, |burst| {
            if !want(burst) {
                return;
            }
            let judge = match self.schedule.assign(burst) {
                Assignment::Model(number) => match self.schedule.judge(number) {
                    Ok(judge) => judge,
                    Err(e) => return failed = Some(e),
                },
                Assignment::Survey => return failed = Some(PipelineError::NeedsSurvey),
                Assignment::Reject(_) => return,
            };
            let (acquisition, judge) = ([Acquisition::Usable(burst.clone())], [Ok(judge)]);
            statistics.of(&acquisition, &judge, &mut statistic);
            listener.judge(&acquisition, &judge, &[], &mut statistics, &mut statistic);
        })?;
        failed.map_or_else(|| Ok(hearing.all()), Err)
    }
}
