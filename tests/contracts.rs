//! What others rely on: settings, schemas, the shipped sample.

use crate::house::{House, root};
use inkling::settings::Settings;

fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

#[test]
fn pipeline_toml_says_every_default() {
    let written: toml::Table = read("pipeline.toml").parse().unwrap();
    let mut defaults = toml::Table::try_from(Settings::default()).unwrap();
    let sample = defaults["input"].as_table_mut().unwrap();
    for key in ["recordings", "design"] {
        sample.insert(key.into(), written["input"][key].clone());
    }
    assert_eq!(written, defaults);
    let text = read("pipeline.toml");
    assert!(text.contains("# oscillations"), "the one key without a default is named");
}

#[test]
fn design_file_has_the_documented_keys() {
    let design: serde_json::Value = serde_json::from_str(&read("sample_logs/design.json")).unwrap();
    let documented: Vec<String> = read("schemas/design.md")
        .lines()
        .filter_map(|l| l.strip_prefix("| `")?.split('`').next().map(str::to_owned))
        .collect();
    let keys = |value: &serde_json::Value, prefix: &str| -> Vec<String> {
        value.as_object().unwrap().keys().map(|k| format!("{prefix}{k}")).collect()
    };
    let mut written = keys(&design, "");
    for (list, prefix) in [("models", "models[]."), ("classes", "classes[].")] {
        written.retain(|k| k != list);
        written.push(format!("{list}[]"));
        written.extend(keys(&design[list][0], prefix));
    }
    assert_eq!(keys(&design["pooled"], "models[]."), keys(&design["models"][0], "models[]."));
    let sorted = |mut v: Vec<String>| {
        v.sort();
        v
    };
    assert_eq!(sorted(written), sorted(documented));
}

/// Recordings are the same within one count, the design within what that does to it.
#[test]
fn sample_logs_regenerate_and_retrain() {
    let house = House::new();
    let scenario = root().join("sample_logs/scenarios/sample.toml");
    house.ok(&format!("simulate {} -o .", scenario.display()));
    for stem in ["train", "print_run"] {
        let shipped = signals(&root().join(format!("sample_logs/{stem}.mcap")));
        let made = signals(&house.path(&format!("{stem}.mcap")));
        assert_eq!(shipped.len(), made.len(), "{stem}: signals");
        let off = shipped
            .iter()
            .flatten()
            .zip(made.iter().flatten())
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(off <= 1.0, "{stem}: off by {off} counts");
    }
    assert_eq!(read("sample_logs/labels.csv").as_bytes(), house.read("labels.csv"));

    house.ok("train train.mcap --labels labels.csv -o design.json");
    let made = house.read_json("design.json");
    let shipped: serde_json::Value =
        serde_json::from_str(&read("sample_logs/design.json")).unwrap();
    assert_eq!(made["signals"], shipped["signals"]);
    for key in ["frequency_hz", "damping_per_s"] {
        let of =
            |d: &serde_json::Value| d["pooled"]["identification"]["poles"][key].as_f64().unwrap();
        assert!((of(&made) / of(&shipped) - 1.0).abs() < 1e-4, "{key}");
    }
}

/// Every usable signal of a recording, counts.
fn signals(path: &std::path::Path) -> Vec<Vec<f64>> {
    use inkling::burst::Acquisition;
    use inkling::io::{Limits, recording::Recording};
    let recording = Recording::open(path, Limits::default()).unwrap();
    let mut reader = recording.reader();
    let mut all = Vec::new();
    for block in recording.blocks().map(Result::unwrap) {
        for acquisition in reader.read(&block).acquisitions {
            let Acquisition::Usable(burst) = acquisition else { panic!("unusable in {path:?}") };
            for row in 0..burst.channels as usize {
                let mut y = vec![0.0; burst.samples_per_channel as usize];
                burst.copy_signal(row, &mut y);
                all.push(y);
            }
        }
    }
    all
}
