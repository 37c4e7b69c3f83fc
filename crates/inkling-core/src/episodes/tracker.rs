//! Follows all channels of a recording: bursts in, episodes out.
//!
//! In: of each burst a [`Looks`], for each channel its detection statistic over the threshold (flagged above 1), in
//! the order of the recording. Out: [`Episode`]s as they end,
//! at last those that are still on, and counts of what was left out.
//!
//! Each printhead's bursts wait in a bounded window (`order`), so that those that are out of order
//! in the recording are looked at in the order of time. Memory is bounded whatever a recording
//! claims: printheads, channels and waiting signals have limits.

#[cfg(test)]
mod tests;

use super::printhead::{Printhead, TrackerOutput};
use super::rules::Rules;
use super::{Episode, EpisodeSettings, Looks, TrackerResult};
use crate::fault::Class;
use std::collections::HashMap;
use std::sync::Arc;

/// At most so many printheads are remembered; the signals of further ones are only counted.
const MOST_PRINTHEADS: usize = 1 << 16;
/// At most so many signals wait for earlier ones, over all printheads.
const MOST_WAITING: usize = 1 << 22;

/// Follows every channel.
#[derive(Debug)]
pub struct Tracker {
    rules: Rules,
    /// At most so many signals of a printhead wait for earlier ones.
    reorder_signals: usize,
    printheads: HashMap<Arc<str>, Printhead>,
    /// Number of signals that wait, over all printheads.
    waiting: usize,
    /// Episodes that nobody has taken yet.
    output: TrackerOutput,
}

impl Tracker {
    /// A tracker before the first burst. `classes`: in the order of the signals' weights; `priors`: of
    /// each; `certainty`: least weight, 0 to 1, of a class or category that is named.
    pub fn new(
        classes: &[Class],
        priors: &[f64],
        certainty: f64,
        settings: &EpisodeSettings,
    ) -> Tracker {
        Tracker {
            rules: Rules::new(classes, priors, certainty, settings.evidence_bound() as f32),
            reorder_signals: settings.reorder_signals,
            printheads: HashMap::new(),
            waiting: 0,
            output: TrackerOutput::default(),
        }
    }

    /// The same tracker for a caller who wants to hear of episodes as soon as they are raised: no
    /// burst waits for earlier ones, and signals that come too late are left out.
    pub fn at_once(self) -> Tracker {
        let output = TrackerOutput { raised: Some(Vec::new()), ..self.output };
        Tracker { reorder_signals: 0, output, ..self }
    }

    /// Takes in one burst of a printhead, in the recording's order. The earliest bursts of that
    /// printhead are looked at while more than `reorder_signals` of it, or `MOST_WAITING` of all, wait.
    pub fn push(&mut self, printhead: &Arc<str>, looks: Looks) {
        let is_full = self.printheads.len() >= MOST_PRINTHEADS;
        if is_full && !self.printheads.contains_key(printhead) {
            self.output.counts.signals_beyond_limit += looks.ratios.len() as u64;
            return;
        }
        let new = || Printhead::new(printhead.clone());
        let of = self.printheads.entry(printhead.clone()).or_insert_with(new);
        self.waiting += looks.ratios.len();
        of.waiting.push(looks);

        while of.waiting.signals > self.reorder_signals || self.waiting > MOST_WAITING {
            let Some(looks) = of.waiting.pop() else { break };
            self.waiting -= looks.ratios.len();
            of.look(&looks, &self.rules, &mut self.output);
        }
    }

    /// The clock of a printhead was set, so that times before and after cannot be compared: what waits is looked at,
    /// episodes end with their channel's last look, and all channels begin as if new.
    pub fn begin_anew(&mut self, printhead: &Arc<str>) {
        let Tracker { rules, printheads, waiting, output, .. } = self;
        let Some(of) = printheads.get_mut(printhead) else { return };
        while let Some(looks) = of.waiting.pop() {
            *waiting -= looks.ratios.len();
            of.look(&looks, rules, output);
        }
        of.begin_anew(rules, output);
    }

    /// The episodes that have ended since the last call.
    pub fn take_ended(&mut self) -> Vec<Episode> {
        std::mem::take(&mut self.output.ended)
    }

    /// The episodes that were raised, or got another name, since the last call; none unless the
    /// tracker works [`Tracker::at_once`].
    pub fn take_raised(&mut self) -> Vec<Episode> {
        self.output.raised.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// Ends with the recording.
    pub fn finish(mut self) -> TrackerResult {
        // a hash map has no order, and results must depend on the recording only
        let mut printheads: Vec<Printhead> = self.printheads.drain().map(|(_, p)| p).collect();
        printheads.sort_by(|a, b| a.name.cmp(&b.name));

        for of in &mut printheads {
            while let Some(looks) = of.waiting.pop() {
                of.look(&looks, &self.rules, &mut self.output);
            }
        }

        // the episodes that are still on, by printhead and channel
        for of in &mut printheads {
            of.states.sort_by_key(|channel| channel.number);
            for channel in &mut of.states {
                let Some(draft) = channel.draft.take().filter(|_| channel.evidence.raised) else {
                    continue;
                };
                self.output.counts.still_on += 1;
                self.output.counts.episodes += 1;
                self.output.ended.push(channel.episode(&of.name, &draft, &self.rules, None));
            }
        }

        let untimely = printheads.into_iter().map(|of| of.untimely);
        let untimely = untimely.filter(|of| of.at_one_time + of.too_late > 0).collect();
        TrackerResult { last: self.output.ended, counts: self.output.counts, untimely }
    }
}
