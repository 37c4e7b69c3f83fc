//! Metrics are what Prometheus's text format allows, read strictly; and the rules in docs/ ask for families that there are.

use crate::house::{House, shipped};
use crate::recipes::some;
use inkling::burst::Burst;
use std::collections::{BTreeMap, BTreeSet};

/// The series of a family: labels as they are written, and the value.
type Series = BTreeMap<String, f64>;

/// The families of a text by name. Each has its help, then its type, then its series, each series once.
#[track_caller]
pub fn families(text: &str) -> BTreeMap<String, Series> {
    assert!(text.ends_with('\n'), "no end of line at the end");
    let mut all: BTreeMap<String, Series> = BTreeMap::new();
    let (mut lines, mut open) = (text.lines(), String::new());
    while let Some(line) = lines.next() {
        if let Some(help) = line.strip_prefix("# HELP ") {
            let (name, words) = help.split_once(' ').expect("a help");
            let kind = lines.next().and_then(|of| of.strip_prefix(&format!("# TYPE {name} ")));
            let kind = kind.unwrap_or_else(|| panic!("no type follows {line}"));
            assert!(["gauge", "counter"].contains(&kind) && !words.is_empty(), "{line}: {kind}");
            assert_eq!(kind == "counter", name.ends_with("_total"), "{name} is a {kind}");
            assert!(is_name(name) && all.insert(name.into(), Series::new()).is_none(), "{line}");
            open = name.to_owned();
            continue;
        }
        let (series, value) = line.rsplit_once(' ').unwrap_or_else(|| panic!("{line}: no value"));
        let (name, labels) = match series.split_once('{') {
            Some((name, labels)) => (name, labels.strip_suffix('}').expect("a bracket closes")),
            None => (series, ""),
        };
        assert_eq!(name, open, "{line}: of another family");
        labels_are_sound(labels);
        let value = value.parse().unwrap_or_else(|_| panic!("{line}: no number"));
        let before = all.get_mut(name).expect("a family").insert(labels.into(), value);
        assert!(before.is_none(), "{line}: twice");
    }
    all
}

fn is_name(name: &str) -> bool {
    let is_letter = |c: char| c.is_ascii_alphabetic() || c == '_';
    name.starts_with(is_letter) && name.chars().all(|c| is_letter(c) || c.is_ascii_digit())
}

/// `name="value",...` without a name twice; in a value a quote, a backslash and an end of line are escaped.
#[track_caller]
fn labels_are_sound(labels: &str) {
    let (mut rest, mut names) = (labels, BTreeSet::new());
    while !rest.is_empty() {
        let (name, value) = rest.split_once("=\"").unwrap_or_else(|| panic!("{rest}: no label"));
        assert!(is_name(name) && names.insert(name), "{labels}");
        let mut escaped = false;
        let end = value.find(|c| {
            let is_end = c == '"' && !escaped;
            assert!(!escaped || ['"', '\\', 'n'].contains(&c), "{labels}: \\{c}");
            escaped = c == '\\' && !escaped;
            is_end
        });
        rest = &value[end.unwrap_or_else(|| panic!("{labels}: no quote closes")) + 1..];
        rest = rest.strip_prefix(',').unwrap_or(rest);
    }
}

#[test]
fn a_night_writes_metrics_that_prometheus_reads_and_the_rules_ask_for() {
    let house = House::new();
    let name = "a \"head\"\\ of\nours";
    let odd = some(0, 20).into_iter().map(|b| Burst { printhead: name.into(), ..b });
    house.record("rec/1.mcap", &some(0, 20).into_iter().chain(odd).collect::<Vec<_>>());
    let design = crate::house::root().join("sample_logs/design.json");
    let settings = format!("[input]\nrecordings = [\"rec\"]\ndesign = {design:?}\n");
    house.write("pipeline.toml", settings + "[identify]\nmode = \"design\"\n");
    house.run("night --metrics m.prom").exits(0);
    let text = house.text("m.prom");
    let found = families(&text);
    let open: f64 = found["inkling_open_faults"].values().sum();
    assert!(open > 0.0 && text.contains(r#"printhead="a \"head\"\\ of\nours""#), "{text}");
    assert_eq!(found["inkling_exit_status"][""], 0.0);

    let rules = shipped("docs/alerts.yml");
    let asked = rules.split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
    let asked: BTreeSet<&str> = asked.filter(|word| word.starts_with("inkling_")).collect();
    assert!(asked.len() > 4 && asked.iter().all(|name| found.contains_key(*name)), "{asked:?}");

    // and the page of them names each
    let page = shipped("docs/every_night.md");
    assert!(found.keys().all(|name| page.contains(&format!("`{name}"))), "{:?}", found.keys());
}
