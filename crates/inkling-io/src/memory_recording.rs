//! Makes a recording of bursts in memory, so that arrays are judged, learned from and criticised
//! like files. The Python package uses it.
//!
//! In: bursts whose samples the caller holds. Out: a [`Recording`] that reads like the MCAP file
//! that would hold these bursts, with messages outside chunks. That file exists only as `Pieces`:
//! small buffers with everything but samples, and between them the bursts' own samples. So samples
//! are copied only block by block as they are read. What a summary would say is said to the
//! [`Recording`] directly.

use super::Limits;
use super::burst_codec::{MESSAGE_ENCODING, SCHEMA_NAME, encode, topic};
use super::channels::Channels;
use super::damage::RecordingError;
use super::dialect::Dialects;
use super::file_error::FileError;
use super::mcap_records::{ChannelRecord, MAGIC, MESSAGE_HEADER, SchemaRecord, op};
use super::recording::Recording;
use super::source::{Pieces, Source};
use bytes::Bytes;
use inkling_core::burst::Burst;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

const SCHEMA_ID: u16 = 1;
/// Key of the protobuf field `samples` (number 9, length-delimited). The field comes last in these
/// messages, so that its bytes can be the burst's own.
const SAMPLES_KEY: u8 = 9 << 3 | 2;

/// A recording of these bursts. `label` stands where a file's path would. The ids of MCAP's
/// channels have 16 bits and 0 is left out, so bursts of more than 65,535 printheads are refused.
pub fn of_bursts(label: &str, bursts: &[Burst]) -> Result<Recording, RecordingError> {
    let printheads: BTreeSet<&str> = bursts.iter().map(|burst| &*burst.printhead).collect();
    let most = u16::MAX;
    if printheads.len() > most.into() {
        let what = format!("a recording holds {most} printheads at most; give fewer at once");
        return Err(FileError::failed(Path::new(label), what).into());
    }

    // one schema, and a channel for each printhead
    let ids: BTreeMap<&str, u16> = printheads.into_iter().zip(1..=most).collect();
    let mut channels = Channels::default();
    let (name, encoding) = (SCHEMA_NAME, MESSAGE_ENCODING);
    let schema = SchemaRecord { id: SCHEMA_ID, name, encoding, data: &[] };
    channels.define_schema(schema).expect("the only one");
    for (printhead, &id) in &ids {
        let (topic, message_encoding) = (&*topic(printhead), encoding);
        let channel = ChannelRecord { id, schema_id: SCHEMA_ID, topic, message_encoding };
        channels.define_channel(channel).expect("its id is its own");
    }

    // everything of a message up to the samples, then the samples themselves, not copied
    let mut pieces = Pieces::default();
    let mut small = Vec::from(MAGIC);
    begin(&mut small, op::HEADER, 0);
    for burst in bursts {
        push_message(&mut small, ids[&*burst.printhead], burst);
        pieces.push(std::mem::take(&mut small).into());
        pieces.push(burst.samples.clone());
    }
    let source = Arc::new(Source::in_memory(pieces));
    let (path, none) = (Path::new(label), Dialects::default());
    Ok(Recording {
        name: label.into(),
        label: label.into(),
        expected: Some(bursts.len() as u64),
        channels: Arc::new(channels),
        // so that several readers can take the blocks side by side
        channels_known_upfront: true,
        ..Recording::of_source(path, source, Limits::default(), &none)?.unindexed(&none)
    })
}

/// Appends what stands before a record's body: opcode and length.
fn begin(out: &mut Vec<u8>, opcode: u8, body_bytes: u64) {
    out.push(opcode);
    out.extend(body_bytes.to_le_bytes());
}

/// Appends the message record of a burst up to its samples; the caller puts the samples behind it.
fn push_message(out: &mut Vec<u8>, channel: u16, burst: &Burst) {
    let mut message = encode(&Burst { samples: Bytes::new(), ..burst.clone() });
    message.push(SAMPLES_KEY);
    prost::encode_length_delimiter(burst.samples.len(), &mut message).expect("a Vec has room");
    let bytes = MESSAGE_HEADER + message.len() + burst.samples.len();
    begin(out, op::MESSAGE, bytes as u64);
    let log_time = u64::try_from(burst.t_acq_ns).unwrap_or_default().to_le_bytes();
    out.extend(channel.to_le_bytes());
    out.extend([0; 4]); // sequence
    out.extend(log_time);
    out.extend(log_time);
    out.extend(message);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::assert_refused;
    use inkling_core::burst::{Acquisition, Format, Layout};

    #[test]
    fn bursts_come_back_as_they_were_and_nothing_is_damaged() {
        let burst = |printhead: &str, t_acq_ns: i64, channels: usize| {
            let signals = vec![vec![t_acq_ns as f32, 2.0, -3.0]; channels];
            let of = Burst::of(&signals, 1e-6, Format::S16Le, Layout::ChannelMajor);
            let topic = 1 + u16::from(printhead == "b");
            let (printhead, logged_ns) = (printhead.into(), t_acq_ns);
            Burst { printhead, topic, t_acq_ns, logged_ns, temperature_c: Some(31.0), ..of }
        };
        let bursts = [burst("a", 5, 2), burst("b", 6, 1), burst("a", 7, 3)];
        let recording = of_bursts("x", &bursts).unwrap();
        assert!(recording.channels_known_upfront && recording.damage.is_empty());
        let mut reader = recording.reader();
        let mut found = Vec::new();
        for block in recording.blocks() {
            let piece = reader.read(&block.unwrap());
            assert_eq!(piece.damage, []);
            found.extend(piece.acquisitions);
        }
        assert_eq!(recording.missing(found.len() as u64), None);
        assert_eq!(found.len(), bursts.len());
        for (found, burst) in found.iter().zip(bursts) {
            assert_eq!(format!("{found:?}"), format!("{:?}", Acquisition::Usable(burst)));
        }
        recording.digest().unwrap();
    }

    #[test]
    fn as_many_printheads_as_there_are_ids_are_told_apart_and_more_are_refused() {
        let of = Burst::of(&[vec![1.0, 2.0]], 1e-6, Format::S16Le, Layout::ChannelMajor);
        let most = usize::from(u16::MAX);
        let mut bursts: Vec<Burst> =
            (0..most).map(|i| Burst { printhead: i.to_string().into(), ..of.clone() }).collect();
        bursts.push(bursts[0].clone());
        let recording = of_bursts("x", &bursts).unwrap();
        assert!(recording.channels_known_upfront && recording.damage.is_empty());
        assert_eq!(recording.expected, Some(bursts.len() as u64));
        bursts.push(Burst { printhead: "one more".into(), ..of });
        assert_refused(of_bursts("x", &bursts), &["65535 printheads"]);
    }
}
