//! What `score --design` says of a design is what `replay` makes of recordings with it: the share of faults that is found, and
//! the classes that are mistaken for each other.

use crate::house::{House, physics};
use crate::own_classes::taken_for;
use serde_json::Value;

/// The physical scenario, with faults of all the sizes that the promise speaks of.
fn scenario(promise: &Value) -> toml::Table {
    let mut toml = physics();
    toml.remove("print_run");
    for class in promise["classes"].as_array().unwrap() {
        let range = class["range"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap());
        let range: Vec<toml::Value> = range.map(Into::into).collect();
        toml["fault"][class["class"].as_str().unwrap()]["range"] = range.into();
    }
    toml["dataset"]["healthy"] = 50.into();
    toml["dataset"]["calibration_test"] = 9000.into();
    toml
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
        let [a, b] = [0, 1].map(|k| pair["classes"][k].as_str().unwrap());
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
