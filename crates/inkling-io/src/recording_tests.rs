//! Tests of reading recordings: whole ones, cut ones, ones with flipped bits, and hostile ones. The
//! rule under test: nothing panics, and nothing is lost without damage that says so.

use super::Limits;
use super::block::{Block, BlockKind};
use super::damage::{Damage, RecordingError};
use super::dialect::Dialects;
use super::file_error::FileError;
use super::recording::Recording;
use super::recording_writer::{Compression, RecordingWriter, WriterOptions};
use inkling_core::burst::{Acquisition, Burst, Format, Layout};
use inkling_core::verdict::Reason;
use mcap::records::MessageHeader;
use std::fs;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::task::Poll;

const COMPRESSIONS: [Compression; 3] = [Compression::None, Compression::Lz4, Compression::Zstd];

/// The i-th burst of the tests' recordings: two printheads take turns, and no two bursts are alike.
fn burst(i: u32) -> Burst {
    Burst {
        t_acq_ns: 1_000 + i64::from(i),
        printhead: ["A", "B"][i as usize % 2].into(),
        first_channel: 10 * i,
        channels: 2,
        samples_per_channel: 5,
        sample_period_s: 1e-6,
        format: Format::S16Le,
        layout: Layout::ChannelMajor,
        samples: (0..20).map(|k| (k * k + i * 31) as u8).collect::<Vec<u8>>().into(),
        temperature_c: Some(f64::from(i)),
        drive_voltage_v: None,
        idle_time_s: vec![0.25],
        neighbours_fired: vec![0, 1].into(),
    }
}

/// Writes a recording of these bursts.
fn write(path: &Path, bursts: u32, options: WriterOptions) {
    let mut writer = RecordingWriter::create(path, options).unwrap();
    for i in 0..bursts {
        writer.write(&burst(i), u64::from(i)).unwrap();
    }
    writer.finish().unwrap();
}

/// Everything that a recording gives: the acquisitions of all blocks, and the damage of opening,
/// blocks, statistics and digest.
fn read(path: &Path) -> Result<(Vec<Acquisition>, Vec<Damage>), RecordingError> {
    read_with(path, Limits::default())
}

/// The same with other limits than the usual ones.
fn read_with(
    path: &Path,
    limits: Limits,
) -> Result<(Vec<Acquisition>, Vec<Damage>), RecordingError> {
    let recording = Recording::open(path, limits)?;
    let mut damage = recording.damage.clone();
    let mut reader = recording.reader();
    let mut acquisitions = Vec::new();
    for block in recording.blocks() {
        match block {
            Ok(block) => {
                let mut piece = reader.read(&block);
                acquisitions.append(&mut piece.acquisitions);
                damage.append(&mut piece.damage);
            }
            Err(found) => damage.push(found),
        }
    }
    damage.extend(recording.missing(acquisitions.len() as u64));
    damage.extend(recording.digest()?.damage);
    assert!(damage.iter().all(|d| d.from_byte <= d.to_byte && d.to_byte <= recording.bytes));
    Ok((acquisitions, damage))
}

/// An acquisition as text, because acquisitions themselves cannot be compared.
fn text(acquisition: &Acquisition) -> String {
    format!("{acquisition:?}")
}

/// The bursts that [`write`] writes, as text.
fn texts(bursts: std::ops::Range<u32>) -> Vec<String> {
    bursts.map(|i| text(&Acquisition::Usable(burst(i)))).collect()
}

/// All blocks of a recording.
fn blocks(path: &Path) -> Vec<Block> {
    let recording = Recording::open(path, Limits::default()).unwrap();
    recording.blocks().map(Result::unwrap).collect()
}

/// Writes a recording by the mcap crate's own writer with any of its options, one message for each
/// pair of log time and data, all on one channel.
fn write_mcap(
    path: &Path,
    options: mcap::WriteOptions,
    schema: &str,
    encoding: &str,
    messages: &[(u64, Vec<u8>)],
) {
    let mut writer = options.create(fs::File::create(path).unwrap()).unwrap();
    let schema = writer.add_schema(schema, "protobuf", &[]).unwrap();
    let none = Default::default();
    let channel_id = writer.add_channel(schema, "/printhead/T/bursts", encoding, &none).unwrap();
    for (log_time, data) in messages {
        let (log_time, publish_time) = (*log_time, *log_time);
        let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time };
        writer.write_to_known_channel(&header, data).unwrap();
    }
    writer.finish().unwrap();
}

/// The log times and encoded messages of the first `bursts` bursts.
fn encoded(bursts: u32) -> Vec<(u64, Vec<u8>)> {
    (0..bursts).map(|i| (u64::from(i), super::burst_codec::encode(&burst(i)))).collect()
}

/// A temporary directory, removed when it is dropped.
struct Dir(tempfile::TempDir);

impl Dir {
    fn new() -> Dir {
        Dir(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
}

/// A directory, and a path in it.
fn place(name: &str) -> (Dir, PathBuf) {
    let dir = Dir::new();
    let path = dir.path(name);
    (dir, path)
}

#[test]
fn bursts_survive_every_compression_and_chunking() {
    let (_dir, path) = place("r.mcap");
    for compression in COMPRESSIONS {
        for chunk_bytes in [None, Some(0), Some(1000), Some(1 << 20)] {
            write(&path, 40, WriterOptions { compression, chunk_bytes });
            let (found, damage) = read(&path).unwrap();
            assert_eq!(damage, []);
            assert_eq!(found.iter().map(text).collect::<Vec<_>>(), texts(0..40));
            let recording = Recording::open(&path, Limits::default()).unwrap();
            assert_eq!(recording.expected, Some(40));
            assert!(recording.channels_known_upfront);
            let kinds: Vec<BlockKind> = blocks(&path).iter().map(|b| b.kind).collect();
            let expected =
                if chunk_bytes.is_none() { BlockKind::Messages } else { BlockKind::Chunk };
            assert!(kinds.iter().all(|&kind| kind == expected));
        }
    }
}

#[test]
fn a_recording_without_summary_or_checksums_reads_the_same_but_cannot_say_what_it_expects() {
    let (_dir, path) = place("r.mcap");
    for use_chunks in [false, true] {
        let options = mcap::WriteOptions::new()
            .use_chunks(use_chunks)
            .chunk_size(Some(300))
            .emit_summary_records(false)
            .emit_summary_offsets(false)
            .emit_message_indexes(false)
            .calculate_chunk_crcs(false)
            .calculate_data_section_crc(false)
            .calculate_summary_section_crc(false);
        write_mcap(&path, options, "inkling.Burst", "protobuf", &encoded(10));
        let (found, damage) = read(&path).unwrap();
        assert_eq!(damage, []);
        assert_eq!(found.iter().map(text).collect::<Vec<_>>(), texts(0..10));
        let recording = Recording::open(&path, Limits::default()).unwrap();
        assert_eq!((recording.expected, recording.channels_known_upfront), (None, false));
    }
}

#[test]
fn blocks_may_be_read_in_any_order_by_any_reader_when_channels_are_known_upfront() {
    let (_dir, path) = place("r.mcap");
    write(&path, 40, WriterOptions { compression: Compression::Zstd, chunk_bytes: Some(300) });
    let recording = Recording::open(&path, Limits::default()).unwrap();
    let blocks = blocks(&path);
    assert!(blocks.len() > 5);
    assert!(blocks.iter().enumerate().all(|(i, b)| b.index == i as u64));
    let mut pieces: Vec<(u64, Vec<String>)> = Vec::new();
    for block in blocks.iter().rev() {
        let piece = recording.reader().read(block);
        assert!(piece.damage.is_empty() && piece.last);
        pieces.push((block.index, piece.acquisitions.iter().map(text).collect()));
    }
    pieces.sort();
    assert_eq!(pieces.into_iter().flat_map(|p| p.1).collect::<Vec<_>>(), texts(0..40));
}

#[test]
fn pieces_of_a_block_are_the_block() {
    let (_dir, path) = place("r.mcap");
    write(&path, 20, WriterOptions { compression: Compression::Lz4, chunk_bytes: Some(1 << 20) });
    let recording = Recording::open(&path, Limits::default()).unwrap();
    let mut reader = recording.reader();
    let mut found = Vec::new();
    reader.load(&blocks(&path)[0]);
    while let Some(piece) = reader.next_piece(6) {
        let rows: usize = piece.acquisitions.iter().map(Acquisition::rows).sum();
        assert!(rows == 6 || piece.last);
        found.extend(piece.acquisitions.iter().map(text));
    }
    assert_eq!(found, texts(0..20));
    assert!(reader.next_piece(6).is_none());
}

#[test]
fn the_same_bursts_give_the_same_bytes_and_digest() {
    let dir = Dir::new();
    let (a, b) = (dir.path("a.mcap"), dir.path("b.mcap"));
    for compression in COMPRESSIONS {
        let options = WriterOptions { compression, chunk_bytes: Some(500) };
        write(&a, 30, options);
        write(&b, 30, options);
        let bytes = fs::read(&a).unwrap();
        assert_eq!(bytes, fs::read(&b).unwrap());
        let digest = Recording::open(&a, Limits::default()).unwrap().digest().unwrap().text;
        assert_eq!(digest, format!("xxh3:{:032x}", xxhash_rust::xxh3::xxh3_128(&bytes)));
    }
}

#[test]
fn a_recording_has_its_name_only_when_finished() {
    let dir = Dir::new();
    let path = dir.path("below/r.mcap");
    let mut writer = RecordingWriter::create(&path, WriterOptions::default()).unwrap();
    writer.write(&burst(0), 0).unwrap();
    let names = || fs::read_dir(dir.path("below")).unwrap().map(|e| e.unwrap().file_name());
    let under_way = names().next().unwrap().to_string_lossy().into_owned();
    assert!(under_way.starts_with(".r.mcap.") && under_way.ends_with(".part"), "{under_way}");
    assert_eq!(names().count(), 1);
    drop(writer);
    assert_eq!(fs::read_dir(dir.path("below")).unwrap().count(), 0);
}

#[test]
fn what_is_no_recording_is_refused_with_its_name_and_what_it_is() {
    let (dir, path) = place("x.mcap");
    for (bytes, says) in [
        (&b""[..], "empty file (0 bytes)"),
        (b"\x89MC", "not an MCAP file (it begins with \"\\x89MC\")"),
        (b"time,y\n0,1\n", "not an MCAP file (it begins with \"time,y\\n0\")"),
        (b"\x89MCAP1\r\n", "MCAP of another version"),
    ] {
        fs::write(&path, bytes).unwrap();
        let error = Recording::open(&path, Limits::default()).unwrap_err().to_string();
        assert!(error.contains("x.mcap") && error.contains(says), "{error}");
    }
    let missing = Recording::open(&dir.path("none"), Limits::default());
    assert!(matches!(missing, Err(RecordingError::File(FileError::Read { .. }))));
    let directory = Recording::open(dir.0.path(), Limits::default()).unwrap_err().to_string();
    assert!(directory.contains("not a file (a directory"), "{directory}");
    assert!(!directory.contains("give an MCAP file, a directory"), "{directory}");
}

#[test]
fn other_channels_are_listed_behind_any_number_of_those_of_bursts() {
    let dir = Dir::new();
    let path = dir.path("many.mcap");
    let mut writer = mcap::Writer::new(fs::File::create(&path).unwrap()).unwrap();
    let none = Default::default();
    let bursts = writer.add_schema("inkling.Burst", "protobuf", &[]).unwrap();
    for i in 0..100 {
        let topic = format!("/printhead/{i}/bursts");
        writer.add_channel(bursts, &topic, "protobuf", &none).unwrap();
    }
    for topic in ["/camera", "/wave"] {
        writer.add_channel(0, topic, "json", &none).unwrap();
    }
    writer.finish().unwrap();
    let recording = Recording::open(&path, Limits::default()).unwrap();
    let others: Vec<&str> = recording.others.iter().map(|other| &*other.topic).collect();
    assert_eq!(others, ["/camera", "/wave"]);
}

#[test]
fn cut_anywhere_every_whole_chunk_is_kept_and_the_loss_is_told() {
    let dir = Dir::new();
    let (path, cut) = (dir.path("r.mcap"), dir.path("cut.mcap"));
    for compression in COMPRESSIONS {
        for chunk_bytes in [None, Some(1500)] {
            write(&path, 12, WriterOptions { compression, chunk_bytes });
            let bytes = fs::metadata(&path).unwrap().len();
            let mut whole: Vec<(u64, usize)> = Vec::new(); // chunk's end, bursts up to it
            let recording = Recording::open(&path, Limits::default()).unwrap();
            let (mut reader, mut n) = (recording.reader(), 0);
            for block in blocks(&path) {
                n += reader.read(&block).acquisitions.len();
                whole.push((block.offset + block.bytes, n));
            }
            fs::copy(&path, &cut).unwrap();
            let file = fs::File::options().write(true).open(&cut).unwrap();
            for length in (8..bytes).rev() {
                file.set_len(length).unwrap();
                let (found, damage) = read(&cut).unwrap();
                assert!(!damage.is_empty(), "cut at {length}");
                assert!(texts(0..12).starts_with(&found.iter().map(text).collect::<Vec<_>>()));
                let kept = whole.iter().rev().find(|w| w.0 <= length).map_or(0, |w| w.1);
                if chunk_bytes.is_some() {
                    assert_eq!(found.len(), kept, "cut at {length}");
                } else {
                    assert!(found.len() >= kept);
                }
            }
        }
    }
}

#[test]
fn a_flipped_bit_anywhere_is_told_and_never_changes_samples_of_a_chunk() {
    let dir = Dir::new();
    let (path, flipped) = (dir.path("r.mcap"), dir.path("flipped.mcap"));
    for compression in COMPRESSIONS {
        for chunk_bytes in [None, Some(1500)] {
            write(&path, 8, WriterOptions { compression, chunk_bytes });
            let bytes = fs::read(&path).unwrap();
            let all = texts(0..8);
            fs::write(&flipped, &bytes).unwrap();
            let mut file = fs::File::options().write(true).open(&flipped).unwrap();
            let mut put = |at: usize, byte: u8| {
                file.seek(SeekFrom::Start(at as u64)).unwrap();
                file.write_all(&[byte]).unwrap();
            };
            for bit in (0..bytes.len()).map(|byte| byte * 8 + byte * 5 % 8) {
                put(bit / 8, bytes[bit / 8] ^ (1 << (bit % 8)));
                let result = read(&flipped);
                put(bit / 8, bytes[bit / 8]);
                let Ok((found, damage)) = result else {
                    assert!(bit / 8 < 8, "only the magic makes it no recording");
                    continue;
                };
                assert!(!damage.is_empty(), "bit {bit} ({compression:?}, {chunk_bytes:?})");
                if chunk_bytes.is_some() {
                    // A message index that becomes a message is a row that cannot be decoded.
                    let usable = found.iter().filter(|f| matches!(f, Acquisition::Usable(_)));
                    let other = usable.map(text).find(|f| !all.contains(f));
                    assert_eq!(other, None, "bit {bit} {compression:?} {damage:?}");
                }
            }
        }
    }
}

#[test]
fn chunks_after_a_damaged_one_are_found_again() {
    let dir = Dir::new();
    let (path, broken) = (dir.path("r.mcap"), dir.path("broken.mcap"));
    for compression in COMPRESSIONS {
        write(&path, 30, WriterOptions { compression, chunk_bytes: Some(500) });
        let bytes = fs::read(&path).unwrap();
        let blocks = blocks(&path);
        let recording = Recording::open(&path, Limits::default()).unwrap();
        // Not a chunk that defines channels: without a summary that would cost the others too.
        let damaged = blocks[3];
        let lost = recording.reader().read(&damaged).acquisitions.len();
        let at = damaged.offset as usize;
        // Its opcode, each byte of its length, its header, its middle.
        for offset in [0, 1, 2, 3, 8, 9 + 28, 9 + 40, (damaged.bytes / 2) as usize] {
            for with_summary in [true, false] {
                let mut changed = bytes.clone();
                changed[at + offset] ^= 0xff;
                if !with_summary {
                    changed.truncate(bytes.len() - 1);
                }
                fs::write(&broken, &changed).unwrap();
                let (found, damage) = read(&broken).unwrap();
                assert!(!damage.is_empty());
                assert!(
                    found.len() >= 30 - lost,
                    "{} of 30 at {offset} {compression:?} {with_summary}: {damage:?}",
                    found.len()
                );
            }
        }
    }
}

#[test]
fn bursts_of_another_encoding_are_unusable_and_other_schemas_are_ignored() {
    let (_dir, path) = place("r.mcap");
    write_mcap(&path, mcap::WriteOptions::new(), "inkling.Burst", "json", &encoded(3));
    let (found, damage) = read(&path).unwrap();
    assert_eq!((found.len(), damage.len()), (3, 0));
    for (i, acquisition) in found.iter().enumerate() {
        let Acquisition::Unusable(u) = acquisition else { panic!("{acquisition:?}") };
        assert_eq!((u.why, u.t_acq_ns, &*u.printhead), (Reason::Undecodable, i as i64, "T"));
    }
    write_mcap(&path, mcap::WriteOptions::new(), "Image", "protobuf", &encoded(3));
    let (found, damage) = read(&path).unwrap();
    assert_eq!((found.len(), damage.len()), (0, 0));
}

#[test]
fn a_message_on_a_channel_that_is_not_defined_is_damage() {
    let (_dir, path) = place("r.mcap");
    write(&path, 4, WriterOptions { compression: Compression::None, chunk_bytes: None });
    let mut bytes = fs::read(&path).unwrap();
    let block = blocks(&path)[0];
    // The last message's channel id; the summary is cut off, so nothing else can tell.
    let message = super::burst_codec::encode(&burst(3));
    let body = (block.offset + block.bytes) as usize - message.len() - MESSAGE_HEADER_BYTES;
    bytes[body] = 99;
    bytes.truncate((block.offset + block.bytes) as usize);
    fs::write(&path, &bytes).unwrap();
    let (found, damage) = read(&path).unwrap();
    assert_eq!(found.len(), 3);
    assert!(damage.iter().any(|d| d.what.contains("channel 99")), "{damage:?}");
}

const MESSAGE_HEADER_BYTES: usize = super::mcap_records::MESSAGE_HEADER;

#[test]
fn a_schema_in_a_chunk_that_is_not_the_one_of_the_summary_is_damage() {
    let dir = Dir::new();
    let path = dir.path("schema.mcap");
    let options = mcap::WriteOptions::new().compression(None).calculate_chunk_crcs(false);
    write_mcap(&path, options, "inkling.Burst", "protobuf", &encoded(2));
    let mut bytes = fs::read(&path).unwrap();
    let name = b"inkling.Burst";
    let at = bytes.windows(name.len()).position(|part| part == name).unwrap();
    bytes[at] = b'I';
    fs::write(&path, &bytes).unwrap();
    let (acquisitions, damage) = read(&path).unwrap();
    assert_eq!(acquisitions.len(), 2, "the summary holds");
    assert!(damage.iter().any(|d| d.what.contains("schema 1 defined again")), "{damage:?}");
}

#[test]
fn a_message_beyond_the_limit_is_a_row_too_large_and_a_chunk_beyond_it_is_damage() {
    let (_dir, path) = place("r.mcap");
    let small = Limits { record_bytes: 1500, chunk_bytes: 1500, ..Limits::default() };
    let mut messages = encoded(3);
    messages[1].1 = vec![0; 2000];
    let options = || mcap::WriteOptions::new().compression(None);
    write_mcap(&path, options().use_chunks(false), "inkling.Burst", "protobuf", &messages);
    let (found, damage) = read_with(&path, small).unwrap();
    assert_eq!(damage, []);
    assert_eq!(found.len(), 3);
    assert!(matches!(&found[1], Acquisition::Unusable(u) if u.why == Reason::TooLarge));
    write_mcap(&path, options().chunk_size(Some(1)), "inkling.Burst", "protobuf", &messages);
    let (found, damage) = read_with(&path, small).unwrap();
    assert_eq!(found.len(), 2);
    assert!(damage.iter().any(|d| d.what.contains("2 burst messages found")), "{damage:?}");
}

#[test]
fn a_chunk_that_claims_to_be_huge_allocates_nothing_and_is_damage() {
    let (_dir, path) = place("r.mcap");
    write(&path, 4, WriterOptions { compression: Compression::Zstd, chunk_bytes: Some(1 << 20) });
    let mut bytes = fs::read(&path).unwrap();
    let size_at = blocks(&path)[0].offset as usize + 9 + 16;
    bytes[size_at..size_at + 8].copy_from_slice(&(1u64 << 57).to_le_bytes());
    fs::write(&path, &bytes).unwrap();
    let (found, damage) = read(&path).unwrap();
    assert!(found.is_empty());
    assert!(damage.iter().any(|d| d.what.contains("beyond the limit")), "{damage:?}");
}

#[test]
fn bursts_read_after_their_reader_moved_on_keep_their_samples() {
    let (_dir, path) = place("r.mcap");
    write(&path, 200, WriterOptions { compression: Compression::Lz4, chunk_bytes: Some(300) });
    let recording = Recording::open(&path, Limits::default()).unwrap();
    let mut reader = recording.reader();
    let mut kept = Vec::new();
    for (i, block) in blocks(&path).iter().enumerate() {
        let piece = reader.read(block);
        if i % 3 == 0 {
            kept.extend(piece.acquisitions);
        } // the others free their buffers, which are used again
    }
    let all = texts(0..200);
    assert!(kept.len() > 20 && kept.iter().all(|k| all.contains(&text(k))));
}

/// The directory of the MCAP conformance suite, if it lies beside the package or beside a directory
/// above it.
fn conformance() -> Option<PathBuf> {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.ancestors().skip(1).map(|dir| dir.join("shared/mcap_conformance")).find(|d| d.is_dir())
}

#[test]
fn every_file_of_the_mcap_conformance_suite_reads_without_damage_and_without_bursts() {
    let Some(dir) = conformance() else {
        eprintln!("SKIPPED: ../shared/mcap_conformance is not there");
        return;
    };
    let mut files = 0;
    for entry in walkdir::WalkDir::new(dir) {
        let entry = entry.unwrap();
        if entry.path().extension().is_some_and(|e| e == "mcap") {
            let (found, damage) = read(entry.path()).unwrap();
            assert_eq!(damage, [], "{}", entry.path().display());
            assert!(found.is_empty());
            files += 1;
        }
    }
    assert!(files > 400, "{files} files");
}

/// The blocks that are whole by now in a recording that is being written.
fn whole_by_now(blocks: &mut super::scan::Blocks) -> Vec<Block> {
    let mut all = Vec::new();
    while let Poll::Ready(Some(block)) = blocks.poll() {
        all.push(block.unwrap());
    }
    all
}

#[test]
fn who_reads_a_growing_recording_earlier_or_later_counts_the_same_blocks() {
    let dir = Dir::new();
    let [whole, now] = ["whole.mcap", "now.mcap"].map(|name| dir.path(name));
    write(&whole, 40, WriterOptions { compression: Compression::None, chunk_bytes: None });
    let bytes = fs::read(&whole).unwrap();
    let mut file = fs::File::create(&now).unwrap();
    file.write_all(&bytes[..bytes.len() / 3]).unwrap();
    let enough = Arc::new(AtomicBool::new(false));
    let dialects = Dialects::default();
    let recording = Recording::follow(&now, Limits::default(), &dialects, enough).unwrap();
    let mut early = recording.blocks();
    let mut seen = whole_by_now(&mut early);
    for rest in bytes[bytes.len() / 3..bytes.len() - 8].chunks(777) {
        file.write_all(rest).unwrap();
        recording.source.grow().unwrap();
        seen.extend(whole_by_now(&mut early));
    }
    assert!(seen.len() > 5, "it was looked at in between");
    assert_eq!(whole_by_now(&mut recording.blocks()), seen);
}
