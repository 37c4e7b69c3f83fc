//! What others rely on: settings, schemas, the shipped sample.

use crate::house::{House, between, root, shipped, shipped_json};
use crate::recipes::is_inert;
use crate::recorded::{bursts, rows, sample};
use inkling::design::Design;
use inkling::settings::Settings;
use serde_json::json;
use std::collections::BTreeSet;
use std::path::Path;

#[test]
fn pipeline_toml_says_every_default() {
    let written: toml::Table = shipped("pipeline.toml").parse().unwrap();
    let mut defaults = toml::Table::try_from(Settings::default()).unwrap();
    let sample = defaults["input"].as_table_mut().unwrap();
    for key in ["recordings", "design"] {
        sample.insert(key.into(), written["input"][key].clone());
    }
    assert_eq!(written, defaults);
    let text = shipped("pipeline.toml");
    for key in [
        "oscillations =",
        "oscillations_of_ring =",
        "bounds =",
        "pulse_s =",
        "waveform =",
        "delay_s =",
        "[isolate.physics.",
    ] {
        assert!(text.contains(&format!("# {key}")), "{key} has no default, and is named");
    }
}

#[test]
fn design_file_has_the_documented_keys() {
    let design = shipped_json("sample_logs/design.json");
    assert_eq!(keys(&design["pooled"], &[]), keys(&design["models"][0], &[]));
    let named = names("design.md", 0).into_iter();
    let named = named.map(|name| name.trim_end_matches("[]").to_owned());
    let written = keys(&design, &["models[]", "classes[]"]);
    assert_eq!(written.into_iter().collect::<BTreeSet<_>>(), named.collect());
}

/// A key or column of a table in `schemas/`.
struct Documented {
    name: String,
    /// It need not be there.
    may_be_absent: bool,
}

/// The rows of one of a schema's tables, from 0; what stands in a further column of backticks is another name.
fn documented(schema: &str, table: usize) -> Vec<Documented> {
    let text = shipped(&format!("schemas/{schema}"));
    let mut tables = vec![Vec::new()];
    for line in text.lines() {
        match line.strip_prefix("| `") {
            Some(row) => {
                let (names, meaning) = row.split_once(" |").unwrap();
                let may_be_absent = meaning.contains("absent");
                for name in names.split("`, `") {
                    let name = name.trim_end_matches('`').to_owned();
                    tables.last_mut().unwrap().push(Documented { name, may_be_absent });
                }
            }
            None if line.starts_with("|---") => tables.push(Vec::new()),
            None => {}
        }
    }
    tables.into_iter().filter(|rows| !rows.is_empty()).nth(table).expect("a table")
}

fn names(schema: &str, table: usize) -> Vec<String> {
    documented(schema, table).into_iter().map(|of| of.name).collect()
}

/// The keys of an object, and those below some of them: in a list's first entry (`causes[]`), or in an object.
fn keys(written: &serde_json::Value, below: &[&str]) -> Vec<String> {
    let mut all = Vec::new();
    for of in std::iter::once(&"").chain(below) {
        let (value, prefix) = match of.strip_suffix("[]") {
            Some(list) => (&written[list][0], format!("{of}.")),
            None if of.is_empty() => (written, String::new()),
            None => (&written[of], format!("{of}.")),
        };
        let object = value.as_object().unwrap_or_else(|| panic!("{of}: {value}"));
        all.extend(object.keys().map(|key| format!("{prefix}{key}")));
    }
    all
}

/// Whether a table names every key that is written, and every key it names is written. Of what it says below
/// a key only `below` is compared.
fn is_documented(schema: &str, table: usize, written: &serde_json::Value, below: &[&str]) {
    let written_keys = keys(written, below);
    let documented = documented(schema, table);
    for key in &written_keys {
        let named = |d: &Documented| d.name == *key || d.name == format!("{key}[]");
        assert!(documented.iter().any(named), "schemas/{schema} does not name {key}");
    }
    for key in documented.iter().filter(|key| !key.may_be_absent) {
        let name = key.name.trim_end_matches("[]");
        let is_below = |of: &&str| key.name.starts_with(&format!("{of}."));
        if !name.contains(['.', '[']) || below.iter().any(is_below) {
            assert!(
                written_keys.iter().any(|k| k == name),
                "schemas/{schema}: {name} is not written"
            );
        }
    }
}

#[test]
fn what_a_replay_leaves_has_the_documented_keys() {
    let house = House::new();
    house.replay("sample_logs/print_run.mcap --baseline b.json").exits(0);
    is_documented("summary.md", 0, &house.read_json("out/print_run.summary.json"), &[]);
    let journal = house.text("out/journal.jsonl");
    let line = serde_json::from_str(journal.lines().next().unwrap()).unwrap();
    is_documented("journal.md", 0, &line, &[]);
    is_documented("journal.md", 1, &house.read_json("out/run.json"), &[]);
    is_documented("baseline.md", 0, &house.read_json("b.json"), &[]);
    let labels = shipped("sample_logs/labels.csv");
    let header: Vec<&str> = labels.lines().next().unwrap().split(',').collect();
    assert_eq!(header, names("labels.md", 0));
}

#[test]
fn what_a_critique_leaves_has_the_documented_keys_and_its_page_quotes_it() {
    let house = House::new();
    // one effect: an interference of fixed phase, two detection limits
    house.ok("simulate sample_logs/scenarios/hidden.toml -o blind --hide 26");
    let truth = house.read_json("blind/sealed/truth.json");
    is_documented("truth.md", 0, &truth, &[]);
    house.ok("critique blind/print_run.mcap -o c");
    let critique = house.read_json("c/critique.json");
    is_documented("critique.md", 0, &critique, &["causes[]", "gain"]);
    let file = std::fs::File::open(house.path("c/evidence.parquet")).unwrap();
    let reader = parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder::try_new(file);
    let schema = reader.unwrap().schema().clone();
    let written: Vec<_> = schema.fields().iter().map(|f| f.name().as_str()).collect();
    assert_eq!(written, names("critique.md", 1));
    is_inert(&house.text("c/report.html"));
    let page = shipped("docs/critique.md");
    let said = critique["sentence"].as_str().unwrap();
    assert!(page.contains(&format!("\n> {said}\n")), "docs/critique.md quotes another: {said}");
    let hz = truth["effects"][0]["value"].as_f64().unwrap();
    assert!(page.contains(&format!("a `tone` at {hz:.0} Hz")), "docs/critique.md: {hz}");
}

/// Recordings are the same within one count, the design within what that does to it.
#[test]
fn sample_logs_regenerate_and_retrain() {
    let house = House::new();
    house.ok("simulate sample_logs/scenarios/sample.toml -o .");
    for name in ["train.mcap", "print_run.mcap"] {
        let (shipped, made) = (signals(&sample(name)), signals(&house.path(name)));
        assert_eq!(shipped.len(), made.len(), "{name}: signals");
        let pairs = shipped.iter().flatten().zip(made.iter().flatten());
        let off = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off <= 1.0, "{name}: off by {off} counts");
    }
    assert_eq!(shipped("sample_logs/labels.csv").as_bytes(), house.read("labels.csv"));

    house.ok("train train.mcap --labels labels.csv -o design.json");
    let made = house.read_json("design.json");
    let shipped = shipped_json("sample_logs/design.json");
    assert_eq!(made["signals"], shipped["signals"]);
    for key in ["frequency_hz", "damping_per_s"] {
        let of =
            |d: &serde_json::Value| d["pooled"]["identification"]["poles"][key].as_f64().unwrap();
        assert!((of(&made) / of(&shipped) - 1.0).abs() < 1e-4, "{key}");
    }
}

/// Every signal of a recording, counts.
fn signals(path: &Path) -> Vec<Vec<f64>> {
    bursts(path).iter().flat_map(rows).collect()
}

#[test]
fn the_page_of_versions_has_each_schema_and_its_version() {
    let page = shipped("docs/versions.md");
    let mut compared = 0;
    for file in std::fs::read_dir(root().join("schemas")).unwrap() {
        let name = file.unwrap().file_name().into_string().unwrap();
        if !name.ends_with(".md") {
            continue;
        }
        let schema = shipped(&format!("schemas/{name}"));
        let heading = schema.lines().next().unwrap();
        let (_, version) = heading.rsplit_once(", version ").expect("a version in the heading");
        let row = page.lines().find(|line| line.contains(&format!("schemas/{name}")));
        let row = row.unwrap_or_else(|| panic!("docs/versions.md has no {name}"));
        assert!(row.contains(&format!("| {version} |")), "{row} is version {version}");
        compared += 1;
    }
    assert!(compared >= 10);
    let design = shipped("schemas/design.md");
    assert!(
        design.starts_with(&format!("# The design file, version {}", inkling::design::VERSION))
    );
}

/// The first column of the table below a heading.
fn in_table_below(page: &str, heading: &str) -> Vec<String> {
    let rows = between(page, &format!("## {heading}\n"), "\n## ").lines();
    rows.filter_map(|row| Some(row.strip_prefix("| `")?.split('`').next()?.to_owned())).collect()
}

#[test]
fn every_dependency_has_its_reason() {
    let page = shipped("docs/dependencies.md");
    let manifest = |path: &str| -> toml::Table { shipped(path).parse().unwrap() };
    let of = |table: &toml::Value| -> Vec<String> {
        table.as_table().unwrap().keys().cloned().collect()
    };
    let of_inkling = [
        "Cargo.toml",
        "crates/inkling-core/Cargo.toml",
        "crates/inkling-io/Cargo.toml",
        "crates/inkling-lab/Cargo.toml",
    ];
    let mut built_in = Vec::new();
    for (paths, heading) in [
        (&of_inkling[..], "inkling"),
        (&["fleet/Cargo.toml"], "inkling-fleet"),
        (&["python/Cargo.toml"], "inkling-python"),
    ] {
        let mut all = Vec::new();
        for manifest in paths.iter().map(|path| manifest(path)) {
            all.extend(of(&manifest["dependencies"]));
            let targets = manifest.get("target").and_then(toml::Value::as_table);
            for target in targets.iter().flat_map(|targets| targets.values()) {
                all.extend(of(&target["dependencies"]));
            }
        }
        all.retain(|name| !name.starts_with("inkling")); // its own crates
        all.sort();
        all.dedup();
        assert_eq!(in_table_below(&page, heading), all, "{paths:?}");
        built_in.extend(all);
    }
    // what the program is built of is there for tests, too
    let mut for_tests = of(&manifest("Cargo.toml")["dev-dependencies"]);
    for_tests.retain(|name| !built_in.contains(name));
    assert_eq!(in_table_below(&page, "Tests and benchmarks"), for_tests);
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

/// Training ends with this look at what it made, and an executor of a fleet begins with it.
#[test]
fn a_design_with_numbers_that_no_filter_can_use_is_told_by_their_key() {
    let good = shipped_json("sample_logs/design.json");
    let numerator = good["pooled"]["generator"]["numerator"].as_array().unwrap().len();
    for (place, value, word) in [
        ("/models/0/expected/3", json!(1e308), "`expected`"),
        ("/models/0/generator/denominator/1", json!(-30.0), "unstable"),
        ("/models/0/median_statistic", json!(1e-300), "`median_statistic`"),
        ("/models/0/identification/poles/frequency_hz", json!(0), "frequency_hz`"),
        ("/pooled/noise", json!(-17.0), "`noise`"),
        ("/pooled/generator/numerator", json!(vec![0.0; numerator]), "lets nothing through"),
    ] {
        let mut design = good.clone();
        *design.pointer_mut(place).unwrap_or_else(|| panic!("no {place}")) = value;
        let design: Design = serde_json::from_value(design).unwrap();
        let told = design.check().unwrap_err().to_string();
        assert!(told.contains(word), "{place}: {told}");
    }
}
