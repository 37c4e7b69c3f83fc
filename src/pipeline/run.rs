//! Sends one recording through the six stages, and decides how its models come to be: in one pass or in two.

use super::identified::Identified;
pub use super::job::Run;

use super::PipelineError;
use super::learner::Learner;
use super::learning::{Learning, MOST_REORDER_NS, USUAL_REORDER_NS};
use super::models::Models;
use super::recording_report::RecordingReport;
use super::schedule::Schedule;
use super::timings::Phases;
use super::wiring::StageResults;
use std::sync::atomic::Ordering;
use std::time::Instant;

impl<'a> Run<'a> {
    /// Judges the recording in one pass where its order allows that, else in two. A recording that is still
    /// being written cannot be read in two passes: that is an error.
    pub fn judge(&self, phases: &mut Phases) -> Result<RecordingReport, PipelineError> {
        let learner = Learner::of(self.replay);
        let why = match self.why_two_passes(&learner) {
            Some(why) => why,
            None => match self.stream(self.learning(&learner)?, phases) {
                // a burst came too late for the windows that were learned, or they hold too much
                Err(PipelineError::NeedsTwoPasses(why)) => why,
                done => return self.report(done?, Identified::by(&learner, None), phases),
            },
        };
        match self.recording.is_growing() {
            true => Err(PipelineError::NeedsTwoPasses(why)),
            false => self.judge_in_two_passes(why, phases),
        }
    }

    /// Judges the recording after passes that learn its models. `why`: the reason
    /// for that, for the report.
    pub fn judge_in_two_passes(
        &self,
        why: String,
        phases: &mut Phases,
    ) -> Result<RecordingReport, PipelineError> {
        let learner = Learner::of(self.replay);
        let mut learning = self.learning(&learner)?;
        learning.learn_before(self.recording, self.control, phases)?;
        let streamed = self.stream(learning, phases)?;
        self.report(streamed, Identified::by(&learner, Some(why)), phases)
    }

    /// The learning of models, before it has seen any burst.
    fn learning<'l>(&'l self, learner: &'l Learner<'l>) -> Result<Learning<'l>, PipelineError> {
        // bursts may come late by what the chunk index says, within bounds
        let reorder_ns = self.recording.disorder_ns.unwrap_or_default().max(USUAL_REORDER_NS);
        let reorder_ns = reorder_ns.min(MOST_REORDER_NS) as i64;
        let schedule = Schedule::new(self.replay.design.as_ref(), &self.replay.settings.isolate)?;
        Ok(Learning::new(learner, schedule, reorder_ns, self.replay.workers(0)))
    }

    /// The reason for which windows cannot be learned while the signals flow, as
    /// far as it is known beforehand.
    fn why_two_passes(&self, learner: &Learner) -> Option<String> {
        let disorder_ns = self.recording.disorder_ns.unwrap_or_default();
        if !learner.knows_by_design() && disorder_ns > MOST_REORDER_NS {
            let seconds = disorder_ns as f64 / 1e9;
            return Some(format!(
                "its chunks lie up to {seconds:.1} s out of the order of their times"
            ));
        }

        let mut spans = self.replay.spans.clone();
        spans.sort_unstable();
        let overlap = spans.windows(2).any(|pair| pair[0].1 > pair[1].0);
        overlap.then(|| "the windows of identify.spans overlap".into())
    }

    /// Sends the recording through the stages. The time of a run that is given up is counted apart.
    fn stream<'l>(
        &'l self,
        learning: Learning<'l>,
        phases: &mut Phases,
    ) -> Result<StageResults<'l>, PipelineError> {
        let (started, signals) = (Instant::now(), self.control.signals.load(Ordering::Relaxed));
        // the recording is read from its beginning; bursts that were handed on in an
        // earlier pass are not waited for
        self.pacer().begin();
        let streamed = self.through_stages(Models::new(learning, self.recording, self.control));
        if streamed.is_err() {
            self.control.signals.store(signals, Ordering::Relaxed); // they are judged again
        }
        phases.add(if streamed.is_ok() { "stages" } else { "given up" }, started.elapsed());
        streamed
    }
}
