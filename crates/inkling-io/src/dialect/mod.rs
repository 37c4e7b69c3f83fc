//! Reads recordings of other loggers: messages of any schema become bursts by the settings' blocks
//! `[[input.dialect]]`. Such a block is called a *dialect* ([`settings::Dialect`]);
//! `docs/recordings_of_others.md` explains its keys.
//!
//! ```text
//! settings ──▶ Dialects ── topic, schema ──▶ Plan (paths checked once) ── message ──▶ Acquisition
//!                          of a recording     protobuf | json | ros
//! ```
//!
//! The files, in the order in which a message meets them:
//!
//! ```text
//! settings        a block as written
//! path            a field path
//! shape, fields   what messages of a schema hold; the same in words, for errors
//! plan            a dialect checked against one channel of one recording
//! protobuf, ros,  an encoding: how its schema becomes a shape, how a message is decoded, and what
//! json            a path finds in it
//! message, value  a decoded message of any encoding, and its time; what a path found in it
//! decoder         what was found becomes a burst
//! guess, names,   the other way round: messages that look like bursts become a block to paste
//! first_message,
//! dimensions
//! unread          of messages that nothing reads: whether they look like bursts, and why nothing reads them
//! ```
//!
//! All encodings share the middle: a schema of any encoding becomes a shape, and in all of them a
//! path finds the same [`value::Value`]s.
//!
//! No size is taken from a message without a bound. A path that leads nowhere is an error when the
//! recording is opened (in JSON, when its first message is read), so that nothing is judged by it.

pub mod decoder;
pub(super) mod dimensions;
mod fields;
mod first_message;
pub mod guess;
pub mod json;
mod message;
mod names;
pub mod path;
pub mod plan;
mod protobuf;
mod ros;
mod ros_definition;
pub mod settings;
mod shape;
pub mod unread;
pub mod value;

pub use names::{NO_CELSIUS, NO_VOLTS, has_word};

use bytes::Bytes;
use globset::{GlobBuilder, GlobMatcher};
use plan::{ChannelDescription, Plan, Schema};
use settings::{Dialect, MOST_DIALECTS};
use std::sync::Arc;

/// All dialects of the settings, ready to be asked which of them reads a topic. Dialects are known
/// by their number, from 0 in the order of the settings. Cheap to clone.
#[derive(Clone, Debug, Default)]
pub struct Dialects {
    all: Arc<[CompiledDialect]>,
}

#[derive(Debug)]
struct CompiledDialect {
    dialect: Arc<Dialect>,
    topic: GlobMatcher,
}

impl Dialects {
    pub fn new(dialects: &[Dialect]) -> Result<Dialects, String> {
        let key = |number: usize| format!("input.dialect[{number}]");
        if dialects.len() > MOST_DIALECTS {
            return Err(format!("{} of input.dialect: at most {MOST_DIALECTS}", dialects.len()));
        }
        let mut all: Vec<CompiledDialect> = Vec::new();
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
            all.push(CompiledDialect { dialect: Arc::new(dialect.clone()), topic });
        }
        Ok(Dialects { all: all.into() })
    }

    pub fn len(&self) -> usize {
        self.all.len()
    }

    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    pub fn fit_topic(&self, topic: &str) -> bool {
        self.all.iter().any(|fitting| fitting.topic.is_match(topic))
    }

    /// The number of the first dialect that reads messages of a topic with a schema of this name; `None`:
    /// without a schema.
    pub fn first(&self, topic: &str, schema: Option<&str>) -> Option<usize> {
        let has_schema = |of: &Dialect| of.schema.is_none() || of.schema.as_deref() == schema;
        self.all.iter().position(|of| has_schema(&of.dialect) && of.topic.is_match(topic))
    }

    pub fn plan(&self, number: usize, written: &ChannelDescription) -> Result<Plan, String> {
        let fitting = &self.all[number];
        Plan::new(&fitting.dialect, written)
            .map_err(|what| format!("input.dialect[{number}], topic {}: {what}", shown(written)))
    }

    /// Whether at least one dialect could read these messages if the topic and schema name that it
    /// asks for are ignored. Such a dialect is probably mistyped, and the user is told so.
    pub fn could_read(&self, written: &ChannelDescription, message: &Bytes) -> bool {
        (0..self.len())
            .filter_map(|number| self.plan(number, written).ok())
            .any(|plan| plan.check_message(message).is_ok() && plan.reading.decode(message).is_ok())
    }

    /// The dialects that are not `used`, each by its key, topic and schema, for a message to the user.
    pub fn without(&self, used: impl Fn(usize) -> bool) -> Vec<String> {
        let unused = self.all.iter().enumerate().filter(|(number, _)| !used(*number));
        let named = unused.map(|(number, CompiledDialect { dialect, .. })| {
            let schema = dialect.schema.as_ref();
            let schema = schema.map_or(String::new(), |name| format!(", schema {name:?}"));
            format!("input.dialect[{number}] (topic {:?}{schema})", dialect.topic)
        });
        named.collect()
    }
}

/// Patterns of topics that the user knows and does not want to be warned of (setting
/// `input.ignore`), of the same form as those of dialects.
#[derive(Clone, Debug, Default)]
pub struct IgnoredTopics(Vec<GlobMatcher>);

impl IgnoredTopics {
    pub fn new(patterns: &[String]) -> Result<IgnoredTopics, String> {
        patterns.iter().map(|pattern| matcher(pattern)).collect::<Result<_, _>>().map(IgnoredTopics)
    }

    pub fn has(&self, topic: &str) -> bool {
        self.0.iter().any(|pattern| pattern.is_match(topic))
    }
}

/// Compiles a pattern. `*` stays within a part of a topic or path; `**` goes over parts where it is a
/// whole part.
pub(super) fn matcher(pattern: &str) -> Result<GlobMatcher, String> {
    let glob = GlobBuilder::new(pattern).literal_separator(true).build();
    glob.map(|glob| glob.compile_matcher()).map_err(|e| format!("no valid pattern: {e}"))
}

/// A channel in words: topic, schema and encoding, such as `/heads/0 (acme.Wave, protobuf)`.
fn shown(written: &ChannelDescription) -> String {
    let schema = written.schema.map_or("no schema", |schema: &Schema| &schema.name);
    let encoding = crate::printable::cell(written.message_encoding);
    let topic = crate::printable::line(written.topic, 200);
    format!("{topic} ({}, {encoding})", crate::printable::line(schema, 200))
}
