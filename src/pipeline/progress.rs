//! A printhead's models, window by window: averaging and identification, thesis §3-1.
//!
//! In: from `learning`, for each window of a printhead, in the order of their times, its sample of signals. Out:
//! the [`Entry`] that it adds to the printhead's timeline, if any, or a [`Refusal`].
//!
//! A window's signals are averaged and a model fitted (`HealthyModel::learn`). The model is refused if it does not
//! describe the signals, if its signals differ too much from each other, or if its resonance, damping or typical
//! distance are too far from the reference's: a fault that grows slowly must not be learned as healthy. Which model
//! then judges depends on the mode: with `identify.mode = "windows"` the window's own from the window's end on; with
//! `"design"` the design's pooled model, once a window has agreed with it.

use super::run::Replay;
use super::schedule::{Refusal, Schedule};
use super::window_rules::Window;
use inkling_core::design::{HealthyModel, LearnSettings};
use inkling_core::identify::reservoir::Reservoir;
use std::sync::Arc;

/// Least share of the average signal's size that the model must explain, per cent. The three are heuristic.
const LEAST_FIT_PERCENT: f64 = 50.0;
/// Signals that differ by more than this share of the expected signal have no healthy signal in common.
const MOST_SCATTER: f64 = 0.5;
/// The threshold follows a window's median statistic up to this factor from the reference's; with more, nothing
/// would be found.
const MOST_RATIO: f64 = 4.0;

#[derive(Debug)]
pub enum Entry {
    /// The printhead's first window gave no model: the design's own judges until a window gives another.
    Known,
    /// A model judges from `from_ns` on (ns; `i64::MIN`: from the beginning).
    Learned { from_ns: i64, model: Arc<HealthyModel>, reference_v: Option<f64> },
}

/// Noise, or a mixture of healthy and faulty channels, does not agree. The error says why in words.
fn agree_with(model: &HealthyModel) -> Result<(), String> {
    let fit = model.identification.fit_percent;
    // a fit that is no number is refused too
    if !matches!(fit.partial_cmp(&LEAST_FIT_PERCENT), Some(o) if o.is_ge()) {
        return Err(format!(
            "the model explains {fit:.0} % of the average signal, {LEAST_FIT_PERCENT} % are needed: \
             nothing rings in this window"
        ));
    }
    // mean squares: of the expected signal, and of what signals differ by beyond noise
    let expected = model.expected.iter().map(|y| y * y).sum::<f64>() / model.expected.len() as f64;
    let scatter = (model.scatter.powi(2) - model.noise.powi(2)).max(0.0);
    if scatter > MOST_SCATTER.powi(2) * expected {
        return Err(format!(
            "the signals differ from each other by {:.0} % of the expected signal: no healthy signal \
             that most of them have in common; choose another window or give labels",
            100.0 * (scatter / expected).sqrt()
        ));
    }
    Ok(())
}

/// Why a window gives no model, and whether that is a drift beyond the bounds of the settings.
type NoModel = (String, bool);

#[derive(Debug)]
pub struct Progress {
    /// The model from which drift is measured, and which passes on its temperature response and the tail of its
    /// threshold: the design's model of this printhead, else the design's pooled one, else the first accepted
    /// one. `None`: there is no design, and no window was accepted yet.
    reference: Option<Arc<HealthyModel>>,
    printhead: Arc<str>,
    known: bool,
    sample_period_s: f64,
    /// Drive voltage at which models expect their signals, V: the design's, or the mean of the first window.
    reference_v: Option<f64>,
    /// Number of windows that were learned from, and of those that gave a model.
    seen: usize,
    accepted: usize,
    pub refusals: Vec<Refusal>,
}

impl Progress {
    pub fn start(schedule: &Schedule, printhead: &Arc<str>, sample_period_s: f64) -> Progress {
        Progress {
            printhead: printhead.clone(),
            known: schedule.model_of(printhead).is_some(),
            sample_period_s,
            reference: schedule.reference_of(printhead),
            reference_v: schedule.design.and_then(|design| design.drive_voltage_v),
            seen: 0,
            accepted: 0,
            refusals: Vec::new(),
        }
    }

    /// Whether no further window can change what judges the group: the design, with which a window agreed.
    pub fn is_over(&self, replay: &Replay) -> bool {
        replay.knows_by_design() && self.accepted > 0
    }

    /// Learns from the group's next window, of which `sample` holds signals. `None`: the timeline stays as it is.
    pub fn take(&mut self, replay: &Replay, window: Window, sample: &Reservoir) -> Option<Entry> {
        if self.is_over(replay) {
            return None;
        }
        self.seen += 1;
        let model = match self.model(replay, sample) {
            Ok(model) => Arc::new(HealthyModel { valid_from_ns: Some(window.to_ns), ..model }),
            // refused: the model before stays; at the first window that may be the design's
            Err((why, drifted)) => {
                let (from_ns, to_ns) = (window.from_ns, window.to_ns);
                let printhead = self.printhead.to_string();
                self.refusals.push(Refusal { printhead, from_ns, to_ns, why, drifted });
                let by_windows = !replay.knows_by_design();
                return (self.seen == 1 && self.known && by_windows).then_some(Entry::Known);
            }
        };
        self.accepted += 1;
        let reference = self.reference.get_or_insert_with(|| model.clone());
        let (from_ns, model) = match replay.knows_by_design() {
            // the design does not know the printhead: its pooled model judges, as a window agrees with it
            true => (i64::MIN, reference.clone()),
            false => (window.to_ns, model),
        };
        Some(Entry::Learned { from_ns, model, reference_v: self.reference_v })
    }

    fn model(&mut self, replay: &Replay, sample: &Reservoir) -> Result<HealthyModel, NoModel> {
        let identify = &replay.settings.identify;

        // without a design the first window's mean voltage is the one to which drives are relative
        if replay.design.is_none() && self.reference_v.is_none() {
            let (sum, n) = sample.voltage_sum();
            self.reference_v = (n > 0).then(|| sum / n as f64);
        }

        // average and fit; labels say which signals are healthy, else enough of them must agree
        let set = sample.to_set(self.reference_v);
        let settings = LearnSettings {
            grey_box: &identify.grey_box,
            detect: &replay.settings.detect,
            least_agreeing: replay.labels.is_none().then_some(identify.least_agreeing),
            sample_period_s: self.sample_period_s,
            filter: replay.design.as_ref().and_then(|design| design.filter.as_ref()),
        };
        let printhead = Some(&*self.printhead);
        let model = HealthyModel::learn(&set, printhead, self.reference.as_deref(), settings)
            .map_err(|e| (e.advice(replay.labels.is_some()), false))?;
        if replay.labels.is_none() {
            agree_with(&model).map_err(|why| (why, false))?;
        }

        // a fault that grows slowly must not be learned as healthy
        if let Some(reference) = &self.reference {
            let (frequency, damping) = reference.drift_to(&model);
            for (what, drift, most) in [
                ("frequency", frequency, identify.max_frequency_drift),
                ("damping", damping, identify.max_damping_drift),
            ] {
                // a drift that is no number is refused too
                if !matches!(drift.abs().partial_cmp(&most), Some(o) if o.is_le()) {
                    let why = format!(
                        "{what} {:+.2} % from the reference model, beyond \
                         identify.max_{what}_drift = {:.2} %: a slow fault or another ink; \
                         the last accepted model stays",
                        100.0 * drift,
                        100.0 * most
                    );
                    return Err((why, true));
                }
            }

            // how far healthy signals typically lie from their model, relative to what its metric predicts
            let ratio = model.typical_distance() / reference.typical_distance();
            if replay.design.is_some() && !(1.0 / MOST_RATIO..=MOST_RATIO).contains(&ratio) {
                let why = format!(
                    "healthy signals lie {ratio:.3} times as far from the model as in the \
                     reference: another amplitude or another noise; the last accepted model stays"
                );
                return Err((why, false));
            }
        }
        Ok(model)
    }
}
