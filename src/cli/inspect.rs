//! `inkling inspect`: what is in a recording, and whether it is whole.

use super::exit::{Exit, Failure};
use super::progress::{Progress, interruptible, thousands};
use super::report::printable;
use crate::burst::Acquisition;
use crate::io::Limits;
use crate::io::recording::{Recording, note};
use crate::pipeline::Control;
use chrono::{DateTime, SecondsFormat};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// An MCAP file
    recording: PathBuf,
    /// The same as one JSON document
    #[arg(long)]
    json: bool,
}

#[derive(Debug)]
struct Found {
    bursts: u64,
    signals: u64,
    first_channel: u32,
    last_channel: u32,
    first_ns: i64,
    last_ns: i64,
    temperature: bool,
    voltage: bool,
}

/// Printhead, samples, sample period in ps.
type Key = (String, u32, u64);

#[derive(Default)]
struct Contents {
    groups: BTreeMap<Key, Found>,
    beyond: u64,
    bursts: u64,
    unusable: BTreeMap<String, u64>,
    damage: Vec<crate::io::recording::Damage>,
}

/// Groups listed; a hostile file may have millions.
const MOST_GROUPS: usize = 1000;
/// Rows decoded at a time.
const MOST_ROWS: usize = 32_768;

pub fn run(args: Args) -> Result<Exit, Failure> {
    if args.recording.is_dir() {
        let dir = args.recording.display();
        return Err(Failure::usage(format!("{dir}: a directory; inspect looks at one recording")));
    }
    let recording = Recording::open(&args.recording, Limits::default()).map_err(Failure::new)?;
    let control = interruptible();
    let progress = Progress::new(1, recording.bytes);
    let mut contents = Contents { damage: recording.damage.clone(), ..Contents::default() };
    progress.during(&recording.name, recording.bytes, &control, || {
        look(&recording, &control, &mut contents);
    });
    if control.interrupted() {
        return Err(Failure::new("interrupted"));
    }
    let digest = recording.digest().map_err(Failure::new)?;
    contents.damage.extend(digest.damage);
    contents.damage.extend(recording.missing(contents.bursts));

    let exit = match contents.damage.is_empty() && contents.unusable.is_empty() {
        _ if contents.bursts == 0 => Exit::Failed,
        true => Exit::Done,
        false => Exit::Incomplete,
    };
    if args.json {
        super::output::event(&contents.document(&recording, &digest.text, exit))?;
        return Ok(exit);
    }
    let mut out = std::io::stdout().lock();
    writeln!(
        out,
        "{}: {} bytes, {}",
        printable(&recording.name),
        thousands(recording.bytes),
        digest.text
    )?;
    let expected = match recording.expected {
        Some(n) => format!("{} by its own statistics", thousands(n)),
        None => "its statistics do not say how many to expect".into(),
    };
    writeln!(out, "  bursts   {} ({expected})", thousands(contents.bursts))?;
    for ((printhead, samples, period_ps), f) in &contents.groups {
        writeln!(
            out,
            "  {:<16} {} bursts, {} signals of {samples} samples every {} ns, channels {} to {}",
            printable(printhead),
            thousands(f.bursts),
            thousands(f.signals),
            *period_ps as f64 / 1e3,
            f.first_channel,
            f.last_channel,
        )?;
        let recorded = |yes: bool| if yes { "recorded" } else { "not recorded" };
        writeln!(
            out,
            "  {:<16} {} to {}; temperature {}, drive voltage {}",
            "",
            time(f.first_ns),
            time(f.last_ns),
            recorded(f.temperature),
            recorded(f.voltage)
        )?;
    }
    if contents.beyond > 0 {
        writeln!(out, "  and {} bursts of further printheads", thousands(contents.beyond))?;
    }
    for (why, n) in &contents.unusable {
        writeln!(out, "  unusable {} {why}", thousands(*n))?;
    }
    for d in &contents.damage {
        writeln!(out, "  damage   bytes {} to {}: {}", d.from_byte, d.to_byte, d.what)?;
    }
    let last = match exit {
        Exit::Failed => "no inkling.Burst messages in it",
        Exit::Done => "whole",
        _ => "NOT whole",
    };
    writeln!(out, "  {last}")?;
    Ok(exit)
}

fn look(recording: &Recording, control: &Control, contents: &mut Contents) {
    let mut reader = recording.reader();
    for block in recording.blocks() {
        if control.interrupted() {
            return;
        }
        let block = match block {
            Ok(block) => block,
            Err(damage) => {
                note(&mut contents.damage, damage);
                continue;
            }
        };
        reader.load(&block);
        while let Some(piece) = reader.next_piece(MOST_ROWS) {
            if control.interrupted() {
                return;
            }
            piece.damage.into_iter().for_each(|damage| note(&mut contents.damage, damage));
            contents.bursts += piece.acquisitions.len() as u64;
            for acquisition in &piece.acquisitions {
                match acquisition {
                    Acquisition::Usable(burst) => contents.see(burst),
                    Acquisition::Unusable(u) => {
                        let why = crate::verdict::Reason::from(u.why).as_str();
                        *contents.unusable.entry(why.into()).or_default() += 1;
                    }
                }
            }
        }
        control.bytes_read.store(block.offset + block.bytes, Ordering::Relaxed);
    }
}

impl Contents {
    fn document(&self, recording: &Recording, digest: &str, exit: Exit) -> Value {
        let groups = self.groups.iter().map(|((printhead, samples, period_ps), f)| {
            json!({
                "printhead": printhead,
                "bursts": f.bursts,
                "signals": f.signals,
                "samples": samples,
                "sample_period_s": *period_ps as f64 / 1e12,
                "first_channel": f.first_channel,
                "last_channel": f.last_channel,
                "from": time(f.first_ns),
                "to": time(f.last_ns),
                "temperature": f.temperature,
                "drive_voltage": f.voltage,
            })
        });
        json!({
            "recording": recording.name,
            "bytes": recording.bytes,
            "digest": digest,
            "bursts": self.bursts,
            "expected": recording.expected,
            "groups": groups.collect::<Vec<_>>(),
            "bursts_of_further_printheads": self.beyond,
            "unusable": self.unusable,
            "damage": self.damage,
            "whole": exit == Exit::Done,
        })
    }

    fn see(&mut self, burst: &crate::burst::Burst) {
        let period_ps = (burst.sample_period_s * 1e12).round() as u64;
        let key = (burst.printhead.to_string(), burst.samples_per_channel, period_ps);
        if !self.groups.contains_key(&key) && self.groups.len() >= MOST_GROUPS {
            self.beyond += 1;
            return;
        }
        let last_channel = burst.first_channel + (burst.channels - 1);
        let found = self.groups.entry(key).or_insert_with(|| Found {
            bursts: 0,
            signals: 0,
            first_channel: burst.first_channel,
            last_channel,
            first_ns: burst.t_acq_ns,
            last_ns: burst.t_acq_ns,
            temperature: false,
            voltage: false,
        });
        found.bursts += 1;
        found.signals += u64::from(burst.channels);
        found.first_channel = found.first_channel.min(burst.first_channel);
        found.last_channel = found.last_channel.max(last_channel);
        found.first_ns = found.first_ns.min(burst.t_acq_ns);
        found.last_ns = found.last_ns.max(burst.t_acq_ns);
        found.temperature |= burst.temperature_c.is_some();
        found.voltage |= burst.drive_voltage_v.is_some();
    }
}

fn time(t_ns: i64) -> String {
    DateTime::from_timestamp_nanos(t_ns).to_rfc3339_opts(SecondsFormat::Millis, true)
}
