//! Recordings of others: messages of any schema, read as bursts by `[[input.dialect]]`.
//!
//! ```text
//! settings ──▶ Dialects ── topic, schema ──▶ Plan (paths resolved once) ── message ──▶ Acquisition
//!                          of a recording     protobuf | json | ros
//! ```
//!
//! A schema becomes a shape (`shape.rs`), in which paths are resolved whatever the encoding; an encoding only walks its
//! bytes. All of them find the same [`value::Value`]s.
//!
//! It must never take a size from a message without a bound, and never judge by a path that leads
//! nowhere: that is said when the recording is opened.

pub mod decoder;
pub mod fields;
pub mod guess;
mod json;
pub mod path;
pub mod plan;
mod protobuf;
mod ros;
mod ros_definition;
pub mod settings;
mod shape;
pub mod value;
mod wanted;

use bytes::Bytes;
use globset::{GlobBuilder, GlobMatcher};
use plan::{Plan, Schema, Written};
use settings::{Dialect, MOST_DIALECTS};
use std::sync::Arc;

/// All dialects of the settings, ready to be asked. Cheap to copy.
#[derive(Clone, Debug, Default)]
pub struct Dialects {
    all: Arc<[Fitting]>,
}

#[derive(Debug)]
struct Fitting {
    dialect: Arc<Dialect>,
    topic: GlobMatcher,
}

/// A set of dialects, one bit each, the first the lowest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Fits(u64);

impl Fits {
    pub fn any(self) -> bool {
        self.0 != 0
    }

    fn numbers(self) -> impl Iterator<Item = usize> {
        (0..MOST_DIALECTS).filter(move |number| self.0 >> number & 1 == 1)
    }
}

impl Dialects {
    /// Refuses what could never take effect, with its key.
    pub fn new(dialects: &[Dialect]) -> Result<Dialects, String> {
        let key = |number: usize| format!("input.dialect[{number}]");
        if dialects.len() > MOST_DIALECTS {
            return Err(format!("{} of input.dialect: at most {MOST_DIALECTS}", dialects.len()));
        }
        let mut all: Vec<Fitting> = Vec::new();
        for (number, dialect) in dialects.iter().enumerate() {
            dialect.check().map_err(|what| format!("{}: {what}", key(number)))?;
            let before = dialects[..number].iter().position(|before| before.hides(dialect));
            if let Some(before) = before {
                return Err(format!(
                    "{} can never take effect: whatever fits it fits {} before",
                    key(number),
                    key(before)
                ));
            }
            let topic =
                matcher(&dialect.topic).map_err(|e| format!("{}.topic: {e}", key(number)))?;
            all.push(Fitting { dialect: Arc::new(dialect.clone()), topic });
        }
        Ok(Dialects { all: all.into() })
    }

    pub fn len(&self) -> usize {
        self.all.len()
    }

    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// Those whose topic fits.
    pub fn of_topic(&self, topic: &str) -> Fits {
        let fits = |(number, fitting): (usize, &Fitting)| {
            u64::from(fitting.topic.is_match(topic)) << number
        };
        Fits(self.all.iter().enumerate().map(fits).sum())
    }

    /// The first of `fits` that fits the schema, too.
    pub fn first(&self, fits: Fits, schema: Option<&str>) -> Option<usize> {
        fits.numbers().find(|&number| match &self.all[number].dialect.schema {
            None => true,
            Some(name) => schema == Some(name),
        })
    }

    /// How a channel's messages are read by a dialect.
    pub fn plan(&self, number: usize, written: &Written) -> Result<Plan, String> {
        let fitting = &self.all[number];
        Plan::new(&fitting.dialect, written)
            .map_err(|what| format!("input.dialect[{number}], topic {}: {what}", shown(written)))
    }

    /// Whether one would read such messages, whatever their topic and their schema's name.
    pub fn could_read(&self, written: &Written, message: &Bytes, most_bytes: u64) -> bool {
        (0..self.len()).filter_map(|number| self.plan(number, written).ok()).any(|plan| {
            plan.check_message(message, most_bytes).is_ok()
                && plan.find(message, most_bytes).is_ok()
        })
    }

    /// Those that are not in `used`, by their keys and topics.
    pub fn without(&self, used: impl Fn(usize) -> bool) -> Vec<String> {
        self.all
            .iter()
            .enumerate()
            .filter(|(number, _)| !used(*number))
            .map(|(number, fitting)| {
                let schema = fitting.dialect.schema.as_ref();
                let schema = schema.map_or(String::new(), |name| format!(", schema {name:?}"));
                format!("input.dialect[{number}] (topic {:?}{schema})", fitting.dialect.topic)
            })
            .collect()
    }
}

/// Topics that somebody knows and does not want: patterns as of dialects.
#[derive(Clone, Debug, Default)]
pub struct Ignored(Vec<GlobMatcher>);

impl Ignored {
    pub fn new(patterns: &[String]) -> Result<Ignored, String> {
        patterns.iter().map(|pattern| matcher(pattern)).collect::<Result<_, _>>().map(Ignored)
    }

    pub fn has(&self, topic: &str) -> bool {
        self.0.iter().any(|pattern| pattern.is_match(topic))
    }
}

fn matcher(pattern: &str) -> Result<GlobMatcher, String> {
    let glob = GlobBuilder::new(pattern).literal_separator(true).build();
    glob.map(|glob| glob.compile_matcher()).map_err(|e| format!("no valid pattern: {e}"))
}

/// `/heads/0 (acme.Wave, protobuf)`.
fn shown(written: &Written) -> String {
    let schema = written.schema.map_or("no schema", |schema: &Schema| &schema.name);
    let encoding = crate::printable::cell(written.message_encoding);
    let topic = crate::printable::line(written.topic, 200);
    format!("{topic} ({}, {encoding})", crate::printable::line(schema, 200))
}
