//! Proposes a dialect for a channel of another logger whose messages look like bursts; `inkling
//! inspect` prints it to be pasted into the settings.
//!
//! In: a channel with its schema, its first message, and the topics of the same kind. Out: a
//! [`Proposal`]: TOML that `inkling replay` takes, with a question mark behind what only a person
//! can know. It is a guess, a heuristic, and the comments in the block say so.
//!
//! Steps: the field with the most numbers is taken for the samples; other keys go to the fields
//! with likely names whose kind fits (`CHANNELS`, `PERIOD` and so on); layout and number of
//! channels come from fields whose number divides that of the samples, checked or replaced by how
//! the samples correlate ([`RowLayout`]).

use super::fields::{FieldInfo, Kind};
use super::plan::{Reading, Schema, Written, is_time};
use super::value::{self, Number, SlotValues, Value};
use super::wanted::Slot;
use crate::printable;
use bytes::Bytes;
use chrono::{DateTime, SecondsFormat};
use inkling_core::burst::Format;
use inkling_core::model::row_layout::RowLayout;
use std::fmt::Write as _;

/// A message with fewer numbers than these is no burst.
const FEWEST_SAMPLES: usize = 32;
/// At most so many fields are tried as samples.
const MOST_CANDIDATES: usize = 32;
/// At most so many fields are listed.
const MOST_SHOWN: usize = 64;
/// A first message that is larger is not looked at.
pub const MOST_MESSAGE_BYTES: usize = 1 << 20;
/// Bound on the bytes of samples that are made of the first message. It is four times the message,
/// because a number of one byte (in an array of int8) may become a float32 of four.
const MOST_LOOKED_AT: u64 = MOST_MESSAGE_BYTES as u64 * 4;
/// Parts of the names of well-known schemas whose large arrays are no ring-downs; messages of
/// schemas with such a name are not looked at.
const OTHERS: [&str; 8] = ["Image", "Video", "PointCloud", "Grid", "Scan", "Mesh", "Model", "Map"];

/// What a field may be called: two texts with blanks between names. The first has whole names, the
/// likeliest first. The second has words: if no field has one of the whole names, a field with one
/// of these words in its name is taken.
struct Names<'a>(&'a str, &'a str);

/// Names of the number of channels.
const CHANNELS: Names =
    Names("channels n_channels num_channels channel_count nozzles rows nchannels", "");
/// Names of the samples per channel. `n` may also be the number of channels; `say_shape` decides by
/// the samples.
const COLUMNS: Names = Names(
    "samples_per_channel samples_per_signal n_samples num_samples sample_count columns cols n",
    "",
);
/// Names of the first channel's number.
const FIRST: Names = Names("first_channel channel_offset first_nozzle start_channel first", "");
/// Names of the sample period in s.
const PERIOD: Names =
    Names("period_s sample_period_s sample_period sampling_period period dt_s dt", "");
/// Names of a period in another unit than s, with the seconds of that unit. A dialect has no unit, so the
/// number is written into the block instead of the path.
const PERIODS: [(&str, f64); 3] = [
    ("period_ms dt_ms", 1e-3),
    ("sample_period_us period_us dt_us", 1e-6),
    ("sample_period_ns period_ns dt_ns", 1e-9),
];
/// Names of the sampling rate in Hz.
const RATE: Names = Names(
    "rate_hz sample_rate_hz sampling_rate_hz sample_rate sampling_rate samplerate sampling_frequency \
     fs_hz fs rate",
    "",
);
/// Names of the burst's time.
const TIME: Names =
    Names("t_acq acquired_at timestamp stamp time", "stamp timestamp time acquired");
/// Names of the printhead.
const PRINTHEAD: Names = Names("printhead print_head head_id head head_name printhead_id", "");
/// Names of the ink's temperature.
const TEMPERATURE: Names =
    Names("temperature_c temp_c temperature ink_temperature temp", "temp temperature");
/// Names of the drive voltage.
const VOLTAGE: Names =
    Names("drive_voltage_v drive_voltage voltage_v voltage amplitude_v", "voltage volt volts");

/// Proposes a dialect for a channel by its first message. `topics` are all topics that carry
/// messages of the same kind; each must have as many parts as this one. `None`: nothing looks like
/// bursts.
pub fn guess(written: &Written, message: &Bytes, topics: &[&str]) -> Option<Proposal> {
    let name = written.schema.map_or("", |schema| &schema.name);
    let own_name = name.rsplit(['.', '/']).next().unwrap_or_default();
    if OTHERS.iter().any(|other| own_name.contains(other)) || message.len() > MOST_MESSAGE_BYTES {
        return None;
    }
    let reading = Reading::of(written).ok()?;
    let fields = reading.fields(Some(message));
    let first = First { reading, message, fields: &fields };
    // the field with the most numbers is taken for the samples
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
    // keys with a question mark as their value are open
    let asked = |line: &str| line.split_once(" = \"?\"").map(|(key, _)| key.to_owned());
    Some(Proposal { open: toml.lines().filter_map(asked).collect(), toml, fields })
}

/// A block of settings that may fit a kind of messages, and what was seen of them.
#[derive(Clone, Debug)]
pub struct Proposal {
    pub toml: String,
    /// The keys that only a person can fill in. They stand in the block with a question mark as their value.
    pub open: Vec<String>,
    /// The fields of the first message, for the user to choose from.
    pub fields: Vec<Shown>,
}

/// A field of the first message.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Shown {
    pub path: String,
    #[serde(rename = "type")]
    pub type_name: String,
    /// Of a field with several elements, how many; of bytes, how many bytes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub length: Option<usize>,
    /// The value of a field that has only one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub value: Option<String>,
}

/// A block that is being written.
struct Guess<'a> {
    topic: &'a str,
    first: &'a First<'a>,
    size: &'a Size,
    toml: String,
}

/// A field whose whole number `n` divides the number of samples, so that `n` may be the channels or
/// the samples per channel.
struct Divisor {
    path: String,
    n: usize,
}

impl Guess<'_> {
    /// Writes the block, key by key, in the order of the documentation.
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

    /// Writes the sample period: a field of a period or of a rate, else a number from a period in another
    /// unit, else a question.
    fn say_sampling(&mut self) {
        let is_named = self.say_named("period_s", &PERIOD, Slot::Period, "in seconds")
            || self.say_named("rate_hz", &RATE, Slot::Rate, "samples a second");
        if is_named {
            return;
        }
        let in_unit = |name: &str, unit_s: f64| {
            let path = find(self.first.fields, &Names(name, ""), Slot::Period)?;
            let n = self.first.number(&path)?.float();
            Some((path, n * unit_s)).filter(|(_, s)| *s > 0.0 && s.is_finite())
        };
        let other = PERIODS
            .iter()
            .find_map(|(names, unit_s)| names.split(' ').find_map(|name| in_unit(name, *unit_s)));
        match other {
            Some((path, s)) => {
                // nine digits: the conversion of the unit brings in more, which the message does not have
                let s: f64 = format!("{s:.9e}").parse().unwrap_or(s);
                self.say("period_s", &format!("{s:e}"), &format!("as {path} of the first message"));
            }
            None => self.ask("period_s", "not in the message: the sample period, s (or rate_hz)"),
        }
    }

    /// Writes the field of the time: a message of seconds and nanoseconds, else a field that is named like a
    /// time and can be one. If there is none, the key is left out, and the log time counts.
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

    /// Writes a key with a question mark, because nothing in the recording tells its value.
    fn ask(&mut self, key: &str, why: &str) {
        self.say(key, "\"?\"", why);
    }

    /// Writes a key whose value follows from the samples; the comment says how.
    fn tell(&mut self, key: &str, value: &str, why: &str) {
        let _ = writeln!(self.toml, "{key} = {value}  # {why}");
    }

    /// Writes a key; a comment with a question mark says what a person should check.
    fn say(&mut self, key: &str, value: &str, why: &str) {
        let why = if why.is_empty() { String::new() } else { format!("  # ? {why}") };
        let _ = writeln!(self.toml, "{key} = {value}{why}");
    }

    /// Writes the field that has one of these names, if there is one; gives whether there is.
    fn say_named(&mut self, key: &str, names: &Names, slot: Slot, why: &str) -> bool {
        let path = find(self.first.fields, names, slot);
        if let Some(path) = &path {
            self.say(key, &quoted(path), why);
        }
        path.is_some()
    }

    /// Writes layout, channels and samples per channel, with n numbers in the message: what fields
    /// say if their numbers divide n, else what the samples look like.
    fn say_shape(&mut self) {
        let numbers = self.size.numbers;
        let rows = self.divisor(&CHANNELS, Slot::Channels);
        let columns = self.divisor(&COLUMNS, Slot::SamplesPerChannel);

        let (rows, columns) = match (rows, columns) {
            // `n` may be either
            (None, Some(n)) if self.counts_channels(&n) => (Some(n), None),
            known => known,
        };

        // 1. the number of channels by the fields, if any says it
        let named = match (&rows, &columns) {
            (Some(rows), _) => Some(rows.n),
            (None, Some(columns)) => Some(numbers / columns.n),
            (None, None) => None,
        };
        // in a list of lists, the number of inner lists is either the channels or the samples per
        // channel
        let outer = self.size.outer;
        let nested = |n: usize| outer.is_none_or(|outer| n == outer || n * outer == numbers);
        // 2. the likeliest layout among those that agree with the fields, or with the lists
        let lie = match named {
            Some(n) => RowLayout::likeliest(&self.size.samples, |m| m == n),
            None => RowLayout::likeliest(&self.size.samples, nested),
        };
        let major =
            |sample_major| if sample_major { "\"sample-major\"" } else { "\"channel-major\"" };

        // 3. the layout, with the correlation of the layout that was not taken for comparison
        match lie {
            Some(lie) => {
                let other = RowLayout::of(&self.size.samples, lie.channels, !lie.sample_major);
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

        // 4. the channels: a field, else what the samples per channel leave, else the samples, else
        //    the lists, else a question
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
        // 5. the samples per channel; a field that contradicts the channels is left out, and then
        //    the decoder divides the samples by the channels
        if let Some(columns) = columns.filter(|columns| agrees(columns.n)) {
            self.say("samples_per_channel", &quoted(&columns.path), "");
        }
    }

    /// Whether a field's number is that of the channels rather than of the samples per channel: the
    /// likelier layout of these two by how the samples correlate.
    fn counts_channels(&self, of: &Divisor) -> bool {
        let either = [of.n, self.size.numbers / of.n];
        let lie = RowLayout::likeliest(&self.size.samples, |n| either.contains(&n));
        lie.is_some_and(|lie| lie.channels == of.n)
    }

    /// The field with one of these names, if its number divides the number of samples.
    fn divisor(&self, names: &Names, slot: Slot) -> Option<Divisor> {
        let path = find(self.first.fields, names, slot)?;
        let n = self.first.count(&path)?;
        self.size.numbers.is_multiple_of(n).then_some(Divisor { path, n })
    }

    /// Writes the printhead's name: a field, else the part of the topic in which the topics differ, else its
    /// second part.
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

/// A text as it stands in TOML.
fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

/// A pattern that fits all topics, with `*` for each part in which they differ; and the number of
/// the first such part, from 0.
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

impl Names<'_> {
    /// The field with the likeliest name, by the last names of the paths.
    fn find<'f>(&self, fields: &[&'f FieldInfo]) -> Option<&'f FieldInfo> {
        let first =
            |is: &dyn Fn(&str) -> bool| fields.iter().find(|of| is(last(&of.path))).copied();
        let Names(whole, words) = self;
        let named = |name: &str| first(&|of| of.eq_ignore_ascii_case(name));
        whole.split(' ').find_map(named).or_else(|| first(&|of| has_word(of, words)))
    }
}

/// The path of the likeliest field of such a name, among the fields that can be what the slot asks for.
fn find(fields: &[FieldInfo], names: &Names, slot: Slot) -> Option<String> {
    let can_be = |field: &&FieldInfo| field.can_be(slot).is_ok();
    let fields: Vec<&FieldInfo> = fields.iter().filter(can_be).collect();
    names.find(&fields).map(|field| field.path.clone())
}

/// The samples that one field of the first message would give, and how many they are.
struct Size {
    numbers: usize,
    /// Length of the field as the user sees it: bytes of a field of bytes, else numbers.
    length: usize,
    /// If the field is a list of lists, how many inner lists it has.
    outer: Option<usize>,
    /// The numbers themselves, in the message's order.
    samples: Vec<f64>,
    /// The guessed format of a field of bytes; `None` for arrays of numbers, whose type is known.
    format: Option<Format>,
}

/// The first message, how it is read, and its fields.
struct First<'a> {
    reading: Reading,
    message: &'a Bytes,
    fields: &'a [FieldInfo],
}

impl First<'_> {
    /// The fields that may be samples.
    fn candidates(&self) -> impl Iterator<Item = &FieldInfo> {
        self.fields.iter().filter(|field| field.can_be(Slot::Samples).is_ok())
    }

    /// A field as the user is shown it: with its length if it has several elements, else with its
    /// value.
    fn shown(&self, field: &FieldInfo) -> Shown {
        let several = field.list || field.kind == Kind::Bytes;
        let size = several.then(|| self.size(field)).flatten();
        let value = if several { None } else { self.value(field) };
        let length = size.map(|size| size.length);
        Shown { path: field.path.clone(), type_name: field.typed(), length, value }
    }

    /// The samples that this field would give. `None`: it cannot be read as samples.
    fn size(&self, field: &FieldInfo) -> Option<Size> {
        let is_bytes = field.kind == Kind::Bytes;
        let value = self.values_at(&field.path, Slot::Samples)?.take(Slot::Samples)?;
        // bytes are read as int16 first; if they look more like float32, they are read as float32
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

    /// The value of a field, as text.
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

    /// The number at a path.
    fn number(&self, path: &str) -> Option<Number> {
        let slot = Slot::SamplesPerChannel;
        self.values_at(path, slot)?.number(slot)
    }

    /// A whole number of more than 0.
    fn count(&self, path: &str) -> Option<usize> {
        let n = self.number(path).and_then(Number::integer)?;
        usize::try_from(n).ok().filter(|n| *n > 0)
    }

    /// What the first message has at a path, as what the slot asks for.
    fn values_at(&self, path: &str, slot: Slot) -> Option<SlotValues> {
        self.reading.look(self.message, path, slot, MOST_LOOKED_AT)
    }
}

/// The last name of a path, without the messages around it.
fn last(path: &str) -> &str {
    path.rsplit('.').next().unwrap_or_default()
}

/// Whether a field's own name has one of these words in it: `ink_temp_c` has `temp`.
fn has_word(name: &str, words: &str) -> bool {
    let name = name.to_ascii_lowercase();
    let mut parts = name.split(|c: char| !c.is_ascii_alphabetic());
    parts.any(|part| !part.is_empty() && words.split(' ').any(|word| word == part))
}

/// Whether bytes look like float32 rather than int16: more than 19 of 20 are, as floats, zero or of
/// a magnitude that samples have (1e-6 to 1e7). Pairs of int16, read as floats, mostly are not.
/// Heuristic.
fn look_like_floats(bytes: &[u8]) -> bool {
    let all = bytes.as_chunks::<4>().0;
    let usual = all.iter().filter(|b| {
        let x = f32::from_le_bytes(**b).abs();
        x == 0.0 || (1e-6..1e7).contains(&x)
    });
    usual.count() * 20 > all.len() * 19
}
