//! How often a healthy signal is flagged, estimated from the verdicts themselves: signals outside
//! of every episode are taken for healthy.
//!
//! In: a [`Survey`], and the recordings' settings, which hold the rate that their thresholds were
//! set for. Out: [`FalseAlarms`]. The report's page tells the estimate, and its rate helps `story` to
//! decide which episodes of a channel are one fault.
//!
//! Faults that are too short or too weak for an episode count as false alarms here, so the estimate
//! is rather too high than too low.

use super::source::Source;
use super::survey::{Head, Survey};

/// Counts of the signals outside of every episode, over all printheads and recordings.
#[derive(Clone, Debug, Default)]
pub struct FalseAlarms {
    /// Number of judged signals, and of those that were flagged.
    pub judged: u64,
    pub flagged: u64,
    /// Least and greatest false-alarm rate that the recordings' thresholds were set for, if any was.
    pub promised: Option<(f64, f64)>,
}

impl FalseAlarms {
    /// Counts all judged signals outside of episodes.
    pub fn of(survey: &Survey, sources: &[Source]) -> FalseAlarms {
        let of_channels = survey.heads.iter().flat_map(Head::outside);
        let (judged, flagged) = of_channels.fold((0, 0), |(n, k), of| (n + of.0, k + of.1));
        FalseAlarms { judged, flagged, promised: promised(sources) }
    }

    /// Share of flagged signals, with one signal added that counts as half flagged, so that it is not 0.
    pub fn rate(&self) -> f64 {
        (self.flagged as f64 + 0.5) / (self.judged as f64 + 1.0)
    }
}

/// Least and greatest `detect.false_alarm_rate` in the settings of those recordings whose threshold is a
/// quantile. Of a recording that was judged by a design these are the design's.
fn promised(sources: &[Source]) -> Option<(f64, f64)> {
    let rates = sources.iter().filter_map(|source| {
        let detect = &source.document["settings"]["detect"];
        let by_quantile = detect["threshold"] == "quantile";
        detect["false_alarm_rate"].as_f64().filter(|_| by_quantile)
    });
    rates.fold(None, |range: Option<(f64, f64)>, rate| {
        let (low, high) = range.unwrap_or((rate, rate));
        Some((low.min(rate), high.max(rate)))
    })
}
