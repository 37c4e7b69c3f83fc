//! Learning a healthy model, from a window's signals or from signals that labels say are healthy.
//!
//! In, from training (`train`) and from the windows of a replay (`pipeline/judges`): signals
//! in counts with their drive and temperature, settings, and the *anchor*, the model that came
//! before (a window's is the design's model of the printhead, or else its first window's). Out: a
//! [`HealthyModel`]. The steps: average, grey box (3-1), filter, effect of temperature, detection
//! (of `detect.method` = `sensitivity` in `learn_distances`).
//!
//! Labelled signals are all healthy, so their mean, spread and tail are taken as they are. Of a
//! window up to two in five signals may be faulty, so only the signals that agree are averaged, the
//! spread is estimated robustly, and the thresholds come from a mixture model or from the anchor.

use super::fd_filter::{LearnSettings, residual_generator};
use super::temperature::AtOneTemperature;
use super::{DetectSettings, HealthyModel, Result};
use crate::detect::threshold::{self, Threshold};
use crate::detect::{DetectMethod, ThresholdMethod};
use crate::identify::SignalSet;
use crate::identify::averaging;
use crate::identify::{grey_box, tangent};
use crate::model::median::median;

#[derive(Clone, Copy)]
pub(super) struct Sources<'a> {
    /// The whole window, or all labelled signals.
    pub set: &'a SignalSet,
    /// Those of its signals that agree with each other; all of them if labels say so.
    pub healthy: &'a SignalSet,
    pub anchor: Option<&'a HealthyModel>,
    pub detect: &'a DetectSettings,
    /// Whether labels say that all signals are healthy; else they are a window's.
    pub labelled: bool,
}

impl HealthyModel {
    /// `printhead`: `None` if the signals are of several; `anchor`: passes on what one window cannot
    /// know (effect of temperature, tail of statistics). Where the signals as they are give no model, they are
    /// taken to stand off zero. An error if the signals are too few, do not agree, or give no model that rings.
    pub fn learn(
        set: &SignalSet,
        printhead: Option<&str>,
        anchor: Option<&HealthyModel>,
        settings: LearnSettings,
    ) -> Result<HealthyModel> {
        let as_they_are = HealthyModel::learn_about_zero(set, printhead, anchor, settings);
        let Err(e) = as_they_are else { return as_they_are };
        let Some(offset) = averaging::offset(set, settings.sample_period_s) else { return Err(e) };
        let model = HealthyModel::learn_about_zero(&set.less(offset), printhead, anchor, settings);
        model.map(|model| HealthyModel { offset, ..model }).map_err(|_| e)
    }

    /// Labelled signals twice: what temperature does is known after the first time, and the second time they are learned
    /// from at one temperature. A window's temperatures hardly differ.
    fn learn_about_zero(
        set: &SignalSet,
        printhead: Option<&str>,
        anchor: Option<&HealthyModel>,
        settings: LearnSettings,
    ) -> Result<HealthyModel> {
        let first = HealthyModel::learn_once(set, printhead, anchor, settings)?;
        if first.temperature_response.is_none() || settings.least_agreeing.is_some() {
            return Ok(first);
        }
        let AtOneTemperature { warmth, signals } = first.at_one_temperature(set)?;
        HealthyModel::learn_once(&signals, printhead, Some(&first.with(warmth)?), settings)
    }

    fn learn_once(
        set: &SignalSet,
        printhead: Option<&str>,
        anchor: Option<&HealthyModel>,
        settings: LearnSettings,
    ) -> Result<HealthyModel> {
        // Departs: thesis §3-1 averages all signals. Of a window only those that agree with each
        // other count here, but with `plain_mean`.
        let least = settings.least_agreeing.filter(|_| !settings.grey_box.plain_mean);
        let healthy = &*averaging::healthy(set, least)?;

        let mean = averaging::average(healthy)?;
        let dt_s = settings.sample_period_s;
        let near = anchor.map(|anchor| &anchor.identification.channel);
        let identification =
            grey_box::identify_scattered(healthy, &mean, dt_s, settings.grey_box, near)?;
        let expected = identification.expected(dt_s, set.samples);
        let generator = residual_generator(&identification, set.samples, settings, dt_s)?;

        // the effect of temperature, counts/K: the anchor's, or a regression on labelled signals
        let temperature_c = healthy.mean_temperature_c();
        let directions = tangent::tangent(&identification, dt_s, set.samples);
        let known = anchor.and_then(|anchor| anchor.temperature_response.clone());
        let temperature_response = known.or_else(|| {
            // in a window temperature and time rise together: any slow change would be taken for it
            let reference = temperature_c.filter(|_| settings.least_agreeing.is_none())?;
            tangent::temperature_response(healthy, &expected, &directions, reference)
        });
        let (damping_per_k, frequency_per_k) = temperature_response
            .as_ref()
            .and_then(|response| tangent::pole_changes(&identification, &directions, response))
            .unwrap_or((0.0, 0.0));

        let mut model = HealthyModel {
            printhead: printhead.map(str::to_owned),
            valid_from_ns: None,
            n_signals: mean.n_signals,
            n_channels: mean.n_channels,
            scatter: mean.scatter,
            noise: mean.noise,
            temperature_c,
            identification,
            expected,
            leftover: Vec::new(),
            offset: 0.0,
            temperature_response,
            damping_per_k,
            frequency_per_k,
            channels_per_k: anchor.and_then(|anchor| anchor.channels_per_k),
            moved_k: 0.0,
            generator,
            sensitivity: None,
            by_maximum: false,
            threshold: Threshold::none(),
            misfit: None,
            apart: None,
            median_statistic: f64::NAN,
        };
        let labelled = settings.least_agreeing.is_none();
        let detect = settings.detect;
        model.learn_detection(Sources { set, healthy, anchor, detect, labelled })?;
        Ok(model)
    }

    /// The model has its average, filter and expected signal already.
    fn learn_detection(&mut self, from: Sources) -> Result<()> {
        let Sources { healthy, detect, .. } = from;
        match detect.method {
            DetectMethod::ResidualEnergy | DetectMethod::ResidualMaximum => {
                self.by_maximum = detect.method == DetectMethod::ResidualMaximum;
                let mut all = Vec::with_capacity(healthy.len());
                self.each_deviation(healthy, |_, deviation, _| {
                    all.push(self.of_residual(deviation));
                });
                self.learn_one_threshold(&all, from)
            }
            DetectMethod::Sensitivity => self.learn_distances(from),
        }
    }

    /// thesis (3-4) on the statistics of healthy signals, for a method with one test.
    fn learn_one_threshold(&mut self, statistics: &[f64], from: Sources) -> Result<()> {
        self.median_statistic = median(&mut statistics.to_vec());
        // Departs: thesis (3-4) takes signals that are known to be healthy. Of a window only the
        // median can be trusted, so the anchor's threshold is scaled by the ratio of medians.
        self.threshold = match from.anchor.filter(|_| !from.labelled) {
            Some(anchor) => {
                anchor.threshold.scaled(self.median_statistic / anchor.median_statistic)
            }
            None => learn_threshold(statistics, &from.healthy.channel, from.detect, 1.0)?,
        };
        Ok(())
    }
}

/// A threshold by `detect.threshold`: thesis (3-4), or the tail quantile. `channels`: of each
/// signal, since signals of one channel are not independent; `share`: of `false_alarm_rate`.
pub(super) fn learn_threshold(
    statistics: &[f64],
    channels: &[u32],
    settings: &DetectSettings,
    share: f64,
) -> Result<Threshold> {
    let (rate, confidence) = (share * settings.false_alarm_rate, settings.confidence);
    Ok(match settings.threshold {
        ThresholdMethod::Max => threshold::max(statistics, channels, settings.mu)?,
        ThresholdMethod::Quantile => threshold::quantile(statistics, channels, rate, confidence)?,
    })
}
