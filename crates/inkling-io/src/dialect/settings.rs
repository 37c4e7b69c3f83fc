//! `[[input.dialect]]`: how messages of others become bursts, as written.
//!
//! In: TOML. Out: [`Dialect`]s whose constants and paths are sound by themselves; whether the paths lead
//! anywhere is decided where a recording's own schema is known.

use super::path::FieldPath;
use super::wanted::Slot;
use inkling_core::burst::{Format, Layout};
use serde::{Deserialize, Serialize, Serializer};

/// What fits is kept as one bit each.
pub const MOST_DIALECTS: usize = 64;
/// Field paths in one printhead's name.
pub const MOST_TEXTS: usize = 4;

/// Messages on topics that fit, and where in them a burst's fields are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dialect {
    /// Glob: `*` within a part of the topic, `**` over parts.
    pub topic: String,
    /// Name of the messages' schema; none: any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub schema: Option<String>,
    /// Bytes, or an array of numbers.
    pub samples: FieldPath,
    /// Of bytes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format: Option<Format>,
    #[serde(default)]
    pub layout: Layout,
    pub channels: Source,
    /// None: as many as there are, by channels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples_per_channel: Option<Source>,
    #[serde(default = "Source::zero")]
    pub first_channel: Source,
    /// Either this or `rate_hz`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub period_s: Option<Source>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_hz: Option<Source>,
    pub printhead: Template,
    #[serde(default)]
    pub time: TimeSource,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature: Option<Source>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub voltage: Option<Source>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub idle: Option<Source>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub neighbours: Option<Source>,
}

/// A number, or where in a message it stands.
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

impl Serialize for Source {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        match self {
            Source::Constant(x) if x.fract() == 0.0 && x.abs() < 1e15 => s.serialize_i64(*x as i64),
            Source::Constant(x) => s.serialize_f64(*x),
            Source::Path(path) => path.serialize(s),
        }
    }
}

/// A [`Source`] as it stands in TOML.
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

/// Where a burst's time stands.
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

/// A printhead's name: text with `{topic.N}` and `{path}` in it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Template {
    text: String,
    pub parts: Vec<Part>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Part {
    Literal(String),
    /// Of the topic's parts, from 0.
    Topic(usize),
    Path(FieldPath),
}

impl Template {
    /// The field paths in it.
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

/// A key of a dialect that takes a number or a path, and what that becomes.
pub struct Numbered<'a> {
    pub key: &'static str,
    pub slot: Slot,
    pub source: &'a Source,
}

/// A key that has a path, and what is to be found there.
pub struct Place<'a> {
    pub key: &'static str,
    pub slot: Slot,
    pub path: &'a FieldPath,
}

impl Dialect {
    /// The keys that are given of those that take a number or a path.
    pub fn numbers(&self) -> impl Iterator<Item = Numbered<'_>> {
        let all = [
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
        all.into_iter()
            .filter_map(|(key, slot, source)| Some(Numbered { key, slot, source: source? }))
    }

    /// Every path of it.
    pub fn places(&self) -> Vec<Place<'_>> {
        let mut places = vec![Place { key: "samples", slot: Slot::Samples, path: &self.samples }];
        places.extend(self.numbers().filter_map(|Numbered { key, slot, source }| match source {
            Source::Constant(_) => None,
            Source::Path(path) => Some(Place { key, slot, path }),
        }));
        if let TimeSource::Path(path) = &self.time {
            places.push(Place { key: "time", slot: Slot::Time, path });
        }
        let texts = self.printhead.paths().zip(0..);
        let key = "printhead";
        places.extend(texts.map(|(path, n)| Place { key, slot: Slot::Text(n), path }));
        places
    }

    /// What is wrong whatever the recording.
    pub fn check(&self) -> Result<(), String> {
        for Numbered { key, slot, source } in self.numbers() {
            let Source::Constant(x) = *source else { continue };
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
                return Err(format!("{key} = {x:?}: {what}"));
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

    /// Whatever fits `other` fits this one before.
    pub fn hides(&self, other: &Dialect) -> bool {
        let all = ["**", "/**"].contains(&self.topic.as_str());
        (all || self.topic == other.topic) && (self.schema.is_none() || self.schema == other.schema)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
            let kept: String = WRITTEN
                .lines()
                .filter(|line| !line.trim_start().starts_with(&format!("{key} ")))
                .map(|line| format!("{line}\n"))
                .collect();
            let e = read(&format!("{kept}{key} = {value}\n")).unwrap_err();
            assert!(e.contains(says), "{key} = {value}: {e}");
        }
    }
}
