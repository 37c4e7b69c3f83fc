//! What former versions wrote is read, judged again, or refused with a sentence, as `docs/versions.md` promises.

use crate::house::{House, root, shipped};
use crate::recorded::sample;
use inkling::design::{Design, VERSION};
use inkling::io::design_file;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

fn former(name: &str) -> PathBuf {
    root().join("tests/former").join(name)
}

/// The results of a former run, in the house.
fn run_of_version_1(house: &House) {
    for file in std::fs::read_dir(former("run-1")).unwrap() {
        let file = file.unwrap();
        let name = format!("out/{}", file.file_name().to_string_lossy());
        house.write(&name, std::fs::read(file.path()).unwrap());
    }
}

/// Names and types of a table's columns.
fn columns(table: &Path) -> BTreeMap<String, String> {
    let reader = ParquetRecordBatchReaderBuilder::try_new(File::open(table).unwrap()).unwrap();
    let fields = reader.schema().fields().iter();
    fields.map(|field| (field.name().clone(), field.data_type().to_string())).collect()
}

#[test]
fn designs_of_former_versions_are_refused_by_their_version() {
    let house = House::new();
    for version in [1, 2, 3] {
        let design = former(&format!("design-{version}.json"));
        house
            .run(&format!("replay sample_logs/print_run.mcap --design {}", design.display()))
            .exits(2)
            .says(&format!("design version {version}, made by inkling 0.1.0"))
            .says("the one that made it reads it, or train again");
    }
    assert!(house.files(".").is_empty());
}

#[test]
fn results_of_version_1_are_reported_and_scored() {
    let house = House::new();
    run_of_version_1(&house);
    let report = house.json("report out -o page.html --json");
    let faults = report["faults"].as_array().unwrap();
    let is_first = |fault: &&Value| fault["printhead"] == "black-2" && fault["channel"] == 0;
    let found = faults.iter().find(is_first).unwrap_or_else(|| panic!("{report}"));
    assert_eq!(found["fault"], "EC", "{found}");
    for table in ["out/print_run.verdicts.parquet".into(), former("verdicts-1-first.parquet")] {
        let args = format!("score {} --labels sample_logs/labels.csv", table.display());
        house.run(&args).exits(0).says("accuracy 0.99");
    }
}

#[test]
fn results_of_version_1_are_judged_again_and_then_finished() {
    let house = House::new();
    run_of_version_1(&house);
    let recording = sample("print_run.mcap");
    let modified = std::fs::metadata(&recording).unwrap().modified().unwrap();
    let mut entry = house.read_json("out/journal.jsonl");
    entry["recording"]["path"] = json!(recording);
    entry["recording"]["modified_ns"] =
        json!(modified.duration_since(UNIX_EPOCH).unwrap().as_nanos() as u64);
    house.write("out/journal.jsonl", format!("{entry}\n"));
    let dry = "sample_logs/print_run.mcap --dry-run";
    house.replay(dry).says("its tables are of another version");
    house.replay("sample_logs/print_run.mcap").exits(0);
    assert!(columns(&house.path("out/print_run.verdicts.parquet")).contains_key("recording"));
    house.replay(dry).says("would judge 0, skip 1");
}

#[test]
fn who_reads_tables_of_version_1_reads_those_of_now() {
    let house = House::new();
    house.replay("sample_logs/print_run.mcap").exits(0);
    house.ok("report out -o page.html");
    let tables = [
        ("run-1/print_run.verdicts.parquet", "out/print_run.verdicts.parquet"),
        ("run-1/print_run.episodes.parquet", "out/print_run.episodes.parquet"),
        ("faults-1.parquet", "page.faults.parquet"),
    ];
    for (before, now) in tables {
        let (before, now) = (columns(&former(before)), columns(&house.path(now)));
        assert!(before.len() >= 14);
        for (name, kind) in before {
            assert_eq!(now.get(&name), Some(&kind), "{name}");
        }
    }
}

#[test]
fn states_of_version_1_are_taken_over() {
    let (with, without) = (House::new(), House::new());
    // states hold for the design that they name: here for the one of that time, in today's file
    let then = std::fs::read(former("design-3.json")).unwrap();
    let mut then: Design = serde_json::from_slice(&then).unwrap();
    then.version = VERSION;
    let path = with.path("design.json");
    design_file::write(&path, &then).unwrap();
    let mut states: Value =
        serde_json::from_slice(&std::fs::read(former("states-1.json")).unwrap()).unwrap();
    states["design"] = design_file::read(&path).unwrap().1.into();
    with.write("states.json", states.to_string());
    let channels = |states: &Value| -> Vec<(String, String)> {
        let heads = states["printheads"].as_object().unwrap().iter();
        let of = |memory: &Value| memory["channels"].as_object().unwrap().clone().into_iter();
        heads.flat_map(|(head, memory)| of(memory).map(|(n, _)| (head.clone(), n))).collect()
    };
    let before = channels(&with.read_json("states.json"));
    for house in [&with, &without] {
        house.ok(&format!(
            "replay sample_logs/print_run.mcap --design {} --baseline states.json --out out",
            path.display()
        ));
    }
    let now = with.read_json("states.json");
    assert!(now["version"].as_u64() > Some(1), "{}", now["version"]);
    let known = channels(&now);
    assert!(before.len() > 100 && before.iter().all(|channel| known.contains(channel)));
    assert_ne!(now, without.read_json("states.json"), "they were learned anew");
}

/// What is written now says that it is of the program that the manifest names.
#[test]
fn one_version_stands_everywhere() {
    let version = env!("CARGO_PKG_VERSION");
    let changes = shipped("CHANGELOG.md");
    let newest = changes.lines().find(|line| line.starts_with("## ")).unwrap();
    assert!(newest.starts_with(&format!("## {version} (")), "{newest}");
    let images = shipped("fleet/deploy/kubernetes.yaml");
    for image in images.lines().filter(|line| line.contains("image: inkling")) {
        assert!(image.ends_with(&format!(":{version}")), "{image}");
    }
}
