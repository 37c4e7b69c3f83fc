//! Says of messages that nothing reads whether they look like bursts, and why nothing reads them, so that
//! nobody takes silence for health.
//!
//! In: how a recording describes a channel, its first message, and the printheads that are known. Out: a
//! [`Look`]. A channel looks like bursts by what its messages hold, where they can be decoded; else by a word
//! in the name of its topic or schema, or because a part of its topic is the name of a printhead.

use super::first_message::{FirstMessage, MOST_MESSAGE_BYTES};
use super::guess::is_of_others;
use super::names::has_word;
use super::plan::{ChannelDescription, Reading};
use crate::printable;
use crate::unread_file::compressed_by;
use bytes::Bytes;
use inkling_core::verdict::Reason;

/// What messages look like that nothing reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Look {
    Others,
    /// Bursts that a dialect could read.
    Bursts,
    /// They are called like bursts, and nothing can read them: why.
    Undecodable(String),
}

/// Words in the names of topics and schemas of bursts.
const BURSTS: &str = "burst bursts ring rings ringdown ringdowns wave waves waveform waveforms piezo \
     piezos nozzle nozzles printhead printheads decay decays sample samples acquisition acquisitions";
/// The smallest message that counts for its printhead's name alone. What is shorter is a state or a
/// temperature rather than a burst.
const LEAST_BYTES: u64 = 128;

/// `message`: the first one, if it was kept; `largest`: bytes of the largest one.
pub fn look<'p>(
    written: &ChannelDescription,
    (message, largest): (Option<&Bytes>, u64),
    printheads: impl IntoIterator<Item = &'p str>,
) -> Look {
    let schema = written.schema.map_or("", |schema| &schema.name);
    if is_of_others(schema) {
        return Look::Others;
    }
    let is_named = has_word(written.topic, BURSTS)
        || has_word(&in_words(schema), BURSTS)
        || largest >= LEAST_BYTES
            && printheads.into_iter().any(|name| is_part(name, written.topic));
    let undecodable = |why: String| match is_named {
        true => Look::Undecodable(why),
        false => Look::Others,
    };
    let reading = match Reading::of(written) {
        Ok(reading) => reading,
        Err(why) => {
            let advice = "convert them (`rosbags-convert` makes ROS 2 of ROS 1)";
            return undecodable(format!("{why}; {advice}"));
        }
    };
    let Some(message) = message.filter(|message| message.len() <= MOST_MESSAGE_BYTES) else {
        return undecodable(format!(
            "a message has {largest} bytes, more than are looked into here"
        ));
    };
    match (FirstMessage::of(&reading, message), compressed_by(message)) {
        (Ok(first), _) => match first.likely_samples() {
            None => Look::Others,
            Some((of, _)) if first.is_one_of_several(of) => Look::Undecodable(format!(
                "each channel is a message of its own, or a field ({}), of which a path reads one alone: \
                 record an array of rows",
                printable::line(&of.path, 200)
            )),
            Some(_) => Look::Bursts,
        },
        // whoever compresses messages one by one has large ones
        (Err(_), Some(name)) => Look::Undecodable(format!(
            "each message is compressed by itself ({name}): record them as they are"
        )),
        (Err(Reason::TooLarge), None) => undecodable("a message has too many values".into()),
        (Err(_), None) => undecodable("their first message is not what its schema says".into()),
    }
}

/// `RingDown` as `Ring Down`.
fn in_words(name: &str) -> String {
    let split = |c: char| [c.is_ascii_uppercase().then_some(' '), Some(c)].into_iter().flatten();
    name.chars().flat_map(split).collect()
}

/// Whether a printhead's name is a part of a topic. A mere number may be anything's.
fn is_part(name: &str, topic: &str) -> bool {
    let is_name = name.len() > 1 && !name.bytes().all(|byte| byte.is_ascii_digit());
    is_name && topic.split('/').any(|part| part.eq_ignore_ascii_case(name))
}

#[cfg(test)]
mod tests {
    use super::super::plan::Schema;
    use super::*;

    #[test]
    fn what_looks_like_bursts_and_is_not_read_is_told_with_why() {
        let json = |n: usize| Bytes::from(format!("{{\"y\":{:?}}}", vec![7; n]));
        let objects = |n: usize| {
            let one = format!("{{\"adc\":{:?}}}", vec![7; 40]);
            Bytes::from(format!("{{\"y\":[{}]}}", vec![one; n].join(",")))
        };
        let zstd = || Bytes::from([&[0x28, 0xb5, 0x2f, 0xfd][..], &[7; 300]].concat());
        let plain = || Bytes::from(vec![b'x'; 300]);
        for (topic, encoding, schema, message, says) in [
            ("/a/b", "json", "", json(40), "bursts"),
            ("/a/b", "json", "", json(4), "others"),
            ("/a/b", "json", "", objects(2), "or a field (y[0].adc)"),
            ("/a/b", "json", "", objects(1), "bursts"),
            ("/line/black-2/adc", "cdr", "ros2idl acme/X", plain(), "not by \"ros2idl\""),
            ("/line/other/adc", "cdr", "ros2idl acme/X", plain(), "others"),
            (
                "/line/black-2/adc",
                "flatbuffer",
                "flatbuffer X",
                plain(),
                "\"flatbuffer\" are not read",
            ),
            ("/line/black-2/state", "cbor", "", Bytes::from_static(b"abc"), "others"),
            (
                "/a/b",
                "cbor",
                "x acme.RingDown",
                Bytes::from_static(b"abc"),
                "\"cbor\" are not read",
            ),
            ("/a/b", "cbor", "x acme.RingImage", plain(), "others"),
            ("/a/b", "json", "", zstd(), "compressed by itself (zstd)"),
            ("/a/ring", "json", "", plain(), "not what its schema says"),
            (
                "/a/ring",
                "json",
                "",
                Bytes::from(vec![b' '; MOST_MESSAGE_BYTES + 1]),
                "more than are looked",
            ),
        ] {
            let (of, name) = schema.split_once(' ').unwrap_or_default();
            let of = Schema { name: name.into(), encoding: of.into(), data: Vec::new() };
            let schema = Some(&of).filter(|_| !schema.is_empty());
            let written = ChannelDescription { topic, message_encoding: encoding, schema };
            let largest = message.len() as u64;
            let told = match look(&written, (Some(&message), largest), ["black-2", "7"]) {
                Look::Others => "others".into(),
                Look::Bursts => "bursts".into(),
                Look::Undecodable(why) => why,
            };
            assert!(told.contains(says), "{topic} {encoding}: {told}");
        }
    }
}
