//! Sends one recording through the six stages, and decides how its models come to be: in one pass or in two.

use super::identified::Identified;
pub use super::job::Run;

use super::PipelineError;
use super::learner::Learner;
use super::learning::{Learning, MOST_REORDER_NS, USUAL_REORDER_NS};
use super::models::Models;
use super::recording_report::RecordingReport;
use super::schedule::Schedule;
use super::survey::survey;
use super::timings::Phases;
use super::wiring::StageResults;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

impl<'a> Run<'a> {
    /// Judges the recording in one pass where its order allows that, else in two. A recording that is still
    /// being written cannot be read in two passes: that is an error.
    pub fn judge(&self, phases: &mut Phases) -> Result<RecordingReport, PipelineError> {
        let learner = self.learner();
        if let Some(why) = self.why_two_passes(&learner) {
            return match self.recording.is_growing() {
                true => Err(PipelineError::NeedsTwoPasses(why)),
                false => self.judge_in_two_passes(why, phases),
            };
        }
        match self.learn_in_stream(&learner, phases) {
            // a burst came too late for the windows that were learned, or they hold too much: begin again
            Err(PipelineError::NeedsTwoPasses(why)) if !self.recording.is_growing() => {
                self.judge_in_two_passes(why, phases)
            }
            done => self.report(done?, Identified::in_stream(&learner), phases),
        }
    }

    /// Judges the recording after a pass that learns its models. `why`: the reason
    /// for two passes, for the report.
    pub fn judge_in_two_passes(
        &self,
        why: String,
        phases: &mut Phases,
    ) -> Result<RecordingReport, PipelineError> {
        let learner = self.learner();
        let streamed = self.learn_before(&learner, phases)?;
        self.report(streamed, Identified::before(&learner, why), phases)
    }

    /// What windows are learned with.
    fn learner(&self) -> Learner<'a> {
        Learner {
            settings: &self.replay.settings,
            design: self.replay.design.as_ref(),
            pooled: self.replay.design.as_ref().map(|design| Arc::new(design.pooled.clone())),
            labels: self.replay.labels.as_ref(),
            spans: self.replay.spans.clone(),
        }
    }

    /// A schedule that holds the design's models alone.
    fn design_schedule(&self) -> Result<Schedule<'a>, PipelineError> {
        Schedule::new(self.replay.design.as_ref(), &self.replay.settings.isolate)
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

        let mut spans = learner.spans.clone();
        spans.sort_unstable();
        let overlap = spans.windows(2).any(|pair| pair[0].1 > pair[1].0);
        overlap.then(|| "the windows of identify.spans overlap".into())
    }

    /// Learns models from windows while the signals flow, which is the default.
    fn learn_in_stream<'l>(
        &'l self,
        learner: &'l Learner<'l>,
        phases: &mut Phases,
    ) -> Result<StageResults<'l>, PipelineError> {
        // bursts may come late by what the chunk index says, within bounds
        let reorder_ns = self.recording.disorder_ns.unwrap_or_default().max(USUAL_REORDER_NS);
        let reorder_ns = reorder_ns.min(MOST_REORDER_NS) as i64;
        let (schedule, workers) = (self.design_schedule()?, self.replay.workers(0));
        let learning = Learning::new(learner, schedule, reorder_ns, workers);
        self.stream(Models::learned(learning, self.recording, self.control), phases)
    }

    /// Learns all models before the stages start, where the file's order does not allow anything else.
    fn learn_before(
        &self,
        learner: &Learner,
        phases: &mut Phases,
    ) -> Result<StageResults<'a>, PipelineError> {
        let windows = |phases: &mut Phases| -> Result<Schedule<'a>, PipelineError> {
            let (recording, control) = (self.recording, self.control);
            let survey =
                phases.time("survey", || survey(recording, learner.every_ns(), control))?;
            let schedule = self.design_schedule()?;
            phases.time("windows", || learner.learn(recording, &survey, schedule, control))
        };

        // windows decide: they are learned before the stages start
        if !learner.knows_by_design() {
            let schedule = windows(phases)?;
            return self.stream(Models::Made(schedule), phases);
        }

        // the design decides: no pass is needed before, unless a printhead is unknown to it
        match self.stream(Models::Made(self.design_schedule()?), phases) {
            // a printhead turned up that the design does not know: windows decide who judges it
            Err(PipelineError::NeedsSurvey) => {
                let schedule = windows(phases)?;
                self.stream(Models::Made(schedule), phases)
            }
            done => done,
        }
    }

    /// Sends the recording through the stages. The time of a run that is given up is counted apart.
    fn stream<'m>(
        &self,
        models: Models<'m>,
        phases: &mut Phases,
    ) -> Result<StageResults<'m>, PipelineError> {
        let (started, signals) = (Instant::now(), self.control.signals.load(Ordering::Relaxed));
        // the recording is read from its beginning; bursts that were handed on in an
        // earlier pass are not waited for
        self.pacer().begin();
        let streamed = self.through_stages(models);
        if streamed.is_err() {
            self.control.signals.store(signals, Ordering::Relaxed); // they are judged again
        }
        phases.add(if streamed.is_ok() { "stages" } else { "given up" }, started.elapsed());
        streamed
    }
}
