//! Scores episodes against the labels: which labelled faults were found, how soon, and which
//! episodes were raised without a fault. An episode is a fault of one channel that inkling found
//! over several bursts (`docs/design/state.md`).
//!
//! In, from `inkling score`: the labels, then the episodes of all recordings (`add_episode`), and
//! then their judged signals (`add_signal`), both in any order. Out: an `EpisodesReport`. The steps:
//! 1. Spans over which the label that applies to a channel names one fault class are merged into one
//!    fault where they follow each other without a gap (`faults_of`). A growing fault is labelled
//!    in such pieces, so the fault has its full size from the begin of its last label on.
//! 2. An episode finds each fault of its channel that it overlaps; the one that was raised first
//!    counts. An episode that finds none and was raised while the channel was labelled healthy is
//!    false.
//! 3. The signals of a fault before its first episode was raised are counted: that is the delay.

use super::sums::share;
use inkling_core::fault::{self, Categories};
use inkling_core::labels::{Channels, Label, Labels};
use serde::Serialize;
use std::collections::{BTreeMap, HashMap};

/// `fault` is the class and `category` the category that it names, if any. `raised_at_ns` is when
/// the evidence sufficed, `began_at_ns` the estimated onset.
#[derive(Clone, Copy, Debug)]
pub struct DetectedEpisode<'a> {
    pub printhead: &'a str,
    pub channel: u32,
    pub category: Option<&'a str>,
    pub fault: Option<&'a str>,
    pub raised_at_ns: i64,
    pub began_at_ns: i64,
}

/// One fault of a channel, while the labels that apply name one class without a gap. It lasts from
/// `from_ns` (i64::MIN: no begin is labelled) until just before `to_ns`.
#[derive(Clone, Debug, Default)]
struct LabelledFault {
    state: String,
    from_ns: i64,
    to_ns: i64,
    /// Time from which on the fault has its full size.
    full_ns: i64,
    /// Number of judged signals of the channel during the fault.
    looks: u64,
    /// Number of these signals before the episode was raised; and of those, at full size.
    looks_before: u64,
    full_looks_before: u64,
    first_detection: Option<FirstDetection>,
}

/// Whether the episode names the category and the class that the label says.
#[derive(Clone, Copy, Debug)]
struct FirstDetection {
    raised_at_ns: i64,
    category_right: bool,
    fault_right: bool,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StateEpisodes {
    pub faults: u64,
    pub found: u64,
    /// Number of the found faults whose category is named rightly, and of those whose class is.
    pub category_right: u64,
    pub fault_right: u64,
    /// Median over the found faults of the judged bursts at full size before the episode was
    /// raised; 0 if it was raised before the full size. `None`: none was found.
    pub delay_bursts: Option<f64>,
}

/// Figures of all episodes. Faults of which no signal was judged do not count.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct EpisodesReport {
    pub faults: u64,
    /// Share of the faults that was found.
    pub recall: f64,
    /// Episodes raised while the channel was labelled healthy.
    #[serde(rename = "false")]
    pub false_episodes: u64,
    pub healthy_signals: u64,
    /// False episodes per million healthy signals.
    pub false_per_million: f64,
    /// As [`StateEpisodes::delay_bursts`].
    pub delay_bursts: Option<f64>,
    /// The same from the fault's onset on.
    pub delay_from_onset_bursts: Option<f64>,
    /// Shares of the found faults whose category is named rightly, and whose class is.
    pub category_accuracy: f64,
    pub fault_accuracy: f64,
    pub by_state: BTreeMap<String, StateEpisodes>,
    /// Episodes raised where no label says what is true.
    pub unlabelled: u64,
}

/// Sums that grow while recordings come in; `report` computes the figures from them.
#[derive(Clone, Debug)]
pub struct EpisodeScore<'a> {
    labels: &'a Labels,
    /// By printhead and channel, for the channels that were met.
    faults: HashMap<String, HashMap<u32, Vec<LabelledFault>>>,
    false_episodes: u64,
    unlabelled: u64,
    healthy_signals: u64,
}

impl<'a> EpisodeScore<'a> {
    /// A score of no episodes yet, against these labels.
    pub fn new(labels: &'a Labels) -> EpisodeScore<'a> {
        let faults = HashMap::new();
        EpisodeScore { labels, faults, false_episodes: 0, unlabelled: 0, healthy_signals: 0 }
    }

    fn faults_of(&mut self, printhead: &str, channel: u32) -> &mut [LabelledFault] {
        if !self.faults.contains_key(printhead) {
            self.faults.insert(printhead.to_owned(), HashMap::new());
        }
        let channels = self.faults.get_mut(printhead).expect("it was put there");
        let labels = self.labels;
        channels.entry(channel).or_insert_with(|| faults_of(labels, printhead, channel))
    }

    /// The episodes of all recordings must come before any signal: a fault may last over several
    /// recordings, and its signals count up to its first episode in any of them.
    pub fn add_episode(&mut self, detected: DetectedEpisode, categories: &Categories) {
        let mut explained = false;
        for fault in self.faults_of(detected.printhead, detected.channel) {
            // the episode may be raised after the fault is over, but not before it has begun
            if detected.raised_at_ns < fault.from_ns || detected.began_at_ns >= fault.to_ns {
                continue;
            }
            explained = true;
            let earlier =
                fault.first_detection.is_some_and(|f| f.raised_at_ns <= detected.raised_at_ns);
            if !earlier {
                fault.first_detection = Some(FirstDetection {
                    raised_at_ns: detected.raised_at_ns,
                    category_right: detected
                        .category
                        .is_some_and(|category| categories.is_of(&fault.state, category)),
                    fault_right: detected.fault == Some(fault.state.as_str()),
                });
            }
        }
        if explained {
            return;
        }

        match self.labels.at(detected.printhead, detected.channel, detected.raised_at_ns) {
            Some(label) if label.state == fault::HEALTHY => self.false_episodes += 1,
            Some(_) => {} // of a fault that is labelled for all channels at once
            None => self.unlabelled += 1,
        }
    }

    /// Adds a judged signal of a recording that has episodes. `t_ns`: its t_a; `label`: what is
    /// true of it, `None` if no label says.
    pub fn add_signal(&mut self, printhead: &str, channel: u32, t_ns: i64, label: Option<&Label>) {
        self.healthy_signals += u64::from(label.is_some_and(|label| label.state == fault::HEALTHY));
        for fault in self.faults_of(printhead, channel) {
            // what is ignored within a fault has no label
            let is_true = label.is_some_and(|label| label.state == fault.state);
            if !is_true || !(fault.from_ns..fault.to_ns).contains(&t_ns) {
                continue;
            }
            fault.looks += 1;
            if fault.first_detection.is_some_and(|found| t_ns < found.raised_at_ns) {
                fault.looks_before += 1;
                fault.full_looks_before += u64::from(t_ns >= fault.full_ns);
            }
        }
    }

    /// The figures over all faults of which a signal was judged.
    pub fn report(&self) -> EpisodesReport {
        let seen = self.faults.values().flat_map(HashMap::values).flatten();
        let mut seen: Vec<&LabelledFault> = seen.filter(|fault| fault.looks > 0).collect();
        seen.sort_by_key(|fault| (fault.from_ns, fault.to_ns));
        let mut of_states: BTreeMap<String, Vec<&LabelledFault>> = BTreeMap::new();
        seen.iter().for_each(|fault| of_states.entry(fault.state.clone()).or_default().push(fault));
        let all = StateEpisodes::of(&seen);
        let found = seen.iter().filter(|fault| fault.first_detection.is_some());
        EpisodesReport {
            faults: all.faults,
            recall: share(all.found, all.faults),
            false_episodes: self.false_episodes,
            healthy_signals: self.healthy_signals,
            false_per_million: self.false_episodes as f64 * 1e6
                / self.healthy_signals.max(1) as f64,
            delay_bursts: all.delay_bursts,
            delay_from_onset_bursts: median(found.map(|fault| fault.looks_before).collect()),
            category_accuracy: share(all.category_right, all.found),
            fault_accuracy: share(all.fault_right, all.found),
            by_state: of_states.iter().map(|(s, of)| (s.clone(), StateEpisodes::of(of))).collect(),
            unlabelled: self.unlabelled,
        }
    }
}

impl StateEpisodes {
    fn of(faults: &[&LabelledFault]) -> StateEpisodes {
        let found = || faults.iter().filter_map(|fault| Some((fault, fault.first_detection?)));
        StateEpisodes {
            faults: faults.len() as u64,
            found: found().count() as u64,
            category_right: found().filter(|(_, first)| first.category_right).count() as u64,
            fault_right: found().filter(|(_, first)| first.fault_right).count() as u64,
            delay_bursts: median(found().map(|(fault, _)| fault.full_looks_before).collect()),
        }
    }
}

/// A span between two changes of a channel's labels that has the class of the fault just before it
/// makes that fault longer, spans in between that labels ignore included. A row for all channels at
/// once is about the printhead, not a fault of this channel.
fn faults_of(labels: &Labels, printhead: &str, channel: u32) -> Vec<LabelledFault> {
    let mut faults: Vec<LabelledFault> = Vec::new();
    // whether the last fault lasts until the span that is looked at
    let mut lasts = false;
    for &[from_ns, to_ns] in labels.changes(printhead, channel).array_windows() {
        let row = labels.row_at(printhead, channel, from_ns);
        let faulty = row.filter(|row| row.is_fault() && row.channel != Channels::All);
        let Some(row) = faulty else {
            lasts &= row.is_some_and(|row| row.state == fault::IGNORE);
            continue;
        };
        match faults.last_mut().filter(|fault| lasts && fault.state == row.state) {
            Some(fault) => {
                fault.to_ns = to_ns;
                if row.from_ns == Some(from_ns) {
                    fault.full_ns = from_ns;
                }
            }
            None => faults.push(LabelledFault {
                state: row.state.clone(),
                from_ns,
                to_ns,
                full_ns: from_ns,
                ..LabelledFault::default()
            }),
        }
        lasts = true;
    }
    faults
}

fn median(mut of: Vec<u64>) -> Option<f64> {
    of.sort_unstable();
    let (low, high) = (of.len().checked_sub(1)? / 2, of.len() / 2);
    Some((of[low] + of[high]) as f64 / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ops::Range;

    fn label(channel: Option<u32>, from: Option<i64>, to: Option<i64>, state: &str) -> Label {
        Label {
            printhead: "p".into(),
            channel: channel.map_or(Channels::All, Channels::One),
            from_ns: from,
            to_ns: to,
            state: state.into(),
            severity: None,
        }
    }

    fn labels() -> Vec<Label> {
        vec![
            label(None, None, Some(1000), "healthy"),
            // a fault that grows from 100 on and has its full size from 102 on
            label(Some(1), Some(100), Some(101), "BN"),
            label(Some(1), Some(101), Some(102), "BN"),
            label(Some(1), Some(102), Some(200), "BN"),
            label(Some(2), Some(300), Some(400), "EC"),
            label(Some(9), Some(0), Some(10), "EC"), // of a channel that was not recorded
        ]
    }

    fn detected(channel: u32, raised_at_ns: i64, fault: Option<&str>) -> DetectedEpisode<'_> {
        DetectedEpisode {
            printhead: "p",
            channel,
            category: Some("blocked_nozzle"),
            fault,
            raised_at_ns,
            began_at_ns: raised_at_ns - 2,
        }
    }

    /// Scores episodes, and a signal of each of the channels at each of the times.
    fn scored(
        labels: Vec<Label>,
        episodes: &[DetectedEpisode],
        channels: Range<u32>,
        times: Range<i64>,
    ) -> EpisodesReport {
        let labels = Labels::new(labels);
        let mut score = EpisodeScore::new(&labels);
        episodes.iter().for_each(|e| score.add_episode(*e, &Categories::default()));
        for t in times {
            for channel in channels.clone() {
                score.add_signal("p", channel, t, labels.at("p", channel, t));
            }
        }
        score.report()
    }

    fn run(episodes: &[DetectedEpisode]) -> EpisodesReport {
        scored(labels(), episodes, 1..4, 0..500)
    }

    #[test]
    fn fault_found_counts_once_with_its_delay() {
        let report = run(&[detected(1, 105, Some("PBN")), detected(1, 150, Some("BN"))]);
        assert_eq!((report.faults, report.recall, report.false_episodes), (2, 0.5, 0));
        assert_eq!((report.delay_bursts, report.delay_from_onset_bursts), (Some(3.0), Some(5.0)));
        assert_eq!((report.category_accuracy, report.fault_accuracy), (1.0, 0.0));
        assert_eq!(report.by_state["EC"].found, 0);
        assert_eq!(report.healthy_signals, 1500 - 200);
    }

    #[test]
    fn a_fault_of_a_range_is_of_each_of_its_channels_but_where_a_narrower_row_says_otherwise() {
        let range = Label { channel: Channels::Range(4, 6), ..label(None, None, None, "BN") };
        let labels = vec![range, label(Some(5), None, None, "healthy")];
        let report = scored(labels, &[detected(4, 105, Some("BN"))], 1..9, 105..106);
        assert_eq!((report.faults, report.recall, report.healthy_signals), (2, 0.5, 1));
    }

    #[test]
    fn labels_that_others_override_neither_explain_episodes_nor_join_faults() {
        // the printhead's own healthy rows beat those of all printheads
        let bn = Label { printhead: "*".into(), ..label(Some(1), Some(0), Some(100), "BN") };
        let healthy = label(Some(1), Some(40), Some(60), "healthy");
        let later = label(Some(1), Some(100), Some(120), "healthy");
        // raised and begun while the channel is healthy, and of the second half of the fault
        let in_between = DetectedEpisode { began_at_ns: 45, ..detected(1, 50, Some("BN")) };
        let episodes = [in_between, detected(1, 70, Some("BN"))];
        let report = scored(vec![bn, healthy, later], &episodes, 1..2, 0..120);
        assert_eq!((report.faults, report.recall, report.false_episodes), (2, 0.5, 1));
        assert_eq!((report.delay_bursts, report.healthy_signals), (Some(10.0), 40));
    }

    #[test]
    fn a_fault_goes_on_beyond_what_is_ignored_and_is_full_from_its_last_labels_begin() {
        let of = |from, to, state| label(Some(1), Some(from), Some(to), state);
        let wide = Label { channel: Channels::Range(0, 9), ..of(0, 100, "BN") };
        let labels = vec![wide, of(20, 30, "BN"), of(60, 70, "ignore")];
        let report = scored(labels, &[detected(1, 50, Some("BN"))], 1..2, 0..100);
        assert_eq!((report.faults, report.recall), (1, 1.0));
        // the narrow label begins at 20; where it ends, no label begins
        assert_eq!((report.delay_bursts, report.delay_from_onset_bursts), (Some(30.0), Some(50.0)));
    }

    #[test]
    fn raised_before_full_size_has_no_delay_and_raised_before_onset_is_false() {
        let report = run(&[detected(1, 101, Some("BN")), detected(2, 299, Some("EC"))]);
        assert_eq!((report.recall, report.false_episodes), (0.5, 1));
        assert_eq!(report.delay_bursts, Some(0.0));
    }

    #[test]
    fn what_no_label_covers_is_neither_right_nor_false() {
        let report = run(&[detected(3, 2000, None)]);
        assert_eq!((report.false_episodes, report.unlabelled), (0, 1));
        assert_eq!(report.delay_bursts, None);
    }
}
