//! Everything that is read may have been changed by anybody: more than ten thousand changed recordings,
//! bursts, labels, settings, designs, baselines, tables and journals, each read in a process of
//! its own. A message or a result, no panic, and no more memory than is stated. `tests/corpus/<reader>/` is read likewise.

use crate::house::{House, root};
use crate::memory::{alone, by_design, most_of};
use crate::readers::{self, READERS};
use crate::recipes::some;
use crate::recorded::{sample, write};
use inkling::io::Limits;
use inkling::io::burst_codec::encode;
use inkling::io::recording::Recording;
use inkling::io::recording_writer::{Compression, RecordingWriter, WriterOptions};
use inkling::pipeline::{self, Control};
use inkling::settings::Settings;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;

/// Changes some bytes, or some words, or the length.
pub fn change(bytes: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    const WORDS: [&[u8]; 12] = [
        b"1e308",
        b"-1",
        b"0",
        b"1e-320",
        b"NaN",
        b"null",
        b"99999999999999999999",
        b"\"x\"",
        b"[]",
        b"{}",
        b"\n",
        b"\xff\xfe",
    ];
    const NUMBERS: [u64; 6] = [0, 1, u32::MAX as u64, i64::MAX as u64, u64::MAX, 1 << 40];
    for _ in 0..random.random_range(1..=4) {
        let n = bytes.len();
        let at = random.random_range(0..=n);
        let length = random.random_range(0..=(n - at).min(64));
        match random.random_range(0..7) {
            0 if at < n => bytes[at] ^= 1 << random.random_range(0..8),
            1 if at < n => bytes[at] = random.random(),
            2 => {
                let number = NUMBERS[random.random_range(0..NUMBERS.len())].to_le_bytes();
                let room = (n - at).min([1, 2, 4, 8][random.random_range(0..4)]);
                bytes[at..at + room].copy_from_slice(&number[..room]);
            }
            3 => drop(bytes.drain(at..at + length)),
            4 => {
                let again = bytes[at..at + length].to_vec();
                bytes.splice(at..at, again);
            }
            5 if random.random_range(0..4) == 0 => bytes.truncate(at),
            _ => {
                // a number or a word of a text, or whatever stands there
                let of_word = |b: &u8| b.is_ascii_alphanumeric() || b".-+_".contains(b);
                let end = at + bytes[at..].iter().take(40).take_while(|b| of_word(b)).count();
                let word = WORDS[random.random_range(0..WORDS.len())];
                bytes.splice(at..end, word.iter().copied());
            }
        }
    }
}

/// What reading one of the small files here may hold at once, whatever is claimed in it.
const MOST_TO_READ: usize = 1 << 24;

/// What judging one may.
const MOST_TO_JUDGE: usize = 1 << 26;

fn corpus(reader: &str) -> Vec<PathBuf> {
    let files = std::fs::read_dir(root().join("tests/corpus").join(reader)).unwrap();
    files.map(|file| file.unwrap().path()).collect()
}

/// Reads the bytes by a reader, without a panic and in bounded memory; how much was held.
fn held(house: &House, reader: &str, bytes: &[u8], what: &str) -> usize {
    let (file, read) = readers::reader(reader);
    let path = house.write(&format!("read/{file}"), bytes);
    let (ended, most) = most_of(|| catch_unwind(AssertUnwindSafe(|| read(&path))));
    assert!(ended.is_ok(), "{reader}: {what} panics");
    assert!(most < MOST_TO_READ, "{reader}: {what} holds {most}");
    most
}

/// Reads `times` changed copies of `original`; the first that panics is told by its number.
fn attack(house: &House, reader: &str, original: &[u8], times: u64) {
    let mut greatest = 0;
    for i in 0..times {
        let mut random = ChaCha8Rng::seed_from_u64(i);
        let mut bytes = original.to_vec();
        change(&mut bytes, &mut random);
        let what = format!("change {i} of {} bytes", original.len());
        greatest = greatest.max(held(house, reader, &bytes, &what));
    }
    println!("{reader} of {} kB: {} kB held at most", original.len() >> 10, greatest >> 10);
}

#[test]
fn the_corpus_and_ten_thousand_changed_files_are_read_without_a_panic_in_bounded_memory() {
    alone(changed_files_are_read);
}

fn changed_files_are_read() {
    let house = House::new();
    for (reader, _) in READERS {
        let files = corpus(reader);
        assert!(!files.is_empty(), "{reader}: nothing in its corpus");
        for path in files {
            let what = path.display().to_string();
            held(&house, reader, &std::fs::read(path).unwrap(), &what);
        }
    }
    let bursts = some(0, 4);
    let first = inkling::burst::Burst {
        idle_time_s: vec![0.5; bursts[0].channels as usize],
        ..bursts[0].clone()
    };
    attack(&house, "burst", &encode(&first), 2000);
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        for chunk_bytes in [None, Some(20_000)] {
            let path = house.path("whole.mcap");
            let options = WriterOptions { compression, chunk_bytes };
            let mut writer = RecordingWriter::create(&path, options).unwrap();
            bursts.iter().for_each(|burst| writer.write(burst, 1).unwrap());
            writer.finish().unwrap();
            attack(&house, "recording", &std::fs::read(path).unwrap(), 700);
        }
    }
    for (reader, times) in [("foreign", 700), ("table", 300)] {
        for path in corpus(reader) {
            attack(&house, reader, &std::fs::read(path).unwrap(), times);
        }
    }
    let head = |name: &str, lines: usize| {
        let text = std::fs::read_to_string(sample(name)).unwrap();
        text.lines().take(lines).map(|line| format!("{line}\n")).collect::<String>()
    };
    attack(&house, "labels", head("labels.csv", 30).as_bytes(), 1500);
    attack(&house, "settings", &std::fs::read(root().join("pipeline.toml")).unwrap(), 1500);
    attack(&house, "design", &std::fs::read(sample("design.json")).unwrap(), 400);
    house.record("rec/a.mcap", &some(0, 20));
    house.replay("rec --quiet").exits(0);
    attack(&house, "verdicts", &house.read("out/a.verdicts.parquet"), 500);
    attack(&house, "episodes", &house.read("out/a.episodes.parquet"), 300);
    attack(&house, "journal", &house.read("out/journal.jsonl"), 300);
    house.ok("replay rec --quiet --out without --baseline own.json");
    attack(&house, "baseline", &house.read("own.json"), 300);
}

#[test]
fn changed_recordings_are_judged_without_a_panic_in_bounded_memory() {
    alone(changed_recordings_are_judged);
}

fn changed_recordings_are_judged() {
    let house = House::new();
    // without chunks, and so without their checksums: what is changed is judged
    let plain = WriterOptions { compression: Compression::None, chunk_bytes: None };
    write(&house.path("whole.mcap"), &some(0, 3), plain);
    let whole = house.read("whole.mcap");
    let settings = |mode: &str| {
        let threads = "replay.threads=1".to_owned();
        Settings::load(None, None, &[format!("identify.mode={mode}"), threads]).unwrap()
    };
    let run_of = |mode| by_design(&sample("design.json"), settings(mode)).unwrap();
    let runs = [run_of("design"), run_of("windows")];
    let (mut judged, mut greatest) = (0, 0);
    for i in 0..300 {
        let mut random = ChaCha8Rng::seed_from_u64(1_000_000 + i);
        let mut bytes = whole.clone();
        change(&mut bytes, &mut random);
        let path = house.write("changed.mcap", &bytes);
        let run = &runs[usize::from(i % 4 == 3)];
        let verdicts = house.path("out/changed.verdicts.parquet");
        let judge = || {
            let recording = Recording::open(&path, Limits::default()).ok()?;
            pipeline::replay(run, &recording, &verdicts, &Control::default()).ok()
        };
        let (ended, most) = most_of(|| catch_unwind(AssertUnwindSafe(judge)));
        let Ok(ended) = ended else { panic!("change {i} panics") };
        assert!(most < MOST_TO_JUDGE, "change {i} holds {most} bytes");
        greatest = greatest.max(most);
        judged += u64::from(ended.is_some());
    }
    println!("judged: {} kB held at most", greatest >> 10);
    assert!(judged > 100, "{judged} judged of 300: the changes are too coarse");
}
