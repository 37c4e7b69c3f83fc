//! Looks at the beginning of a recording: which dialects read something in it, and which channels
//! look like bursts although nothing reads them.
//!
//! In: a [`Recording`], of which a few blocks are decoded. Out: [`DialectsUsed`], to check settings
//! before judging, and [`UnreadChannel`]s, told after it.

use super::block::Block;
use super::block_reader::BlockReader;
use super::census::{MessageKind, TopicSummary};
use super::damage::RecordingError;
use super::dialect::plan::Plan;
use super::dialect::unread::{Look, look};
use super::dialect::{Dialects, dimensions};
use super::mcap_summary::MOST_OF_A_NAME;
use super::printable;
use super::recording::Recording;
use bytes::Bytes;
use inkling_core::burst::{Acquisition, UnusableBurst};
use std::collections::BTreeSet;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnreadChannel {
    pub topic: String,
    pub schema: String,
    /// The encodings of its messages and of its schema, such as `cdr, ros2idl`.
    pub encoding: String,
    /// Messages by the statistics; `None`: the file does not say, or it has more than 64 such
    /// topics.
    pub messages: Option<u64>,
    /// Whether a dialect would read the channel under another topic or schema name: then a name is
    /// probably mistyped.
    pub by_dialect: bool,
    /// Why no dialect can read it, such as its encoding. Then only names of the channel look like bursts, or
    /// each message is compressed.
    pub undecodable: Option<String>,
}

/// Numbers of the dialects that fit channels of a recording, some of them twice.
#[derive(Clone, Debug)]
pub struct DialectsUsed {
    pub numbers: Vec<usize>,
    /// Whether the summary names all channels.
    pub all: bool,
}

/// Bytes after which the search for what dialects read gives up, asked every `PEEKED_AT_ONCE`
/// blocks.
const MOST_PEEKED_BYTES: u64 = 64 << 20;
/// Blocks that are looked at in any case, because only a channel's first message says whether paths
/// in JSON lead anywhere. After each further so many blocks it is asked whether that is enough.
const PEEKED_AT_ONCE: u64 = 16;
const MOST_PEEKED_ROWS: usize = 32_768;

impl Recording {
    /// Only the beginning is looked at: until each channel that a dialect reads has had a message
    /// and, without a summary, each of the settings' `dialects` dialects has read something. It is
    /// an error if a dialect cannot read a channel that it fits.
    pub fn dialects_used(&self, dialects: usize) -> Result<DialectsUsed, RecordingError> {
        let wrong = |what: String| RecordingError::Dialect { path: self.path.clone(), what };
        // a summary names all channels, and so all dialects that read something
        let mut used = DialectsUsed { numbers: Vec::new(), all: self.channels_known_upfront };
        used.numbers.extend(self.channels.dialects_used());
        if used.all && used.numbers.is_empty() {
            return Ok(used);
        }

        let reader = self.peek(|block, reader| {
            if block.index == 0 || !block.index.is_multiple_of(PEEKED_AT_ONCE) {
                return false;
            }
            // one number for each channel that a dialect reads
            let met = if used.all { used.numbers.clone() } else { reader.dialects_met() };
            let all = used.all || met.iter().collect::<BTreeSet<_>>().len() >= dialects;
            all && reader.foreign_seen() >= met.len() || block.offset > MOST_PEEKED_BYTES
        });
        used.numbers.extend(reader.dialects_met());

        // then each channel's first messages are checked; if one of them can be read, the others are odd
        for TopicSummary { topic, kind, first_message, next_messages, .. } in &reader.topics() {
            let checked = match kind {
                MessageKind::Unread(why) => Err(why.to_string()),
                MessageKind::Foreign(plan) => {
                    let first = first_message.iter().chain(next_messages);
                    let mut checked = first.map(|message| check_message(plan, message));
                    match checked.next() {
                        Some(Err(what)) if !checked.any(|of| of.is_ok()) => {
                            Err(format!("{}: {what}", printable::line(topic, 200)))
                        }
                        _ => Ok(()),
                    }
                }
                _ => Ok(()),
            };
            checked.map_err(wrong)?;
        }
        Ok(used)
    }

    /// Reads blocks until `is_enough` says so of the next block. Gives the reader, which has counted
    /// the dialects and the channels of these blocks.
    fn peek(&self, is_enough: impl Fn(&Block, &BlockReader) -> bool) -> BlockReader {
        let mut reader = self.reader().counting();
        for block in self.blocks().filter_map(Result::ok) {
            if is_enough(&block, &reader) {
                break;
            }
            reader.load(&block);
            reader.next_piece(MOST_PEEKED_ROWS);
        }
        reader
    }

    /// Channels whose messages look like bursts and that nothing reads, as far as the first 16
    /// blocks tell. `printheads`: the names of those that were met.
    pub fn unread(&self, dialects: &Dialects, printheads: &[&str]) -> Vec<UnreadChannel> {
        if self.channels_known_upfront && self.others.is_empty() {
            return Vec::new();
        }
        let topics = self.peek(|block, _| block.index >= PEEKED_AT_ONCE).topics();
        // the schemas that a dialect reads on other topics: there a topic's pattern may be mistyped
        let read = |summary: &&TopicSummary| matches!(summary.kind, MessageKind::Foreign(_));
        let read: BTreeSet<&str> =
            topics.iter().filter(read).map(|summary| &*summary.schema_name).collect();
        let unread = |summary: &TopicSummary| {
            let written = summary.written()?;
            let message = summary.first_message.as_ref();
            let undecodable =
                match look(&written, (message, summary.largest), printheads.iter().copied()) {
                    Look::Others => return None,
                    Look::Bursts => None,
                    Look::Undecodable(why) => Some(why),
                };
            let fits = dialects.fit_topic(&summary.topic) || read.contains(&*summary.schema_name);
            let of_it = self.others.iter().find(|other| other.topic == summary.topic);
            Some(UnreadChannel {
                topic: printable::line(&summary.topic, MOST_OF_A_NAME),
                schema: printable::line(&summary.schema_name, MOST_OF_A_NAME),
                encoding: summary.encoding(),
                messages: of_it.and_then(|other| other.messages),
                by_dialect: fits && message.is_some_and(|of| dialects.could_read(&written, of)),
                undecodable,
            })
        };
        // a channel that is defined and has no message in these blocks is not known
        let nothing = topics.iter().filter(|of| of.messages > 0);
        let nothing = nothing.filter(|of| matches!(of.kind, MessageKind::Nothing));
        nothing.filter_map(unread).collect()
    }

    /// The first message that is no usable burst: why, its printhead, and what is wrong with it. The recording is
    /// read up to there.
    pub fn first_unusable(&self) -> Option<UnusableBurst> {
        let mut reader = self.reader();
        let mut blocks = self.blocks().filter_map(Result::ok);
        blocks.find_map(|block| {
            reader.load(&block);
            let mut pieces = std::iter::from_fn(|| reader.next_piece(MOST_PEEKED_ROWS));
            pieces.find_map(|piece| piece.acquisitions.into_iter().find_map(unusable))
        })
    }
}

/// Whether the paths of a dialect lead to what they are to lead to, and its numbers are those of the message.
fn check_message(plan: &Plan, message: &Bytes) -> Result<(), String> {
    plan.check_message(message)?;
    dimensions::contradiction(plan, message).map_or(Ok(()), Err)
}

fn unusable(of: Acquisition) -> Option<UnusableBurst> {
    match of {
        Acquisition::Unusable(of) if !of.what.is_empty() => Some(of),
        _ => None,
    }
}
