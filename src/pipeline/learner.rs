//! What models are learned from and with, whether a recording is learned in one pass or in two.

use super::survey::GroupKey;
use crate::settings::{IdentifyMode, Settings};
use inkling_core::burst::Burst;
use inkling_core::design::{Design, HealthyModel};
use inkling_core::fault::HEALTHY;
use inkling_core::identify::reservoir::Reservoir;
use inkling_core::labels::Labels;
use inkling_core::verdict::{Reason, unusable_signal};
use std::sync::Arc;

/// Maximum bytes of signals held at a time while windows are learned in passes
/// of their own, and of one window.
pub(super) const HELD_BYTES: usize = 96 << 20;
/// So many signals of a window may be held however long they are.
const FEWEST_HELD: usize = 64;

/// Seconds in ns.
fn ns(seconds: f64) -> i64 {
    (seconds * 1e9) as i64
}

/// A healthy window: a half-open span of one group's time.
#[derive(Clone, Copy, Debug)]
pub struct Window {
    /// Index of the group.
    pub group: usize,
    pub from_ns: i64,
    pub to_ns: i64,
}

/// Everything beside the signals that models are learned from.
#[derive(Debug)]
pub struct Learner<'a> {
    pub settings: &'a Settings,
    pub design: Option<&'a Design>,
    /// The design's model of all printheads together.
    pub pooled: Option<Arc<HealthyModel>>,
    pub labels: Option<&'a Labels>,
    /// The windows of `identify.spans`, ns; empty: windows are placed by `identify.first` and
    /// `identify.every`.
    pub spans: Vec<(i64, i64)>,
}

impl Learner<'_> {
    /// The reason for which the signals of a printhead are rejected if none of its windows gave a model.
    pub fn nobody(&self) -> Reason {
        if self.design.is_some() { Reason::DesignMismatch } else { Reason::NoModel }
    }

    /// Whether the design's models judge as they are. Windows then only say whether the design's pooled model
    /// agrees with a printhead that the design does not know.
    pub fn knows_by_design(&self) -> bool {
        self.design.is_some() && self.settings.identify.mode == IdentifyMode::Design
    }

    /// Whether windows of a group are to be learned: it must be sampled as the design is, and with
    /// `identify.mode = "design"` its printhead must be unknown to the design.
    pub fn needs_windows(&self, key: &GroupKey, sample_period_s: f64) -> bool {
        match self.design {
            None => true,
            Some(design) => {
                design.fits(sample_period_s, key.samples as usize)
                    && (self.settings.identify.mode == IdentifyMode::Windows
                        || design.model_of(&key.printhead).is_none())
            }
        }
    }

    /// The length of a window, ns.
    pub fn first_ns(&self) -> i64 {
        ns(self.settings.identify.first)
    }

    /// The time from the begin of a window to that of the next, ns; 0: there is only one window, or the
    /// windows are given.
    pub fn every_ns(&self) -> i64 {
        if self.spans.is_empty() { ns(self.settings.identify.every) } else { 0 }
    }

    /// Maximum number of signals of a window that are kept, for signals of that many
    /// samples: of long ones fewer are.
    pub fn most_signals(&self, samples: usize) -> usize {
        let fit = HELD_BYTES / (4 * samples.max(1));
        self.settings.identify.window_signals.min(fit.max(FEWEST_HELD))
    }
}

/// Offers a burst's usable signals to a window's sample, with labels only those that are labelled healthy.
/// What the design's extension says is in them is subtracted first.
pub(super) fn offer(
    settings: &Settings,
    labels: Option<&Labels>,
    design: Option<&Design>,
    burst: &Burst,
    reservoir: &mut Reservoir,
) {
    let mut signal = vec![0.0; burst.samples_per_channel as usize];
    for row in 0..burst.channels {
        let channel = burst.first_channel + row;
        if !reservoir.may_keep(burst.t_acq_ns, channel) {
            continue; // most of a long window's
        }
        let healthy = |labels: &Labels| {
            labels
                .at(&burst.printhead, channel, burst.t_acq_ns)
                .is_some_and(|label| label.state == HEALTHY)
        };
        if labels.is_some_and(|labels| !healthy(labels)) {
            continue;
        }
        burst.copy_signal(row as usize, &mut signal);
        if unusable_signal(&signal, settings.input.rails).is_none() {
            if let Some(design) = design {
                design.take_off_extension(burst, row as usize, &mut signal);
            }
            reservoir.offer(burst.beside(row as usize), &signal, f64::NAN);
        }
    }
}
