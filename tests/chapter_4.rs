//! thesis Tables 4-1 and 4-3 on the thesis-form data set: its own method gives figures near its own.
//! Bands are asserted on a few seeds; physics.md of the project's makers states means over 20.

use crate::goals::{Goals, Rate};
use crate::house::House;
use inkling::fault::CLASSES;
use inkling::thesis::{self, DataSet};
use std::collections::BTreeMap;

/// A training set of the thesis's size, and as many signals to judge.
fn simulated(seed: u64) -> House {
    let house = House::new();
    house.ok(&format!("simulate sample_logs/scenarios/thesis.toml -o . --seed {seed}"));
    house
}

/// The score of a design that was trained by these labels, by the names of others.
fn scored(house: &House, train: &str, replay: &str, names: &str) -> serde_json::Value {
    house.ok(&format!("train train.mcap -o d.json --labels {train}"));
    house.ok(&format!("replay test.mcap --design d.json --out out --force {replay}"));
    house.json(&format!("score out --labels {names} --json"))
}

#[test]
fn thesis_method_reproduces_detection_and_isolation_within_bands() {
    let (mut detection, mut isolation) = (0.0, 0.0);
    let seeds = [101, 102];
    for seed in seeds {
        let score = scored(&simulated(seed), "labels.csv --preset thesis", "", "labels.csv");
        let count = |key: &str| score["detection"][key].as_f64().unwrap();
        assert_eq!(count("tp") + count("fn"), 2025.0);
        assert_eq!(count("fp") + count("tn"), 2475.0);
        detection += (count("tp") + count("tn")) / 4500.0 / seeds.len() as f64;
        isolation += score["isolation"]["accuracy"].as_f64().unwrap() / seeds.len() as f64;
    }
    println!("FD accuracy {detection:.4} (thesis .979), FI accuracy {isolation:.4} (thesis .801)");
    // one seed scatters by 21 misses of 4500, .005; the mean of two by .0035 about .978
    assert!((0.968..=0.988).contains(&detection), "FD accuracy {detection}");
    assert!((0.77..=0.83).contains(&isolation), "FI accuracy {isolation}");
}

/// Labels of so many signals of each class: nothing is learned of the others. `own`: before the names of classes.
fn few(labels: &str, per_class: usize, own: &str) -> String {
    let (mut seen, mut kept) = (BTreeMap::new(), String::new());
    for line in labels.lines() {
        kept += &match line.split(',').collect::<Vec<_>>()[..] {
            [head, channel, from, to, state, _] if CLASSES.contains(&state) => {
                let n = seen.entry(state).or_insert(0);
                *n += 1;
                let state = if *n > per_class { "ignore".into() } else { own.to_owned() + state };
                format!("{head},{channel},{from},{to},{state},\n")
            }
            _ => format!("{line}\n"),
        };
    }
    kept
}

/// By names that the physics knows, and by own ones.
#[test]
fn a_stated_certainty_holds_with_few_labels() {
    let houses: Vec<House> = (913_005..913_008).map(simulated).collect();
    let mut goals = Goals::default();
    for own in ["", "my-"] {
        let new = CLASSES.map(|class| format!(" --new-class {own}{class}")).concat();
        let new = if own.is_empty() { "" } else { &new };
        for per_class in [3, 5, 10] {
            let [mut certain, mut right] = [Rate::default(); 2];
            for house in &houses {
                let labels = house.text("labels.csv");
                house.write("few.csv", few(&labels, per_class, own));
                house.write("all.csv", few(&labels, usize::MAX, own));
                let train = format!("few.csv{new}");
                let score = scored(house, &train, "--set isolate.gate=false", "all.csv");
                let share = |of: &str| score["certain"][of].as_f64().unwrap_or(0.0);
                let n = (2025.0 * share("coverage")).round();
                certain.count += n as usize;
                certain.of += 2025;
                right.count += (n * share("accuracy")).round() as usize;
                right.of += n as usize;
            }
            let what = format!("{per_class} labels, {own}: certain");
            goals.at_least(&format!("{what} and right"), right, 0.95);
            let is_said = per_class < 10 || certain.share() >= 0.2;
            goals.met(is_said, format!("{what} of {:.2}", certain.share()));
        }
    }
    goals.all_are_met();
}

/// Bands: physics of the project's makers, means over 20 seeds, widened by two standard errors of
/// the mean of four.
#[test]
fn chapter_4_lands_in_its_bands() {
    let seeds = [201, 202, 203, 204];
    let chapter = thesis::simulated(&seeds, 2, || ()).unwrap();
    let of_form = chapter.set(DataSet::ThesisForm).unwrap();
    let drying = chapter.set(DataSet::Drying).unwrap();
    let by_model = chapter.set(DataSet::ByModel).unwrap();
    for (set, key, low, high) in [
        (of_form, "I, 1.12 f0/right", 0.968, 0.988),
        (of_form, "I, 1.12 f0/false alarms", 0.0, 4.0),
        (of_form, "I/misses", 10.0, 60.0),
        (of_form, "LR on r, all/accuracy", 0.78, 0.82),
        (of_form, "LR on r, all/certain", 0.88, 0.94),
        (of_form, "LR on r, all/coverage", 0.50, 0.60),
        (of_form, "1-NN on r, all/accuracy", 0.81, 0.86),
        (of_form, "1-NN on y, all/accuracy", 0.83, 0.88),
        (of_form, "LR on r, tenth/accuracy", 0.75, 0.82),
        // half the training signals lose next to nothing
        (of_form, "LR on r, half/accuracy", 0.77, 0.82),
        (of_form, "LR on r, half/certain", 0.87, 0.94),
        (of_form, "LR on y, half/accuracy", 0.77, 0.84),
        (of_form, "1-NN on r, half/accuracy", 0.79, 0.86),
        (of_form, "default/misses", 0.0, 25.0),
        (of_form, "default/false alarms", 0.0, 4.0),
        (of_form, "default, all/accuracy", 0.905, 0.93),
        (of_form, "default, all/certain", 0.97, 1.0),
        (of_form, "default, all/coverage", 0.77, 0.86),
        (of_form, "default, half/accuracy", 0.90, 0.93),
        // the practice: detects as well as the method here, isolates four of nine classes at most
        (of_form, "practice/right", 0.97, 0.99),
        (of_form, "practice/four classes", 0.38, 0.445),
        (of_form, "practice/of the four", 0.86, 1.0),
        (of_form, "(3-3b)/misses", 5.0, 120.0),
        (of_form, "I, 1.12 f0, maximum/misses", 150.0, 500.0),
        (of_form, "I, 1.12 f0, maximum/false alarms", 0.0, 4.0),
        (of_form, "model matching/models", 9.0, 9.0),
        (drying, "LR on r, all/accuracy", 0.92, 1.0),
        (drying, "I, 1.12 f0/detected", 0.9, 1.0),
        // an independent program: class .681, category .769, the default .973 and .999
        (by_model, "LR on r, all/accuracy", 0.64, 0.72),
        (by_model, "LR on r, all/category", 0.73, 0.81),
        (by_model, "default, all/accuracy", 0.955, 0.985),
        (by_model, "default, all/category", 0.995, 1.0),
    ] {
        let v = set.spread(key).unwrap_or_else(|| panic!("{:?}: {key}", set.set));
        println!("{:?}: {key}: {:.4} ± {:.4}", set.set, v.mean, v.sd);
        assert!((low..=high).contains(&v.mean), "{key}: {}", v.mean);
    }
    let mean = |key: &str| of_form.mean(key);
    // why the text prefers the energy: it goes on growing
    assert!(mean("I, 1.12 f0, maximum/misses") > mean("I, 1.12 f0/misses"));
    // matrices of the text's exact sizes
    for (set, name, sizes) in [
        (of_form, "I, 1.12 f0", &[2475.0, 2025.0][..]),
        (drying, "I, 1.12 f0", &[48.0, 99.0]),
        (of_form, "LR on r", &[225.0; 9]),
        (drying, "LR on r", &[39.0, 60.0]),
    ] {
        let rows = set.confusions[name].counts.iter();
        let mut sums: Vec<f64> = rows.map(|row| row.iter().sum()).collect();
        if name == "LR on r" {
            sums.sort_by(f64::total_cmp);
        }
        assert!(sums.iter().zip(sizes).all(|(s, n)| (s - n).abs() < 1e-6), "{name}: {sums:?}");
    }
    let house = House::new();
    thesis::write(&chapter, None, &house.path(".")).unwrap();
    let tables = house.text("tables.md");
    for title in ["4-1", "4-2", "4-3", "4-4", "4-5", "4-6", "4-7"] {
        assert!(tables.contains(&format!("Table {title}")), "{title}");
    }
    assert!(tables.contains("| faulty |"), "2 x 2 matrices");
    assert!(!tables.contains("NaN"), "{tables}");
    let picture = house.text("mean_residuals.svg");
    assert!(CLASSES.iter().all(|class| picture.contains(class)), "a line for each class");
}
