//! Counts the bursts of a recording by printhead and sampling, for `inkling inspect`. In: the
//! acquisitions of a recording one by one, usable or not ([`Contents::see`]). Out: text or JSON,
//! with what is unusable, what is damaged, and what is odd about the times.

use super::exit::Exit;
use super::progress::{counted, thousands};
use super::report::printable;
use crate::pipeline::clock_words;
use crate::pipeline::groups::GroupKey;
use crate::pipeline::head_clock::{FileOrder, HeadClock};
use chrono::{DateTime, SecondsFormat};
use inkling_core::burst::Acquisition;
use inkling_io::damage::Damage;
use inkling_io::recording::Recording;
use serde::{Serialize, Serializer};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{self, Write};

/// Counts of the bursts of one printhead with the same number of samples and sample period.
#[derive(Debug, Default, Serialize)]
struct BurstGroup {
    bursts: u64,
    signals: u64,
    first_channel: u32,
    last_channel: u32,
    /// Times t_a of its earliest and latest burst, ns since the epoch.
    #[serde(rename = "from", serialize_with = "as_time")]
    first_ns: i64,
    #[serde(rename = "to", serialize_with = "as_time")]
    last_ns: i64,
    /// Whether some burst has a temperature, and a drive voltage.
    temperature: bool,
    #[serde(rename = "drive_voltage")]
    voltage: bool,
}

/// Printhead, number of samples, and sample period in ps, rounded so that equal periods compare
/// equal.
type Key = (String, u32, u64);

/// What a recording holds.
#[derive(Debug)]
pub struct Contents {
    groups: BTreeMap<Key, BurstGroup>,
    order: FileOrder,
    clocks: BTreeMap<Key, HeadClock>,
    /// Bursts of groups beyond [`MOST_GROUPS`].
    beyond: u64,
    /// Number of bursts, unusable ones included.
    pub bursts: u64,
    /// Number of unusable bursts by reason.
    pub unusable: BTreeMap<String, u64>,
    /// What is wrong with the first message that could not be decoded.
    undecodable: String,
    /// Damage of the file, which the caller adds.
    pub damage: Vec<Damage>,
}

/// Most characters of what is wrong with a message: the fields that it has are a part of it.
const MOST_TOLD: usize = 600;
/// Most groups that are kept: a hostile file may have millions.
const MOST_GROUPS: usize = 1000;

impl Contents {
    pub fn new(recording: &Recording) -> Contents {
        Contents {
            groups: BTreeMap::new(),
            order: FileOrder::of(recording),
            clocks: BTreeMap::new(),
            beyond: 0,
            bursts: 0,
            unusable: BTreeMap::new(),
            undecodable: String::new(),
            damage: recording.damage.clone(),
        }
    }

    /// What is odd about the times of each printhead's bursts, in words.
    fn odd_times(&self) -> Vec<String> {
        let (told, _) = clock_words::told(self.clocks.values().cloned().collect());
        told.into_iter().map(|of| of.what).collect()
    }

    /// Counts a burst.
    pub fn see(&mut self, acquisition: &Acquisition) {
        self.bursts += 1;
        match acquisition {
            Acquisition::Usable(burst) => self.see_burst(burst),
            Acquisition::Unusable(u) => {
                if self.undecodable.is_empty() {
                    self.undecodable.clone_from(&u.what);
                }
                *self.unusable.entry(u.why.as_str().into()).or_default() += 1;
            }
        }
    }

    pub fn printheads(&self) -> Vec<&str> {
        self.groups.keys().map(|(printhead, ..)| printhead.as_str()).collect()
    }

    /// Takes messages of another encoding off the number of messages that cannot be decoded: they
    /// are named like bursts, and are no damage. A dialect may read them (`topics`).
    pub fn set_aside(&mut self, of_other_encoding: u64) {
        if let Some(n) = self.unusable.get_mut("undecodable") {
            *n = n.saturating_sub(of_other_encoding);
        }
        self.unusable.retain(|_, n| *n > 0);
    }

    /// Prints the contents as text.
    pub fn print(&self, recording: &Recording, out: &mut impl Write) -> io::Result<()> {
        let expected = match recording.expected {
            Some(n) => format!("{} by its own statistics", thousands(n)),
            None => "its statistics do not say how many to expect".into(),
        };
        writeln!(out, "  bursts   {} ({expected})", thousands(self.bursts))?;
        for ((printhead, samples, period_ps), group) in &self.groups {
            let BurstGroup { first_channel, last_channel, .. } = group;
            let (head, period_ns) = (printable(printhead), *period_ps as f64 / 1e3);
            let (bursts, signals) =
                (counted(group.bursts, "burst"), counted(group.signals, "signal"));
            let every = format!("{signals} of {samples} samples every {period_ns} ns");
            let channels = format!("channels {first_channel} to {last_channel}");
            writeln!(out, "  {head:<16} {bursts}, {every}, {channels}")?;
            let [from, to] = [group.first_ns, group.last_ns].map(time);
            let recorded = |yes: bool| if yes { "recorded" } else { "not recorded" };
            let [temperature, voltage] = [group.temperature, group.voltage].map(recorded);
            let covariates = format!("temperature {temperature}, drive voltage {voltage}");
            writeln!(out, "  {:<16} {from} to {to}; {covariates}", "")?;
        }
        if self.beyond > 0 {
            writeln!(out, "  and {} of further printheads", counted(self.beyond, "burst"))?;
        }
        for told in self.odd_times() {
            writeln!(out, "  clock    {told}")?;
        }
        for (why, n) in &self.unusable {
            writeln!(out, "  unusable {} {why}", thousands(*n))?;
        }
        if !self.undecodable.is_empty() {
            let first = inkling_io::printable::line(&self.undecodable, MOST_TOLD);
            writeln!(out, "           the first undecodable: {first}")?;
        }
        Ok(())
    }

    /// The contents as JSON. `digest`: of the whole file; `exit`: `Done` if nothing is damaged or
    /// unusable.
    pub fn document(&self, recording: &Recording, digest: &str, exit: Exit) -> Value {
        let groups = self.groups.iter().map(|((printhead, samples, period_ps), group)| {
            let mut group = json!(group);
            (group["printhead"], group["samples"]) = (json!(printhead), json!(samples));
            group["sample_period_s"] = json!(*period_ps as f64 / 1e12);
            group
        });
        json!({
            "recording": recording.name,
            "bytes": recording.bytes,
            "digest": digest,
            "bursts": self.bursts,
            "expected": recording.expected,
            "groups": groups.collect::<Vec<_>>(),
            "bursts_of_further_printheads": self.beyond,
            "odd_times": self.odd_times(),
            "unusable": self.unusable,
            "first_undecodable": Some(&self.undecodable).filter(|what| !what.is_empty()),
            "damage": self.damage,
            "whole": exit == Exit::Done,
        })
    }

    /// Counts a usable burst for its group.
    fn see_burst(&mut self, burst: &inkling_core::burst::Burst) {
        let period_ps = (burst.sample_period_s * 1e12).round() as u64;
        let key = (burst.printhead.to_string(), burst.samples_per_channel, period_ps);
        if !self.groups.contains_key(&key) && self.groups.len() >= MOST_GROUPS {
            self.beyond += 1;
            return;
        }
        let clock = self.clocks.entry(key.clone());
        let new = || HeadClock::new(GroupKey::of(burst), self.order);
        clock.or_insert_with(new).hear(burst);
        let group = self.groups.entry(key).or_insert_with(|| BurstGroup {
            first_channel: u32::MAX,
            first_ns: i64::MAX,
            last_ns: i64::MIN,
            ..BurstGroup::default()
        });
        group.bursts += 1;
        group.signals += u64::from(burst.channels);
        group.first_channel = group.first_channel.min(burst.first_channel);
        group.last_channel = group.last_channel.max(burst.first_channel + (burst.channels - 1));
        group.first_ns = group.first_ns.min(burst.t_acq_ns);
        group.last_ns = group.last_ns.max(burst.t_acq_ns);
        group.temperature |= burst.temperature_c.is_some();
        group.voltage |= burst.drive_voltage_v.is_some();
    }
}

/// Writes a time, ns since the epoch, as RFC 3339 in milliseconds.
fn as_time<S: Serializer>(t_ns: &i64, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(&time(*t_ns))
}

/// A time, ns since the epoch, as RFC 3339 in milliseconds.
pub fn time(t_ns: i64) -> String {
    DateTime::from_timestamp_nanos(t_ns).to_rfc3339_opts(SecondsFormat::Millis, true)
}
