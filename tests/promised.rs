//! What `score --design` says of a design is what `replay` makes of recordings with it: the share of faults that is found, and
//! the classes that are mistaken for each other.

use crate::house::{House, physics};
use serde_json::Value;

/// The physical scenario, with faults of all the sizes that the promise speaks of.
fn scenario(promise: &Value) -> toml::Table {
    let mut toml = physics();
    toml.remove("print_run");
    for class in promise["classes"].as_array().unwrap() {
        let range: Vec<toml::Value> =
            class["range"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap().into()).collect();
        let fault = toml["fault"][class["class"].as_str().unwrap()].as_table_mut().unwrap();
        fault.insert("range".into(), range.into());
    }
    let dataset = toml["dataset"].as_table_mut().unwrap();
    dataset.insert("healthy".into(), 50.into());
    dataset.insert("calibration_test".into(), 9000.into());
    toml
}

/// Of the flagged signals of a class the share whose best class is another, by `inkling score --json`.
fn taken_for(score: &Value, class: &Value, other: &Value) -> f64 {
    let isolation = &score["isolation"];
    let place = |name: &Value| {
        isolation["classes"].as_array().unwrap().iter().position(|of| of == name).unwrap()
    };
    let row: Vec<f64> = isolation["confusion"][place(class)]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(Value::as_f64)
        .collect();
    row[place(other)] / row.iter().sum::<f64>()
}

#[test]
fn what_a_design_promises_is_what_a_replay_does() {
    let house = House::new();
    let promise = house.json("score --design sample_logs/design.json --json")["promise"].take();
    house.write("scenario.toml", scenario(&promise).to_string());
    house.ok("simulate scenario.toml -o sim --seed 31");
    house.ok("replay sim/calibration.mcap --design sample_logs/design.json --out out --quiet");
    let score = house.json("score out --labels sim/labels.csv --json");
    // a promise weighs sizes by their effect, the scenario all alike
    for class in promise["classes"].as_array().unwrap() {
        let state = &score["by_state"][class["class"].as_str().unwrap()];
        let found = state["flagged"].as_f64().unwrap() / state["signals"].as_f64().unwrap();
        println!("{}: promised {}, found {found}", class["class"], class["found"]);
        assert!((found - class["found"].as_f64().unwrap()).abs() <= 0.08, "{class} {state}");
    }
    let mut told = 0;
    for pair in promise["pairs"].as_array().unwrap() {
        let [a, b] = [0, 1].map(|k| &pair["classes"][k]);
        let mistaken = 0.5 * (taken_for(&score, a, b) + taken_for(&score, b, a));
        let promised = pair["mistaken"].as_f64().unwrap();
        if promised.max(mistaken) > 0.01 {
            println!("{a}, {b}: promised {promised}, mistaken {mistaken}");
            told += 1;
        }
        assert!((mistaken - promised).abs() <= 0.05, "{pair}: {mistaken}");
    }
    assert!(told >= 2, "some are mistaken, so the comparison says something");
}
