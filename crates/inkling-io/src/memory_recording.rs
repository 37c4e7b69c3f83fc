//! Makes a recording of bursts in memory, so that arrays are judged, learned from and criticised
//! like files. The Python package uses it.
//!
//! In: bursts whose samples the caller holds. Out: a [`Recording`] that reads like the MCAP file
//! that would hold these bursts, with messages outside chunks and a summary. That file exists only
//! as `Pieces`: small buffers with everything but samples, and between them the bursts' own
//! samples. So samples are copied only block by block as they are read.

use super::Limits;
use super::burst_codec::{FILE_DESCRIPTOR_SET, MESSAGE_ENCODING, SCHEMA_NAME, encode, topic};
use super::damage::RecordingError;
use super::dialect::Dialects;
use super::file_error::FileError;
use super::mcap_records::{MAGIC, MESSAGE_HEADER, op};
use super::pieces::Pieces;
use super::recording::Recording;
use super::source::Source;
use bytes::Bytes;
use inkling_core::burst::Burst;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::path::Path;
use std::sync::Arc;

const SCHEMA_ID: u16 = 1;
/// Key of the protobuf field `samples` (number 9, length-delimited). The field comes last in these
/// messages, so that its bytes can be the burst's own.
const SAMPLES_KEY: u8 = 9 << 3 | 2;

/// A recording of these bursts. `label` stands where a file's path would. The ids of MCAP's
/// channels have 16 bits and 0 is left out, so bursts of more than 65,535 printheads are refused.
pub fn of_bursts(label: &str, bursts: &[Burst]) -> Result<Recording, RecordingError> {
    let mut pieces = Pieces::default();
    let mut small = Vec::from(MAGIC);
    record(&mut small, op::HEADER, &[text(""), text("inkling")].concat());

    // one schema, and a channel for each printhead: its id and its number of bursts
    let mut channels: HashMap<&Arc<str>, (u16, u64)> = HashMap::new();
    let mut definitions = Vec::new();
    record(&mut definitions, op::SCHEMA, &schema());
    for burst in bursts {
        let number = channels.len() + 1;
        let of_printhead = match channels.entry(&burst.printhead) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => {
                let id = u16::try_from(number).map_err(|_| {
                    let most = u16::MAX;
                    let what =
                        format!("a recording holds {most} printheads at most; give fewer at once");
                    FileError::failed(Path::new(label), what)
                })?;
                record(&mut definitions, op::CHANNEL, &channel(id, &burst.printhead));
                new.insert((id, 0))
            }
        };
        of_printhead.1 += 1;
    }
    small.extend(&definitions);

    for burst in bursts {
        // everything up to the samples, then the samples themselves, not copied
        push_message(&mut small, channels[&burst.printhead].0, burst);
        pieces.push(std::mem::take(&mut small).into());
        pieces.push(burst.samples.clone());
    }
    // no checksum of the data section
    record(&mut small, op::DATA_END, &[0; 4]);

    // the summary names all channels, so that several readers can take the blocks side by side
    let summary_start = pieces.bytes() + small.len() as u64;
    small.extend(definitions);
    record(&mut small, op::STATISTICS, &statistics(bursts.len() as u64, channels.values()));
    // the footer: where the summary begins, no summary offsets, no checksum
    let footer = [summary_start.to_le_bytes().as_slice(), &[0; 8 + 4]].concat();
    record(&mut small, op::FOOTER, &footer);
    small.extend(MAGIC);
    pieces.push(small.into());
    let source = Arc::new(Source::in_memory(pieces));
    Recording::of_source(Path::new(label), source, Limits::default(), &Dialects::default())
}

fn record(out: &mut Vec<u8>, opcode: u8, body: &[u8]) {
    begin(out, opcode, body.len() as u64);
    out.extend(body);
}

/// Appends what stands before a record's body: opcode and length.
fn begin(out: &mut Vec<u8>, opcode: u8, body_bytes: u64) {
    out.push(opcode);
    out.extend(body_bytes.to_le_bytes());
}

/// A text as MCAP has it: its length (32 bits), then its bytes.
fn text(of: &str) -> Vec<u8> {
    [&(of.len() as u32).to_le_bytes(), of.as_bytes()].concat()
}

fn schema() -> Vec<u8> {
    let data_bytes = (FILE_DESCRIPTOR_SET.len() as u32).to_le_bytes();
    let (name, encoding) = (text(SCHEMA_NAME), text(MESSAGE_ENCODING));
    [&SCHEMA_ID.to_le_bytes(), &name[..], &encoding, &data_bytes, FILE_DESCRIPTOR_SET].concat()
}

fn channel(id: u16, printhead: &str) -> Vec<u8> {
    let (topic, encoding) = (text(&topic(printhead)), text(MESSAGE_ENCODING));
    let ids = [id.to_le_bytes(), SCHEMA_ID.to_le_bytes()].concat();
    let no_metadata = [0; 4];
    [&ids[..], &topic, &encoding, &no_metadata].concat()
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

/// The body of the statistics record. Only the counts matter to readers here; the rest is 0.
fn statistics<'a>(bursts: u64, channels: impl ExactSizeIterator<Item = &'a (u16, u64)>) -> Vec<u8> {
    let mut body = bursts.to_le_bytes().to_vec();
    body.extend(1u16.to_le_bytes()); // schemas
    body.extend((channels.len() as u32).to_le_bytes());
    body.extend([0; 4 + 4 + 4 + 8 + 8]); // attachments, metadata, chunks, first and last log time
    body.extend((10 * channels.len() as u32).to_le_bytes());
    for (id, messages) in channels {
        body.extend(id.to_le_bytes());
        body.extend(messages.to_le_bytes());
    }
    body
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
            Burst { printhead: printhead.into(), t_acq_ns, temperature_c: Some(31.0), ..of }
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
