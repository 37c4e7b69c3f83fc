//! A user's own names for faults that the physics knows: they keep sizes and sentences.

use crate::house::{House, only_healthy, physics, shipped};
use crate::recorded::{bursts, sample, with_samples};
use inkling::burst::Burst;
use serde_json::Value;

const DECLARED: &str =
    r#"--set isolate.classes={Verstopfung=["PBN","BN"],Luft=["AB1","AB2","AB3"]}"#;

/// Labelled faults by physics, and as many to judge, under names of one's own.
fn recorded(house: &House) {
    let mut toml = physics();
    toml.remove("print_run");
    toml["dataset"]["calibration_test"] = 2700.into();
    house.write("scenario.toml", toml.to_string());
    house.ok("simulate scenario.toml -o sim --seed 31");
    let labels = house.text("sim/labels.csv");
    house.write("healthy.csv", only_healthy(&labels));
    let own_names = [
        ("PBN", "Verstopfung"),
        ("BN", "Verstopfung"),
        ("AB1", "Luft"),
        ("AB2", "Luft"),
        ("AB3", "Luft"),
    ];
    let renamed = own_names.into_iter().fold(labels, |labels, (state, own)| {
        labels.replace(&format!(",{state},"), &format!(",{own},"))
    });
    house.write("own.csv", renamed);
}

fn judged(house: &House, train: &str) -> Value {
    house.ok(&format!("train {train} -o design.json"));
    house.ok("replay sim/calibration.mcap --design design.json --out out --force");
    house.json("score out/calibration.verdicts.parquet --labels own.csv --json")
}

/// Of a class's flagged signals the share whose best class it is, by `inkling score --json`.
fn right(score: &Value, class: &str) -> f64 {
    taken_for(score, class, class)
}

/// Likewise the share whose best class is this other one.
pub fn taken_for(score: &Value, class: &str, other: &str) -> f64 {
    let isolation = &score["isolation"];
    let classes = isolation["classes"].as_array().unwrap();
    let place = |class: &str| classes.iter().position(|name| name == class).unwrap();
    let row = isolation["confusion"][place(class)].as_array().unwrap();
    let of_class: f64 = row.iter().flat_map(Value::as_f64).sum();
    row[place(other)].as_f64().unwrap() / of_class
}

#[test]
fn own_names_that_are_declared_keep_sizes_labelled_or_not_and_misspelt_ones_are_refused() {
    let house = House::new();
    recorded(&house);
    // beside declared names one that nobody declared is refused
    let labels = house.text("own.csv");
    house.write("misspelt.csv", labels.replace("Verstopfung", "Verstopfug"));
    let train = format!("train sim/train.mcap --labels misspelt.csv -o design.json {DECLARED}");
    house.run(&train).exits(2).says("did you mean Verstopfung?");
    // under their own names, under the thesis's, none at all
    for labels in ["own.csv", "sim/labels.csv", "healthy.csv"] {
        let score = judged(&house, &format!("sim/train.mcap --labels {labels} {DECLARED}"));
        let classes = &score["isolation"]["classes"];
        println!("{labels}: {classes} {}", score["isolation"]["accuracy"]);
        let names = classes.to_string();
        assert!(names.contains("Verstopfung") && names.contains("Luft"), "{names}");
        assert!(!names.contains("BN") && !names.contains("AB"), "{names}");
        let accuracy = score["isolation"]["accuracy"].as_f64().unwrap();
        assert!(accuracy >= 0.95, "{labels}: {accuracy}");
        for own in ["Verstopfung", "Luft"] {
            assert!(right(&score, own) >= 0.9, "{labels}: {own}: {}", score["isolation"]);
        }
        let size = &score["severity"]["Verstopfung"];
        println!("{labels}: {}", score["severity"]);
        assert!(size["r2"].as_f64().unwrap() >= 0.9, "{labels}: {size}");
        let covered = size["coverage95"].as_f64().unwrap();
        assert!((0.88..=1.0).contains(&covered), "{labels}: {size}");
        // a bubble's length and its compliance have no common unit
        assert!(score["severity"]["Luft"].is_null(), "{}", score["severity"]);
    }
    // known to nobody: named by labelled signals alone, and sized where these lie on one curve
    let new = "--new-class Verstopfung --new-class Luft";
    let score = judged(&house, &format!("sim/train.mcap --labels own.csv {new}"));
    for own in ["Verstopfung", "Luft"] {
        assert!(right(&score, own) >= 0.8, "{own}: {}", score["isolation"]);
    }
    let size = &score["severity"]["Verstopfung"];
    assert!(size["r2"].as_f64().unwrap() >= 0.99, "{size}");
    assert!(size["coverage95"].as_f64().unwrap() >= 0.9, "{size}");
    assert!(score["severity"]["Luft"].is_null(), "{}", score["severity"]);
}

/// A class by a law of one's own, and what is no class.
const LAWS: &str = r#"
[isolate.physics."lose Leitung"]
size = "share"
amplitude = 1.0
range = [0.2, 0.9]
category = "sensor_line"
unit = "of the signal"

[isolate.physics."a longer nozzle"]
size = "added"
nozzle_inertance = 1.0
nozzle_resistance = 1.0
range = [0.05, 0.5]
weight = 0.005
"#;

#[test]
fn a_law_of_ones_own_is_a_class_before_any_signal_of_it_was_labelled() {
    let house = House::new();
    house.copy("train.mcap", "train.mcap");
    let labels = shipped("sample_logs/labels.csv");
    house.write("healthy.csv", only_healthy(&labels));
    house.write("laws.toml", LAWS);
    let train = "train train.mcap --labels healthy.csv --config laws.toml -o d.json";
    house.run(train).exits(0).says("10 classes");
    let faulty = |channel: u32| labels.contains(&format!("\ndataset,{channel},"));
    let weak: std::collections::BTreeSet<u32> =
        (0..1140).filter(|c| !faulty(*c)).take(40).collect();
    let scaled = |burst: &Burst| {
        let is_weak = |row: usize| weak.contains(&(burst.first_channel + row as u32));
        with_samples(burst, |row, _, y| if is_weak(row) { 0.6 * y } else { y })
    };
    let bursts: Vec<Burst> = bursts(&sample("train.mcap")).iter().map(scaled).collect();
    house.record("weak.mcap", &bursts);
    let rows: String =
        weak.iter().map(|channel| format!("dataset,{channel},,,lose Leitung,0.4\n")).collect();
    house.write("weak.csv", labels + &rows);
    house.run("replay weak.mcap --design d.json --out out").exits(0);
    let score = house.json("score out/ --labels weak.csv --json");
    let state = &score["by_state"]["lose Leitung"];
    assert!(state["signals"] == 40 && state["flagged"] == 40, "{state}");
    assert!(right(&score, "lose Leitung") > 0.95, "{}", score["isolation"]);
    let size = &score["severity"]["lose Leitung"];
    assert!(size["rmse"].as_f64().unwrap() < 0.05, "{size}");
    let bubbles = right(&score, "AB3");
    assert!(bubbles > 0.9, "known classes keep their names: {bubbles}");
    // the design knows its laws: nobody repeats them, and other ones need another training
    let again =
        "replay weak.mcap --design d.json --out out2 --set isolate.physics.x.size=\"share\"";
    house.run(again).exits(2);
}
