//! A recording that is being written is followed: episodes are told as they are raised, and at its end, or
//! where it was enough, the tables are those of a replay.
#![cfg(unix)]

use crate::house::{HANGS, House, signal};
use crate::recorded::{bursts, sample, write};
use inkling::burst::Burst;
use inkling::episodes::Episode;
use inkling::io::recording_writer::{Compression, WriterOptions};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

pub const WINDOWS: &str = "--identify windows --set identify.first=8";

/// How a recording is written that is followed, and what it is replayed with.
pub const WRITTEN: [(Compression, Option<u64>, &str); 3] = [
    (Compression::Lz4, Some(30_000), WINDOWS),
    (Compression::Zstd, Some(100_000), "--identify design"),
    (Compression::None, None, "--identify design"),
];

/// `inkling replay now.mcap --follow` on its way; it is killed when it is dropped.
pub struct Follower {
    child: Child,
    lines: Receiver<Value>,
    told: Vec<Value>,
}

impl Follower {
    pub fn start(house: &House, args: &str) -> Follower {
        const ALWAYS: &str =
            "replay now.mcap --follow --json --out out --design sample_logs/design.json";
        let mut inkling = house.inkling(&format!("{ALWAYS} {args}"));
        let mut child = inkling.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let (send, lines) = channel();
        let out = BufReader::new(child.stdout.take().unwrap());
        std::thread::spawn(move || {
            for line in out.lines() {
                let event = serde_json::from_str(&line.unwrap()).expect("JSON lines");
                if send.send(event).is_err() {
                    return;
                }
            }
        });
        Follower { child, lines, told: Vec::new() }
    }

    /// Waits for the next event of a kind.
    pub fn next(&mut self, kind: &str) -> Value {
        loop {
            let told = self.lines.recv_timeout(HANGS);
            let event =
                told.unwrap_or_else(|_| panic!("no further {kind} was told: {:?}", self.told));
            self.told.push(event.clone());
            if event["event"] == kind {
                return event;
            }
        }
    }

    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    pub fn enough(&self) {
        signal(self.pid(), "-INT");
    }

    /// What was told, and complaints, of one that ends with an exit status.
    #[track_caller]
    pub fn ends(&mut self, exit: i32) -> (Vec<Value>, String) {
        while let Ok(event) = self.lines.recv_timeout(HANGS) {
            self.told.push(event);
        }
        let mut stderr = String::new();
        self.child.stderr.take().unwrap().read_to_string(&mut stderr).unwrap();
        assert_eq!(self.child.wait().unwrap().code(), Some(exit), "{stderr}");
        (std::mem::take(&mut self.told), stderr)
    }
}

impl Drop for Follower {
    fn drop(&mut self) {
        // one that has ended is killed already
        let _ = self.child.kill(); // SIGKILL
        let _ = self.child.wait();
    }
}

/// What was told: printhead, channel, when it was raised.
fn raised(told: &[Value]) -> BTreeSet<(String, u64, i64)> {
    let of = |event: &Value| {
        let time = chrono::DateTime::parse_from_rfc3339(event["raised_at"].as_str()?).ok()?;
        let printhead = event["printhead"].as_str()?.to_owned();
        Some((printhead, event["channel"].as_u64()?, time.timestamp_nanos_opt()?))
    };
    let episodes = told.iter().filter(|event| event["event"] == "episode");
    episodes.map(|event| of(event).unwrap_or_else(|| panic!("{event}"))).collect()
}

fn in_table(house: &House, of: &str) -> BTreeSet<(String, u64, i64)> {
    let key = |e: Episode| (e.printhead.to_string(), u64::from(e.channel), e.raised_at_ns);
    house.episodes(of).into_iter().map(key).collect()
}

/// An ordinary replay of `recording` writes the same bytes.
#[track_caller]
pub fn tables_are_those_of_a_replay(house: &House, recording: &[u8], args: &str, exit: i32) {
    replay_again(house, recording, args, exit);
    for table in ["verdicts.parquet", "episodes.parquet"] {
        let [followed, replayed] =
            ["out", "again/out"].map(|out| house.read(&format!("{out}/now.{table}")));
        assert!(followed == replayed, "{table} differs");
    }
}

fn replay_again(house: &House, recording: &[u8], args: &str, exit: i32) {
    house.write("again/now.mcap", recording);
    house.replay_to("again/out", &format!("again/now.mcap {args}")).exits(exit);
}

/// The sample's bursts in the order of their times.
pub fn in_order() -> Vec<Burst> {
    let mut all = bursts(&sample("print_run.mcap"));
    all.sort_by_key(|burst| burst.t_acq_ns);
    all
}

/// The bytes of a recording of these bursts.
fn encoded(bursts: &[Burst], compression: Compression, chunk_bytes: Option<u64>) -> Vec<u8> {
    let house = House::new();
    write(&house.path("whole.mcap"), bursts, WriterOptions { compression, chunk_bytes });
    house.read("whole.mcap")
}

pub fn create(house: &House) -> File {
    File::create(house.path("now.mcap")).unwrap()
}

/// A recording that is being written while it is followed.
pub struct Growing {
    pub follower: Follower,
    pub house: House,
    /// The whole recording.
    pub bytes: Vec<u8>,
    has_chunks: bool,
    file: File,
    written: usize,
}

impl Growing {
    /// Nothing of these bursts is written yet.
    pub fn of(
        bursts: &[Burst],
        compression: Compression,
        chunk_bytes: Option<u64>,
        args: &str,
    ) -> Growing {
        let house = House::new();
        let bytes = encoded(bursts, compression, chunk_bytes);
        let (file, has_chunks) = (create(&house), chunk_bytes.is_some());
        let follower = Follower::start(&house, args);
        Growing { follower, house, bytes, has_chunks, file, written: 0 }
    }

    /// Of the sample, in chunks of some bursts.
    pub fn sample(args: &str) -> Growing {
        Growing::of(&in_order(), Compression::Lz4, Some(30_000), args)
    }

    /// Goes on up to a share of the recording, in pieces that end anywhere.
    pub fn write_to(&mut self, share: f64) {
        let end = (self.bytes.len() as f64 * share) as usize;
        for size in [1, 7, 4_001, 60_013, 333].into_iter().cycle() {
            let next = (self.written + size).min(end);
            self.file.write_all(&self.bytes[self.written..next]).unwrap();
            self.written = next;
            if next == end {
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Writes the rest; gives what is told, and complaints, until the run ends.
    #[track_caller]
    pub fn finish(&mut self) -> (Vec<Value>, String) {
        self.write_to(1.0);
        self.follower.ends(0)
    }

    /// An ordinary replay writes the same: the same bytes, but for messages outside of chunks, whose rows are put
    /// together as they come.
    #[track_caller]
    pub fn is_as_replayed(&self, args: &str) {
        let house = &self.house;
        if self.has_chunks {
            return tables_are_those_of_a_replay(house, &self.bytes, args, 0);
        }
        replay_again(house, &self.bytes, args, 0);
        assert!(house.verdicts("out/now") == house.verdicts("again/out/now"), "verdicts differ");
        assert_eq!(in_table(house, "out/now"), in_table(house, "again/out/now"));
    }
}

#[test]
fn episodes_are_told_while_it_is_written_and_tables_are_those_of_a_replay() {
    for (compression, chunk_bytes, args) in WRITTEN {
        let mut growing = Growing::of(&in_order(), compression, chunk_bytes, args);
        growing.write_to(2.0 / 3.0);
        // the writer waits for what is told of the first part
        (0..3).for_each(|_| drop(growing.follower.next("episode")));
        let (told, _) = growing.finish();
        assert_eq!(raised(&told), in_table(&growing.house, "out/now"), "{args}");
        assert_eq!(told.last().unwrap()["event"], "run");
        growing.is_as_replayed(args);
    }
}

/// Of every episode the last that was told is what the table says, and what was told otherwise before is revised.
fn last_told_is_the_table(house: &House, told: &[Value]) {
    let mut last: BTreeMap<(String, u64, String), &Value> = BTreeMap::new();
    for event in told.iter().filter(|event| event["explanation"].is_string()) {
        let text = |key: &str| event[key].as_str().unwrap().to_owned();
        let key = |raised_at: &str| {
            (text("printhead"), event["channel"].as_u64().unwrap(), raised_at.to_owned())
        };
        if let Some(raised_at) = event["revises"]["raised_at"].as_str() {
            let before = last.remove(&key(raised_at)).expect("what is revised was told");
            let name = |of: &Value| (of["category"].clone(), of["fault"].clone());
            assert_eq!(name(&event["revises"]), name(before));
            let is_other = name(event) != name(before) || event["raised_at"] != raised_at;
            assert!(event["event"] == "withdrawn" || is_other, "{event}");
        }
        assert!(last.insert(key(&text("raised_at")), event).is_none(), "told twice: {event}");
    }
    last.retain(|_, event| event["event"] == "episode");
    let named: BTreeSet<(String, u64, String)> = last
        .iter()
        .map(|(key, event)| {
            (key.0.clone(), key.1, json!([event["category"], event["fault"]]).to_string())
        })
        .collect();
    let of_table = house.episodes("out/now").into_iter().map(|e| {
        let name = json!([e.category, e.fault]).to_string();
        (e.printhead.to_string(), u64::from(e.channel), name)
    });
    assert_eq!(named, of_table.collect());
}

#[test]
fn what_was_told_and_changed_is_told_again_as_revised() {
    let mut growing = Growing::sample(WINDOWS);
    let (told, _) = growing.finish();
    // faults of the sample grow, so that what they are is seen better later
    assert!(told.iter().any(|event| event["revises"].is_object()), "{told:?}");
    last_told_is_the_table(&growing.house, &told);
}

#[test]
fn ctrl_c_ends_it_with_what_was_complete() {
    let mut growing = Growing::sample(WINDOWS);
    growing.write_to(0.75);
    (0..3).for_each(|_| drop(growing.follower.next("episode")));
    growing.follower.enough();
    let (told, stderr) = growing.follower.ends(0);
    let Growing { house, bytes, .. } = growing;
    assert_eq!(raised(&told), in_table(&house, "out/now"));
    assert!(stderr.contains("the recording was not closed"), "{stderr}");
    let summary = house.read_json("out/now.summary.json");
    assert_eq!(summary["damage"].as_array().unwrap().len(), 0);
    let complete = summary["recording"]["bytes"].as_u64().unwrap() as usize;
    assert!((bytes.len() / 4..=bytes.len() * 3 / 4).contains(&complete), "{complete}");
    // cut short, for whoever does not know that it was enough
    tables_are_those_of_a_replay(&house, &bytes[..complete], WINDOWS, 3);
}

#[test]
fn what_is_out_of_order_is_judged_as_a_replay_judges_it() {
    const WINDOWS: &str = "--identify windows";
    let mut backward = bursts(&sample("print_run.mcap"));
    backward.reverse();
    let mut growing = Growing::of(&backward, Compression::Zstd, Some(1 << 20), WINDOWS);
    growing.finish();
    growing.is_as_replayed(WINDOWS);
}

#[test]
fn a_recording_that_shrinks_or_is_replaced_is_no_recording() {
    for what in ["shrank", "replaced"] {
        let mut growing = Growing::sample("--identify design");
        growing.write_to(0.5);
        growing.follower.next("episode");
        match what {
            "shrank" => growing.file.set_len(100).unwrap(),
            _ => {
                let path = growing.house.write("other.mcap", &growing.bytes);
                std::fs::rename(path, growing.house.path("now.mcap")).unwrap();
            }
        }
        let (_, stderr) = growing.follower.ends(1);
        assert!(stderr.contains(what), "{stderr}");
        let left = growing.house.files("out");
        let is_table = |name: &String| name.ends_with(".part") || name == "now.verdicts.parquet";
        assert!(!left.iter().any(is_table), "{what}: {left:?}");
    }
}
