//! What settings, design and labels say about windows, for both ways of learning models (in the stream, in passes
//! before): which groups need windows, which signals of a burst are offered to a window's sample, and how many are
//! kept. And how a recording's models came to be ([`Identified`]), for its summary and `--timings`.

use super::groups::GroupKey;
use super::run::Replay;
use super::visit;
use crate::settings::IdentifyMode;
use inkling_core::burst::Burst;
use inkling_core::identify::reservoir::Reservoir;
use inkling_core::verdict::{Reason, unusable_signal};
use serde::Serialize;

/// Maximum bytes of signals held at a time in passes of their own, and of one window.
pub(super) const HELD_BYTES: usize = 96 << 20;
/// Number of signals of a window that may be held however long the signals are.
const FEWEST_HELD: usize = 64;

fn ns(seconds: f64) -> i64 {
    (seconds * 1e9) as i64
}

/// A healthy window: a half-open span of one group's time.
#[derive(Clone, Copy, Debug)]
pub struct Window {
    pub group: usize,
    pub from_ns: i64,
    pub to_ns: i64,
}

impl Replay {
    /// The reason for which the signals of a printhead are rejected if none of its windows gave a model.
    pub(super) fn nobody(&self) -> Reason {
        if self.design.is_some() { Reason::DesignMismatch } else { Reason::NoModel }
    }

    /// Whether the design's models judge as they are. Windows then only say whether its pooled model agrees
    /// with a printhead that the design does not know.
    pub(super) fn knows_by_design(&self) -> bool {
        self.design.is_some() && self.settings.identify.mode == IdentifyMode::Design
    }

    /// Whether windows of a group are to be learned. Without a design always; with one the group must be
    /// sampled as the design is, and with `identify.mode = "design"` its printhead must be unknown to it.
    pub(super) fn needs_windows(&self, key: &GroupKey, sample_period_s: f64) -> bool {
        let by_windows = self.settings.identify.mode == IdentifyMode::Windows;
        self.design.as_ref().is_none_or(|design| {
            design.fits(sample_period_s, key.samples as usize)
                && (by_windows || design.model_of(&key.printhead).is_none())
        })
    }

    pub(super) fn first_ns(&self) -> i64 {
        ns(self.settings.identify.first)
    }

    /// The time from the begin of a window to that of the next, ns; 0: there is only one window.
    pub(super) fn every_ns(&self) -> i64 {
        ns(self.settings.identify.every)
    }

    /// Maximum number of signals of a window that are kept, for signals of that many samples.
    pub(super) fn most_signals(&self, samples: usize) -> usize {
        let fit = HELD_BYTES / (4 * samples.max(1));
        self.settings.identify.window_signals.min(fit.max(FEWEST_HELD))
    }

    /// Offers a burst's usable signals, with labels only healthy ones, to a window's sample, without what the
    /// design's extension says is in them.
    pub(super) fn offer(&self, burst: &Burst, reservoir: &mut Reservoir) {
        let labels = self.labels.as_ref();
        let mut signal = vec![0.0; burst.samples_per_channel as usize];
        for row in 0..burst.channels {
            let channel = burst.first_channel + row;
            // most signals of a long window are not kept, and so need not be decoded
            let may_keep = reservoir.may_keep(burst.t_acq_ns, channel);
            if !may_keep || !visit::is_healthy(labels, burst, channel) {
                continue;
            }
            burst.copy_signal(row as usize, &mut signal);
            if unusable_signal(&signal, self.settings.input.rails).is_none() {
                if let Some(design) = &self.design {
                    design.take_off_extension(burst, row as usize, &mut signal);
                }
                reservoir.offer(burst.beside(row as usize), &signal, f64::NAN);
            }
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Identified {
    pub how: ModelSource,
    /// The reason for which models were not learned while the signals flowed; `None`: they were.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ModelSource {
    /// From the design, with windows only for printheads that it does not know.
    Design,
    /// From windows, while the signals flowed.
    InStream,
    /// From windows, in passes before the stages started.
    TwoPasses,
}

impl Identified {
    /// `why`: the reason for which models were learned before the stages started; `None`: they were not.
    pub fn by(replay: &Replay, why: Option<String>) -> Identified {
        let how = match why {
            _ if replay.knows_by_design() => ModelSource::Design,
            None => ModelSource::InStream,
            Some(_) => ModelSource::TwoPasses,
        };
        Identified { how, why }
    }

    pub fn in_words(&self) -> Option<String> {
        let why = self.why.as_ref()?;
        Some(format!("models and baselines were learned in passes of their own: {why}"))
    }
}
