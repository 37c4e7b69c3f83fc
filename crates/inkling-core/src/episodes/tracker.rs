//! Follows all channels of a recording: bursts in, episodes out.

#[cfg(test)]
mod tests;

use super::naming::Naming;
use super::printhead::{BurstContext, Printhead, TrackerOutput};
use super::{Episode, EpisodeSettings, Looks, TrackerResult};
use crate::fault::Class;
use std::collections::HashMap;
use std::sync::Arc;

/// Printheads that are remembered.
const MOST_PRINTHEADS: usize = 1 << 16;
/// Signals that wait for earlier ones, over all printheads.
const MOST_WAITING: usize = 1 << 22;

/// Follows every channel. Episodes leave as they end, in an order that depends on the recording only.
#[derive(Debug)]
pub struct Tracker {
    naming: Naming,
    bound: f32,
    reorder_signals: usize,
    printheads: HashMap<Arc<str>, Printhead>,
    channels: usize,
    waiting: usize,
    output: TrackerOutput,
}

impl Tracker {
    /// `classes` in the order of the weights; `priors` of them, which lack that of no class to 1; `certainty`: least weight
    /// of what is named.
    pub fn new(
        classes: &[Class],
        priors: &[f64],
        certainty: f64,
        settings: &EpisodeSettings,
    ) -> Tracker {
        Tracker {
            naming: Naming::new(classes, priors, certainty),
            bound: settings.evidence_bound() as f32,
            reorder_signals: settings.reorder_signals,
            printheads: HashMap::new(),
            channels: 0,
            waiting: 0,
            output: TrackerOutput::default(),
        }
    }

    /// The same for who wants to hear of episodes as soon as they are raised: no burst waits for earlier ones,
    /// which then are left out.
    pub fn at_once(self) -> Tracker {
        let output = TrackerOutput { raised: Some(Vec::new()), ..self.output };
        Tracker { reorder_signals: 0, output, ..self }
    }

    /// Takes in one burst of a printhead, in the recording's order.
    pub fn push(&mut self, printhead: &Arc<str>, looks: Looks) {
        if !self.printheads.contains_key(printhead) {
            if self.printheads.len() >= MOST_PRINTHEADS {
                self.output.counts.signals_beyond_limit += looks.ratios.len() as u64;
                return;
            }
            self.printheads.insert(printhead.clone(), Printhead::new(printhead.clone()));
        }
        let Some(of) = self.printheads.get_mut(printhead) else { return };
        self.waiting += looks.ratios.len();
        of.waiting.push(looks);
        while of.waiting.signals() > self.reorder_signals || self.waiting > MOST_WAITING {
            let Some(looks) = of.waiting.pop() else { break };
            self.waiting -= looks.ratios.len();
            let burst = BurstContext { looks: &looks, bound: self.bound, naming: &self.naming };
            of.look(burst, &mut self.channels, &mut self.output);
        }
    }

    /// The episodes that have ended since this was asked last.
    pub fn take_ended(&mut self) -> Vec<Episode> {
        std::mem::take(&mut self.output.ended)
    }

    /// The episodes that were raised, or named otherwise, since this was asked last, as they were then. There are none
    /// unless the tracker works [`Tracker::at_once`].
    pub fn take_raised(&mut self) -> Vec<Episode> {
        self.output.raised.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// Ends with the recording: looks at what still waits, and hands out the episodes that are still on.
    pub fn finish(mut self) -> TrackerResult {
        let mut printheads: Vec<Printhead> = self.printheads.drain().map(|(_, p)| p).collect();
        printheads.sort_by(|a, b| a.name.cmp(&b.name));
        for of in &mut printheads {
            while let Some(looks) = of.waiting.pop() {
                let burst = BurstContext { looks: &looks, bound: self.bound, naming: &self.naming };
                of.look(burst, &mut self.channels, &mut self.output);
            }
        }
        for of in &mut printheads {
            of.states.sort_by_key(|channel| channel.number);
            for channel in &mut of.states {
                let Some(draft) = channel.draft.take().filter(|_| channel.evidence.is_raised())
                else {
                    continue;
                };
                self.output.counts.still_on += 1;
                self.output.counts.episodes += 1;
                self.output.ended.push(channel.episode(&of.name, &draft, &self.naming, None));
            }
        }
        let untimely = printheads.into_iter().map(|of| of.untimely);
        let untimely = untimely.filter(|of| of.at_one_time + of.too_late > 0).collect();
        TrackerResult { last: self.output.ended, counts: self.output.counts, untimely }
    }
}
