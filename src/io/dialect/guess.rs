//! A dialect to paste, where a channel's messages look like bursts.
//!
//! In: a channel, what its schema has, and its first message. Out: TOML that `inkling replay` takes, with a
//! question mark behind what only a person knows. A guess: names and sizes decide, and it says so.

use super::fields::{FieldInfo, Kind};
use super::path::FieldPath;
use super::plan::{Plan, Reading, Written};
use super::settings::{Dialect, SampleFormat, SampleLayout, Source, Template, TimeSource};
use super::value::{Number, Value};
use super::wanted::Slot;
use bytes::Bytes;
use std::fmt::Write as _;
use std::sync::Arc;

/// Fewer numbers are no burst.
const FEWEST_SAMPLES: usize = 32;
/// Fields that are tried as samples.
const MOST_CANDIDATES: usize = 32;
/// Of a first message that is looked at.
pub const MOST_MESSAGE_BYTES: usize = 1 << 20;
/// Well-known schemas with large arrays that are no ring-downs.
const OTHERS: [&str; 8] = ["Image", "Video", "PointCloud", "Grid", "Scan", "Mesh", "Model", "Map"];

/// Names that fields go by, the likelier first.
const CHANNELS: &[&str] =
    &["channels", "n_channels", "num_channels", "channel_count", "nozzles", "rows", "nchannels"];
const COLUMNS: &[&str] = &[
    "samples_per_channel",
    "samples_per_signal",
    "n_samples",
    "num_samples",
    "sample_count",
    "columns",
    "cols",
    "n",
];
const FIRST: &[&str] =
    &["first_channel", "channel_offset", "first_nozzle", "start_channel", "first"];
const PERIOD: &[&str] =
    &["period_s", "sample_period_s", "sample_period", "sampling_period", "period", "dt_s", "dt"];
const TIME: &[&str] = &["t_acq", "acquired_at", "timestamp", "stamp", "time"];
const PRINTHEAD: &[&str] =
    &["printhead", "print_head", "head_id", "head", "head_name", "printhead_id"];
const TEMPERATURE: &[&str] = &["temperature_c", "temp_c", "temperature", "ink_temperature", "temp"];
const VOLTAGE: &[&str] =
    &["drive_voltage_v", "drive_voltage", "voltage_v", "voltage", "amplitude_v"];

/// `topics`: all that carry the same, with equally many parts. `None`: nothing looks like bursts.
pub fn guess(written: &Written, message: &Bytes, topics: &[&str]) -> Option<String> {
    let name = written.schema.map_or("", |schema| &schema.name);
    let last = name.rsplit(['.', '/']).next().unwrap_or_default();
    if OTHERS.iter().any(|other| last.contains(other)) || message.len() > MOST_MESSAGE_BYTES {
        return None;
    }
    let reading = Reading::of(written).ok()?;
    let fields = reading.fields(Some(message));
    let candidates = fields.iter().filter(|field| field.can_be(Slot::Samples).is_ok());
    let (samples, size) = candidates
        .take(MOST_CANDIDATES)
        .filter_map(|field| Some((field, size(written, message, field)?)))
        .max_by_key(|(_, size)| size.numbers)?;
    if size.numbers < FEWEST_SAMPLES {
        return None;
    }
    let toml = String::from("[[input.dialect]]\n");
    let mut guess = Guess { written, message, fields: &fields, size: &size, toml };
    guess.say_all(samples, topics);
    Some(guess.toml)
}

/// A dialect under way.
struct Guess<'a> {
    written: &'a Written<'a>,
    message: &'a Bytes,
    fields: &'a [FieldInfo],
    size: &'a Size,
    toml: String,
}

/// A field with a whole number that the samples can be divided by.
struct Divisor {
    path: String,
    n: usize,
}

impl Guess<'_> {
    fn say_all(&mut self, samples: &FieldInfo, topics: &[&str]) {
        let (glob, varies) = glob(self.written.topic, topics);
        self.say("topic", &quoted(&glob), "");
        if let Some(schema) = self.written.schema.filter(|schema| !schema.name.is_empty()) {
            self.say("schema", &quoted(&schema.name), "");
        }
        self.say("samples", &quoted(&samples.path), "");
        if let Some(format) = self.size.format {
            let value = if format == SampleFormat::S16le { "\"s16le\"" } else { "\"f32le\"" };
            self.say("format", value, "by the look of the first message");
        }
        self.say("layout", "\"channel-major\"", "or \"sample-major\"");
        self.say_shape();
        self.say_named("first_channel", FIRST, Slot::FirstChannel, "");
        if !self.say_named("period_s", PERIOD, Slot::Period, "in seconds") {
            self.say("period_s", "1e-6", "not in the message: the sample period, s");
        }
        self.say_printhead(varies);
        let stamp = |field: &&FieldInfo| field.kind == Kind::Time && !field.list;
        match self.fields.iter().find(stamp) {
            Some(field) => self.say("time", &quoted(&field.path), ""),
            None => {
                self.say_named("time", TIME, Slot::Time, "");
            }
        }
        self.say_named("temperature", TEMPERATURE, Slot::Temperature, "in °C");
        self.say_named("voltage", VOLTAGE, Slot::Voltage, "in V");
    }

    fn say(&mut self, key: &str, value: &str, why: &str) {
        let why = if why.is_empty() { String::new() } else { format!("  # ? {why}") };
        let _ = writeln!(self.toml, "{key} = {value}{why}");
    }

    /// The field of such a name, if there is one.
    fn say_named(&mut self, key: &str, names: &[&str], slot: Slot, why: &str) -> bool {
        let path = find(self.fields, names, slot);
        if let Some(path) = &path {
            self.say(key, &quoted(path), why);
        }
        path.is_some()
    }

    /// Channels and samples per channel.
    fn say_shape(&mut self) {
        let numbers = self.size.numbers;
        let rows = self.divisor(CHANNELS, Slot::Channels);
        let columns = self.divisor(COLUMNS, Slot::SamplesPerChannel);
        match (&rows, &columns) {
            (Some(rows), Some(columns)) if rows.n * columns.n == numbers => {
                self.say("channels", &quoted(&rows.path), "");
            }
            (Some(rows), None) => self.say("channels", &quoted(&rows.path), ""),
            (Some(rows), Some(_)) => {
                self.say("channels", &quoted(&rows.path), "or is this samples per channel");
            }
            (None, Some(columns)) => {
                let why = "not in the message: numbers of the first, by samples_per_channel";
                self.say("channels", &(numbers / columns.n).to_string(), why);
            }
            (None, None) => self.say("channels", "1", "not in the message"),
        }
        // what contradicts the channels is left out: there are as many as there are
        let agrees = |n: usize| rows.as_ref().is_none_or(|rows| rows.n * n == numbers);
        if let Some(columns) = columns.filter(|columns| agrees(columns.n)) {
            self.say("samples_per_channel", &quoted(&columns.path), "");
        }
    }

    fn divisor(&self, names: &[&str], slot: Slot) -> Option<Divisor> {
        let path = find(self.fields, names, slot)?;
        let n = count(self.written, self.message, &path)?;
        self.size.numbers.is_multiple_of(n).then_some(Divisor { path, n })
    }

    fn say_printhead(&mut self, varies: Option<usize>) {
        if let Some(path) = find(self.fields, PRINTHEAD, Slot::Text(0)) {
            return self.say("printhead", &quoted(&format!("{{{path}}}")), "");
        }
        let parts = self.written.topic.trim_start_matches('/').split('/').count();
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

/// The field whose last name is the likeliest.
fn find(fields: &[FieldInfo], names: &[&str], slot: Slot) -> Option<String> {
    names.iter().find_map(|name| {
        fields
            .iter()
            .filter(|field| field.can_be(slot).is_ok())
            .find(|field| {
                let last = field.path.rsplit('.').next().unwrap_or_default();
                last.eq_ignore_ascii_case(name)
            })
            .map(|field| field.path.clone())
    })
}

/// Of the samples in the first message.
struct Size {
    numbers: usize,
    /// Of bytes.
    format: Option<SampleFormat>,
}

/// A field's whole number, more than 0, in the first message.
fn count(written: &Written, message: &Bytes, path: &str) -> Option<usize> {
    let n = number(written, message, path).and_then(Number::integer)?;
    usize::try_from(n).ok().filter(|n| *n > 0)
}

fn probe(samples: &str, format: Option<SampleFormat>) -> Option<Dialect> {
    Some(Dialect {
        topic: "**".into(),
        schema: None,
        samples: FieldPath::try_from(samples.to_owned()).ok()?,
        format,
        layout: SampleLayout::default(),
        channels: Source::Constant(1.0),
        samples_per_channel: None,
        first_channel: Source::Constant(0.0),
        period_s: Source::Constant(1.0),
        printhead: Template::try_from("p".to_owned()).ok()?,
        time: TimeSource::LogTime,
        temperature: None,
        voltage: None,
        idle: None,
        neighbours: None,
    })
}

fn size(written: &Written, message: &Bytes, field: &FieldInfo) -> Option<Size> {
    let is_bytes = field.kind == Kind::Bytes;
    let dialect = probe(&field.path, is_bytes.then_some(SampleFormat::S16le))?;
    let plan = Plan::new(&Arc::new(dialect), written).ok()?;
    let most_bytes = MOST_MESSAGE_BYTES as u64 * 4;
    let value = plan.find(message, most_bytes)?.take(Slot::Samples)?;
    let samples = value.samples(message, plan.format, most_bytes)?;
    let (whole, bytes) = (samples.bytes.len() / samples.format.bytes(), &samples.bytes);
    if !is_bytes {
        return Some(Size { numbers: whole, format: None });
    }
    Some(match bytes.len().is_multiple_of(4) && look_like_floats(bytes) {
        true => Size { numbers: bytes.len() / 4, format: Some(SampleFormat::F32le) },
        false => Size { numbers: whole, format: Some(SampleFormat::S16le) },
    })
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

fn number(written: &Written, message: &Bytes, path: &str) -> Option<Number> {
    let mut dialect = probe(path, None)?;
    dialect.samples_per_channel = Some(Source::Path(dialect.samples.clone()));
    // samples must be an array; the number is found beside any
    let reading = Reading::of(written).ok()?;
    let fields = reading.fields(Some(message));
    let samples = fields.iter().find(|field| field.can_be(Slot::Samples).is_ok())?;
    dialect.samples = FieldPath::try_from(samples.path.clone()).ok()?;
    dialect.format = (samples.kind == Kind::Bytes).then_some(SampleFormat::S16le);
    let plan = Plan::new(&Arc::new(dialect), written).ok()?;
    match plan.find(message, MOST_MESSAGE_BYTES as u64 * 4)?.take(Slot::SamplesPerChannel)? {
        Value::Number(number) => Some(number),
        _ => None,
    }
}
