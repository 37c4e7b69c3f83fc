//! On a print run with known truth: faults are found, healthy channels left alone.

use crate::house::{House, physics};

/// Half the printheads and bursts of the frozen benchmark, the same physics.
fn smaller_print_run() -> String {
    let mut toml = physics();
    let run = toml["print_run"].as_table_mut().unwrap();
    run.insert("printheads".into(), 2.into());
    run.insert("bursts_per_channel".into(), 200.into());
    toml["dataset"].as_table_mut().unwrap().insert("calibration_test".into(), 0.into());
    toml.to_string()
}

#[test]
fn faults_are_detected_at_few_false_alarms() {
    let house = House::new();
    house.write("scenario.toml", smaller_print_run());
    // trained on one run, judged on another
    house.ok("simulate scenario.toml -o learn --seed 11");
    house.ok("simulate scenario.toml -o judge --seed 12");
    house
        .ok("train learn/train.mcap learn/print_run.mcap --labels learn/labels.csv -o design.json");
    house
        .run("replay judge/print_run.mcap --design design.json --identify windows --out .")
        .exits(0);
    let score = house.json("score print_run.verdicts.parquet --labels judge/labels.csv --json");
    let false_alarms = score["detection"]["fp"].as_f64().unwrap()
        / (score["detection"]["fp"].as_f64().unwrap() + score["detection"]["tn"].as_f64().unwrap());
    let (mut flagged, mut signals) = (0.0, 0.0);
    for class in ["EC", "AB1", "AB2", "AB3", "BN", "DDN"] {
        let state = &score["by_state"][class];
        if state.is_object() {
            flagged += state["flagged"].as_f64().unwrap();
            signals += state["signals"].as_f64().unwrap();
        }
    }
    println!("recall {:.4} of {signals}, false alarms {false_alarms:.6}", flagged / signals);
    assert!(flagged / signals >= 0.95, "recall {} (ramps included)", flagged / signals);
    assert!(false_alarms <= 1e-3, "false alarms {false_alarms}");

    // the same rows over time: every fault but the slightly dried nozzles, and no other
    let episodes = &score["episodes"];
    let (mut faults, mut found, mut category_right) = (0, 0, 0);
    for (state, of) in episodes["by_state"].as_object().unwrap() {
        if state != "SDN" {
            faults += of["faults"].as_u64().unwrap();
            found += of["found"].as_u64().unwrap();
            category_right += of["category_right"].as_u64().unwrap();
        }
    }
    println!("episodes {found} of {faults}, category right of {category_right}: {episodes}");
    assert!(faults >= 15 && found == faults, "{episodes}");
    assert!(category_right as f64 >= 0.9 * faults as f64, "{episodes}");
    assert!(episodes["false"].as_u64().unwrap() <= 1, "{episodes}");
    assert!(episodes["delay_bursts"].as_f64().unwrap() <= 3.0, "{episodes}");
}

#[test]
fn unknown_temperature_is_followed_and_another_head_begins_anew() {
    let house = House::new();
    house.write("scenario.toml", smaller_print_run());
    house.ok("simulate scenario.toml -o head --seed 21");
    house.ok("simulate scenario.toml -o other --seed 22");
    // the fault library was recorded at 25 degrees, the print runs at 21 to 29
    let trained = house.run("train head/train.mcap --labels head/labels.csv -o design.json");
    assert!(trained.stderr().contains("what temperature does was not learned"));
    let episodes = |run: &str, options: &str, says: &str| {
        let replay =
            format!("replay {run}/print_run.mcap --design design.json --out {run}/out {options}");
        let said = house.run(&replay).stderr();
        assert!(said.contains(says), "{said}");
        assert!(
            !said.contains("after later ones"),
            "the order of the file is that of time: {said}"
        );
        let score =
            format!("score {run}/out/print_run.verdicts.parquet --labels {run}/labels.csv --json");
        let score = house.json(&score);
        println!("{replay}: {}", score["episodes"]);
        (
            score["episodes"]["recall"].as_f64().unwrap(),
            score["episodes"]["false"].as_u64().unwrap(),
        )
    };
    let by_design = episodes("head", "", "");
    assert!(by_design.0 >= 0.9 && by_design.1 <= 1, "{by_design:?}");
    let by_own = episodes("head", "--baseline own.json", "");
    assert!(by_own.0 >= 0.95 && by_own.1 <= 1, "{by_own:?}");
    // a head's first burst comes before what its first window knows, and is no late one
    let by_windows = episodes("head", "--identify windows --baseline windows.json", "");
    assert!(by_windows.0 >= 0.95 && by_windows.1 <= 1, "{by_windows:?}");
    // another head of the same names: its channels are not those that are remembered
    let by_others =
        episodes("other", "--baseline own.json", "others than those that --baseline remembers");
    assert!(by_others.0 >= 0.9 && by_others.1 <= 1, "{by_others:?}");
}
