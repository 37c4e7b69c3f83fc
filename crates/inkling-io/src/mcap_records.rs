//! Parses those MCAP records that are read. Chunks, schemas, channels and the chunk index are parsed
//! by hand, the rest by the mcap crate. The crate wants the whole body of a chunk, where here its
//! first bytes must do; and of what a channel says about itself, which nothing here asks for, it
//! makes a map of texts, in which a record of 256 MiB would take some 2 GB (mcap 0.26).
//!
//! In, from `scan.rs`, `mcap_summary.rs`, `block_reader.rs` and others: a record's body, which is the
//! bytes behind the record header. Out: its fields; `None` if the bytes are too few, or a text is
//! not UTF-8. No file is read here.

pub use mcap::MAGIC;
pub use mcap::records::{Footer, MessageHeader, Statistics, op};

use bytes::Buf;
use mcap::parse_record;
use mcap::records::Record;

/// Bytes before a record's body: opcode and length of the body.
pub const RECORD_HEADER: usize = 9;
/// Bytes of the footer record: opcode, length, three fields.
pub const FOOTER_BYTES: u64 = 9 + 20;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordHeader {
    pub opcode: u8,
    pub body_bytes: u64,
}

impl RecordHeader {
    pub fn parse(mut bytes: &[u8]) -> Option<RecordHeader> {
        let opcode = bytes.try_get_u8().ok()?;
        Some(RecordHeader { opcode, body_bytes: bytes.try_get_u64_le().ok()? })
    }
}

/// Times are log times, ns since 1970.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChunkHeader<'a> {
    pub start_time: u64,
    pub end_time: u64,
    pub uncompressed_size: u64,
    /// CRC-32 of the uncompressed records; 0: no checksum.
    pub uncompressed_crc: u32,
    pub compression: &'a str,
    pub compressed_size: u64,
    /// Bytes of these fields together; the records begin behind them.
    pub header_bytes: u64,
}

impl ChunkHeader<'_> {
    pub fn parse(body: &[u8]) -> Option<ChunkHeader<'_>> {
        let mut rest = body;
        Some(ChunkHeader {
            start_time: rest.try_get_u64_le().ok()?,
            end_time: rest.try_get_u64_le().ok()?,
            uncompressed_size: rest.try_get_u64_le().ok()?,
            uncompressed_crc: rest.try_get_u32_le().ok()?,
            compression: text(&mut rest)?,
            compressed_size: rest.try_get_u64_le().ok()?,
            header_bytes: (body.len() - rest.len()) as u64,
        })
    }

    /// The header, if `body` may be the beginning of a chunk's body of `body_bytes`: its compression is known, its
    /// sizes and times agree, and it claims no more than `most_bytes` uncompressed.
    pub fn plausible(body: &[u8], body_bytes: u64, most_bytes: u64) -> Option<ChunkHeader<'_>> {
        let body = &body[..body.len().min(usize::try_from(body_bytes).unwrap_or(usize::MAX))];
        let h = ChunkHeader::parse(body)?;
        let sizes_agree = h.compressed_size <= body_bytes.checked_sub(h.header_bytes)?
            && (!h.compression.is_empty() || h.uncompressed_size == h.compressed_size);
        (["", "lz4", "zstd"].contains(&h.compression)
            && sizes_agree
            && h.uncompressed_size <= most_bytes
            && h.start_time <= h.end_time)
            .then_some(h)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SchemaRecord<'a> {
    pub id: u16,
    pub name: &'a str,
    pub encoding: &'a str,
    pub data: &'a [u8],
}

impl SchemaRecord<'_> {
    pub fn parse(mut body: &[u8]) -> Option<SchemaRecord<'_>> {
        let body = &mut body;
        Some(SchemaRecord {
            id: body.try_get_u16_le().ok()?,
            name: text(body)?,
            encoding: text(body)?,
            data: counted(body)?,
        })
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChannelRecord<'a> {
    pub id: u16,
    pub schema_id: u16,
    pub topic: &'a str,
    pub message_encoding: &'a str,
}

impl ChannelRecord<'_> {
    pub fn parse(mut body: &[u8]) -> Option<ChannelRecord<'_>> {
        let body = &mut body;
        let channel = ChannelRecord {
            id: body.try_get_u16_le().ok()?,
            schema_id: body.try_get_u16_le().ok()?,
            topic: text(body)?,
            message_encoding: text(body)?,
        };
        counted(body).map(|_metadata| channel)
    }
}

/// Takes bytes with their length (32 bits) before them off the front.
fn counted<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let length = rest.try_get_u32_le().ok()?;
    rest.split_off(..length as usize)
}

/// Takes a text with its length before it off the front. `None`: it is not UTF-8, or not whole.
fn text<'a>(rest: &mut &'a [u8]) -> Option<&'a str> {
    std::str::from_utf8(counted(rest)?).ok()
}

/// Bytes of a message before its data: channel, sequence, log time, publish time.
pub const MESSAGE_HEADER: usize = 2 + 4 + 8 + 8;

pub fn message_header(body: &[u8]) -> Option<MessageHeader> {
    let Ok(Record::Message { header: of, .. }) = parse_record(op::MESSAGE, body) else {
        return None;
    };
    Some(of)
}

pub fn statistics(body: &[u8]) -> Option<Statistics> {
    let Ok(Record::Statistics(of)) = parse_record(op::STATISTICS, body) else { return None };
    Some(of)
}

pub fn footer(body: &[u8]) -> Option<Footer> {
    let Ok(Record::Footer(of)) = parse_record(op::FOOTER, body) else { return None };
    Some(of)
}

/// Where a chunk lies in time and in the file, as the chunk index says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChunkSpan {
    /// The first and the last log time of the chunk's messages (`to_ns` is inclusive), ns since
    /// 1970. Both are 0 for a chunk without messages, which `mcap_summary.rs` relies on.
    pub from_ns: u64,
    pub to_ns: u64,
    pub offset: u64,
}

impl ChunkSpan {
    pub fn parse(mut body: &[u8]) -> Option<ChunkSpan> {
        let mut next = || body.try_get_u64_le().ok();
        Some(ChunkSpan { from_ns: next()?, to_ns: next()?, offset: next()? })
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordAt {
    pub opcode: u8,
    /// The body's first byte, and the first byte behind the body (`to` is exclusive).
    pub from: usize,
    pub to: usize,
}

/// The record that begins at `at` in a buffer of records; `None` if it does not end in the buffer.
pub fn record_at(buffer: &[u8], at: usize) -> Option<RecordAt> {
    let header = RecordHeader::parse(buffer.get(at..)?)?;
    let from = at + RECORD_HEADER;
    let to = from.checked_add(usize::try_from(header.body_bytes).ok()?)?;
    (to <= buffer.len()).then_some(RecordAt { opcode: header.opcode, from, to })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Independent route: the mcap crate's own parser, over a file that it wrote.
    #[test]
    fn records_read_the_same_as_by_the_mcap_crate_and_any_cut_of_them_is_none() {
        let mut seen = Vec::new();
        // messages stand in a chunk, or outside of chunks
        for is_chunked in [true, false] {
            let options = mcap::WriteOptions::new().use_chunks(is_chunked);
            let mut file = std::io::Cursor::new(Vec::new());
            let mut writer = options.create(&mut file).unwrap();
            let schema = writer.add_schema("inkling.Burst", "protobuf", b"data").unwrap();
            let metadata = [("k".to_string(), "v".to_string())].into();
            let channel = writer.add_channel(schema, "/t", "protobuf", &metadata).unwrap();
            let header =
                MessageHeader { channel_id: channel, sequence: 1, log_time: 5, publish_time: 6 };
            writer.write_to_known_channel(&header, b"abc").unwrap();
            writer.finish().unwrap();
            drop(writer);
            let bytes = file.into_inner();

            let mut at = MAGIC.len();
            while let Some(record) = record_at(&bytes[..bytes.len() - MAGIC.len()], at) {
                let body = &bytes[record.from..record.to];
                // what reads the record, and the bytes that it needs
                type Reads = fn(&[u8]) -> bool;
                let (reads, needed): (Reads, usize) =
                    match mcap::parse_record(record.opcode, body).unwrap() {
                        Record::Schema { header, data } => {
                            let ours = SchemaRecord::parse(body).unwrap();
                            assert_eq!((ours.id, ours.name), (header.id, &*header.name));
                            assert_eq!((ours.encoding, ours.data), (&*header.encoding, &*data));
                            (|cut| SchemaRecord::parse(cut).is_some(), body.len())
                        }
                        Record::Channel(c) => {
                            let ours = ChannelRecord::parse(body).unwrap();
                            assert_eq!((ours.id, ours.schema_id), (c.id, c.schema_id));
                            assert_eq!(ours.topic, c.topic);
                            assert_eq!(ours.message_encoding, c.message_encoding);
                            (|cut| ChannelRecord::parse(cut).is_some(), body.len())
                        }
                        Record::Chunk { header, data } => {
                            let ours = ChunkHeader::parse(body).unwrap();
                            assert_eq!(ours.uncompressed_size, header.uncompressed_size);
                            assert_eq!(ours.uncompressed_crc, header.uncompressed_crc);
                            assert_eq!(ours.compression, header.compression);
                            assert_eq!(ours.compressed_size, data.len() as u64);
                            assert_eq!(ours.header_bytes + ours.compressed_size, body.len() as u64);
                            assert_eq!((ours.start_time, ours.end_time), (5, 5));
                            (|cut| ChunkHeader::parse(cut).is_some(), ours.header_bytes as usize)
                        }
                        Record::ChunkIndex(c) => {
                            let ours = ChunkSpan::parse(body).unwrap();
                            assert_eq!(ours.offset, c.chunk_start_offset);
                            let times = (c.message_start_time, c.message_end_time);
                            assert_eq!((ours.from_ns, ours.to_ns), times);
                            (|cut| ChunkSpan::parse(cut).is_some(), 24)
                        }
                        _ => (|_| true, 0),
                    };
                assert!(reads(&body[..needed]) && !(0..needed).any(|cut| reads(&body[..cut])));
                seen.push(record.opcode);
                at = record.to;
            }
        }
        for opcode in [op::SCHEMA, op::CHANNEL, op::CHUNK, op::CHUNK_INDEX] {
            assert!(seen.contains(&opcode));
        }
    }

    #[test]
    fn a_record_that_claims_more_than_there_is_is_not_whole() {
        let mut bytes = vec![op::MESSAGE];
        bytes.extend(u64::MAX.to_le_bytes());
        assert_eq!(record_at(&bytes, 0), None);
        assert_eq!(record_at(&bytes, usize::MAX), None);
    }
}
