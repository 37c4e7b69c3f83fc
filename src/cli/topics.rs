//! The topics of a recording, and proposed dialects for messages that look like bursts, for
//! `inkling inspect`. In: the census of a recording's messages, which counts them topic by topic
//! and keeps the first of each. Out: text or JSON, and the proposals, which `inspect --write`
//! writes.
//!
//! A *dialect* is a block `[[input.dialect]]` of the settings, which says where in a foreign
//! message a burst's fields stand. The guess is made by `inkling_io::dialect::guess` from the first
//! message of a kind; topics of one kind share a dialect, so each kind is guessed once.

use super::progress::thousands;
use super::report::printable;
use crate::report::{Column, columns, three_digits};
use bytes::Bytes;
use inkling_io::census::{MessageKind, TopicSummary};
use inkling_io::dialect::guess::{Proposal, guess};
use inkling_io::dialect::unread::{Look, look};
use inkling_io::printable as shown;
use serde_json::{Value, json};
use std::io::{self, Write};

/// Most topics that are listed: a hostile file may have 65,536 and more.
const MOST_LISTED: usize = 200;
/// Most kinds of messages for which a dialect is proposed.
const MOST_PROPOSED: usize = 8;
/// Most messages of a kind that are looked at.
const MOST_MESSAGES: usize = 32;
/// Most characters of a schema's name and encodings.
const MOST_NAME: usize = 120;

/// What is told of the topics of one recording.
pub struct Topics {
    topics: Vec<TopicSummary>,
    /// Of each of them why nothing can read it though it is called like bursts.
    unread: Vec<Option<String>>,
    /// Proposed dialects, one for all topics of a kind.
    pub proposals: Vec<Proposal>,
}

/// The topics that a reader has counted, with proposals. `printheads`: those that were met.
pub fn of(topics: Vec<TopicSummary>, printheads: &[&str]) -> Topics {
    let proposals = proposals(&topics);
    let unread = |of: &TopicSummary| unread(of, printheads);
    Topics { unread: topics.iter().map(unread).collect(), topics, proposals }
}

/// Why nothing can read a topic that is called like bursts.
fn unread(summary: &TopicSummary, printheads: &[&str]) -> Option<String> {
    let is_open = summary.messages > 0 && matches!(summary.kind, MessageKind::Nothing);
    let message = (summary.first_message.as_ref(), summary.largest);
    let look = look(&summary.written().filter(|_| is_open)?, message, printheads.iter().copied());
    if let Look::Undecodable(why) = look { Some(why) } else { None }
}

/// Proposes a dialect for each kind of messages that is not read yet. Topics are of one kind if schema,
/// encodings and the number of parts of the topic's name agree.
fn proposals(topics: &[TopicSummary]) -> Vec<Proposal> {
    // printheads often have topics of their own, `/head/1/piezo`, `/head/2/piezo`, which have as
    // many parts
    let parts = |summary: &TopicSummary| summary.topic.matches('/').count();
    let same = |a: &TopicSummary, b: &TopicSummary| {
        (&a.schema_name, &a.schema_encoding, &a.message_encoding, parts(a))
            == (&b.schema_name, &b.schema_encoding, &b.message_encoding, parts(b))
    };
    let open = |summary: &&TopicSummary| {
        matches!(summary.kind, MessageKind::Nothing | MessageKind::OtherEncoding)
    };

    // gather the topics that nothing reads by kind, then guess from the first topic that has a
    // message
    let mut kinds: Vec<Vec<&TopicSummary>> = Vec::new();
    for this in topics.iter().filter(open).take(MOST_LISTED) {
        match kinds.iter_mut().find(|kind| same(kind[0], this)) {
            Some(kind) => kind.push(this),
            None => kinds.push(vec![this]),
        }
    }
    let propose = |kind: &Vec<&TopicSummary>| {
        let topics: Vec<&str> = kind.iter().map(|summary| summary.topic.as_str()).collect();
        let first = kind.iter().find(|summary| summary.first_message.is_some())?;
        let all = kind.iter().flat_map(|of| of.first_message.iter().chain(&of.next_messages));
        let messages = first.first_message.iter().chain(all).take(MOST_MESSAGES);
        guess(&first.written()?, &messages.collect::<Vec<&Bytes>>(), &topics)
    };
    kinds.iter().filter_map(propose).take(MOST_PROPOSED).collect()
}

impl Topics {
    /// Number of messages that have the schema name `inkling.Burst` and another encoding than
    /// protobuf.
    pub fn of_other_encoding(&self) -> u64 {
        let other = self.topics.iter().filter(|s| matches!(s.kind, MessageKind::OtherEncoding));
        other.map(|summary| summary.messages).sum()
    }

    /// Prints a table of the topics, then the proposals.
    pub fn print(&self, out: &mut impl Write) -> io::Result<()> {
        let listed = &self.topics[..self.topics.len().min(MOST_LISTED)];
        let topic = |summary: &TopicSummary| printable(&summary.topic);
        let width = listed.iter().map(|s| topic(s).chars().count()).max().unwrap_or(0).clamp(5, 48);
        if !listed.is_empty() {
            let heads = [
                Column::Words("topic", width),
                Column::Number("messages", 10),
                Column::Number("rate", 12),
                Column::Number("bytes each", 20),
                Column::Last("schema"),
            ];
            let of_topic = listed.iter().zip(&self.unread).map(|(summary, unread)| {
                let rate = summary.rate_hz().map(|hz| format!("{} Hz", three_digits(hz)));
                let rate = rate.unwrap_or_else(|| "-".into());
                let schema = schema(summary) + &becomes(summary, unread.as_deref());
                [topic(summary), thousands(summary.messages), rate, sizes(summary), schema]
            });
            columns(out, heads, of_topic)?;
        }
        let more = (self.topics.len() - listed.len()) as u64;
        if more > 0 {
            writeln!(out, "  and {} topics more", thousands(more))?;
        }
        self.proposals.iter().try_for_each(|proposal| print_proposal(proposal, out))
    }

    /// Adds the topics and proposals to the document of `--json`.
    pub fn describe(&self, document: &mut Value) {
        let topics = self.topics.iter().zip(&self.unread).take(MOST_LISTED);
        let topics = topics.map(|(summary, unread)| {
            json!({
                "topic": summary.topic,
                "schema": summary.schema_name,
                "schema_encoding": summary.schema_encoding,
                "message_encoding": summary.message_encoding,
                "messages": summary.messages,
                "bytes": summary.bytes,
                "smallest": if summary.messages > 0 { summary.smallest } else { 0 },
                "largest": summary.largest,
                "rate_hz": summary.rate_hz(),
                "becomes": match &summary.kind {
                    MessageKind::Bursts => "bursts",
                    MessageKind::Foreign(_) => "bursts_by_dialect",
                    MessageKind::Unread(_) => "undecodable",
                    MessageKind::OtherEncoding => "bursts_of_other_encoding",
                    MessageKind::Nothing => "nothing",
                },
                "unread": unread,
            })
        });
        document["topics"] = topics.collect();
        document["topics_more"] = json!(self.topics.len().saturating_sub(MOST_LISTED));
        let blocks = self.proposals.iter().map(|proposal| &proposal.toml);
        document["dialects"] = json!(blocks.collect::<Vec<_>>());
        let described = self.proposals.iter().map(|p| json!({"fields": p.fields, "open": p.open}));
        document["messages"] = described.collect();
    }
}

/// Prints the fields of a kind of messages, and the block of settings that reads them.
fn print_proposal(proposal: &Proposal, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "  looks like bursts; its first message has")?;
    let rows = proposal.fields.iter().map(|field| {
        let value = match (&field.length, &field.value) {
            (Some(n), _) => format!("{} of it", thousands(*n as u64)),
            (None, value) => value.as_deref().map(printable).unwrap_or_default(),
        };
        [printable(&field.path), printable(&field.type_name), value]
    });
    let rows: Vec<[String; 3]> = rows.collect();
    let width = |k: usize| rows.iter().map(|row| row[k].chars().count()).max().unwrap_or(0).min(48);
    let (of_path, of_type) = (width(0), width(1));
    for [path, type_name, value] in &rows {
        let line = format!("    {path:<of_path$}  {type_name:<of_type$}  {value}");
        writeln!(out, "{}", line.trim_end())?;
    }
    let what = "into a settings file (--write FILE, or by hand), what has a \"?\" looked at:";
    writeln!(out, "  {what}\n")?;
    for line in proposal.toml.lines() {
        writeln!(out, "{}", shown::line(line, 1000))?;
    }
    writeln!(out)?;
    match proposal.open.as_slice() {
        [] => Ok(()),
        open => writeln!(out, "  to be filled in, as nothing in it says so: {}", open.join(", ")),
    }
}

/// The sizes of a topic's messages, bytes: one number, or the smallest and the largest.
fn sizes(summary: &TopicSummary) -> String {
    match summary.messages {
        0 => "-".into(),
        _ if summary.smallest == summary.largest => thousands(summary.largest),
        _ => format!("{} to {}", thousands(summary.smallest), thousands(summary.largest)),
    }
}

/// The name of a topic's schema, with its encodings.
fn schema(summary: &TopicSummary) -> String {
    let name = &summary.schema_name;
    let name = if summary.without_schema { "none".into() } else { shown::line(name, MOST_NAME) };
    format!("{name} ({})", summary.encoding())
}

/// What a topic's messages are read as, if there is something to say. `unread`: why they cannot be.
fn becomes(summary: &TopicSummary, unread: Option<&str>) -> String {
    match &summary.kind {
        MessageKind::Bursts => String::new(),
        MessageKind::Nothing => {
            unread.map_or(String::new(), |why| format!("; {}", shown::line(why, 400)))
        }
        MessageKind::Foreign(_) => "; read by a dialect".into(),
        MessageKind::Unread(why) => format!("; {}", shown::line(why, 400)),
        MessageKind::OtherEncoding => "; bursts, but not protobuf: a dialect can read them".into(),
    }
}
