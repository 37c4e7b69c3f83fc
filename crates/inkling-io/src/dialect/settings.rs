//! The settings' block `[[input.dialect]]`, as a user writes it: how messages of another logger
//! become bursts.
//!
//! In: TOML. Out: [`Dialect`]s, of which [`Dialect::check`] says whether constants and paths are
//! sound by themselves. Whether the paths lead anywhere is decided where a recording's own schema
//! is known (`plan.rs`). `docs/recordings_of_others.md` has a table of the keys.

use super::fields::Slot;
use super::path::FieldPath;
use inkling_core::burst::{Format, Layout};
use serde::{Deserialize, Serialize, Serializer};

/// At most so many dialects: each topic is compared with the pattern of each of them.
pub const MOST_DIALECTS: usize = 64;
/// At most so many field paths in the pattern of a printhead's name.
pub const MOST_TEXTS: usize = 4;

/// One block: the topics whose messages are bursts, and where in such a message the fields of a burst are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dialect {
    /// Pattern of topics: `*` within a part of the topic, `**` over parts.
    pub topic: String,
    /// Name of the messages' schema; `None`: any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub schema: Option<String>,
    pub samples: FieldPath,
    /// Type of the samples where they are bytes; arrays of numbers have a type of their own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format: Option<Format>,
    /// How many numbers stand before the first sample, as `data_offset` of ROS says; `None`: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset: Option<Source>,
    /// Order of the samples; channel by channel if nothing is said.
    #[serde(default)]
    pub layout: Layout,
    pub channels: Source,
    /// Samples of each channel; `None`: as many as there are, divided by the channels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples_per_channel: Option<Source>,
    #[serde(default = "Source::zero")]
    pub first_channel: Source,
    /// Sample period in s. Exactly one of this and `rate_hz` must be given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub period_s: Option<Source>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_hz: Option<Source>,
    pub printhead: Template,
    #[serde(default)]
    pub time: TimeSource,
    /// Temperature of the ink in °C; `None`: not recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature: Option<Source>,
    /// Drive voltage in V; `None`: not recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub voltage: Option<Source>,
    /// Idle time in s: from a channel's last actuation but one to the burst. One number for all
    /// channels or one for each; NaN: there was no actuation before. `None`: not recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub idle: Option<Source>,
    /// How many neighbours were actuated together with a channel: one number for all, or one for each.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub neighbours: Option<Source>,
}

/// A number that holds for all messages, or the path to it in each message.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(try_from = "WrittenSource")]
pub enum Source {
    Constant(f64),
    Path(FieldPath),
}

impl Source {
    fn zero() -> Source {
        Source::Constant(0.0)
    }
}

/// Whole numbers are written without a decimal point, so that the block reads as the user wrote it.
impl Serialize for Source {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        match self {
            Source::Constant(x) if x.fract() == 0.0 && x.abs() < 1e15 => s.serialize_i64(*x as i64),
            Source::Constant(x) => s.serialize_f64(*x),
            Source::Path(path) => path.serialize(s),
        }
    }
}

/// A [`Source`] as it stands in TOML. Serde tries a number first, then a text.
#[derive(Deserialize)]
#[serde(untagged, expecting = "give a number, or a field path as text")]
enum WrittenSource {
    Number(f64),
    Text(String),
}

impl TryFrom<WrittenSource> for Source {
    type Error = String;

    fn try_from(written: WrittenSource) -> Result<Source, String> {
        match written {
            WrittenSource::Number(x) => Ok(Source::Constant(x)),
            WrittenSource::Text(text) => FieldPath::try_from(text).map(Source::Path),
        }
    }
}

#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum TimeSource {
    #[default]
    LogTime,
    PublishTime,
    Path(FieldPath),
}

impl TryFrom<String> for TimeSource {
    type Error = String;

    fn try_from(text: String) -> Result<TimeSource, String> {
        match text.as_str() {
            "log_time" => Ok(TimeSource::LogTime),
            "publish_time" => Ok(TimeSource::PublishTime),
            _ => FieldPath::try_from(text).map(TimeSource::Path),
        }
    }
}

impl From<TimeSource> for String {
    fn from(time: TimeSource) -> String {
        match time {
            TimeSource::LogTime => "log_time".into(),
            TimeSource::PublishTime => "publish_time".into(),
            TimeSource::Path(path) => path.to_string(),
        }
    }
}

/// A printhead's name as a pattern: text with `{topic.N}` and `{path}` in it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Template {
    text: String,
    pub parts: Vec<Part>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Part {
    Literal(String),
    /// The part of the topic with this number, from 0 (parts are separated by `/`).
    Topic(usize),
    Path(FieldPath),
}

impl Template {
    /// The field paths in the pattern, in their order.
    pub fn paths(&self) -> impl Iterator<Item = &FieldPath> {
        self.parts.iter().filter_map(|part| match part {
            Part::Path(path) => Some(path),
            Part::Literal(_) | Part::Topic(_) => None,
        })
    }
}

impl TryFrom<String> for Template {
    type Error = String;

    fn try_from(text: String) -> Result<Template, String> {
        let (mut parts, mut rest) = (Vec::new(), text.as_str());
        while let Some((before, after)) = rest.split_once('{') {
            let (inside, behind) = after.split_once('}').ok_or_else(|| {
                format!("{text:?}: a {{ without a }}; give text with {{topic.1}} or {{field.path}}")
            })?;
            parts.push(Part::Literal(before.to_owned()));
            let number = inside.strip_prefix("topic.").and_then(|n| n.parse().ok());
            parts.push(match number {
                Some(number) => Part::Topic(number),
                None => Part::Path(FieldPath::try_from(inside.to_owned())?),
            });
            rest = behind;
        }
        parts.push(Part::Literal(rest.to_owned()));
        parts.retain(|part| !matches!(part, Part::Literal(text) if text.is_empty()));
        let template = Template { text, parts };
        match (template.parts.is_empty(), template.paths().count() > MOST_TEXTS) {
            (true, _) => Err("is empty: give a name, or {topic.1} or {field.path}".into()),
            (_, true) => Err(format!("{:?}: more than {MOST_TEXTS} paths", template.text)),
            _ => Ok(template),
        }
    }
}

impl From<Template> for String {
    fn from(template: Template) -> String {
        template.text
    }
}

/// A key of a dialect with its value, which is a [`Source`] or a path, and what becomes of it.
pub struct Key<'a, T> {
    pub name: &'static str,
    pub slot: Slot,
    pub value: &'a T,
}

impl Dialect {
    /// The keys that take a number or a path, as far as the block gives them.
    pub fn numbers(&self) -> impl Iterator<Item = Key<'_, Source>> {
        let all = [
            ("offset", Slot::FirstChannel, self.offset.as_ref()),
            ("channels", Slot::Channels, Some(&self.channels)),
            ("samples_per_channel", Slot::SamplesPerChannel, self.samples_per_channel.as_ref()),
            ("first_channel", Slot::FirstChannel, Some(&self.first_channel)),
            ("period_s", Slot::Period, self.period_s.as_ref()),
            ("rate_hz", Slot::Rate, self.rate_hz.as_ref()),
            ("temperature", Slot::Temperature, self.temperature.as_ref()),
            ("voltage", Slot::Voltage, self.voltage.as_ref()),
            ("idle", Slot::Idle, self.idle.as_ref()),
            ("neighbours", Slot::Neighbours, self.neighbours.as_ref()),
        ];
        all.into_iter().filter_map(|(name, slot, value)| Some(Key { name, slot, value: value? }))
    }

    pub fn paths(&self) -> Vec<Key<'_, FieldPath>> {
        let mut paths = vec![Key { name: "samples", slot: Slot::Samples, value: &self.samples }];
        paths.extend(self.numbers().filter_map(|Key { name, slot, value }| match value {
            Source::Constant(_) => None,
            Source::Path(value) => Some(Key { name, slot, value }),
        }));
        if let TimeSource::Path(value) = &self.time {
            paths.push(Key { name: "time", slot: Slot::Time, value });
        }
        let texts = self.printhead.paths();
        paths.extend(texts.map(|value| Key { name: "printhead", slot: Slot::Text, value }));
        paths
    }

    /// Checks what is wrong whatever the recording. The error names the key and says what to give.
    pub fn check(&self) -> Result<(), String> {
        for Key { name, slot, value } in self.numbers() {
            let Source::Constant(x) = *value else { continue };
            let is_whole = x.fract() == 0.0;
            let (is_good, what) = match slot {
                Slot::Channels | Slot::SamplesPerChannel => {
                    (is_whole && (1.0..=65_536.0).contains(&x), "give 1 to 65536")
                }
                Slot::FirstChannel => {
                    let fits = (0.0..=f64::from(u32::MAX)).contains(&x);
                    (is_whole && fits, "give a whole number from 0 on")
                }
                Slot::Period => (x.is_finite() && x > 0.0, "give the sample period in seconds"),
                Slot::Rate => (x.is_finite() && x > 0.0, "give the samples a second"),
                Slot::Temperature => (x.is_finite(), "give °C"),
                Slot::Voltage => (x.is_finite(), "give V"),
                Slot::Idle => (x.is_nan() || x >= 0.0, "give seconds, or nan: there was none"),
                _ => (is_whole && (0.0..=255.0).contains(&x), "give 0 to 255"),
            };
            if !is_good {
                return Err(format!("{name} = {x:?}: {what}"));
            }
        }
        match (&self.period_s, &self.rate_hz) {
            (None, None) => {
                Err("period_s is missing: give the sample period in seconds, or rate_hz".into())
            }
            (Some(_), Some(_)) => Err("period_s and rate_hz say the same: give one of them".into()),
            _ => Ok(()),
        }
    }

    /// Whether `other`, coming later, could never take effect. Only plain cases are noticed: equal
    /// patterns, and patterns that fit every topic.
    pub fn hides(&self, other: &Dialect) -> bool {
        let below_root = self.topic == "/**" && other.topic.starts_with('/');
        let all = self.topic == "**" || below_root;
        (all || self.topic == other.topic) && (self.schema.is_none() || self.schema == other.schema)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::assert_refused;

    const WRITTEN: &str = r#"
        topic = "/heads/*/burst"
        samples = "wave.data"
        channels = 128
        period_s = 5e-7
        printhead = "K-{topic.1}/{head.id}"
    "#;

    fn read(text: &str) -> Result<Dialect, String> {
        let dialect: Dialect = toml::from_str(text).map_err(|e| e.to_string())?;
        dialect.check().map(|()| dialect)
    }

    #[test]
    fn defaults_and_names_are_those_of_the_contract() {
        let dialect = read(WRITTEN).unwrap();
        assert_eq!(dialect.first_channel, Source::Constant(0.0));
        assert_eq!(dialect.time, TimeSource::LogTime);
        let path = |text: &str| FieldPath::try_from(text.to_owned()).unwrap();
        let literal = |text: &str| Part::Literal(text.into());
        let parts = [literal("K-"), Part::Topic(1), literal("/"), Part::Path(path("head.id"))];
        assert_eq!(dialect.printhead.parts, parts);
        let again: Dialect = toml::from_str(&toml::to_string(&dialect).unwrap()).unwrap();
        assert_eq!(again, dialect);
    }

    #[test]
    fn what_can_mean_nothing_is_refused() {
        for (key, value, says) in [
            ("channels", "0", "channels = 0"),
            ("channels", "1.5", "channels = 1.5"),
            ("channels", "true", "a number, or a field path"),
            ("period_s", "0", "sample period"),
            ("rate_hz", "2e6", "give one of them"),
            ("period_s", "\"?\"", "still a question"),
            ("period_s", "\"a..b\"", "no field path"),
            ("first_channel", "-1", "first_channel"),
            ("printhead", "\"\"", "is empty"),
            ("printhead", "\"{a\"", "without a }"),
            ("neighbours", "256", "neighbours"),
            ("idle", "-1", "idle"),
            ("format", "\"s24le\"", "s16le"),
            ("layout", "\"rows\"", "channel-major"),
            ("colour", "1", "colour"),
        ] {
            let line_of = format!("{key} ");
            let kept = WRITTEN.lines().filter(|line| !line.trim_start().starts_with(&line_of));
            let text = format!("{}\n{key} = {value}\n", kept.collect::<Vec<_>>().join("\n"));
            assert_refused(read(&text), &[says]);
        }
    }

    #[test]
    fn a_pattern_hides_only_topics_that_all_fit_it() {
        let of = |topic: &str| Dialect { topic: topic.into(), ..read(WRITTEN).unwrap() };
        assert!(of("**").hides(&of("heads/*")) && of("/**").hides(&of("/heads/*")));
        assert!(!of("/**").hides(&of("heads/*")) && !of("/heads/**").hides(&of("/heads/*")));
    }
}
