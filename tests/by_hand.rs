//! Tables of verdicts and episodes made by hand: what another channel, another printer, another replay may write.

use crate::house::House;
use inkling::episodes::Episode;
use inkling::io::episode_table::EpisodeWriter;
use inkling::io::verdict_table::{TableOptions, TimestampUnit, VerdictWriter};
use inkling::verdict::{Outcome, VerdictColumns};

const DAY_S: i64 = 86_400;
/// 2025-01-01T08:00:00Z, when scenarios begin.
pub const START_S: i64 = 1_735_718_400;
const CHANNELS: u32 = 6;

/// A channel that is faulty from when to when, s since the recording began.
struct Spell {
    channel: u32,
    began_s: i64,
    ended_s: Option<i64>,
}

impl Spell {
    /// `1@5..15`, or `1@5..` where it is still on.
    fn parsed(text: &str) -> Spell {
        let (channel, times) = text.split_once('@').expect("a channel and times");
        let (from, to) = times.split_once("..").expect("from when to when");
        let ended_s = (!to.is_empty()).then(|| to.parse().unwrap());
        Spell { channel: channel.parse().unwrap(), began_s: from.parse().unwrap(), ended_s }
    }

    fn covers(&self, channel: u32, t_s: i64) -> bool {
        self.channel == channel && t_s >= self.began_s && self.ended_s.is_none_or(|end| t_s < end)
    }
}

/// A recording of 40 bursts of six channels, one a second.
struct Recording<'a> {
    printhead: &'a str,
    from_s: i64,
    spells: Vec<Spell>,
    /// A channel that was not measured.
    without: Option<u32>,
    /// A single faulty signal, which is no episode.
    single: Option<Spell>,
}

/// Tables in `out`: of `0`, or of `08..10` three, at `1d` or, each 600 s after the one before, at `k600`; then what is faulty in
/// them, `1@5..15`, a single faulty signal, `!0@33..34`, a channel that was not measured, `-1`, and `of` which printhead.
pub fn by_hand(house: &House, names: &str, words: &str) {
    let (words, printhead) = words.split_once(" of ").unwrap_or((words, "p"));
    let (from, faulty) = words.split_once(' ').unwrap_or((words, ""));
    let (first, last) = names.split_once("..").unwrap_or((names, names));
    let number = |text: &str| text.parse::<i64>().unwrap_or_else(|_| panic!("{text}: no number"));
    for k in number(first)..=number(last) {
        let from_s = match (from.strip_prefix('k'), from.strip_suffix('d')) {
            (Some(every), _) => k * number(every),
            (_, Some(days)) => DAY_S * number(days),
            _ => number(from),
        };
        let printhead = &printhead.replace("\\e", "\u{1b}");
        let mut recording =
            Recording { printhead, from_s, spells: Vec::new(), without: None, single: None };
        for word in faulty.split(' ').filter(|word| !word.is_empty()) {
            match (word.strip_prefix('-'), word.strip_prefix('!')) {
                (Some(channel), _) => recording.without = channel.parse().ok(),
                (_, Some(spell)) => recording.single = Some(Spell::parsed(spell)),
                _ => recording.spells.push(Spell::parsed(word)),
            }
        }
        recording.write(house, &format!("out/{k:0width$}", width = first.len()));
    }
}

impl Recording<'_> {
    fn write(&self, house: &House, stem: &str) {
        let document = format!("{{\"recording\":{{\"digest\":\"{stem} of {}\"}}}}", self.from_s);
        house.write(&format!("{stem}.summary.json"), &document);
        let options = TableOptions {
            recording: "r.mcap".into(),
            classes: vec!["PBN".into()],
            categories: vec!["blocked_nozzle".into()],
            weights: false,
            timestamp_unit: TimestampUnit::Ns,
        };
        let path = house.path(&format!("{stem}.verdicts.parquet"));
        let mut verdicts = VerdictWriter::create(&path, options).unwrap();
        for t_s in 0..40 {
            verdicts.write(&self.rows(t_s).into()).unwrap();
        }
        verdicts.complete(document.clone()).unwrap().name().unwrap();

        let path = house.path(&format!("{stem}.episodes.parquet"));
        let mut episodes = EpisodeWriter::create(&path, TimestampUnit::Ns, "r.mcap").unwrap();
        episodes.write(self.spells.iter().map(|spell| self.episode(spell)).collect()).unwrap();
        episodes.complete(document).unwrap().name().unwrap();
    }

    fn ns(&self, t_s: i64) -> i64 {
        (START_S + self.from_s + t_s) * 1_000_000_000
    }

    fn rows(&self, t_s: i64) -> VerdictColumns {
        let channels: Vec<u32> = (0..CHANNELS).filter(|c| self.without != Some(*c)).collect();
        let n = channels.len();
        let is_faulty =
            |c: &u32| self.spells.iter().chain(&self.single).any(|of| of.covers(*c, t_s));
        let faulty: Vec<bool> = channels.iter().map(is_faulty).collect();
        let named: Vec<_> = faulty.iter().map(|of| of.then_some(0)).collect();
        let outcome = |of: &bool| if *of { Outcome::Faulty } else { Outcome::Healthy };
        let mut rows = VerdictColumns {
            acquired_at_ns: vec![self.ns(t_s); n],
            printhead: vec![0; n],
            printheads: vec![self.printhead.into()],
            outcome: faulty.iter().map(outcome).collect(),
            category: named.clone(),
            fault: named.clone(),
            candidate: named,
            certainty: vec![Some(0.9); n],
            statistic: faulty.iter().map(|of| Some(if *of { 9.0 } else { 0.2 })).collect(),
            threshold: vec![Some(1.0); n],
            severity: faulty.iter().map(|of| of.then_some(0.3)).collect(),
            channel: channels,
            ..VerdictColumns::default()
        };
        rows.fill_up();
        rows
    }

    fn episode(&self, spell: &Spell) -> Episode {
        Episode {
            printhead: self.printhead.into(),
            channel: spell.channel,
            category: Some("blocked_nozzle".into()),
            fault: Some("PBN".into()),
            raised_at_ns: self.ns(spell.began_s + 1),
            began_at_ns: self.ns(spell.began_s),
            ended_at_ns: spell.ended_s.map(|end| self.ns(end)),
            bursts: 10,
            certainty: Some(0.9),
            severity_first: Some(0.3),
            severity_max: Some(0.3),
            severity_last: Some(0.3),
            severity_sd: Some(0.01),
            explanation: format!("channel {} of {}", spell.channel, self.printhead),
            ..Episode::default()
        }
    }
}
