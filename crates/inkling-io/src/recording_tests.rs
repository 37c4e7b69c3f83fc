//! Tests of reading recordings: whole ones, cut ones, ones with flipped bits, and hostile ones. The
//! rule under test: nothing panics, and nothing is lost without damage that says so.

use super::Limits;
use super::block::{Block, BlockKind};
use super::burst_codec::encode;
use super::damage::{Damage, RecordingError};
use super::dialect::Dialects;
use super::file_error::FileError;
use super::fixtures::{assert_refused, place};
use super::mcap_records::MESSAGE_HEADER;
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

/// Every compression with each of these sizes of a chunk.
fn layouts(chunks: &[Option<u64>]) -> impl Iterator<Item = WriterOptions> {
    let with = |compression, chunk_bytes| WriterOptions { compression, chunk_bytes };
    COMPRESSIONS.into_iter().flat_map(move |of| chunks.iter().map(move |&chunk| with(of, chunk)))
}

/// The i-th burst of the tests' recordings: two printheads take turns, and no two bursts are alike.
fn burst(i: u32) -> Burst {
    let signals = [0, 1].map(|row| (0..5).map(|k| (k * k * 999 + i * 31 + row) as f32).collect());
    Burst {
        t_acq_ns: 1_000 + i64::from(i),
        logged_ns: i64::from(i),
        topic: 1 + i as u16 % 2,
        printhead: ["A", "B"][i as usize % 2].into(),
        first_channel: 10 * i,
        temperature_c: Some(f64::from(i)),
        idle_time_s: vec![0.25],
        neighbours_fired: vec![0, 1].into(),
        ..Burst::of(&signals, 1e-6, Format::S16Le, Layout::ChannelMajor)
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

/// Writes a recording of messages outside chunks.
fn write_plain(path: &Path, bursts: u32) {
    write(path, bursts, WriterOptions { compression: Compression::None, chunk_bytes: None });
}

fn open(path: &Path) -> Recording {
    Recording::open(path, Limits::default()).unwrap()
}

/// Three encoded messages, of which the second has 2000 bytes.
fn with_a_long_one() -> Vec<(u64, Vec<u8>)> {
    let mut messages = encoded(3);
    messages[1].1 = vec![0; 2000];
    messages
}

/// Everything that a recording gives: the acquisitions of all blocks, and the damage of opening,
/// blocks, statistics and digest.
type Found = Result<(Vec<Acquisition>, Vec<Damage>), RecordingError>;

fn read(path: &Path) -> Found {
    read_with(path, Limits::default())
}

fn read_with(path: &Path, limits: Limits) -> Found {
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

/// Acquisitions as text, because they themselves cannot be compared.
fn texts_of(acquisitions: &[Acquisition]) -> Vec<String> {
    acquisitions.iter().map(|acquisition| format!("{acquisition:?}")).collect()
}

/// The first bursts that [`write`] writes, as text.
fn texts(bursts: u32) -> Vec<String> {
    (0..bursts).flat_map(|i| texts_of(&[Acquisition::Usable(burst(i))])).collect()
}

/// All blocks of a recording.
fn blocks(path: &Path) -> Vec<Block> {
    open(path).blocks().map(Result::unwrap).collect()
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
    (0..bursts).map(|i| (u64::from(i), encode(&burst(i)))).collect()
}

#[test]
fn bursts_survive_every_compression_and_chunking_and_give_the_same_bytes_and_digest() {
    let (dir, path) = place("r.mcap");
    let again = dir.path().join("again.mcap");
    for options in layouts(&[None, Some(0), Some(1000), Some(1 << 20)]) {
        write(&path, 40, options);
        let (found, damage) = read(&path).unwrap();
        assert_eq!(damage, []);
        assert_eq!(texts_of(&found), texts(40));
        let recording = open(&path);
        assert_eq!(recording.expected, Some(40));
        assert!(recording.channels_known_upfront);
        let in_chunks = options.chunk_bytes.is_some();
        let kind = if in_chunks { BlockKind::Chunk } else { BlockKind::Messages };
        assert!(blocks(&path).iter().all(|block| block.kind == kind));
        let bytes = fs::read(&path).unwrap();
        let digest = format!("xxh3:{:032x}", xxhash_rust::xxh3::xxh3_128(&bytes));
        assert_eq!(recording.digest().unwrap().text, digest);
        write(&again, 40, options);
        assert_eq!(fs::read(&again).unwrap(), bytes);
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
        let of_one_topic = |i: u32| Acquisition::Usable(Burst { topic: 1, ..burst(i) });
        let written: Vec<Acquisition> = (0..10).map(of_one_topic).collect();
        assert_eq!(texts_of(&found), texts_of(&written));
        let recording = open(&path);
        assert_eq!((recording.expected, recording.channels_known_upfront), (None, false));
    }
}

#[test]
fn what_is_no_recording_is_refused_with_its_name_and_what_it_is() {
    let (dir, path) = place("x.mcap");
    let open = |path: &Path| Recording::open(path, Limits::default());
    for (bytes, says) in [
        (&b""[..], "empty file (0 bytes)"),
        (b"\x89MC", "not an MCAP file (it begins with \"\\x89MC\")"),
        (b"time,y\n0,1\n", "not an MCAP file (it begins with \"time,y\\n0\")"),
        (b"\x89MCAP1\r\n", "MCAP of another version"),
        (b"\x89MCAP0\n\x01", "copied as text"),
        (b"\x89MCAP0\r\r", "copied as text"),
    ] {
        fs::write(&path, bytes).unwrap();
        assert_refused(open(&path), &["x.mcap", says]);
    }
    let missing = open(&dir.path().join("none"));
    assert!(matches!(missing, Err(RecordingError::File(FileError::Read { .. }))));
    let directory = open(dir.path()).unwrap_err().to_string();
    assert!(directory.contains("not a file (a directory"), "{directory}");
    assert!(!directory.contains("give an MCAP file, a directory"), "{directory}");
}

#[test]
fn other_channels_are_listed_behind_any_number_of_those_of_bursts() {
    let (_dir, path) = place("many.mcap");
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
    let recording = open(&path);
    let others: Vec<&str> = recording.others.iter().map(|other| &*other.topic).collect();
    assert_eq!(others, ["/camera", "/wave"]);
    assert_eq!((recording.silent.len(), &*recording.silent[0]), (64, "/printhead/0/bursts"));
}

#[test]
fn cut_anywhere_every_whole_chunk_is_kept_and_the_loss_is_told() {
    let (dir, path) = place("r.mcap");
    let cut = dir.path().join("cut.mcap");
    let all = texts(12);
    for options in layouts(&[None, Some(1500)]) {
        write(&path, 12, options);
        let mut whole: Vec<(u64, usize)> = Vec::new(); // chunk's end, bursts up to it
        let recording = open(&path);
        let (mut reader, mut n) = (recording.reader(), 0);
        for block in blocks(&path) {
            n += reader.read(&block).acquisitions.len();
            whole.push((block.offset + block.bytes, n));
        }
        let bytes = fs::copy(&path, &cut).unwrap();
        let file = fs::File::options().write(true).open(&cut).unwrap();
        for length in (8..bytes).rev() {
            file.set_len(length).unwrap();
            let (found, damage) = read(&cut).unwrap();
            assert!(!damage.is_empty(), "cut at {length}");
            assert!(all.starts_with(&texts_of(&found)));
            let kept = whole.iter().rev().find(|w| w.0 <= length).map_or(0, |w| w.1);
            match options.chunk_bytes {
                Some(_) => assert_eq!(found.len(), kept, "cut at {length}"),
                None => assert!(found.len() >= kept),
            }
        }
    }
}

#[test]
fn a_flipped_bit_anywhere_is_told_and_never_changes_samples_of_a_chunk() {
    let (_dir, path) = place("r.mcap");
    let all = texts(8);
    for options in layouts(&[None, Some(1500)]) {
        write(&path, 8, options);
        let bytes = fs::read(&path).unwrap();
        let mut file = fs::File::options().write(true).open(&path).unwrap();
        let mut put = |at: usize, byte: u8| {
            file.seek(SeekFrom::Start(at as u64)).unwrap();
            file.write_all(&[byte]).unwrap();
        };
        for (at, &byte) in bytes.iter().enumerate() {
            put(at, byte ^ (1 << (at * 5 % 8)));
            let result = read(&path);
            put(at, byte);
            let Ok((mut found, damage)) = result else {
                assert!(at < 8, "only the magic makes it no recording");
                continue;
            };
            assert!(!damage.is_empty(), "byte {at} {options:?}");
            if options.chunk_bytes.is_some() {
                // A message index that becomes a message is a row that cannot be decoded.
                found.retain(|acquisition| matches!(acquisition, Acquisition::Usable(_)));
                let other = texts_of(&found).into_iter().find(|text| !all.contains(text));
                assert_eq!(other, None, "byte {at} {options:?} {damage:?}");
            }
        }
    }
}

#[test]
fn chunks_after_a_damaged_one_are_found_again() {
    let (_dir, path) = place("r.mcap");
    for options in layouts(&[Some(500)]) {
        write(&path, 30, options);
        let bytes = fs::read(&path).unwrap();
        // Not a chunk that defines channels: without a summary that would cost the others too.
        let damaged = blocks(&path)[3];
        let lost = open(&path).reader().read(&damaged).acquisitions.len();
        let at = damaged.offset as usize;
        // Its opcode, each byte of its length, its header, its middle.
        for offset in [0, 1, 2, 3, 8, 9 + 28, 9 + 40, (damaged.bytes / 2) as usize] {
            for length in [bytes.len(), bytes.len() - 1] {
                let mut changed = bytes[..length].to_vec(); // cut, it has no summary
                changed[at + offset] ^= 0xff;
                fs::write(&path, &changed).unwrap();
                let (found, damage) = read(&path).unwrap();
                assert!(!damage.is_empty());
                let kept = found.len();
                assert!(
                    kept >= 30 - lost,
                    "{kept} at {offset} of {length} {options:?}: {damage:?}"
                );
            }
        }
    }
}

#[test]
fn a_recording_that_is_appended_to_another_is_read_also_where_that_one_ends_in_a_chunk() {
    let (_dir, path) = place("r.mcap");
    for options in layouts(&[Some(500)]) {
        write(&path, 30, options);
        let whole = fs::read(&path).unwrap();
        let cut = blocks(&path)[3];
        let cuts = [whole.len() as u64, cut.offset + cut.bytes / 2, cut.offset + 9];
        for kept in cuts.map(|of| of as usize) {
            fs::write(&path, [&whole[..kept], &whole].concat()).unwrap();
            let (found, damage) = read(&path).unwrap();
            let appended = damage.iter().any(|of| of.what.contains("appended"));
            assert_eq!(appended, kept == whole.len(), "{damage:?}");
            let last = texts(30);
            assert!(texts_of(&found).ends_with(&last), "{kept} {options:?}: {damage:?}");
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

/// Recordings with one thing wrong: how many acquisitions are found all the same, and what is told.
#[test]
fn what_contradicts_itself_or_is_too_large_is_damage() {
    type Make = fn(&Path) -> Vec<u8>;
    let small = Limits { record_bytes: 1500, chunk_bytes: 1500, ..Limits::default() };
    let recordings: [(Make, Limits, usize, &str); 4] = [
        (of_an_undefined_channel, Limits::default(), 3, "channel 99"),
        (with_two_schemas_of_one_number, Limits::default(), 2, "schema 1 defined again"),
        (with_a_huge_message, small, 2, "2 burst messages found"),
        (with_a_huge_claim, Limits::default(), 0, "beyond the limit"),
    ];
    let (_dir, path) = place("r.mcap");
    for (make, limits, usable, says) in recordings {
        let bytes = make(&path);
        fs::write(&path, bytes).unwrap();
        let (found, damage) = read_with(&path, limits).unwrap();
        assert_eq!(found.len(), usable, "{says}");
        assert!(damage.iter().any(|d| d.what.contains(says)), "{says}: {damage:?}");
    }
}

/// The last of four messages has another channel's id; the summary is cut off, so nothing else can tell.
fn of_an_undefined_channel(path: &Path) -> Vec<u8> {
    write_plain(path, 4);
    let end = blocks(path)[0].offset + blocks(path)[0].bytes;
    let mut bytes = fs::read(path).unwrap();
    bytes.truncate(end as usize);
    let body = bytes.len() - encode(&burst(3)).len() - MESSAGE_HEADER;
    bytes[body] = 99;
    bytes
}

/// The schema in the chunk is not the one of the summary, which holds.
fn with_two_schemas_of_one_number(path: &Path) -> Vec<u8> {
    let options = mcap::WriteOptions::new().compression(None).calculate_chunk_crcs(false);
    write_mcap(path, options, "inkling.Burst", "protobuf", &encoded(2));
    let mut bytes = fs::read(path).unwrap();
    let name = b"inkling.Burst";
    let at = bytes.windows(name.len()).position(|part| part == name).unwrap();
    bytes[at] = b'I';
    bytes
}

/// Each message has a chunk of its own, and the second is beyond a limit of 1500 bytes.
fn with_a_huge_message(path: &Path) -> Vec<u8> {
    let options = mcap::WriteOptions::new().compression(None).chunk_size(Some(1));
    write_mcap(path, options, "inkling.Burst", "protobuf", &with_a_long_one());
    fs::read(path).unwrap()
}

/// A chunk says that it holds 2^57 bytes; nothing is allocated for them.
fn with_a_huge_claim(path: &Path) -> Vec<u8> {
    write(path, 4, WriterOptions { compression: Compression::Zstd, chunk_bytes: Some(1 << 20) });
    let mut bytes = fs::read(path).unwrap();
    let size_at = blocks(path)[0].offset as usize + 9 + 16;
    bytes[size_at..size_at + 8].copy_from_slice(&(1u64 << 57).to_le_bytes());
    bytes
}

#[test]
fn a_message_beyond_the_limit_is_a_row_too_large() {
    let (_dir, path) = place("r.mcap");
    let options = mcap::WriteOptions::new().use_chunks(false);
    write_mcap(&path, options, "inkling.Burst", "protobuf", &with_a_long_one());
    let small = Limits { record_bytes: 1500, ..Limits::default() };
    let (found, damage) = read_with(&path, small).unwrap();
    assert_eq!((found.len(), damage.len()), (3, 0));
    assert!(matches!(&found[1], Acquisition::Unusable(u) if u.why == Reason::TooLarge));
}

#[test]
fn bursts_read_after_their_reader_moved_on_keep_their_samples() {
    let (_dir, path) = place("r.mcap");
    write(&path, 200, WriterOptions { compression: Compression::Lz4, chunk_bytes: Some(300) });
    let recording = open(&path);
    let mut reader = recording.reader();
    let mut kept = Vec::new();
    for (i, block) in blocks(&path).iter().enumerate() {
        let piece = reader.read(block);
        if i % 3 == 0 {
            kept.extend(piece.acquisitions);
        } // the others free their buffers, which are used again
    }
    let all = texts(200);
    assert!(kept.len() > 20 && texts_of(&kept).iter().all(|text| all.contains(text)));
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
    let (dir, whole) = place("whole.mcap");
    let now = dir.path().join("now.mcap");
    write_plain(&whole, 40);
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
