//! How often a healthy signal is flagged, estimated from the verdicts themselves: signals outside
//! of every episode are taken for healthy.
//!
//! In: a [`Survey`], and the recordings' settings, which hold the rate that their thresholds were
//! set for. Out: [`FalseAlarms`]. The report's page tells the estimate with an interval, and its
//! rate helps `story` to decide which episodes of a channel are one fault.
//!
//! Faults that are too short or too weak for an episode count as false alarms here, so the estimate
//! is rather too high than too low. Channels differ, and a channel near its threshold is flagged
//! again and again. So the signals count in the interval for as few independent ones as would
//! scatter as much over channels (Korn and Graubard, 1998): the standard error of the rate is taken
//! from the scatter over channels, divided by the one that independent signals would have, and
//! squared; by this factor the numbers of signals are divided before Wilson's interval.

use super::source::Source;
use super::survey::{Head, Survey};

/// Counts of the signals outside of every episode, over all printheads and recordings.
#[derive(Clone, Debug, Default)]
pub struct FalseAlarms {
    /// Number of judged signals, and of those that were flagged.
    pub judged: u64,
    pub flagged: u64,
    /// Standard error of the share of flagged signals, from the scatter over channels.
    pub standard_error: f64,
    /// Least and greatest false-alarm rate that the recordings' thresholds were set for, if any was.
    pub promised: Option<(f64, f64)>,
}

impl FalseAlarms {
    /// Counts all judged signals outside of episodes.
    pub fn of(survey: &Survey, sources: &[Source]) -> FalseAlarms {
        // judged and flagged signals of each channel outside of its episodes
        let counts: Vec<(u64, u64)> = survey.heads.iter().flat_map(Head::outside).collect();

        let judged: u64 = counts.iter().map(|c| c.0).sum();
        let flagged: u64 = counts.iter().map(|c| c.1).sum();
        let rate = flagged as f64 / judged.max(1) as f64;

        // Cluster-robust standard error of a ratio, with each channel as one cluster: sqrt(sum over
        // channels of (k - rate n)^2) / sum of n, with k flagged of n signals. The signals of a
        // channel may depend on each other, channels do not.
        let squares =
            counts.iter().map(|&(n, k)| (k as f64 - rate * n as f64).powi(2)).sum::<f64>();
        let standard_error = squares.sqrt() / judged.max(1) as f64;
        FalseAlarms { judged, flagged, standard_error, promised: promised(sources) }
    }

    /// Share of flagged signals, with one signal added that counts as half flagged, so that it is not 0.
    pub fn rate(&self) -> f64 {
        (self.flagged as f64 + 0.5) / (self.judged as f64 + 1.0)
    }

    /// 95 % interval of the share `flagged / judged`: Wilson's, of as many independent signals as scatter as much.
    pub fn interval(&self) -> [f64; 2] {
        let (n, k) = (self.judged.max(1) as f64, self.flagged as f64);
        let by_chance = (k * (1.0 - k / n)).sqrt() / n;
        // so many signals tell as much as one independent signal would; if none was flagged,
        // nothing scatters, and the NaN becomes 1
        let alike = (self.standard_error / by_chance).powi(2).max(1.0);
        wilson(k / alike, n / alike)
    }
}

/// 95 % interval of a share from `hits` among `n` independent signals (Wilson 1927). Both may be fractions,
/// as for an effective number of signals.
fn wilson(hits: f64, n: f64) -> [f64; 2] {
    const Z2: f64 = 1.96 * 1.96;
    let share = hits / n.max(1.0);
    let middle = (share + Z2 / (2.0 * n.max(1.0))) / (1.0 + Z2 / n.max(1.0));
    let spread = share * (1.0 - share) / n.max(1.0) + Z2 / (4.0 * n.max(1.0).powi(2));
    let half = (Z2 * spread).sqrt() / (1.0 + Z2 / n.max(1.0));
    [(middle - half).max(0.0), (middle + half).min(1.0)]
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::fixtures::{surveyed, verdicts};
    use inkling_core::verdict::Outcome;

    #[test]
    fn channels_that_are_flagged_again_and_again_widen_the_interval() {
        let estimate = |flagged: &dyn Fn(u32, i64) -> bool| {
            let burst = |t: i64| {
                let outcome = |c| match flagged(c, t) {
                    true => Outcome::Undecided,
                    false => Outcome::Healthy,
                };
                verdicts(t, (0..40).map(|c| (c, outcome(c))))
            };
            FalseAlarms::of(&surveyed(&[(0..1000).map(burst).collect()]), &[])
        };
        let spread = estimate(&|c, t| (t + 17 * i64::from(c)) % 100 == 0);
        let one = estimate(&|c, t| c == 3 && t < 400);
        assert_eq!((spread.flagged, one.flagged, spread.judged), (400, 400, 40_000));
        assert!(one.standard_error > 10.0 * spread.standard_error);
        // one of some hundred independent signals (Wilson): .0018 to .054
        assert!(one.interval()[0] < 0.002 && one.interval()[1] > 0.05);
    }

    #[test]
    fn wilson_is_the_published_interval() {
        // Newcombe 1998, table I: 81 of 263, 15 of 148, 0 of 20
        for (hits, n, low, high) in
            [(81.0, 263.0, 0.2553, 0.3662), (15.0, 148.0, 0.0624, 0.1605), (0.0, 20.0, 0.0, 0.1611)]
        {
            let [a, b] = wilson(hits, n);
            assert!((a - low).abs() < 1e-4 && (b - high).abs() < 1e-4, "{hits}/{n}: {a} {b}");
        }
    }
}
