//! A user's own names for faults that the physics knows: they keep sizes and sentences.

use crate::house::{House, root};
use serde_json::Value;

const DECLARED: &str =
    r#"--set isolate.classes={Verstopfung=["PBN","BN"],Luft=["AB1","AB2","AB3"]}"#;

/// Labelled faults by physics, and as many to judge, under names of one's own.
fn recorded(house: &House) {
    let text = std::fs::read_to_string(root().join("sample_logs/scenarios/physics.toml")).unwrap();
    let mut toml: toml::Table = text.parse().unwrap();
    toml.remove("print_run");
    let dataset = toml["dataset"].as_table_mut().unwrap();
    dataset.insert("calibration_test".into(), 2700.into());
    house.write("scenario.toml", toml.to_string());
    house.ok("simulate scenario.toml -o sim --seed 31");
    toml["dataset"].as_table_mut().unwrap().insert("per_fault".into(), 0.into());
    house.write("scenario.toml", toml.to_string());
    house.ok("simulate scenario.toml -o healthy --seed 31");
    let labels = String::from_utf8(house.read("sim/labels.csv")).unwrap();
    let renamed = |state: &str| {
        match state {
            "PBN" | "BN" => "Verstopfung",
            "AB1" | "AB2" | "AB3" => "Luft",
            other => other,
        }
        .to_owned()
    };
    let rename = |line: &str| -> String {
        line.split(',').map(renamed).collect::<Vec<_>>().join(",") + "\n"
    };
    house.write("own.csv", labels.lines().map(rename).collect::<String>());
}

fn judged(house: &House, train: &str) -> Value {
    house.ok(&format!("train {train} -o design.json"));
    house.run("replay sim/calibration.mcap --design design.json --out out --force");
    house.json("score out/calibration.verdicts.parquet --labels own.csv --json")
}

/// Of a class's flagged signals the share whose best class it is.
fn right(score: &Value, class: &str) -> f64 {
    let isolation = &score["isolation"];
    let classes = isolation["classes"].as_array().unwrap();
    let place = classes.iter().position(|name| name == class).unwrap();
    let row: Vec<f64> =
        isolation["confusion"][place].as_array().unwrap().iter().flat_map(Value::as_f64).collect();
    row[place] / row.iter().sum::<f64>()
}

#[test]
fn own_names_that_are_declared_keep_sizes_labelled_or_not() {
    let house = House::new();
    recorded(&house);
    // under their own names, under the thesis's, none at all
    for (labels, least) in [
        ("sim/train.mcap --labels own.csv", 0.95),
        ("sim/train.mcap --labels sim/labels.csv", 0.95),
        ("healthy/train.mcap --labels healthy/labels.csv", 0.95),
    ] {
        let score = judged(&house, &format!("{labels} {DECLARED}"));
        let classes = &score["isolation"]["classes"];
        println!("{labels}: {classes} {}", score["isolation"]["accuracy"]);
        let names = classes.to_string();
        assert!(names.contains("Verstopfung") && names.contains("Luft"), "{names}");
        assert!(!names.contains("BN") && !names.contains("AB"), "{names}");
        let accuracy = score["isolation"]["accuracy"].as_f64().unwrap();
        assert!(accuracy >= least, "{labels}: {accuracy}");
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
    // known to nobody: named all the same, never sized
    let new = "--new-class Verstopfung --new-class Luft";
    let score = judged(&house, &format!("sim/train.mcap --labels own.csv {new}"));
    for own in ["Verstopfung", "Luft"] {
        assert!(right(&score, own) >= 0.8, "{own}: {}", score["isolation"]); // by labelled signals alone
    }
    assert!(score["severity"]["Verstopfung"].is_null(), "{}", score["severity"]);
}

#[test]
fn what_cannot_be_declared_is_refused_in_words() {
    let house = House::new();
    let refused = [
        (r#"{Luft=["AB7"]}"#, "there is no class \"AB7\""),
        (r#"{Luft=[]}"#, "name at least one class"),
        (r#"{BN=["PBN"]}"#, "give a name of your own"),
        (r#"{A=["BN"],B=["BN"]}"#, "BN is taken by \"A\""),
    ];
    for (classes, words) in refused {
        let train =
            format!("train none.mcap --labels none.csv -o d.json --set isolate.classes={classes}");
        house.run(&train).exits(2).says(words);
    }
    let sample = root().join("sample_logs");
    let sample = sample.display();
    let replay = format!("replay {sample}/print_run.mcap --design {sample}/design.json --out out");
    house.run(&format!("{replay} {DECLARED}")).exits(2).says("train again with these settings");
}

#[test]
fn a_label_beside_declared_ones_that_nobody_declared_is_refused() {
    let house = House::new();
    recorded(&house);
    let labels = String::from_utf8(house.read("own.csv")).unwrap();
    house.write("misspelt.csv", labels.replace("Verstopfung", "Verstopfug"));
    let train = format!("train sim/train.mcap --labels misspelt.csv -o design.json {DECLARED}");
    house.run(&train).exits(2).says("did you mean Verstopfung?");
    house.run(&train.replace("misspelt", "own")).exits(0);
}
