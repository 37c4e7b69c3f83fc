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

pub use super::first_message::{MOST_MESSAGE_BYTES, ShownField};

use super::fields::{FieldInfo, Kind, Slot};
use super::first_message::{FirstMessage, MessageSamples};
use super::plan::{ChannelDescription, Reading, Schema};
use bytes::Bytes;
use inkling_core::burst::Format;
use inkling_core::model::row_layout::RowLayout;
use inkling_core::verdict::Reason;
use std::fmt::Write as _;

/// A message with fewer numbers than these is no burst.
const FEWEST_SAMPLES: usize = 32;
/// At most so many fields are tried as samples.
const MOST_CANDIDATES: usize = 32;
const MOST_SHOWN: usize = 64;
/// The value of a key that only a person can fill in, as it stands in TOML.
const QUESTION: &str = "\"?\"";
/// Parts of the names of well-known schemas whose large arrays are no ring-downs; messages of
/// schemas with such a name are not looked at.
const OTHERS: [&str; 8] = ["Image", "Video", "PointCloud", "Grid", "Scan", "Mesh", "Model", "Map"];

/// What a field may be called: two texts with blanks between names. The first has whole names, the
/// likeliest first. The second has words: if no field has one of the whole names, a field with one
/// of these words in its name is taken.
struct Names<'a>(&'a str, &'a str);

const CHANNELS: Names =
    Names("channels n_channels num_channels channel_count nozzles rows nchannels", "");
const COLUMNS: Names = Names(
    "samples_per_channel samples_per_signal n_samples num_samples sample_count columns cols n",
    "",
);
const FIRST: Names = Names("first_channel channel_offset first_nozzle start_channel first", "");
const PERIOD: Names =
    Names("period_s sample_period_s sample_period sampling_period period dt_s dt", "");
const RATE: Names = Names(
    "rate_hz sample_rate_hz sampling_rate_hz sample_rate sampling_rate samplerate sampling_frequency \
     fs_hz fs rate",
    "",
);
const TIME: Names =
    Names("t_acq acquired_at timestamp stamp time", "stamp timestamp time acquired");
const PRINTHEAD: Names = Names("printhead print_head head_id head head_name printhead_id", "");
const TEMPERATURE: Names =
    Names("temperature_c temp_c temperature ink_temperature temp", "temp temperature");
const VOLTAGE: Names =
    Names("drive_voltage_v drive_voltage voltage_v voltage amplitude_v", "voltage volt volts");

/// Words in the names of topics and schemas of bursts, for messages that cannot be looked into.
const BURSTS: &str = "burst bursts ring rings ringdown ringdowns wave waves waveform waveforms piezo \
     piezos nozzle nozzles printhead printheads decay decays sample samples acquisition acquisitions";

/// Why nothing can decode messages whose topic or schema is named like bursts. `None`: they can be
/// decoded, or are named otherwise.
pub fn undecodable(written: &ChannelDescription, message: &Bytes) -> Option<String> {
    let schema = written.schema.map_or("", |schema| &schema.name);
    if !has_word(written.topic, BURSTS) && !has_word(&in_words(schema), BURSTS) {
        return None;
    }
    match Reading::of(written) {
        Err(why) => Some(why),
        Ok(reading) => match reading.decode(message) {
            Err(Reason::Undecodable) => {
                Some("their first message is not what its schema says".into())
            }
            _ => None,
        },
    }
}

/// `RingDown` as `Ring Down`.
fn in_words(name: &str) -> String {
    let split = |c: char| [c.is_ascii_uppercase().then_some(' '), Some(c)].into_iter().flatten();
    name.chars().flat_map(split).collect()
}

/// `topics` are all topics that carry messages of the same kind; each must have as many parts as
/// this one. `None`: nothing looks like bursts.
pub fn guess(written: &ChannelDescription, message: &Bytes, topics: &[&str]) -> Option<Proposal> {
    let name = written.schema.map_or("", |schema| &schema.name);
    let own_name = name.rsplit(['.', '/']).next().unwrap_or_default();
    if OTHERS.iter().any(|other| own_name.contains(other)) || message.len() > MOST_MESSAGE_BYTES {
        return None;
    }
    let reading = Reading::of(written).ok()?;
    let message = reading.decode(message).ok()?;
    let fields = reading.fields(Some(&message));
    let first = FirstMessage { message: &message, fields: &fields };
    let (field, samples) = fields
        .iter()
        .filter(|field| field.can_be(Slot::Samples).is_ok())
        .take(MOST_CANDIDATES)
        .filter_map(|field| Some((field, first.samples(field)?)))
        .max_by_key(|(_, samples)| samples.numbers.len())?;
    if samples.numbers.len() < FEWEST_SAMPLES {
        return None;
    }

    let toml = String::from("[[input.dialect]]\n");
    let mut guess = Guess { topic: written.topic, first: &first, samples: &samples, toml };
    guess.say_all(written.schema, field, topics);
    let toml = guess.toml;

    let there = fields.iter().filter(|field| field.kind != Kind::Message).take(MOST_SHOWN);
    let fields = there.map(|field| first.shown(field)).collect();
    let open = |line: &str| {
        let (key, value) = line.split_once(" = ")?;
        value.starts_with(QUESTION).then(|| key.to_owned())
    };
    Some(Proposal { open: toml.lines().filter_map(open).collect(), toml, fields })
}

#[derive(Clone, Debug)]
pub struct Proposal {
    pub toml: String,
    pub open: Vec<String>,
    /// The fields of the first message, for the user to choose from.
    pub fields: Vec<ShownField>,
}

struct Guess<'a> {
    topic: &'a str,
    first: &'a FirstMessage<'a>,
    samples: &'a MessageSamples,
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
        if let Some(format) = self.samples.format {
            let value = if format == Format::S16Le { "\"s16le\"" } else { "\"f32le\"" };
            self.say("format", value, "? by the look of the first message");
        }
        self.say_shape();
        self.say_named("first_channel", &FIRST, Slot::FirstChannel, "");
        self.say_sampling();
        self.say_printhead(varies);
        self.say_time();
        self.say_named("temperature", &TEMPERATURE, Slot::Temperature, "? in °C");
        self.say_named("voltage", &VOLTAGE, Slot::Voltage, "? in V");
    }

    /// Writes the sample period: a field of a period or of a rate, else a question. A dialect has no unit, so
    /// a period in another unit than s is a number that only a person can write.
    fn say_sampling(&mut self) {
        if !self.say_named("period_s", &PERIOD, Slot::Period, "? in seconds")
            && !self.say_named("rate_hz", &RATE, Slot::Rate, "? samples a second")
        {
            let comment = "? no field of it in s: the sample period, s (or rate_hz)";
            self.say("period_s", QUESTION, comment);
        }
    }

    /// Writes the field of the time: one that is named like a time, before all a message of seconds and
    /// nanoseconds or a text that is a date; else any of those. If there is none, the key is left out,
    /// and the log time counts.
    fn say_time(&mut self) {
        let fields = self.first.fields.iter();
        let times: Vec<&FieldInfo> = fields.filter(|of| of.can_be(Slot::Time).is_ok()).collect();
        let stamps = times.iter().filter(|field| field.kind == Kind::Time).copied();
        let stamps: Vec<&FieldInfo> = stamps.collect();
        let named = TIME.find(&stamps).or_else(|| TIME.find(&times));
        if let Some(field) = named.or(stamps.first().copied()) {
            self.say("time", &quoted(&field.path), "");
        }
    }

    /// A question mark in a comment says what a person should check; one as the value says that
    /// nothing in the recording tells it.
    fn say(&mut self, key: &str, value: &str, comment: &str) {
        let comment = if comment.is_empty() { String::new() } else { format!("  # {comment}") };
        let _ = writeln!(self.toml, "{key} = {value}{comment}");
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
        let numbers = self.samples.numbers.len();
        let rows = self.divisor(&CHANNELS, Slot::Channels);
        let (rows, columns) = match (rows, self.divisor(&COLUMNS, Slot::SamplesPerChannel)) {
            // `n` may be either
            (None, Some(n)) if self.counts_channels(&n) => (Some(n), None),
            known => known,
        };

        // 1. the number of channels by the fields, if any says it
        let by_columns = || columns.as_ref().map(|columns| numbers / columns.n);
        let named = rows.as_ref().map(|rows| rows.n).or_else(by_columns);
        // in a list of lists, the number of inner lists is either the channels or the samples per
        // channel
        let outer = self.samples.outer;
        let nested = |n: usize| outer.is_none_or(|outer| n == outer || n * outer == numbers);
        // 2. the likeliest layout among those that agree with the fields, or with the lists
        let agrees = |n: usize| named.map_or_else(|| nested(n), |named| n == named);
        let lie = RowLayout::likeliest(&self.samples.numbers, agrees);
        self.say_layout(lie);

        // 3. the channels: a field, else what the samples per channel leave, else the samples, else
        //    the lists, else a question
        let agrees = |n: usize| rows.as_ref().is_none_or(|rows| rows.n * n == numbers);
        let unknown = format!("? not in the message, which has {numbers} samples");
        let (value, comment) = match (&rows, named, lie, outer) {
            (Some(rows), ..) => {
                let is_sure = columns.as_ref().is_none_or(|columns| agrees(columns.n));
                let comment = if is_sure { "" } else { "? or is this samples per channel" };
                (quoted(&rows.path), comment)
            }
            (None, Some(n), ..) => {
                let comment = "? not in the message: numbers of the first, by samples_per_channel";
                (n.to_string(), comment)
            }
            (None, None, Some(lie), _) => {
                (lie.channels.to_string(), "by the samples: so many signals ring alike")
            }
            (None, None, None, Some(outer)) => {
                (outer.to_string(), "? the lists in the first message")
            }
            (None, None, None, None) => (QUESTION.into(), &*unknown),
        };
        self.say("channels", &value, comment);
        // 4. the samples per channel; a field that contradicts the channels is left out, and then
        //    the decoder divides the samples by the channels
        if let Some(columns) = columns.filter(|columns| agrees(columns.n)) {
            self.say("samples_per_channel", &quoted(&columns.path), "");
        }
    }

    /// Writes the layout, with the correlation of the layout that was not taken for comparison.
    fn say_layout(&mut self, lie: Option<RowLayout>) {
        let major = |sample_major| if sample_major { "sample-major" } else { "channel-major" };
        let (sample_major, comment) = match lie {
            Some(RowLayout { channels, sample_major, neighbours, .. }) => {
                let other = RowLayout::of(&self.samples.numbers, channels, !sample_major);
                let (name, other) = (major(!sample_major), other.map_or(0.0, |of| of.neighbours));
                let comment = format!(
                    "by the samples: neighbours of a channel correlate ({neighbours:.2}; laid out as {name} {other:.2})"
                );
                (sample_major, comment)
            }
            None => (false, "? or \"sample-major\"".to_owned()),
        };
        self.say("layout", &quoted(major(sample_major)), &comment);
    }

    /// Whether a field's number is that of the channels rather than of the samples per channel: the
    /// likelier layout of these two by how the samples correlate.
    fn counts_channels(&self, of: &Divisor) -> bool {
        let either = [of.n, self.samples.numbers.len() / of.n];
        let lie = RowLayout::likeliest(&self.samples.numbers, |n| either.contains(&n));
        lie.is_some_and(|lie| lie.channels == of.n)
    }

    fn divisor(&self, names: &Names, slot: Slot) -> Option<Divisor> {
        let path = find(self.first.fields, names, slot)?;
        let n = self.first.count(&path)?;
        self.samples.numbers.len().is_multiple_of(n).then_some(Divisor { path, n })
    }

    /// Writes the printhead's name: a field, else the part of the topic in which the topics differ, else its
    /// second part.
    fn say_printhead(&mut self, varies: Option<usize>) {
        if let Some(path) = find(self.first.fields, &PRINTHEAD, Slot::Text) {
            return self.say("printhead", &quoted(&format!("{{{path}}}")), "");
        }
        let parts = self.topic.trim_start_matches('/').split('/').count();
        let part = varies.unwrap_or(usize::from(parts > 1));
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

impl Names<'_> {
    fn find<'f>(&self, fields: &[&'f FieldInfo]) -> Option<&'f FieldInfo> {
        let first = |is: &dyn Fn(&str) -> bool| {
            // the last name of a path is the field's own, without the messages around it
            fields.iter().find(|f| is(f.path.rsplit('.').next().unwrap_or_default())).copied()
        };
        let Names(whole, words) = self;
        let named = |name: &str| first(&|of| of.eq_ignore_ascii_case(name));
        whole.split(' ').find_map(named).or_else(|| first(&|of| has_word(of, words)))
    }
}

fn find(fields: &[FieldInfo], names: &Names, slot: Slot) -> Option<String> {
    let can_be = |field: &&FieldInfo| field.can_be(slot).is_ok();
    let fields: Vec<&FieldInfo> = fields.iter().filter(can_be).collect();
    names.find(&fields).map(|field| field.path.clone())
}

/// Whether a field's own name has one of these words in it: `ink_temp_c` has `temp`.
fn has_word(name: &str, words: &str) -> bool {
    let name = name.to_ascii_lowercase();
    let mut parts = name.split(|c: char| !c.is_ascii_alphabetic());
    parts.any(|part| !part.is_empty() && words.split(' ').any(|word| word == part))
}
