//! A recording that is being written is followed: episodes are told as they are raised, and at its end, or
//! where it was enough, the tables are those of a replay.
#![cfg(unix)]

use crate::house::{House, signal};
use crate::pipeline::{bursts, sample, write};
use inkling::io::recording_writer::{Compression, WriterOptions};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

/// Nothing is asserted of times; what hangs fails instead.
pub const HANGS: Duration = Duration::from_secs(300);

/// How a recording is written that is followed, and what it is replayed with.
pub const WRITTEN: [(Compression, Option<u64>, &str); 3] = [
    (Compression::Lz4, Some(30_000), "--identify windows --set identify.first=8"),
    (Compression::Zstd, Some(100_000), "--identify design"),
    (Compression::None, None, "--identify design"),
];

/// `inkling replay now.mcap --follow` on its way.
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

    /// Waits for the next episode.
    fn episode(&mut self) {
        self.next("episode");
    }

    /// Waits for the next event of a kind.
    pub fn next(&mut self, kind: &str) -> Value {
        loop {
            let Ok(event) = self.lines.recv_timeout(HANGS) else {
                self.child.kill().unwrap();
                panic!("no further {kind} was told: {:?}", self.told);
            };
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

    /// At once, whatever it is doing.
    pub fn kill(mut self) {
        self.child.kill().unwrap(); // SIGKILL
        self.child.wait().unwrap();
    }

    /// What was told, and complaints, of one that ends with an exit status.
    #[track_caller]
    pub fn ends(mut self, exit: i32) -> (Vec<Value>, String) {
        while let Ok(event) = self.lines.recv_timeout(HANGS) {
            self.told.push(event);
        }
        let mut stderr = String::new();
        self.child.stderr.take().unwrap().read_to_string(&mut stderr).unwrap();
        assert_eq!(self.child.wait().unwrap().code(), Some(exit), "{stderr}");
        (self.told, stderr)
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

fn in_table(house: &House, out: &str) -> BTreeSet<(String, u64, i64)> {
    let path = house.path(&format!("{out}/now.episodes.parquet"));
    let episodes = inkling::io::episode_table::read(&path).unwrap();
    let of = episodes.iter();
    of.map(|e| (e.printhead.to_string(), u64::from(e.channel), e.raised_at_ns)).collect()
}

/// The same bytes as an ordinary replay of `recording` writes.
pub fn tables_are_those_of_a_replay(house: &House, recording: &[u8], args: &str, exit: i32) {
    house.write("again/now.mcap", recording);
    let replay = "replay again/now.mcap --design sample_logs/design.json --out again/out";
    house.run(&format!("{replay} {args}")).exits(exit);
    for table in ["verdicts.parquet", "episodes.parquet"] {
        let [followed, replayed] =
            ["out", "again/out"].map(|out| house.read(&format!("{out}/now.{table}")));
        assert!(followed == replayed, "{table} differs");
    }
}

/// The sample in chunks of some bursts.
pub fn recording(house: &House, compression: Compression, chunk_bytes: Option<u64>) -> Vec<u8> {
    let mut all = bursts(&sample("print_run.mcap"));
    all.sort_by_key(|burst| burst.t_acq_ns);
    let path = house.path("whole.mcap");
    write(&path, &all, WriterOptions { compression, chunk_bytes });
    std::fs::read(path).unwrap()
}

/// Appends in pieces that end anywhere.
pub fn append(file: &mut File, bytes: &[u8]) {
    let mut rest = bytes;
    for size in [1, 7, 4_001, 60_013, 333].into_iter().cycle() {
        let (piece, more) = rest.split_at(size.min(rest.len()));
        file.write_all(piece).unwrap();
        std::thread::sleep(Duration::from_millis(1));
        rest = more;
        if rest.is_empty() {
            return;
        }
    }
}

pub fn create(house: &House) -> File {
    File::create(house.path("now.mcap")).unwrap()
}

#[test]
fn episodes_are_told_while_it_is_written_and_tables_are_those_of_a_replay() {
    for (compression, chunk_bytes, args) in WRITTEN {
        let house = House::new();
        let bytes = recording(&house, compression, chunk_bytes);
        let mut file = create(&house);
        let mut follower = Follower::start(&house, args);
        let (most, rest) = bytes.split_at(bytes.len() * 2 / 3);
        append(&mut file, most);
        // the writer waits for what is told of the first part
        for _ in 0..3 {
            follower.episode();
        }
        append(&mut file, rest);
        let (told, _) = follower.ends(0);
        assert_eq!(raised(&told), in_table(&house, "out"), "{args}");
        assert_eq!(told.last().unwrap()["event"], "run");
        match chunk_bytes {
            Some(_) => tables_are_those_of_a_replay(&house, &bytes, args, 0),
            // rows of messages outside chunks are put together as they come
            None => {
                house.write("again/now.mcap", &bytes);
                house.ok(&format!(
                    "replay again/now.mcap --design sample_logs/design.json --out again/out {args}"
                ));
                let verdicts = |out: &str| {
                    crate::pipeline::verdicts(&house.path(&format!("{out}/now.verdicts.parquet")))
                };
                assert!(verdicts("out") == verdicts("again/out"));
                assert_eq!(in_table(&house, "out"), in_table(&house, "again/out"));
            }
        }
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
    let table = house.path("out/now.episodes.parquet");
    let in_table = inkling::io::episode_table::read(&table).unwrap();
    let of_table = in_table.iter().map(|e| {
        let name = json!([e.category, e.fault]).to_string();
        (e.printhead.to_string(), u64::from(e.channel), name)
    });
    assert_eq!(named, of_table.collect());
}

#[test]
fn what_was_told_and_changed_is_told_again_as_revised() {
    let house = House::new();
    let bytes = recording(&house, Compression::Lz4, Some(30_000));
    let mut file = create(&house);
    let follower = Follower::start(&house, "--identify windows --set identify.first=8");
    append(&mut file, &bytes);
    let (told, _) = follower.ends(0);
    // faults of the sample grow, so that what they are is seen better later
    assert!(told.iter().any(|event| event["revises"].is_object()), "{told:?}");
    last_told_is_the_table(&house, &told);
}

#[test]
fn ctrl_c_ends_it_with_what_was_complete() {
    const ARGS: &str = "--identify windows --set identify.first=8";
    let house = House::new();
    let bytes = recording(&house, Compression::Lz4, Some(30_000));
    let mut file = create(&house);
    let mut follower = Follower::start(&house, ARGS);
    append(&mut file, &bytes[..bytes.len() * 3 / 4]);
    for _ in 0..3 {
        follower.episode();
    }
    follower.enough();
    let (told, stderr) = follower.ends(0);
    assert_eq!(raised(&told), in_table(&house, "out"));
    assert!(stderr.contains("the recording was not closed"), "{stderr}");
    let summary = house.read_json("out/now.summary.json");
    assert_eq!(summary["damage"].as_array().unwrap().len(), 0);
    let complete = summary["recording"]["bytes"].as_u64().unwrap() as usize;
    assert!((bytes.len() / 4..=bytes.len() * 3 / 4).contains(&complete), "{complete}");
    // cut short, for whoever does not know that it was enough
    tables_are_those_of_a_replay(&house, &bytes[..complete], ARGS, 3);
}

#[test]
fn what_is_out_of_order_is_told_at_the_end() {
    let house = House::new();
    let mut backward = bursts(&sample("print_run.mcap"));
    backward.reverse();
    house.record("whole.mcap", &backward);
    let bytes = house.read("whole.mcap");
    let mut file = create(&house);
    let follower = Follower::start(&house, "--identify windows");
    append(&mut file, &bytes);
    let (_, stderr) = follower.ends(0);
    assert!(stderr.contains("told when the recording is closed"), "{stderr}");
    tables_are_those_of_a_replay(&house, &bytes, "--identify windows", 0);
}

#[test]
fn a_recording_that_shrinks_or_is_replaced_is_no_recording() {
    let house = House::new();
    let bytes = recording(&house, Compression::Lz4, Some(30_000));
    let shrink = || {
        let file = OpenOptions::new().write(true).open(house.path("now.mcap"));
        file.unwrap().set_len(100).unwrap();
    };
    let replace = || {
        let path = house.write("other.mcap", &bytes);
        std::fs::rename(path, house.path("now.mcap")).unwrap();
    };
    let spoils: [(&str, &dyn Fn()); 2] = [("shrank", &shrink), ("replaced", &replace)];
    for (what, spoil) in spoils {
        let mut file = create(&house);
        let mut follower = Follower::start(&house, "--identify design");
        append(&mut file, &bytes[..bytes.len() / 2]);
        follower.episode();
        spoil();
        let (_, stderr) = follower.ends(1);
        assert!(stderr.contains(what), "{stderr}");
        assert!(!house.path("out/now.verdicts.parquet").exists());
        assert!(!house.files("out").iter().any(|name| name.ends_with(".part")));
    }
}

#[test]
fn what_cannot_be_followed_is_refused_with_what_to_do() {
    let house = House::new();
    house.copy("print_run.mcap", "a.mcap");
    house.copy("print_run.mcap", "b.mcap");
    for (args, says) in [
        ("a.mcap b.mcap", "one recording at a time"),
        (".", "name the recording that is being written"),
        ("*.mcap", "name the recording that is being written"),
        ("a.mcap --dry-run", "--dry-run"),
        ("a.mcap --pace recorded", "the recorder sets the pace"),
        ("a.mcap --layout date", "--layout tree"),
        ("s3://bucket/a.mcap", "follow the file that is uploaded"),
    ] {
        house.run(&format!("replay {args} --follow --out out")).exits(2).says(says);
    }
    house.run("replay missing.mcap --follow --out out").exits(2).says("no such file");
    house.write("text.mcap", "this is no recording");
    house.run("replay text.mcap --follow --out out").exits(1).says("not an MCAP file");
    // closed already: its footer ends it at once
    house.ok("replay a.mcap --follow --out out");
    house.run("replay a.mcap --follow --out out").exits(0).says("skipped");
}

#[test]
fn a_state_is_kept_of_what_is_followed_as_of_what_is_replayed() {
    let house = House::new();
    house.copy("print_run.mcap", "a.mcap");
    for (out, how) in [("followed", "--follow"), ("replayed", "--force")] {
        house.ok(&format!(
            "replay a.mcap --design sample_logs/design.json --out {out} --baseline {out}.json {how}"
        ));
    }
    assert!(house.read("followed.json") == house.read("replayed.json"));
    let tables =
        ["followed", "replayed"].map(|out| house.read(&format!("{out}/a.verdicts.parquet")));
    assert!(tables[0] == tables[1], "verdicts differ");
}
