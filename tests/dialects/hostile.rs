//! Schemas, messages and paths that nobody means well with: words and rows, no panic, nothing unbounded.

use super::encodings;
use crate::memory::{alone, most_of};
use crate::mutations::change;
use crate::recipes::some;
use inkling::burst::{Acquisition, Burst, UnusableBurst};
use inkling::io::Limits;
use inkling::io::dialect::Dialects;
use inkling::io::dialect::decoder::{DialectDecoder, Times};
use inkling::io::dialect::guess::guess;
use inkling::io::dialect::json::MOST_VALUES;
use inkling::io::dialect::plan::{ChannelDescription as OfChannel, Plan, Schema};
use inkling::io::dialect::settings::Dialect;
use inkling::verdict::Reason;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

fn dialect(text: &str) -> Arc<Dialect> {
    let settings: toml::Table = text.parse().unwrap();
    let mut dialects: Vec<Dialect> = settings["input"]["dialect"].clone().try_into().unwrap();
    assert!(Dialects::new(&dialects).is_ok());
    Arc::new(dialects.remove(0))
}

/// The dialect, the schema, and a message of a burst.
struct Kind {
    dialect: Arc<Dialect>,
    schema: Option<Schema>,
    encoding: &'static str,
    message: Vec<u8>,
}

fn kinds() -> Vec<Kind> {
    let burst = Burst { idle_time_s: vec![0.5; 2], ..some(0, 1).remove(0) };
    encodings()
        .into_iter()
        .map(|(_, written, text)| Kind {
            dialect: dialect(&text),
            schema: (!written.schema_name.is_empty()).then(|| Schema {
                name: written.schema_name.into(),
                encoding: written.schema_encoding.into(),
                data: written.schema.clone(),
            }),
            encoding: written.message_encoding,
            message: (written.encode)(&burst),
        })
        .collect()
}

impl Kind {
    fn of_channel(&self) -> OfChannel<'_> {
        let (topic, message_encoding) = ("/heads/K/burst", self.encoding);
        OfChannel { topic, message_encoding, schema: self.schema.as_ref() }
    }
}

fn plan(kind: &Kind) -> Result<Plan, String> {
    Plan::new(&kind.dialect, &kind.of_channel())
}

fn decode(plan: &Plan, message: &[u8]) -> Acquisition {
    let times = Times { log_ns: 1, publish_ns: 2 };
    let bytes = bytes::Bytes::copy_from_slice(message);
    DialectDecoder::new(Limits::default()).decode(plan, bytes, times, &Arc::from("topic"))
}

#[test]
fn changed_messages_of_others_are_bursts_or_rows() {
    let (mut usable, mut rows) = (0, 0);
    for (n, kind) in kinds().iter().enumerate() {
        let plan = plan(kind).unwrap();
        assert!(matches!(decode(&plan, &kind.message), Acquisition::Usable(_)), "kind {n}");
        for i in 0..1000 {
            let mut random = ChaCha8Rng::seed_from_u64(n as u64 * 10_000 + i);
            let mut message = kind.message.clone();
            change(&mut message, &mut random);
            match decode(&plan, &message) {
                Acquisition::Usable(burst) => {
                    usable += 1;
                    let mut signal = vec![0.0; burst.samples_per_channel as usize];
                    burst.copy_signal(burst.channels as usize - 1, &mut signal);
                }
                Acquisition::Unusable(_) => rows += 1,
            }
        }
    }
    assert!(usable > 500 && rows > 500, "{usable} usable, {rows} rows: not both are reached");
}

#[test]
fn changed_schemas_of_others_are_read_or_refused() {
    let (mut read, mut refused) = (0, 0);
    for (n, kind) in kinds().into_iter().enumerate() {
        let Some(schema) = &kind.schema else { continue };
        for i in 0..600 {
            let mut random = ChaCha8Rng::seed_from_u64(n as u64 * 10_000 + i);
            let mut changed = schema.clone();
            change(&mut changed.data, &mut random);
            let message = kind.message.clone();
            let kind =
                Kind { dialect: kind.dialect.clone(), schema: Some(changed), message, ..kind };
            let bytes = bytes::Bytes::copy_from_slice(&kind.message);
            drop(guess(&kind.of_channel(), &[&bytes], &["/heads/K/burst"]));
            match plan(&kind) {
                Ok(plan) => {
                    read += 1;
                    drop(decode(&plan, &kind.message));
                }
                Err(_) => refused += 1,
            }
        }
    }
    // most changes leave no schema in which every path leads somewhere
    assert!(read > 200 && refused > 200, "{read} read, {refused} refused: not both are reached");
}

fn unusable(plan: &Plan, message: &[u8]) -> UnusableBurst {
    match decode(plan, message) {
        Acquisition::Unusable(unusable) => unusable,
        other => panic!("usable: {other:?}"),
    }
}

/// No value of such a message is known, and none is part of a name.
#[test]
fn a_message_that_cannot_be_decoded_is_of_its_topics_printhead() {
    let (_, _, text) = encodings().into_iter().nth(1).unwrap();
    let dialect = dialect(&text.replace("\"{header.id}\"", "\"K-{header.id}\""));
    let of = unusable(&plan(&Kind { dialect, ..kinds().remove(1) }).unwrap(), &[0xff; 40]);
    assert_eq!((&*of.printhead, of.why), ("topic", Reason::Undecodable));
}

#[test]
fn sizes_that_a_message_claims_are_not_believed() {
    let kinds = kinds();
    let json = plan(&kinds[3]).unwrap();
    let text = |samples: &str, channels: &str| {
        format!(
            "{{\"header\":{{\"stamp\":{{\"sec\":1,\"nanosec\":0}}}},\"heads\":[0,{{\"first\":0}}],\
             \"samples\":{samples},\"channels\":{channels},\"period\":1e-6}}"
        )
    };
    let of =
        |samples: &str, channels: &str| unusable(&json, text(samples, channels).as_bytes()).why;
    assert_eq!(of("[1,2,3]", "2"), Reason::WrongLength);
    assert_eq!(of("[1,2]", "0"), Reason::NoChannels);
    assert_eq!(of("[1,2]", "4294967296"), Reason::TooLarge);
    assert_eq!(of("[1,2]", "-1"), Reason::Undecodable);
    assert_eq!(of("[1,2]", "1.5"), Reason::Undecodable);
    assert_eq!(of("[[1,2],[3]]", "2"), Reason::Undecodable);
    assert_eq!(of("[[[1]]]", "1"), Reason::Undecodable);
    assert_eq!(of("\"not base64\"", "1"), Reason::Undecodable);
    let deep = "[".repeat(100_000) + &"]".repeat(100_000);
    assert_eq!(of(&deep, "1"), Reason::Undecodable);
    // arrays of four thousand million elements in a message of some bytes
    for kind in &kinds[4..] {
        let plan = plan(kind).unwrap();
        for at in 0..kind.message.len().min(200) {
            let mut message = kind.message.clone();
            message[at..at + 4].copy_from_slice(&[0xff; 4]);
            drop(decode(&plan, &message));
        }
    }
}

/// `serde_json` keeps a number of two bytes as a value of 32.
#[test]
fn what_a_message_holds_when_it_is_decoded_is_bounded_and_one_of_more_values_is_told() {
    alone(|| {
        let kinds = kinds();
        let protobuf = plan(&kinds[1]).unwrap();
        let json = plan(&kinds[3]).unwrap();
        let field = |number: u8, inside: &[u8]| {
            let mut out = vec![number << 3 | 2];
            prost::encoding::encode_varint(inside.len() as u64, &mut out);
            [out, inside.to_vec()].concat()
        };
        let listed = |one: &str, n: usize| format!("{{\"a\":[{}0]}}", format!("{one},").repeat(n));
        let most = MOST_VALUES;
        let cases: [(&str, &Plan, Vec<u8>, Reason); 7] = [
            ("numbers", &json, listed("0", most - 100).into(), Reason::Undecodable),
            ("more numbers", &json, listed("0", most).into(), Reason::TooLarge),
            ("rows", &json, listed("[1]", most / 6).into(), Reason::Undecodable),
            ("objects", &json, listed("{\"\":0}", most / 20).into(), Reason::Undecodable),
            ("more objects", &json, listed("{}", most / 15).into(), Reason::TooLarge),
            ("packed", &protobuf, field(3, &field(3, &vec![0; 32 << 20])), Reason::Undecodable),
            ("messages", &protobuf, field(3, &[8, 1]).repeat(1 << 20), Reason::Undecodable),
        ];
        for (name, plan, message, why) in cases {
            let (unusable, held) = most_of(|| unusable(plan, &message));
            println!("{name}: {} kB hold {} kB", message.len() >> 10, held >> 10);
            assert_eq!(unusable.why, why, "{name}");
            assert!(held < 220 << 20, "{name}: {held}");
        }
    });
}

#[test]
fn a_text_of_samples_is_one_value_whatever_its_length() {
    let kind = kinds().remove(3);
    let text = encodings()[3].2.replace("\"samples\"\n", "\"samples\"\nformat = \"s16le\"\n");
    let plan = Plan::new(&dialect(&text), &kind.of_channel()).unwrap();
    let mut message: serde_json::Value = serde_json::from_slice(&kind.message).unwrap();
    let channels = message["channels"].as_u64().unwrap() as usize;
    message["samples"] = "AAAA".repeat(2 * channels * 65_536 / 3).into(); // zeros
    let decoded = decode(&plan, message.to_string().as_bytes());
    let Acquisition::Usable(burst) = decoded else { panic!("not read: {decoded:?}") };
    assert_eq!(burst.samples_per_channel, 65_536);
}
