//! `--rotate`: while a recording is written its rows are also in parts, each a table by itself; they go when it is
//! closed, stay when the run is killed, and nothing else is ever touched.
#![cfg(unix)]

use crate::follow::{
    Follower, HANGS, WRITTEN, append, create, recording, tables_are_those_of_a_replay,
};
use crate::house::House;
use crate::pipeline::{bursts, sample, write};
use inkling::io::inputs;
use inkling::io::recording_writer::{Compression, WriterOptions};
use inkling::io::verdict_reader::VerdictReader;
use inkling::verdict::VerdictColumns;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

const ARGS: &str = "--identify design --rotate 7s";

/// Every row of a table in its order, all that it says.
fn rows(table: &Path) -> Vec<String> {
    let text = |c: &VerdictColumns, i: usize| {
        let printhead = &c.printheads[c.printhead[i] as usize];
        format!(
            "{} {printhead} {} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?}",
            c.acquired_at_ns[i],
            c.channel[i],
            c.outcome[i],
            c.category[i],
            c.fault[i],
            c.candidate[i],
            c.certainty[i],
            c.statistic[i],
            c.threshold[i],
            c.test[i],
            c.misfit[i],
            c.severity[i],
            c.severity_sd[i],
            c.model[i],
            c.reason[i],
        )
    };
    let batches = VerdictReader::open(table).unwrap().map(Result::unwrap);
    batches.flat_map(|c| (0..c.len()).map(|i| text(&c, i)).collect::<Vec<_>>()).collect()
}

/// The document in a table's metadata.
fn document(table: &Path) -> Value {
    let reader = VerdictReader::open(table).unwrap();
    serde_json::from_str(reader.metadata_json().unwrap()).unwrap()
}

/// What lies in the directory of parts and has its name.
fn parts(house: &House) -> Vec<PathBuf> {
    let names = house.files("out/now.parts").into_iter().filter(|name| !name.ends_with(".part"));
    names.map(|name| house.path("out/now.parts").join(name)).collect()
}

fn rows_of(parts: &[PathBuf]) -> Vec<String> {
    parts.iter().flat_map(|part| rows(part)).collect()
}

/// When a row was acquired, and by which printhead: a burst.
fn burst_of(row: &str) -> &str {
    let (at, _) = row.match_indices(' ').nth(1).unwrap();
    &row[..at]
}

#[test]
fn parts_are_the_first_rows_of_the_table_and_go_when_it_has_its_name() {
    for (compression, chunk_bytes, args) in WRITTEN {
        let house = House::new();
        let bytes = recording(&house, compression, chunk_bytes);
        let mut file = create(&house);
        let mut follower = Follower::start(&house, &format!("{args} --rotate 7s"));
        append(&mut file, &bytes[..bytes.len() * 2 / 3]);
        let told: Vec<Value> = (0..3).map(|_| follower.next("part")).collect();
        let closed = parts(&house);
        assert!(closed.len() >= 3, "{closed:?}");
        for (nth, (event, part)) in told.iter().zip(&closed).enumerate() {
            let document = document(part);
            assert_eq!(event["file"], format!("out/now.parts/{:05}.parquet", nth + 1));
            assert_eq!(document["part"]["number"], nth + 1);
            for key in ["number", "rows", "from", "to"] {
                assert_eq!(document["part"][key], event[key], "{key}");
            }
            assert_eq!(document["part"]["rows"], rows(part).len());
            let of = &document["recording"];
            assert_eq!((&of["name"], &of["complete"]), (&"now.mcap".into(), &false.into()));
            assert!(document["classes"].as_array().is_some_and(|list| !list.is_empty()));
        }
        let first = rows_of(&closed);
        for pair in closed.windows(2) {
            let [before, after] = [&pair[0], &pair[1]].map(|part| rows(part));
            assert_ne!(burst_of(before.last().unwrap()), burst_of(&after[0]), "a burst is split");
        }
        // whoever searches for tables meets none yet
        let out = house.path("out").display().to_string();
        assert!(inputs::find_verdicts(&[out]).is_err());

        append(&mut file, &bytes[bytes.len() * 2 / 3..]);
        follower.ends(0);
        assert!(!house.path("out/now.parts").exists());
        let all = rows(&house.path("out/now.verdicts.parquet"));
        assert!(first.len() < all.len() && first[..] == all[..first.len()], "{args}");
        match chunk_bytes {
            Some(_) => tables_are_those_of_a_replay(&house, &bytes, args, 0),
            None => {
                assert_eq!(document(&house.path("out/now.verdicts.parquet"))["part"], Value::Null)
            }
        }
    }
}

#[test]
fn ctrl_c_leaves_the_table_and_no_parts() {
    let house = House::new();
    let bytes = recording(&house, Compression::Lz4, Some(30_000));
    let mut file = create(&house);
    let mut follower = Follower::start(&house, ARGS);
    append(&mut file, &bytes[..bytes.len() / 2]);
    follower.next("part");
    follower.enough();
    follower.ends(0);
    assert!(house.path("out/now.verdicts.parquet").exists());
    assert!(!house.path("out/now.parts").exists());
}

/// Follows the first half of a recording and is killed when there are two parts.
fn killed(house: &House, bytes: &[u8]) -> Vec<PathBuf> {
    let mut file = create(house);
    let mut follower = Follower::start(house, ARGS);
    append(&mut file, &bytes[..bytes.len() / 2]);
    (0..2).for_each(|_| drop(follower.next("part")));
    follower.kill();
    parts(house)
}

#[test]
fn parts_of_a_killed_run_can_be_read_and_the_next_run_removes_them_and_nothing_else() {
    let house = House::new();
    let bytes = recording(&house, Compression::Lz4, Some(30_000));
    let left = killed(&house, &bytes);
    assert!(left.len() >= 2, "{left:?}");
    let first = rows_of(&left);
    // named like a part, like one that is being written, like nothing of ours
    let foreign = ["00077.parquet", "00078.parquet.part", "notes.txt"];
    for name in foreign {
        house.write(&format!("out/now.parts/{name}"), name);
    }
    house.write("out/now.mcap.parts/00001.parquet", "x");

    house.write("now.mcap", &bytes);
    house.ok("replay now.mcap --out out --design sample_logs/design.json");
    let all = rows(&house.path("out/now.verdicts.parquet"));
    assert!(first[..] == all[..first.len()]);
    tables_are_those_of_a_replay(&house, &bytes, "--identify design", 0);
    assert_eq!(house.files("out/now.parts"), foreign);
    assert!(house.path("out/now.mcap.parts/00001.parquet").exists());
}

#[test]
fn who_follows_again_begins_with_the_first_part_unless_that_is_anothers() {
    let house = House::new();
    let bytes = recording(&house, Compression::Lz4, Some(30_000));
    let left = killed(&house, &bytes);
    house.write("now.mcap", &bytes);
    let follower = Follower::start(&house, ARGS);
    let (told, _) = follower.ends(0);
    let parts = told.iter().filter(|event| event["event"] == "part");
    let numbers: Vec<u64> = parts.map(|part| part["number"].as_u64().unwrap()).collect();
    assert!(numbers.len() > left.len() && numbers.iter().copied().eq(1..=numbers.len() as u64));
    assert!(!house.path("out/now.parts").exists(), "{numbers:?}");

    // yesterday's recording of the same name, of which these parts are all there is
    std::fs::remove_dir_all(house.path("out")).unwrap();
    let left = killed(&house, &bytes);
    let theirs: Vec<Vec<u8>> = left.iter().map(|part| std::fs::read(part).unwrap()).collect();
    house.record("now.mcap", &bursts(&sample("print_run.mcap")));
    let (_, stderr) = Follower::start(&house, ARGS).ends(1);
    assert!(stderr.contains("00001.parquet") && stderr.contains("Move it away"), "{stderr}");
    house.ok("replay now.mcap --out out --design sample_logs/design.json");
    let there: Vec<Vec<u8>> = left.iter().map(|part| std::fs::read(part).unwrap()).collect();
    assert!(there == theirs);
}

#[test]
fn parts_go_at_once_where_the_rest_turns_out_to_need_the_whole() {
    const WINDOWS: &str = "--identify windows --set identify.first=5 --set identify.every=10";
    let house = House::new();
    let mut all = bursts(&sample("print_run.mcap"));
    all.sort_by_key(|burst| burst.t_acq_ns);
    let two_thirds = all.len() * 2 / 3;
    all[two_thirds..].reverse();
    let options = WriterOptions { compression: Compression::Lz4, chunk_bytes: Some(30_000) };
    write(&house.path("whole.mcap"), &all, options);
    let bytes = house.read("whole.mcap");
    let mut file = create(&house);
    let mut follower = Follower::start(&house, &format!("{WINDOWS} --rotate 7s"));
    append(&mut file, &bytes[..bytes.len() / 2]);
    follower.next("part");
    assert!(!parts(&house).is_empty());
    append(&mut file, &bytes[bytes.len() / 2..bytes.len() * 9 / 10]);
    let since = Instant::now();
    while house.path("out/now.parts").exists() {
        assert!(since.elapsed() < HANGS, "parts of a run that was given up stay");
        std::thread::sleep(Duration::from_millis(10));
    }
    append(&mut file, &bytes[bytes.len() * 9 / 10..]);
    let (_, stderr) = follower.ends(0);
    assert!(stderr.contains("told when the recording is closed"), "{stderr}");
    tables_are_those_of_a_replay(&house, &bytes, WINDOWS, 0);
}

#[test]
fn a_directory_of_parts_that_cannot_be_is_an_error() {
    let house = House::new();
    house.copy("print_run.mcap", "now.mcap");
    house.write("out/now.parts", "a file");
    let (_, stderr) = Follower::start(&house, ARGS).ends(1);
    assert!(stderr.contains("out/now.parts"), "{stderr}");
    assert_eq!(house.read("out/now.parts"), b"a file");
    assert!(!house.path("out/now.verdicts.parquet").exists());
}

#[test]
fn what_cannot_be_rotated_is_refused_with_what_to_do() {
    let house = House::new();
    house.copy("print_run.mcap", "now.mcap");
    for (args, says) in [
        ("--rotate 10min", "add --follow"),
        ("--follow --rotate 0s", "a part is of 1s to 366days"),
        ("--follow --rotate 10", "time unit needed"),
        ("--follow --rotate 10min --out s3://bucket/out", "give a directory by --out"),
    ] {
        house.run(&format!("replay now.mcap {args}")).exits(2).says(says);
    }
    // a part that a person reads of
    let said = house.ok("replay now.mcap --follow --rotate 7s --design sample_logs/design.json");
    assert!(
        said.contains("  part 1, ") && said.contains("verdicts/now.parts/00001.parquet"),
        "{said}"
    );
}
