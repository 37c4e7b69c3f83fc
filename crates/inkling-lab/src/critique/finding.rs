//! The findings of a critique: plain data that is written to files. There is no algorithm here.
//!
//! `engine.rs` and `decay/mod.rs` fill them. `critique.json` is [`Critique`] serialised, without the fields
//! marked `skip` (`schemas/critique.md`); evidence goes to a table of its own, figures to the report.

use super::candidate::{Objection, WhyNot};
use super::catalogue::{CATALOGUE, CauseId, Entry};
use crate::plot::digits;
pub use crate::score::blind::Verdict;
use serde::Serialize;
use std::collections::BTreeMap;

pub const VERSION: u32 = 1;
/// The unit of an oscillator's samples, of which its recording says nothing.
pub const UNIT: &str = "units";

#[derive(Clone, Debug, Serialize)]
pub struct Critique {
    pub version: u32,
    pub verdict: Verdict,
    pub causes: Vec<Cause>,
    pub not_testable: Vec<NotTestable>,
    pub misfit: Misfit,
    pub gain: Gain,
    /// File name of the extended design, beside this document; absent where none was made.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub extended_model: Option<String>,
    /// Of an oscillator.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plant: Option<Structure>,
    pub sentence: String,
    /// What remains unexplained, which outliers were left out, which experiment would settle a tie.
    pub remarks: Vec<String>,
    pub equation: String,
    pub signals: Signals,
    #[serde(skip)]
    pub evidence: Vec<Evidence>,
    #[serde(skip)]
    pub figures: Figures,
}

/// A cause that was found; with verdict `unknown`, one that the misfit resembles.
#[derive(Clone, Debug, Serialize)]
pub struct Cause {
    pub id: CauseId,
    /// Name and unit of the catalogue's parameter; its value in that unit, with its 95 % interval.
    pub parameter: String,
    pub unit: String,
    pub value: f64,
    pub ci95: [f64; 2],
    /// Size in detection limits: sqrt(noncentrality / 20.9).
    pub strength_dl: f64,
    /// BIC without this cause minus BIC with it: positive speaks for it.
    pub delta_bic: f64,
    /// Causes of the catalogue that explain the signals as well.
    pub tied_with: Vec<CauseId>,
    /// Rivals without a name that explain the signals as well.
    #[serde(skip)]
    pub tied_unnamed: Vec<CauseId>,
    pub matters_for_detection: bool,
    /// With verdict `unknown`: the share of the misfit that all causes together explain, the same in each of
    /// them; or, where no cause entered a decay's model, the share that the nearest one explains.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub explains: Option<f64>,
    pub sentence: String,
}

impl Critique {
    /// The size of a cause with its interval. What the catalogue calls counts is, of an oscillator, anything.
    pub fn measured(&self, cause: &Cause) -> String {
        let unit = match self.plant {
            Some(_) => cause.unit.replace("counts", UNIT),
            None => cause.unit.clone(),
        };
        digits::measured(cause.value, cause.ci95, &unit)
    }
}

impl Cause {
    pub fn is_tied(&self) -> bool {
        !self.tied_with.is_empty() || !self.tied_unnamed.is_empty()
    }

    pub fn tied_words(&self) -> String {
        let named = self.tied_with.iter().map(|id| id.name());
        let all: Vec<&str> =
            named.chain(self.tied_unnamed.iter().map(|id| id.row().words)).collect();
        all.join(" or ")
    }
}

/// What an oscillator is.
#[derive(Clone, Debug, Serialize)]
pub struct Structure {
    /// The largest first.
    pub modes: Vec<Mode>,
    /// Where its decay begins to be free, after the first sample.
    pub onset_s: f64,
    pub forecast: Forecast,
}

#[derive(Clone, Copy, Debug, Serialize)]
pub struct Mode {
    pub frequency_hz: f64,
    pub ci95: [f64; 2],
    pub damping_per_s: f64,
    /// Of the squares of what all modes show.
    pub share: f64,
}

/// Error of a forecast of the last 40 % of the record, and of one of the fitted model with noise.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Forecast {
    pub record_percent: f64,
    pub control_percent: f64,
}

/// A cause that these data cannot test, and what it would need.
#[derive(Clone, Debug, Serialize)]
pub struct NotTestable {
    pub id: CauseId,
    pub needs: String,
}

impl NotTestable {
    /// All causes of the catalogue for which `lacking` says what they would need.
    pub fn all(lacking: impl Fn(&Entry) -> Option<&'static str>) -> Vec<NotTestable> {
        let lacks = |e: &Entry| Some(NotTestable { id: e.id, needs: lacking(e)?.into() });
        CATALOGUE.iter().filter_map(lacks).collect()
    }
}

/// Misfit of the baseline model on all signals that the critique rests on.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Misfit {
    /// Square of the misfit in its expected covariance, per degree of freedom: 1 if the model is right.
    pub chi2_per_dof: f64,
    pub nrmse_percent: f64,
    pub whiteness_p: f64,
}

/// What the extension buys on signals that nothing was fitted to.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Gain {
    pub before: GainFigures,
    pub after: GainFigures,
    /// Detection AUC after the extension minus before: its interval, drawing the same channels for both. None
    /// where nothing was extended or detection was not measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub detection_gain_interval: Option<[f64; 2]>,
    /// The difference itself; 0 where there is no interval.
    #[serde(skip)]
    pub detection_gain: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub log_likelihood_per_signal: Option<LogLikelihood>,
    pub held_out: HeldOut,
}

/// Gain of a model's ln likelihood per held-out signal, by all causes together and by each, keyed by name.
#[derive(Clone, Debug, Serialize)]
pub struct LogLikelihood {
    #[serde(flatten)]
    pub all: Worth,
    pub by_cause: BTreeMap<&'static str, Worth>,
}

/// Mean gain in ln likelihood over the signals, nats, and its 95 % interval by resampling channels (of
/// decays: stretches of time).
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Worth {
    pub gain: f64,
    pub ci95: [f64; 2],
}

impl Worth {
    pub fn is_sure(self) -> bool {
        self.ci95[0] > 0.0
    }
}

/// Size of the small nozzle fault that detection is measured with: a change of ln damping, in standard
/// deviations of the extended model's healthy signals: a convention.
pub const FAULT: f64 = 2.5;

/// Smallest difference in detection AUC that matters.
const MATTERS: f64 = 0.01;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detection {
    Better,
    Worse,
    /// The difference's interval holds 0, or the difference is too small to matter.
    Same,
    NotMeasured,
}

impl Gain {
    pub fn worth(&self, id: CauseId) -> Option<Worth> {
        self.log_likelihood_per_signal.as_ref()?.by_cause.get(id.name()).copied()
    }

    /// Better or worse only if the interval excludes 0 and the difference is large enough to matter.
    pub fn detection(&self) -> Detection {
        match self.detection_gain_interval {
            None => Detection::NotMeasured,
            Some([low, _]) if low > 0.0 && self.detection_gain > MATTERS => Detection::Better,
            Some([_, high]) if high < 0.0 && self.detection_gain < -MATTERS => Detection::Worse,
            Some(_) => Detection::Same,
        }
    }
}

/// On held-out signals; the first figures are those of [`Misfit`]. Intervals are 95 %, by resampling channels
/// (of decays: stretches of time). What concerns detection is NaN where it was not measured.
#[derive(Clone, Debug, Default, Serialize)]
pub struct GainFigures {
    pub chi2_per_dof: f64,
    pub chi2_per_dof_interval: Option<[f64; 2]>,
    pub nrmse_percent: f64,
    pub nrmse_percent_interval: Option<[f64; 2]>,
    pub whiteness_p: f64,
    pub threshold: f64,
    pub false_alarms: f64,
    pub false_alarms_interval: Option<[f64; 2]>,
    /// Area under the ROC curve of a small nozzle fault put into held-out signals.
    pub detection_auc: f64,
    pub detection_auc_interval: Option<[f64; 2]>,
}

#[derive(Clone, Debug, Default, Serialize)]
pub struct HeldOut {
    /// `channel+time`, `channel` where every channel was heard once, or `time` where there are few channels;
    /// of decays, what was held out, in words.
    pub by: String,
    pub signals: usize,
    pub channels: usize,
    pub fitted_signals: usize,
    pub fitted_channels: usize,
}

#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Signals {
    /// Usable signals that the recordings hold.
    pub found: u64,
    /// Those that the critique rests on: drawn at random where there were too many, outliers left out.
    pub used: usize,
    pub outliers: usize,
    /// Channels of the used signals; of decays, outputs.
    pub channels: usize,
    /// Signals that could not be used; the engine says 0, the command line fills it in.
    pub rejected: u64,
}

/// The test of one candidate in one step of the selection.
#[derive(Clone, Debug)]
pub struct Evidence {
    /// Number of causes that had entered the model before; 0: the baseline.
    pub step: u32,
    pub id: CauseId,
    pub statistic: f64,
    /// What the statistic must exceed, by its distribution without effect; NaN where not testable.
    pub threshold: f64,
    /// Probability of so large a statistic by chance, with all corrections.
    pub p: f64,
    pub delta_bic: f64,
    pub strength_dl: f64,
    /// Size as the catalogue's parameter, with its standard error; NaN where it was not estimated.
    pub value: f64,
    pub sd: f64,
    pub why_not: Option<WhyNot>,
}

impl Evidence {
    pub fn accepted(&self) -> bool {
        self.why_not.is_none()
    }

    /// Empty where it was accepted.
    pub fn why_not_in_words(&self) -> String {
        self.why_not.map_or_else(String::new, |why| why.to_string())
    }

    pub fn tested(&self) -> bool {
        !matches!(self.why_not, Some(WhyNot::Objection(Objection::Untested(_))))
    }
}

/// The numbers behind the report's pictures.
#[derive(Clone, Debug, Default)]
pub struct Figures {
    pub unit: String,
    /// Mean of measured minus simulated by time, s, with its 95 % band.
    pub mean_misfit: Compared,
    /// Mean periodogram of single signals' misfits beside their own rings, unit² per bin, by frequency, Hz;
    /// the band holds 95 % if the model is right.
    pub spectrum: Compared,
}

/// A curve with a band: an interval of the curve itself, or where it lies if the model is right.
#[derive(Clone, Debug, Default)]
pub struct Curve {
    pub y: Vec<f64>,
    pub low: Vec<f64>,
    pub high: Vec<f64>,
}

impl Curve {
    pub fn about(y: Vec<f64>, half_widths: impl IntoIterator<Item = f64>) -> Curve {
        let edges = y.iter().zip(half_widths).map(|(y, half)| (y - half, y + half));
        let (low, high) = edges.unzip();
        Curve { y, low, high }
    }
}

#[derive(Clone, Debug, Default)]
pub struct Compared {
    pub x: Vec<f64>,
    pub before: Curve,
    pub after: Curve,
}

impl Compared {
    /// `curves`: before and after.
    pub fn of(x: Vec<f64>, [before, after]: [Curve; 2]) -> Compared {
        Compared { x, before, after }
    }
}
