//! On a print run with known truth: faults are found, healthy channels left alone.

use crate::house::{House, physics};
use crate::recorded::{bursts, sample, with_samples};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use std::cell::RefCell;

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

/// The noise of the sample is 12 counts.
#[test]
fn a_printhead_that_is_louder_or_noisier_as_a_whole_is_told() {
    let house = House::new();
    let rng = RefCell::new(ChaCha8Rng::seed_from_u64(1));
    for (gain, noise) in [(0.5, 0.0), (2.0, 0.0), (8.0, 0.0), (1.0, 36.0), (1.0, 0.0)] {
        let other = |y: f64| {
            let more: f64 = rng.borrow_mut().sample(StandardNormal);
            gain * y + noise * more
        };
        let all = bursts(&sample("print_run.mcap"));
        let head = all.into_iter().filter(|of| &*of.printhead == "cyan-1");
        let changed: Vec<_> = head.map(|of| with_samples(&of, |_, _, y| other(y))).collect();
        house.record("r.mcap", &changed);
        let run = house.run("replay r.mcap --design sample_logs/design.json --out out --force");
        let told = run.stderr();
        let times =
            told.split(" times as large").next().and_then(|before| before.split(' ').next_back());
        let times: Option<f64> = times.and_then(|times| times.parse().ok());
        assert_eq!(times.is_some(), gain != 1.0, "{gain} {noise}: {told}");
        assert!(times.is_none_or(|times| (times / gain - 1.0).abs() < 0.05), "{gain}: {told}");
        assert_eq!(told.contains("hold more than the ring"), noise > 0.0, "{gain} {noise}: {told}");
    }
}

/// As an amplifier does that was set anew, on all printheads, after the design was trained.
#[test]
fn a_gain_of_a_half_more_costs_no_name() {
    let house = House::new();
    for gain in [1.2, 1.45] {
        let all = bursts(&sample("print_run.mcap"));
        let changed: Vec<_> =
            all.iter().map(|of| with_samples(of, |_, _, y| (gain * y).round())).collect();
        house.record("print_run.mcap", &changed);
        house.ok("replay print_run.mcap --design sample_logs/design.json --out out --force");
        let score = "score out/print_run.verdicts.parquet --labels sample_logs/labels.csv --json";
        let score = house.json(score);
        println!("{gain}: {} {}", score["detection"], score["episodes"]);
        assert_eq!(score["episodes"]["false"], 0, "{gain}");
        assert_eq!(score["episodes"]["category_accuracy"], 1.0, "{gain}");
        // the stated rate allows 6 of 8322
        assert!(score["detection"]["fp"].as_u64().unwrap() <= 12, "{gain}: {}", score["detection"]);
        assert!(score["detection"]["fn"].as_u64().unwrap() <= 12, "{gain}: {}", score["detection"]);
    }
}
