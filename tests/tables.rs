//! Tables as other programs read them: whose each row is wherever it lies, rings in every mode, why what has no name has
//! none, metadata once.

use crate::house::House;
use crate::nights::some;
use crate::recorded::{self, cells};
use arrow_array::RecordBatch;
use arrow_array::types::Float32Type;
use parquet::file::reader::{FileReader, SerializedFileReader};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs::File;

fn batches(house: &House, name: &str) -> Vec<RecordBatch> {
    recorded::batches(&house.path(name))
}

fn texts(batches: &[RecordBatch], name: &str) -> Vec<Option<String>> {
    has(batches, name);
    batches.iter().flat_map(|batch| recorded::texts(batch, name)).collect()
}

fn numbers(batches: &[RecordBatch], name: &str) -> Vec<Option<f32>> {
    has(batches, name);
    batches.iter().flat_map(|batch| cells::<Float32Type>(batch, name)).collect()
}

#[track_caller]
fn has(batches: &[RecordBatch], name: &str) {
    assert!(batches.iter().all(|batch| batch.column_by_name(name).is_some()), "no column {name}");
}

fn document(house: &House, name: &str) -> Value {
    let file = SerializedFileReader::new(File::open(house.path(name)).unwrap()).unwrap();
    let entries = file.metadata().file_metadata().key_value_metadata().unwrap().clone();
    let document = entries.into_iter().find(|entry| entry.key == "inkling").unwrap();
    serde_json::from_str(&document.value.unwrap()).unwrap()
}

#[track_caller]
fn what_has_no_name_says_why(rows: &[RecordBatch]) {
    for (category, reason) in texts(rows, "category").iter().zip(texts(rows, "reason")) {
        assert_eq!(category.is_none(), reason.is_some(), "{category:?} {reason:?}");
    }
}

#[test]
fn every_row_says_whose_it_is_wherever_its_table_lies() {
    let house = House::new();
    for (name, from) in [("rec/1/a.mcap", 0), ("rec/2/b.mcap", 9)] {
        house.record(name, &some(from, 9));
    }
    let replay = |layout: &str| {
        house.ok(&format!(
            "replay rec --design sample_logs/design.json --out out --layout {layout}"
        ));
    };
    replay("tree");
    replay("date"); // the same recordings a second time below out
    let (mut names, mut rows) = (Vec::new(), 0);
    let tables = house.files("out").into_iter().filter(|name| name.ends_with(".verdicts.parquet"));
    for table in tables {
        let of = texts(&batches(&house, &format!("out/{table}")), "recording");
        let distinct: BTreeSet<_> = of.iter().cloned().collect();
        assert_eq!(distinct.len(), 1, "the same in every row");
        rows += of.len();
        names.extend(distinct.into_iter().flatten());
    }
    names.sort();
    assert_eq!(
        names,
        ["1/a.mcap", "1/a.mcap", "2/b.mcap", "2/b.mcap"],
        "each recording once by name"
    );
    assert_eq!(rows, 2 * 18 * 48);
    // a run of one says its name, and so do its episodes
    house.ok("replay sample_logs/print_run.mcap --design sample_logs/design.json --out one");
    let episodes = batches(&house, "one/print_run.episodes.parquet");
    let of: BTreeSet<_> = texts(&episodes, "recording").into_iter().flatten().collect();
    assert_eq!(of, BTreeSet::from(["print_run.mcap".to_owned()]));
}

#[test]
fn flagged_signals_have_their_ring_in_every_mode_and_all_have_where_that_is_asked_for() {
    let house = House::new();
    let by_design = "--design sample_logs/design.json";
    let thesis = "--preset thesis --set identify.labels=sample_logs/labels.csv";
    for mode in ["", by_design, thesis] {
        let table = "out/print_run.verdicts.parquet";
        house.ok(&format!("replay sample_logs/print_run.mcap --out out --force {mode}"));
        let flagged = batches(&house, table);
        let resonances = numbers(&flagged, "resonance_hz");
        let dampings = numbers(&flagged, "damping_per_s");
        let outcomes = texts(&flagged, "outcome");
        let is_healthy = |row: usize| outcomes[row].as_deref() == Some("healthy");
        for row in 0..outcomes.len() {
            let has = (resonances[row].is_some(), dampings[row].is_some());
            let is_flagged = !is_healthy(row) && outcomes[row].as_deref() != Some("rejected");
            assert_eq!(has, (is_flagged, is_flagged), "row {row} of replay {mode}");
        }
        house.ok(&format!(
            "replay sample_logs/print_run.mcap --out out --force {mode} --set output.ring=all"
        ));
        let all = batches(&house, table);
        assert_eq!(texts(&all, "outcome"), outcomes, "{mode}");
        for column in ["statistic", "threshold", "certainty", "severity"] {
            assert!(numbers(&all, column) == numbers(&flagged, column), "{column} of {mode}");
        }
        let models = house.read_json("out/print_run.summary.json")["models"].clone();
        let models = models.as_array().unwrap().iter();
        let known = models.filter_map(|m| m["poles"]["frequency_hz"].as_f64());
        let (low, high) = known.fold((f64::MAX, 0.0f64), |(l, h), f| (l.min(f), h.max(f)));
        let rings = numbers(&all, "resonance_hz").into_iter().enumerate();
        let mut healthy: Vec<f64> = rings
            .filter(|(row, _)| is_healthy(*row))
            .map(|(_, f)| f64::from(f.expect("a resonance")))
            .collect();
        healthy.sort_by(f64::total_cmp);
        let median = healthy[healthy.len() / 2];
        assert!((0.99 * low..1.01 * high).contains(&median), "{median} Hz, models {low} to {high}");
    }
}

#[test]
fn episodes_say_their_ring_and_why_they_have_no_name_and_carry_no_models() {
    let house = House::new();
    house.replay("sample_logs/print_run.mcap").exits(0);
    let episodes = batches(&house, "out/print_run.episodes.parquet");
    what_has_no_name_says_why(&episodes);
    let rings = numbers(&episodes, "resonance_hz");
    let rings_there = |f: &Option<f32>| f.is_some_and(|f| (10e3..200e3).contains(&f));
    assert!(!rings.is_empty() && rings.iter().all(rings_there), "{rings:?}");
    // models are in the table of verdicts, once
    let [of_verdicts, of_episodes] = ["verdicts", "episodes"]
        .map(|table| document(&house, &format!("out/print_run.{table}.parquet")));
    assert!(of_verdicts["models"].as_array().is_some_and(|models| !models.is_empty()));
    assert!(of_episodes["models"].is_null() && of_episodes["settings"].is_null());
    assert_eq!(of_episodes["recording"], of_verdicts["recording"]);
    // windows make many models: the table of few episodes stays small
    house.ok("replay sample_logs/print_run.mcap --design sample_logs/design.json --out many \
         --identify windows --set identify.first=4 --set identify.every=4");
    let bytes = house.read("many/print_run.episodes.parquet").len();
    assert!(bytes < 16_000, "{bytes} bytes");
    // without a design nothing has a name, and everything flagged says why
    house.ok("replay sample_logs/print_run.mcap --out none");
    let episodes = batches(&house, "none/print_run.episodes.parquet");
    let reasons = texts(&episodes, "reason");
    assert!(!reasons.is_empty() && reasons.iter().all(Option::is_some), "{reasons:?}");
    house.ok("report out none -o r.html");
    what_has_no_name_says_why(&batches(&house, "r.faults.parquet"));
}
