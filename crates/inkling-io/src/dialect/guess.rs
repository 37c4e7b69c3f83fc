//! Proposes a dialect for a channel of another logger whose messages look like bursts; `inkling
//! inspect` prints it to be pasted into the settings.
//!
//! In: a channel with its schema, some messages, and the topics of the same kind. Out: a
//! [`Proposal`]: TOML that `inkling replay` takes, with a question mark behind what only a person
//! can know. It is a guess, a heuristic, and the comments in the block say so.
//!
//! Steps: the field with the most numbers is taken for the samples; other keys go to the fields
//! with likely names whose kind fits (`CHANNELS`, `PERIOD` and so on); layout and number of
//! channels are found by `guess/layout.rs`.

mod layout;

pub use super::first_message::{MOST_MESSAGE_BYTES, ShownField};

use super::dimensions::dimensions;
use super::fields::{FieldInfo, Kind, Slot};
use super::first_message::{FirstMessage, MessageSamples};
use super::names::{
    CHANNEL, CHANNELS, FIRST, NO_CELSIUS, NO_VOLTS, Names, PERIOD, PRINTHEAD, RATE, TEMPERATURE,
    TIME, VOLTAGE, find, has_word, sampling,
};
use super::plan::{ChannelDescription, Reading, Schema};
use crate::time_column::has_word_for_time;
use bytes::Bytes;
use inkling_core::burst::Format;
use std::fmt::Write as _;

const MOST_SHOWN: usize = 64;
/// What parts of topics are called that number channels, as `ch07`.
const CHANNEL_WORDS: &str = "ch channel nozzle";
/// The value of a key that only a person can fill in, as it stands in TOML.
const QUESTION: &str = "\"?\"";
/// Dates of one recording lie nearer to each other, ns.
const YEAR_NS: i64 = 366 * 86_400 * 1_000_000_000;
/// Parts of the names of well-known schemas whose large arrays are no ring-downs; messages of
/// schemas with such a name are not looked at.
const OTHERS: [&str; 8] = ["Image", "Video", "PointCloud", "Grid", "Scan", "Mesh", "Model", "Map"];

/// Whether a schema is well known, and none of bursts.
pub(super) fn is_of_others(schema: &str) -> bool {
    let own_name = schema.rsplit(['.', '/']).next().unwrap_or_default();
    OTHERS.iter().any(|other| own_name.contains(other))
}

/// `messages`: the first of the channel, and others of the kind. `topics` are all topics that carry messages of the same
/// kind; each must have as many parts as this one. `None`: nothing looks like bursts.
pub fn guess(
    written: &ChannelDescription,
    messages: &[&Bytes],
    topics: &[&str],
) -> Option<Proposal> {
    let name = written.schema.map_or("", |schema| &schema.name);
    let (message, others) = messages.split_first()?;
    if is_of_others(name) || message.len() > MOST_MESSAGE_BYTES {
        return None;
    }
    let reading = Reading::of(written).ok()?;
    let first = FirstMessage::of(&reading, message).ok()?;
    let (field, samples) = first.likely_samples().filter(|(of, _)| !first.is_one_of_several(of))?;

    let others = others.iter().filter(|of| of.len() <= MOST_MESSAGE_BYTES);
    let others = others.filter_map(|of| FirstMessage::of(&reading, of).ok()).collect();
    let (toml, open) = (String::from("[[input.dialect]]\n"), Vec::new());
    let (topic, path, first, samples) = (written.topic, &*field.path, &first, &samples);
    let mut guess = Guess { topic, path, first, others, samples, toml, open };
    guess.say_all(written.schema, field, topics);
    let Guess { toml, open, .. } = guess;

    let there = first.fields.iter().filter(|field| field.kind != Kind::Message).take(MOST_SHOWN);
    let fields = there.map(|field| first.shown(field)).collect();
    Some(Proposal { toml, open, fields })
}

#[derive(Clone, Debug)]
pub struct Proposal {
    pub toml: String,
    /// The keys that only a person can fill in.
    pub open: Vec<String>,
    /// The fields of the first message, for the user to choose from.
    pub fields: Vec<ShownField>,
}

struct Guess<'a> {
    topic: &'a str,
    /// Where the samples are.
    path: &'a str,
    first: &'a FirstMessage,
    /// Further messages of the kind.
    others: Vec<FirstMessage>,
    samples: &'a MessageSamples,
    toml: String,
    open: Vec<String>,
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
        if let Some(format) = self.samples.format {
            let value = if format == Format::S16Le { "\"s16le\"" } else { "\"f32le\"" };
            self.say("format", value, "? by the look of the first message");
        }
        match dimensions(self.first, &samples.path) {
            Some(of) => self.say_dimensions(&of),
            None => self.say_shape(),
        }
        self.say_first_channel(&samples.path);
        self.say_sampling();
        self.say_printhead(varies);
        self.say_time();
        self.say_in_unit("temperature", &TEMPERATURE, Slot::Temperature, ("°C", NO_CELSIUS));
        self.say_in_unit("voltage", &VOLTAGE, Slot::Voltage, ("V", NO_VOLTS));
    }

    /// Writes the field that has one of these names, unless its name says another unit (one of the words `others`): a
    /// dialect has no units, and numbers in another one would be believed.
    fn say_in_unit(&mut self, key: &str, names: &Names, slot: Slot, (unit, others): (&str, &str)) {
        match find(&self.first.fields, names, slot) {
            Some(path) if has_word(path.rsplit('.').next().unwrap_or_default(), others) => {
                let _ = writeln!(self.toml, "# {key}: left out, as {path} is not in {unit}");
            }
            Some(path) => self.say(key, &quoted(&path), &format!("? in {unit}")),
            None => {}
        }
    }

    /// Writes the sample period: a field of a period or of a rate, else a question. A dialect has no unit, so
    /// a period in another unit than s is a number that only a person can write.
    fn say_sampling(&mut self) {
        if !self.say_named("period_s", &PERIOD, Slot::Period, "? in seconds")
            && !self.say_named("rate_hz", &RATE, Slot::Rate, "? samples a second")
        {
            match sampling(self.first) {
                Some(of) if of.is_of_key => self.say(of.key, &quoted(&of.path), "?"),
                Some(of) => {
                    let unit = if of.key == "rate_hz" { "Hz" } else { "s" };
                    let others = self.others.iter().filter_map(sampling);
                    let mut others = others.filter(|other| other.path == of.path);
                    let other = others.find(|other| other.value != of.value);
                    let path = &of.path;
                    let (value, comment) = match other.map(|other| other.value) {
                        Some(other) => {
                            let values = format!("{:?} and {other:?} {unit}", of.value);
                            let comment = format!(
                                "? {path} varies: {values}; give a field that is in {unit}"
                            );
                            (QUESTION.to_owned(), comment)
                        }
                        None => (
                            format!("{:?}", of.value),
                            format!("? {path} of the first message, in {unit}"),
                        ),
                    };
                    self.say(of.key, &value, &comment);
                }
                None => {
                    let comment = "? no field of it in s: the sample period, s (or rate_hz)";
                    self.say("period_s", QUESTION, comment);
                }
            }
        }
    }

    /// Writes the number of the first channel, if a field says it. A dialect has channels that follow each other, so a
    /// list of other numbers is a question.
    fn say_first_channel(&mut self, samples: &str) {
        if self.say_named("first_channel", &FIRST, Slot::FirstChannel, "") {
            return;
        }
        if self.is_of_one_channel() {
            self.say_named("first_channel", &CHANNEL, Slot::FirstChannel, "");
            return;
        }
        let is_list = |field: &&FieldInfo| {
            let own = field.path.rsplit('.').next().unwrap_or_default();
            let is_named = has_word(own, "channel channels nozzle nozzles ch chs");
            field.is_numbers() && field.path != samples && is_named
        };
        let Some(list) = self.first.fields.iter().find(is_list) else { return };
        let numbers = self.first.numbers(&list.path).unwrap_or_default();
        let Some(first) = numbers.first() else { return };
        if numbers.windows(2).all(|of| of[1] == of[0] + 1.0) {
            let comment = format!("? by {} of the first message", list.path);
            self.say("first_channel", &first.to_string(), &comment);
        } else {
            let comment = format!("? {} lists numbers that do not follow each other", list.path);
            self.say("first_channel", QUESTION, &comment);
        }
    }

    /// Whether a message has one channel, whose number it says, and not the number of channels under such a name.
    fn is_of_one_channel(&self) -> bool {
        let is_flat = self.samples.outer.is_none();
        let number = find(&self.first.fields, &CHANNEL, Slot::FirstChannel);
        is_flat
            && find(&self.first.fields, &CHANNELS, Slot::Channels).is_none()
            && number.is_some_and(|path| !self.counts_rings(&path))
    }

    /// Writes the field of the time: one that is named like a time, before all a message of seconds and
    /// nanoseconds or a text that is a date; else any of those, else a number that is a date. If there is none, the key
    /// is left out, and the log time counts.
    fn say_time(&mut self) {
        let fields = self.first.fields.iter();
        let times: Vec<&FieldInfo> = fields.filter(|of| of.can_be(Slot::Time).is_ok()).collect();
        let stamps = times.iter().filter(|field| field.kind == Kind::Time).copied();
        let stamps: Vec<&FieldInfo> = stamps.collect();
        let is_named = |field: &&&FieldInfo| {
            has_word_for_time(field.path.rsplit('.').next().unwrap_or_default())
        };
        let named = TIME.find(&stamps).or_else(|| TIME.find(&times));
        let named = named.or_else(|| times.iter().find(is_named).copied());
        if let Some(field) = named.or(stamps.first().copied()) {
            self.say("time", &quoted(&field.path), "");
        } else if let Some(field) = times.iter().find(|field| self.is_date(&field.path)) {
            self.say("time", &quoted(&field.path), "? by its numbers, which are dates");
        } else if let Some((path, why)) = self.unread_time() {
            let _ = writeln!(self.toml, "# time: left out, as {path} {why}; the log time counts");
        }
    }

    /// Whether a number is a date in all messages, within a year, and not the same one in them all.
    fn is_date(&self, path: &str) -> bool {
        let all = [self.first].into_iter().chain(&self.others).map(|of| of.date(path));
        let Some(dates) = all.collect::<Option<Vec<i64>>>() else { return false };
        let least = dates.iter().min().copied().unwrap_or_default();
        let span = dates.iter().map(|date| date - least).max().unwrap_or_default();
        span < YEAR_NS && (span > 0 || self.others.is_empty())
    }

    /// A field that is called time and cannot be read as one, and why.
    fn unread_time(&self) -> Option<(String, String)> {
        let has_digits = |field: &FieldInfo| {
            let text = self.first.text(&field.path);
            text.is_some_and(|text| text.contains(|c: char| c.is_ascii_digit()))
        };
        let may_be = |field: &&FieldInfo| {
            field.path != self.path && (field.is_numbers() || has_digits(field))
        };
        let fields: Vec<&FieldInfo> = self.first.fields.iter().filter(may_be).collect();
        let own = |field: &FieldInfo| {
            has_word_for_time(field.path.rsplit('.').next().unwrap_or_default())
        };
        let field = TIME.find(&fields).or_else(|| fields.into_iter().find(|field| own(field)))?;
        Some((field.path.clone(), field.can_be(Slot::Time).err()?))
    }

    /// A question mark in a comment says what a person should check; one as the value says that
    /// nothing in the recording tells it.
    fn say(&mut self, key: &str, value: &str, comment: &str) {
        let comment = if comment.is_empty() { String::new() } else { format!("  # {comment}") };
        let _ = writeln!(self.toml, "{key} = {value}{comment}");
        self.open.extend((value == QUESTION).then(|| key.to_owned()));
    }

    /// Writes the field that has one of these names, if there is one; gives whether there is.
    fn say_named(&mut self, key: &str, names: &Names, slot: Slot, why: &str) -> bool {
        let path = find(&self.first.fields, names, slot);
        if let Some(path) = &path {
            self.say(key, &quoted(path), why);
        }
        path.is_some()
    }

    /// Writes the printhead's name: a field, else the part of the topic in which the topics differ, else its
    /// second part.
    fn say_printhead(&mut self, varies: Option<usize>) {
        if let Some(path) = find(&self.first.fields, &PRINTHEAD, Slot::Text) {
            return self.say("printhead", &quoted(&format!("{{{path}}}")), "");
        }
        // topics that differ in their channel say the printhead elsewhere
        let parts: Vec<&str> = self.topic.trim_start_matches('/').split('/').collect();
        let is_channel = |part: &usize| has_word(parts[*part], CHANNEL_WORDS);
        let part = varies.filter(|part| *part == 0 || !is_channel(part));
        let part = part.or_else(|| varies?.checked_sub(1)).unwrap_or(usize::from(parts.len() > 1));
        let part = format!("\"{{topic.{part}}}\"");
        self.say("printhead", &part, "? this part of the topic, from 0");
    }
}

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
