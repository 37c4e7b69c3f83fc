//! A dialect to paste, where a channel's messages look like bursts.
//!
//! In: a channel, what its schema has, and its first message. Out: TOML that `inkling replay` takes, with a
//! question mark behind what only a person knows. A guess: names and sizes decide, and it says so.

use super::fields::{FieldInfo, Kind};
use super::plan::{Reading, Schema, Written, is_time};
use super::value::{self, Number, SlotValues, Value};
use super::wanted::Slot;
use crate::printable;
use bytes::Bytes;
use chrono::{DateTime, SecondsFormat};
use inkling_core::burst::Format;
use inkling_core::model::lie::Lie;
use std::fmt::Write as _;

/// Fewer numbers are no burst.
const FEWEST_SAMPLES: usize = 32;
/// Fields that are tried as samples.
const MOST_CANDIDATES: usize = 32;
/// Fields that are listed.
const MOST_SHOWN: usize = 64;
/// Of a first message that is looked at.
pub const MOST_MESSAGE_BYTES: usize = 1 << 20;
/// Of samples that are made of it.
const MOST_LOOKED_AT: u64 = MOST_MESSAGE_BYTES as u64 * 4;
/// Well-known schemas with large arrays that are no ring-downs.
const OTHERS: [&str; 8] = ["Image", "Video", "PointCloud", "Grid", "Scan", "Mesh", "Model", "Map"];

/// What a field is called: whole names, the likelier first, and words in a name that tell the same where no field has
/// one of the names.
struct Names<'a>(&'a [&'a str], &'a [&'a str]);

const CHANNELS: Names = Names::of(&[
    "channels",
    "n_channels",
    "num_channels",
    "channel_count",
    "nozzles",
    "rows",
    "nchannels",
]);
const COLUMNS: Names = Names::of(&[
    "samples_per_channel",
    "samples_per_signal",
    "n_samples",
    "num_samples",
    "sample_count",
    "columns",
    "cols",
    "n",
]);
const FIRST: Names =
    Names::of(&["first_channel", "channel_offset", "first_nozzle", "start_channel", "first"]);
const PERIOD: Names = Names::of(&[
    "period_s",
    "sample_period_s",
    "sample_period",
    "sampling_period",
    "period",
    "dt_s",
    "dt",
]);
/// Of a period in another unit, with the seconds of one.
const PERIODS: &[(&str, f64)] = &[
    ("period_ms", 1e-3),
    ("dt_ms", 1e-3),
    ("sample_period_us", 1e-6),
    ("period_us", 1e-6),
    ("dt_us", 1e-6),
    ("sample_period_ns", 1e-9),
    ("period_ns", 1e-9),
    ("dt_ns", 1e-9),
];
const RATE: Names = Names::of(&[
    "rate_hz",
    "sample_rate_hz",
    "sampling_rate_hz",
    "sample_rate",
    "sampling_rate",
    "samplerate",
    "sampling_frequency",
    "fs_hz",
    "fs",
    "rate",
]);
const TIME: Names = Names(
    &["t_acq", "acquired_at", "timestamp", "stamp", "time"],
    &["stamp", "timestamp", "time", "acquired"],
);
const PRINTHEAD: Names =
    Names::of(&["printhead", "print_head", "head_id", "head", "head_name", "printhead_id"]);
const TEMPERATURE: Names = Names(
    &["temperature_c", "temp_c", "temperature", "ink_temperature", "temp"],
    &["temp", "temperature"],
);
const VOLTAGE: Names = Names(
    &["drive_voltage_v", "drive_voltage", "voltage_v", "voltage", "amplitude_v"],
    &["voltage", "volt", "volts"],
);

/// `topics`: all that carry the same, with equally many parts. `None`: nothing looks like bursts.
pub fn guess(written: &Written, message: &Bytes, topics: &[&str]) -> Option<Proposal> {
    let name = written.schema.map_or("", |schema| &schema.name);
    let own_name = name.rsplit(['.', '/']).next().unwrap_or_default();
    if OTHERS.iter().any(|other| own_name.contains(other)) || message.len() > MOST_MESSAGE_BYTES {
        return None;
    }
    let reading = Reading::of(written).ok()?;
    let fields = reading.fields(Some(message));
    let first = First { reading, message, fields: &fields };
    let (samples, size) = first
        .candidates()
        .take(MOST_CANDIDATES)
        .filter_map(|field| Some((field, first.size(field)?)))
        .max_by_key(|(_, size)| size.numbers)?;
    if size.numbers < FEWEST_SAMPLES {
        return None;
    }
    let toml = String::from("[[input.dialect]]\n");
    let mut guess = Guess { topic: written.topic, first: &first, size: &size, toml };
    guess.say_all(written.schema, samples, topics);
    let toml = guess.toml;
    let there = fields.iter().filter(|field| field.kind != Kind::Message).take(MOST_SHOWN);
    let fields = there.map(|field| first.shown(field)).collect();
    let asked = |line: &str| line.split_once(" = \"?\"").map(|(key, _)| key.to_owned());
    Some(Proposal { open: toml.lines().filter_map(asked).collect(), toml, fields })
}

/// What a settings file may say of a kind of messages, and what was seen of them.
#[derive(Clone, Debug)]
pub struct Proposal {
    pub toml: String,
    /// Keys that only a person can fill in: they stand in the block with a question mark.
    pub open: Vec<String>,
    pub fields: Vec<Shown>,
}

/// A field of the first message.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Shown {
    pub path: String,
    #[serde(rename = "type")]
    pub type_name: String,
    /// Of what there are several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub length: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub value: Option<String>,
}

/// A dialect under way.
struct Guess<'a> {
    topic: &'a str,
    first: &'a First<'a>,
    size: &'a Size,
    toml: String,
}

/// A field with a whole number that the samples can be divided by.
struct Divisor {
    path: String,
    n: usize,
}

impl Guess<'_> {
    fn say_all(&mut self, schema: Option<&Schema>, samples: &FieldInfo, topics: &[&str]) {
        let (glob, varies) = glob(self.topic, topics);
        self.say("topic", &quoted(&glob), "");
        if let Some(schema) = schema.filter(|schema| !schema.name.is_empty()) {
            self.say("schema", &quoted(&schema.name), "");
        }
        self.say("samples", &quoted(&samples.path), "");
        if let Some(format) = self.size.format {
            let value = if format == Format::S16Le { "\"s16le\"" } else { "\"f32le\"" };
            self.say("format", value, "by the look of the first message");
        }
        self.say_shape();
        self.say_named("first_channel", &FIRST, Slot::FirstChannel, "");
        self.say_sampling();
        self.say_printhead(varies);
        self.say_time();
        self.say_named("temperature", &TEMPERATURE, Slot::Temperature, "in °C");
        self.say_named("voltage", &VOLTAGE, Slot::Voltage, "in V");
    }

    /// A period, a rate, a period in another unit; else a question.
    fn say_sampling(&mut self) {
        let is_named = self.say_named("period_s", &PERIOD, Slot::Period, "in seconds")
            || self.say_named("rate_hz", &RATE, Slot::Rate, "samples a second");
        if is_named {
            return;
        }
        let other = PERIODS.iter().find_map(|(name, unit_s)| {
            let path = find(self.first.fields, &Names::of(&[name]), Slot::Period)?;
            let n = self.first.number(&path)?.float();
            Some((path, n * unit_s)).filter(|(_, s)| *s > 0.0 && s.is_finite())
        });
        match other {
            Some((path, s)) => {
                // digits that the unit alone brings in are none of the message
                let s: f64 = format!("{s:.9e}").parse().unwrap_or(s);
                self.say("period_s", &format!("{s:e}"), &format!("as {path} of the first message"));
            }
            None => self.ask("period_s", "not in the message: the sample period, s (or rate_hz)"),
        }
    }

    /// Seconds and nanoseconds; else what is named like a time and can be one.
    fn say_time(&mut self) {
        let can_be_time = |field: &&FieldInfo| {
            let is_text = field.kind == Kind::Text && !field.list;
            let text = || self.first.value(field);
            field.can_be(Slot::Time).is_ok() || (is_text && text().is_some_and(|t| is_time(&t)))
        };
        let times: Vec<&FieldInfo> = self.first.fields.iter().filter(can_be_time).collect();
        let stamp = times.iter().find(|field| field.kind == Kind::Time).copied();
        if let Some(field) = stamp.or_else(|| TIME.find(&times)) {
            self.say("time", &quoted(&field.path), "");
        }
    }

    /// A key that nothing in the recording tells.
    fn ask(&mut self, key: &str, why: &str) {
        self.say(key, "\"?\"", why);
    }

    /// A statement that rests on the samples.
    fn tell(&mut self, key: &str, value: &str, why: &str) {
        let _ = writeln!(self.toml, "{key} = {value}  # {why}");
    }

    fn say(&mut self, key: &str, value: &str, why: &str) {
        let why = if why.is_empty() { String::new() } else { format!("  # ? {why}") };
        let _ = writeln!(self.toml, "{key} = {value}{why}");
    }

    /// The field of such a name, if there is one.
    fn say_named(&mut self, key: &str, names: &Names, slot: Slot, why: &str) -> bool {
        let path = find(self.first.fields, names, slot);
        if let Some(path) = &path {
            self.say(key, &quoted(path), why);
        }
        path.is_some()
    }

    /// Layout, channels and samples per channel: what the message says, else what its samples look like.
    fn say_shape(&mut self) {
        let numbers = self.size.numbers;
        let rows = self.divisor(&CHANNELS, Slot::Channels);
        let columns = self.divisor(&COLUMNS, Slot::SamplesPerChannel);
        let (rows, columns) = match (rows, columns) {
            // `n` may be either
            (None, Some(n)) if self.counts_channels(&n) => (Some(n), None),
            known => known,
        };
        let named = match (&rows, &columns) {
            (Some(rows), _) => Some(rows.n),
            (None, Some(columns)) => Some(numbers / columns.n),
            (None, None) => None,
        };
        // lists of lists say one of the two numbers
        let outer = self.size.outer;
        let nested = |n: usize| outer.is_none_or(|outer| n == outer || n * outer == numbers);
        let lie = match named {
            Some(n) => Lie::likeliest(&self.size.samples, |m| m == n),
            None => Lie::likeliest(&self.size.samples, nested),
        };
        let major =
            |sample_major| if sample_major { "\"sample-major\"" } else { "\"channel-major\"" };
        match lie {
            Some(lie) => {
                let other = Lie::of(&self.size.samples, lie.channels, !lie.sample_major);
                let other = other.map_or(0.0, |other| other.neighbours);
                let why = format!(
                    "by the samples: neighbours of a channel correlate ({:.2}; laid out as {} {other:.2})",
                    lie.neighbours,
                    major(!lie.sample_major).trim_matches('"')
                );
                self.tell("layout", major(lie.sample_major), &why);
            }
            None => self.say("layout", major(false), "or \"sample-major\""),
        }
        let agrees = |n: usize| rows.as_ref().is_none_or(|rows| rows.n * n == numbers);
        match (&rows, &columns, lie) {
            (Some(rows), columns, _) => {
                let is_sure = columns.as_ref().is_none_or(|columns| agrees(columns.n));
                let why = if is_sure { "" } else { "or is this samples per channel" };
                self.say("channels", &quoted(&rows.path), why);
            }
            (None, Some(columns), _) => {
                let why = "not in the message: numbers of the first, by samples_per_channel";
                self.say("channels", &(numbers / columns.n).to_string(), why);
            }
            (None, None, Some(lie)) => {
                let why = "by the samples: so many signals ring alike";
                self.tell("channels", &lie.channels.to_string(), why);
            }
            (None, None, None) => match outer {
                Some(outer) => {
                    self.say("channels", &outer.to_string(), "the lists in the first message")
                }
                None => self
                    .ask("channels", &format!("not in the message, which has {numbers} samples")),
            },
        }
        // what contradicts the channels is left out: there are as many as there are
        if let Some(columns) = columns.filter(|columns| agrees(columns.n)) {
            self.say("samples_per_channel", &quoted(&columns.path), "");
        }
    }

    /// Whether the samples rather are of so many channels than of channels with so many samples.
    fn counts_channels(&self, of: &Divisor) -> bool {
        let either = [of.n, self.size.numbers / of.n];
        let lie = Lie::likeliest(&self.size.samples, |n| either.contains(&n));
        lie.is_some_and(|lie| lie.channels == of.n)
    }

    fn divisor(&self, names: &Names, slot: Slot) -> Option<Divisor> {
        let path = find(self.first.fields, names, slot)?;
        let n = self.first.count(&path)?;
        self.size.numbers.is_multiple_of(n).then_some(Divisor { path, n })
    }

    fn say_printhead(&mut self, varies: Option<usize>) {
        if let Some(path) = find(self.first.fields, &PRINTHEAD, Slot::Text(0)) {
            return self.say("printhead", &quoted(&format!("{{{path}}}")), "");
        }
        let parts = self.topic.trim_start_matches('/').split('/').count();
        let part = varies.unwrap_or(usize::from(parts > 1));
        let part = format!("\"{{topic.{part}}}\"");
        self.say("printhead", &part, "this part of the topic, from 0");
    }
}

fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

/// What all topics fit, and the first part in which they differ.
fn glob(first: &str, topics: &[&str]) -> (String, Option<usize>) {
    let slash = if first.starts_with('/') { "/" } else { "" };
    let parts = |topic: &str| -> Vec<String> {
        topic.trim_start_matches('/').split('/').map(globset::escape).collect()
    };
    let mut common = parts(first);
    let mut varies = None;
    for topic in topics {
        for (n, (part, of)) in common.iter_mut().zip(parts(topic)).enumerate() {
            if *part != of {
                *part = "*".into();
                varies = varies.or(Some(n));
            }
        }
    }
    (format!("{slash}{}", common.join("/")), varies)
}

impl<'a> Names<'a> {
    /// Whole names alone.
    const fn of(whole: &'a [&'a str]) -> Names<'a> {
        Names(whole, &[])
    }

    /// The field whose last name is the likeliest.
    fn find<'f>(&self, fields: &[&'f FieldInfo]) -> Option<&'f FieldInfo> {
        let first =
            |is: &dyn Fn(&str) -> bool| fields.iter().find(|of| is(last(&of.path))).copied();
        let Names(whole, words) = self;
        let named = |name: &&str| first(&|of| of.eq_ignore_ascii_case(name));
        whole.iter().find_map(named).or_else(|| first(&|of| has_word(of, words)))
    }
}

/// The path of the likeliest field of such a name that can be what a slot asks for.
fn find(fields: &[FieldInfo], names: &Names, slot: Slot) -> Option<String> {
    let can_be = |field: &&FieldInfo| field.can_be(slot).is_ok();
    let fields: Vec<&FieldInfo> = fields.iter().filter(can_be).collect();
    names.find(&fields).map(|field| field.path.clone())
}

/// Of the samples in the first message.
struct Size {
    numbers: usize,
    /// Bytes, or numbers.
    length: usize,
    /// Of lists of lists, how many lists.
    outer: Option<usize>,
    samples: Vec<f64>,
    /// Of bytes.
    format: Option<Format>,
}

/// The first message, and what there is in it.
struct First<'a> {
    reading: Reading,
    message: &'a Bytes,
    fields: &'a [FieldInfo],
}

impl First<'_> {
    /// Fields that may be samples.
    fn candidates(&self) -> impl Iterator<Item = &FieldInfo> {
        self.fields.iter().filter(|field| field.can_be(Slot::Samples).is_ok())
    }

    fn shown(&self, field: &FieldInfo) -> Shown {
        let several = field.list || field.kind == Kind::Bytes;
        let size = several.then(|| self.size(field)).flatten();
        let value = if several { None } else { self.value(field) };
        let length = size.map(|size| size.length);
        Shown { path: field.path.clone(), type_name: field.typed(), length, value }
    }

    fn size(&self, field: &FieldInfo) -> Option<Size> {
        let is_bytes = field.kind == Kind::Bytes;
        let value = self.values_at(&field.path, Slot::Samples)?.take(Slot::Samples)?;
        let written = is_bytes.then_some(Format::S16Le);
        let samples = value.samples(written, MOST_LOOKED_AT)?;
        let bytes = &samples.bytes;
        let format = match is_bytes && bytes.len().is_multiple_of(4) && look_like_floats(bytes) {
            true => Format::F32Le,
            false => samples.format,
        };
        let samples: Vec<f64> = value::samples(bytes, format).collect();
        Some(Size {
            numbers: samples.len(),
            length: if is_bytes { bytes.len() } else { samples.len() },
            outer: field.rows,
            samples,
            format: is_bytes.then_some(format),
        })
    }

    /// What a field holds, as text.
    fn value(&self, field: &FieldInfo) -> Option<String> {
        match field.kind {
            Kind::Integer | Kind::Float => match self.number(&field.path)? {
                Number::Integer(n) => Some(n.to_string()),
                Number::Float(x) => Some(x.to_string()),
            },
            Kind::Text => match self.values_at(&field.path, Slot::Text(0))?.take(Slot::Text(0))? {
                Value::Text(text) => Some(printable::cell(&text)),
                Value::Number(number) => Some(number.float().to_string()),
                _ => None,
            },
            Kind::Time => {
                let mut values = self.values_at(&field.path, Slot::Time)?;
                let seconds = values.number(Slot::Seconds)?.integer()?.try_into().ok()?;
                let nanoseconds = values.number(Slot::Nanoseconds)?.integer()?.try_into().ok()?;
                let time = DateTime::from_timestamp(seconds, nanoseconds)?;
                Some(time.to_rfc3339_opts(SecondsFormat::Nanos, true))
            }
            Kind::Bool | Kind::Bytes | Kind::Message => None,
        }
    }

    fn number(&self, path: &str) -> Option<Number> {
        let slot = Slot::SamplesPerChannel;
        self.values_at(path, slot)?.number(slot)
    }

    /// A whole number, more than 0.
    fn count(&self, path: &str) -> Option<usize> {
        let n = self.number(path).and_then(Number::integer)?;
        usize::try_from(n).ok().filter(|n| *n > 0)
    }

    fn values_at(&self, path: &str, slot: Slot) -> Option<SlotValues> {
        self.reading.look(self.message, path, slot, MOST_LOOKED_AT)
    }
}

/// The last name of a path.
fn last(path: &str) -> &str {
    path.rsplit('.').next().unwrap_or_default()
}

/// Whether a field's own name has one of these words in it: `ink_temp_c` has `temp`.
fn has_word(name: &str, words: &[&str]) -> bool {
    let name = name.to_ascii_lowercase();
    name.split(|c: char| !c.is_ascii_alphabetic()).any(|part| words.contains(&part))
}

/// Nearly all are zero or of a magnitude that samples have; int16 side by side are not.
fn look_like_floats(bytes: &[u8]) -> bool {
    let all = bytes.as_chunks::<4>().0;
    let usual = all.iter().filter(|b| {
        let x = f32::from_le_bytes(**b).abs();
        x == 0.0 || (1e-6..1e7).contains(&x)
    });
    usual.count() * 20 > all.len() * 19
}
