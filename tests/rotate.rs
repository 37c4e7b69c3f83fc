//! `--rotate`: while a recording is written its rows are also in parts, each a table by itself; they go when it is
//! closed, stay when the run is killed, and nothing else is ever touched.
#![cfg(unix)]

use crate::follow::{Follower, Growing, WRITTEN, in_order, tables_are_those_of_a_replay};
use crate::house::{House, wait_until};
use crate::recorded::{Acquired, bursts, sample, table_rows};
use inkling::io::inputs;
use inkling::io::recording_writer::Compression;
use inkling::io::verdict_reader::VerdictReader;
use serde_json::Value;
use std::path::{Path, PathBuf};

const ARGS: &str = "--identify design --rotate 7s";

type Row = (Acquired, String, Option<u16>);

fn table(house: &House) -> Vec<Row> {
    table_rows(&house.path("out/now.verdicts.parquet"))
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

fn rows_of(parts: &[PathBuf]) -> Vec<Row> {
    parts.iter().flat_map(|part| table_rows(part)).collect()
}

/// When a row was acquired, and by which printhead.
fn burst_of(((at_ns, printhead, _), ..): &Row) -> (i64, &str) {
    (*at_ns, printhead.as_str())
}

/// What is told of the next `n` parts.
fn next_parts(follower: &mut Follower, n: usize) -> Vec<Value> {
    (0..n).map(|_| follower.next("part")).collect()
}

#[test]
fn parts_are_the_first_rows_of_the_table_and_go_when_it_has_its_name() {
    for (compression, chunk_bytes, args) in WRITTEN {
        let rotated = format!("{args} --rotate 7s");
        let mut growing = Growing::of(&in_order(), compression, chunk_bytes, &rotated);
        growing.write_to(2.0 / 3.0);
        let told = next_parts(&mut growing.follower, 3);
        let closed = parts(&growing.house);
        assert!(closed.len() >= 3, "{closed:?}");
        for (nth, (event, part)) in told.iter().zip(&closed).enumerate() {
            let document = document(part);
            assert_eq!(event["file"], format!("out/now.parts/{:05}.parquet", nth + 1));
            assert_eq!(document["part"]["number"], nth + 1);
            for key in ["number", "rows", "from", "to"] {
                assert_eq!(document["part"][key], event[key], "{key}");
            }
            assert_eq!(document["part"]["rows"], table_rows(part).len());
            let of = &document["recording"];
            assert_eq!((&of["name"], &of["complete"]), (&"now.mcap".into(), &false.into()));
            assert!(document["classes"].as_array().is_some_and(|list| !list.is_empty()));
        }
        let first = rows_of(&closed);
        for pair in closed.windows(2) {
            let [before, after] = [&pair[0], &pair[1]].map(|part| table_rows(part));
            assert_ne!(burst_of(before.last().unwrap()), burst_of(&after[0]), "a burst is split");
        }
        // whoever searches for tables meets none yet
        let out = growing.house.path("out").display().to_string();
        assert!(inputs::find_verdicts(&[out]).is_err());

        growing.finish();
        assert!(!growing.house.path("out/now.parts").exists());
        let all = table(&growing.house);
        assert!(first.len() < all.len() && first[..] == all[..first.len()], "{args}");
        assert_eq!(document(&growing.house.path("out/now.verdicts.parquet"))["part"], Value::Null);
        growing.is_as_replayed(args);
    }
}

#[test]
fn ctrl_c_leaves_the_table_and_no_parts() {
    let mut growing = Growing::sample(ARGS);
    growing.write_to(0.5);
    growing.follower.next("part");
    growing.follower.enough();
    growing.follower.ends(0);
    assert!(growing.house.path("out/now.verdicts.parquet").exists());
    assert!(!growing.house.path("out/now.parts").exists());
}

/// Follows the first half of the sample and is killed when there are two parts, which are left.
fn killed() -> (House, Vec<u8>, Vec<PathBuf>) {
    let mut growing = Growing::sample(ARGS);
    growing.write_to(0.5);
    next_parts(&mut growing.follower, 2);
    let Growing { house, bytes, follower, .. } = growing;
    drop(follower);
    let left = parts(&house);
    assert!(left.len() >= 2, "{left:?}");
    (house, bytes, left)
}

#[test]
fn parts_of_a_killed_run_can_be_read_and_the_next_run_removes_them_and_nothing_else() {
    let (house, bytes, left) = killed();
    let first = rows_of(&left);
    // named like a part, like one that is being written, like nothing of ours
    let foreign = ["00077.parquet", "00078.parquet.part", "notes.txt"];
    for name in foreign {
        house.write(&format!("out/now.parts/{name}"), name);
    }
    house.write("out/now.mcap.parts/00001.parquet", "x");

    house.write("now.mcap", &bytes);
    house.replay("now.mcap").exits(0);
    let all = table(&house);
    assert!(first[..] == all[..first.len()]);
    tables_are_those_of_a_replay(&house, &bytes, "--identify design", 0);
    assert_eq!(house.files("out/now.parts"), foreign);
    assert!(house.path("out/now.mcap.parts/00001.parquet").exists());
}

#[test]
fn who_follows_again_begins_with_the_first_part() {
    let (house, bytes, left) = killed();
    house.write("now.mcap", &bytes);
    let (told, _) = Follower::start(&house, ARGS).ends(0);
    let parts = told.iter().filter(|event| event["event"] == "part");
    let numbers: Vec<u64> = parts.map(|part| part["number"].as_u64().unwrap()).collect();
    assert!(numbers.len() > left.len() && numbers.iter().copied().eq(1..=numbers.len() as u64));
    assert!(!house.path("out/now.parts").exists(), "{numbers:?}");
}

/// Parts are all there is of yesterday's recording of the same name.
#[test]
fn parts_of_another_recording_stay() {
    let (house, _, left) = killed();
    let of = || left.iter().map(|part| std::fs::read(part).unwrap()).collect::<Vec<_>>();
    let theirs = of();
    house.record("now.mcap", &bursts(&sample("print_run.mcap")));
    let (_, stderr) = Follower::start(&house, ARGS).ends(1);
    assert!(stderr.contains("00001.parquet") && stderr.contains("Move it away"), "{stderr}");
    house.replay("now.mcap").exits(0);
    assert!(of() == theirs);
}

#[test]
fn parts_go_at_once_where_the_rest_turns_out_to_need_the_whole() {
    const WINDOWS: &str = "--identify windows --set identify.first=5 --set identify.every=10";
    let mut all = in_order();
    let two_thirds = all.len() * 2 / 3;
    all[two_thirds..].reverse();
    let rotated = format!("{WINDOWS} --rotate 7s");
    let mut growing = Growing::of(&all, Compression::Lz4, Some(30_000), &rotated);
    growing.write_to(0.5);
    growing.follower.next("part");
    assert!(!parts(&growing.house).is_empty());
    growing.write_to(0.9);
    let there = growing.house.path("out/now.parts");
    wait_until("parts of a run that was given up go", || !there.exists());
    let (_, stderr) = growing.finish();
    assert!(stderr.contains("told when the recording is closed"), "{stderr}");
    growing.is_as_replayed(WINDOWS);
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
    let part = "verdicts/now.parts/00001.parquet";
    assert!(said.contains("  part 1, ") && said.contains(part), "{said}");
}
