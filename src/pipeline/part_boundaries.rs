//! Decides where the table of a recording that is being written is cut into parts: before the first burst
//! that lies a whole span of recording time after the earliest burst of its printhead in the part.
//!
//! In: batches of verdicts in the recording's order, from `rotation` ([`PartBoundaries::cut`]). Out: each batch
//! in sections, one per part of the table.
//!
//! Each printhead counts by its own times, because clocks of two printheads may differ by more than a part; the
//! first printhead whose burst lies a whole span behind ends the part for all. Nothing is cut within a burst.

use super::groups::of_printhead;
use inkling_core::verdict::{Part, Reason, Verdicts};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Maximum number of printheads whose times decide.
const MOST_PRINTHEADS: usize = 1 << 16;

#[derive(Debug)]
pub struct PartBoundaries {
    span_ns: i64,
    /// By printhead, t_a of its earliest burst in the part.
    first_ns: BTreeMap<Arc<str>, i64>,
}

#[derive(Debug, PartialEq)]
pub struct Section {
    pub parts: Vec<Part>,
    /// t_a of its earliest and of its latest burst, ns; without a burst the largest and the least i64.
    pub from_ns: i64,
    pub to_ns: i64,
}

impl PartBoundaries {
    pub fn new(span_ns: i64) -> PartBoundaries {
        PartBoundaries { span_ns, first_ns: BTreeMap::new() }
    }

    /// The first section, which may be empty, continues the part at hand; each further one begins a part.
    pub fn cut(&mut self, of: &Verdicts) -> Vec<Section> {
        let mut sections = Vec::new();
        let mut section = Section::empty();
        for burst in of.by_burst() {
            let printhead = &of.rows.printheads[burst.printhead as usize];
            if self.lies_behind(printhead, burst.t_ns, is_undecoded(of, &burst.part)) {
                sections.push(std::mem::replace(&mut section, Section::empty()));
            }
            section.from_ns = section.from_ns.min(burst.t_ns);
            section.to_ns = section.to_ns.max(burst.t_ns);
            section.parts.push(burst.part);
        }
        sections.push(section);
        sections
    }

    /// Whether a burst begins the next part; notes the burst's time. `undecoded`: only the burst's log time is
    /// known, which is another clock's, so that it cuts nothing.
    fn lies_behind(&mut self, printhead: &Arc<str>, t_ns: i64, undecoded: bool) -> bool {
        if undecoded {
            return false;
        }
        let first_ns = self.first_ns.get(printhead);
        let behind = first_ns.is_some_and(|first| t_ns.saturating_sub(*first) >= self.span_ns);
        // the next part begins: the times of all printheads count anew
        if behind {
            self.first_ns.clear();
        }
        let first_ns = of_printhead(&mut self.first_ns, printhead, MOST_PRINTHEADS, || t_ns);
        if let Some(first_ns) = first_ns {
            *first_ns = t_ns.min(*first_ns);
        }
        behind
    }
}

impl Section {
    fn empty() -> Section {
        Section { parts: Vec::new(), from_ns: i64::MAX, to_ns: i64::MIN }
    }
}

fn is_undecoded(of: &Verdicts, part: &Part) -> bool {
    match part {
        Part::Healthy(_) => false,
        Part::Rows(rows) => of.rows.reason[rows.start] == Some(Reason::Undecodable),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use inkling_core::verdict::{HealthyRun, Outcome, Test};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Adds a burst of `signals` signals. `reason`: why it was rejected; `None`:
    /// some of its signals are healthy.
    fn push(
        of: &mut Verdicts,
        printhead: u32,
        t_ns: i64,
        signals: usize,
        reason: Option<Reason>,
        rng: &mut ChaCha8Rng,
    ) {
        let mut channel = 0;
        while channel < signals {
            let healthy = rng.random_range(1..=signals - channel);
            if reason.is_none() && rng.random_bool(0.5) {
                let from = of.tests.statistic.len();
                of.tests.statistic.resize(from + healthy, 0.0);
                of.parts.push(Part::Healthy(HealthyRun {
                    t_ns,
                    printhead,
                    first_channel: channel as u32,
                    signals: from..from + healthy,
                    model: 0,
                    along: Test::Ring,
                    threshold: 1.0,
                    beside: 1.0,
                }));
                channel += healthy;
                continue;
            }
            of.rows.acquired_at_ns.push(t_ns);
            of.rows.printhead.push(printhead);
            of.rows.channel.push(channel as u32);
            of.rows.outcome.push(Outcome::Undecided);
            of.rows.fill_up();
            of.rows.reason[of.rows.acquired_at_ns.len() - 1] = reason;
            of.close_rows();
            channel += 1;
        }
    }

    fn batch() -> Verdicts {
        let mut of = Verdicts::default();
        of.rows.printheads = ["a".into(), "b".into()].to_vec();
        of
    }

    /// Printhead, time and channel of every signal.
    fn signals(of: &Verdicts, parts: &[Part]) -> Vec<(u32, i64, u32)> {
        let c = &of.rows;
        let rows = |part: &Part| -> Vec<(u32, i64, u32)> {
            match part {
                Part::Healthy(run) => (run.first_channel..)
                    .zip(run.signals.clone())
                    .map(|(channel, _)| (run.printhead, run.t_ns, channel))
                    .collect(),
                Part::Rows(rows) => rows
                    .clone()
                    .map(|row| (c.printhead[row], c.acquired_at_ns[row], c.channel[row]))
                    .collect(),
            }
        };
        parts.iter().flat_map(rows).collect()
    }

    #[test]
    fn property_borders_never_split_a_burst_and_nothing_is_lost_or_twice() {
        let mut rng = ChaCha8Rng::seed_from_u64(22);
        for span_ns in [1, 7, 100] {
            let mut boundaries = PartBoundaries::new(span_ns);
            // the clock of printhead b is far ahead of that of a
            let (mut t_ns, ahead_ns) = (0, 1_000_000);
            let mut parts: Vec<Vec<(u32, i64, u32)>> = vec![Vec::new()];
            let mut all = Vec::new();
            for _ in 0..200 {
                let mut of = batch();
                for _ in 0..rng.random_range(0..6) {
                    t_ns += rng.random_range(1..10);
                    let printhead = rng.random_range(0..2u32);
                    let t_ns = t_ns + i64::from(printhead) * ahead_ns;
                    let n = rng.random_range(1..20);
                    push(&mut of, printhead, t_ns, n, None, &mut rng);
                }
                all.extend(signals(&of, &of.parts));
                for (nth, section) in boundaries.cut(&of).iter().enumerate() {
                    if nth > 0 {
                        parts.push(Vec::new());
                    }
                    parts.last_mut().unwrap().extend(signals(&of, &section.parts));
                }
            }
            assert_eq!(parts.concat(), all);
            assert!(parts.len() as i64 > t_ns / (span_ns + 20), "{span_ns}: {}", parts.len());
            for pair in parts.windows(2) {
                let ((last, t, _), (first, next_t, _)) = (pair[0][pair[0].len() - 1], pair[1][0]);
                assert!((last, t) != (first, next_t), "a burst is split at {t}");
            }
            for part in &parts {
                for head in 0..2 {
                    let times = part.iter().filter(|row| row.0 == head).map(|row| row.1);
                    let ends = times.clone().min().zip(times.max());
                    assert!(ends.is_none_or(|(from, to)| to - from < span_ns), "{ends:?}");
                }
            }
        }
    }

    /// Cuts one batch of bursts of `a`, and returns the first and last time of each section.
    fn cut(times: &[i64], reason: Option<Reason>) -> Vec<(i64, i64)> {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut of = batch();
        times.iter().for_each(|&t_ns| push(&mut of, 0, t_ns, 3, reason, &mut rng));
        let sections = PartBoundaries::new(10).cut(&of);
        sections.iter().map(|section| (section.from_ns, section.to_ns)).collect()
    }

    #[test]
    fn late_bursts_and_stray_clocks_cost_one_part_at_most() {
        assert_eq!(cut(&[0, 9, 10, 11, 20], None), [(0, 9), (10, 11), (20, 20)]);
        // a late burst moves the begin of the part, and so its end, to an earlier time
        assert_eq!(cut(&[5, 0, 9, 10, 12], None), [(0, 9), (10, 12)]);
        assert_eq!(cut(&[0, 1_000_000, 1, 2, 3], None), [(0, 0), (1, 1_000_000)]);
        assert_eq!(cut(&[i64::MAX, i64::MIN, i64::MIN + 9], None), [(i64::MIN, i64::MAX)]);
        // the time of a burst that was not decoded is the log's, and cuts nothing
        assert_eq!(cut(&[0, 1_000_000, 1], Some(Reason::Undecodable)), [(0, 1_000_000)]);
        assert_eq!(cut(&[0, 10], Some(Reason::WrongLength)), [(0, 0), (10, 10)]);
    }
}
