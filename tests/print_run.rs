//! On a print run with known truth: faults are found, healthy channels left alone.

use crate::house::{House, physics};

/// Half the printheads and bursts of the frozen benchmark, the same physics.
fn smaller_print_run() -> String {
    let mut toml = physics();
    toml["print_run"]["printheads"] = 2.into();
    toml["print_run"]["bursts_per_channel"] = 200.into();
    toml["dataset"]["calibration_test"] = 0.into();
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
    let [false_alarms, passed] = ["fp", "tn"].map(|key| score["detection"][key].as_f64().unwrap());
    let false_alarms = false_alarms / (false_alarms + passed);
    // a class that this run does not have counts nothing
    let sum = |key: &str| -> f64 {
        let states =
            ["EC", "AB1", "AB2", "AB3", "BN", "DDN"].map(|class| &score["by_state"][class]);
        states.iter().filter_map(|state| state[key].as_f64()).sum()
    };
    let (flagged, signals) = (sum("flagged"), sum("signals"));
    println!("recall {:.4} of {signals}, false alarms {false_alarms:.6}", flagged / signals);
    assert!(flagged / signals >= 0.95, "recall {} (ramps included)", flagged / signals);
    assert!(false_alarms <= 1e-3, "false alarms {false_alarms}");

    // the same rows over time: every fault but the slightly dried nozzles, and no other
    let episodes = &score["episodes"];
    let [faults, found, category_right] = ["faults", "found", "category_right"].map(|key| {
        let states = episodes["by_state"].as_object().unwrap().iter();
        states
            .filter(|(state, _)| *state != "SDN")
            .map(|(_, of)| of[key].as_u64().unwrap())
            .sum::<u64>()
    });
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
    let judge = |run: &str, options: &str, says: &str, least_recall: f64| {
        let replay =
            format!("replay {run}/print_run.mcap --design design.json --out {run}/out {options}");
        let said = house.run(&replay).exits(0).stderr();
        assert!(said.contains(says), "{said}");
        assert!(
            !said.contains("after later ones"),
            "the order of the file is that of time: {said}"
        );
        let score =
            format!("score {run}/out/print_run.verdicts.parquet --labels {run}/labels.csv --json");
        let episodes = &house.json(&score)["episodes"];
        println!("{replay}: {episodes}");
        assert!(episodes["recall"].as_f64().unwrap() >= least_recall, "{replay}: {episodes}");
        assert!(episodes["false"].as_u64().unwrap() <= 1, "{replay}: {episodes}");
    };
    judge("head", "", "", 0.9);
    judge("head", "--baseline own.json", "", 0.95);
    // a head's first burst comes before what its first window knows, and is no late one
    judge("head", "--identify windows --baseline windows.json", "", 0.95);
    // another head of the same names: its channels are not those that are remembered
    judge("other", "--baseline own.json", "others than those that --baseline remembers", 0.9);
}
