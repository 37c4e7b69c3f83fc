//! Page, list, JSON, mail, metrics and table of faults put the statements of `account.json` into words, and each of these
//! stands on rows of the tables.

use crate::house::{House, root};
use crate::prometheus::families;
use crate::recipes::{on_day, some};
use crate::recorded::{batches, cells, texts};
use arrow_array::types::{Float32Type, TimestampNanosecondType, UInt32Type};
use serde_json::Value;

/// A signal that is not healthy.
struct Flagged {
    printhead: String,
    channel: u64,
    at_ns: i64,
    category: Option<String>,
    severity: Option<f64>,
}

fn flagged(house: &House, verdicts: &str) -> Vec<Flagged> {
    let mut all = Vec::new();
    for batch in batches(&house.path(verdicts)) {
        let (heads, outcomes) = (texts(&batch, "printhead"), texts(&batch, "outcome"));
        let (channels, times) = (
            cells::<UInt32Type>(&batch, "channel"),
            cells::<TimestampNanosecondType>(&batch, "acquired_at"),
        );
        let (categories, sizes) =
            (texts(&batch, "category"), cells::<Float32Type>(&batch, "severity"));
        for row in 0..batch.num_rows() {
            if matches!(outcomes[row].as_deref(), Some("faulty" | "undecided")) {
                all.push(Flagged {
                    printhead: heads[row].clone().expect("a printhead"),
                    channel: channels[row].expect("a channel").into(),
                    at_ns: times[row].expect("a time"),
                    category: categories[row].clone(),
                    severity: sizes[row].map(f64::from),
                });
            }
        }
    }
    all
}

fn ns(time: &Value) -> i64 {
    let text = time.as_str().expect("a time");
    chrono::DateTime::parse_from_rfc3339(text).unwrap().timestamp_nanos_opt().unwrap()
}

fn of_kinds<'a>(account: &'a Value, kinds: &[&str]) -> Vec<&'a Value> {
    let all = account["statements"].as_array().expect("statements").iter();
    all.filter(|of| kinds.contains(&of["kind"].as_str().unwrap())).collect()
}

fn sentences<'a>(of: impl IntoIterator<Item = &'a Value>) -> Vec<String> {
    of.into_iter().map(|of| of["sentence"].as_str().expect("a sentence").to_owned()).collect()
}

#[test]
fn all_tellers_tell_the_statements_of_the_account_and_rows_stand_behind_each() {
    let house = House::new();
    house.ok("replay sample_logs/print_run.mcap --design sample_logs/design.json --out out -q");
    let list = house.ok("report out -o page.html");
    let (account, told) = (house.read_json("out/account.json"), house.json("report out --json"));
    let faults = of_kinds(&account, &["fault", "past_fault"]);
    assert!(faults.len() >= 6, "{}", faults.len());

    // 1. the same sentences in JSON and in the table, and the same faults on the page and in the list
    let in_account = sentences(faults.iter().copied());
    assert_eq!(in_account, sentences(told["faults"].as_array().expect("faults")));
    let table = batches(&house.path("page.faults.parquet"));
    let in_table: Vec<String> =
        table.iter().flat_map(|batch| texts(batch, "sentence")).flatten().collect();
    assert_eq!(in_account, in_table);
    let page = house.text("page.html");
    for fault in of_kinds(&account, &["fault"]) {
        let (head, channel) = (fault["printhead"].as_str().unwrap(), &fault["channel"]);
        let urgency = format!("{:.2}", fault["fault"]["urgency"].as_f64().unwrap());
        let line = list.lines().find(|line| {
            let words: Vec<&str> = line.split_whitespace().collect();
            words.len() > 3 && words[..3] == [&urgency, head, &channel.to_string()]
        });
        assert!(line.is_some(), "{head} {channel} in {list}");
        assert!(page.contains(&format!("urgency {urgency}")), "{head} {channel} on the page");
    }
    assert_eq!(
        account["complete"], told["coverage"]["complete"],
        "what is known of the whole is one thing"
    );

    // 2. the rows
    let rows = flagged(&house, "out/print_run.verdicts.parquet");
    for fault in faults {
        let (from, to) = (ns(&fault["rows"]["from"]), ns(&fault["rows"]["to"]));
        let of_fault = rows.iter().filter(|of| {
            Some(of.printhead.as_str()) == fault["printhead"].as_str()
                && Some(of.channel) == fault["channel"].as_u64()
                && (from..=to).contains(&of.at_ns)
        });
        let of_fault: Vec<&Flagged> = of_fault.collect();
        assert_eq!(Some(of_fault.len() as u64), fault["signals"].as_u64(), "{fault}");
        let category = fault["fault"]["category"].as_str();
        let named = || of_fault.iter().rev().filter(|of| of.category.as_deref() == category);
        let last = named().next().expect("a signal that carries the name");
        assert_eq!(last.at_ns, ns(&fault["as_of"]), "{fault}");
        let size = fault["fault"]["severity"].as_f64();
        let is_a_row = |size: f64| named().any(|of| of.severity == Some(size));
        assert!(size.is_none_or(is_a_row), "{size:?} stands in no row of {fault}");
    }
}

#[test]
fn the_mail_and_the_metrics_of_a_night_tell_its_account() {
    let house = House::new();
    let design = root().join("sample_logs/design.json");
    let settings = format!("[input]\nrecordings = [\"rec\"]\ndesign = {design:?}\n");
    let rest = "[identify]\nmode = \"design\"\n[output]\ndir = \"out\"\n";
    house.write("pipeline.toml", settings + rest);
    house.record("rec/1.mcap", &some(0, 20));
    house.ok("night");
    house.record("rec/2.mcap", &on_day(1, 20));
    let mail = house.ok("night --metrics m.prom");
    let account = house.read_json("out/account.json");

    // 1. whatever the mail says of a channel stands in the account
    let statements = of_kinds(&account, &["fault", "past_fault"]);
    let told: Vec<&str> = mail
        .lines()
        .filter_map(|line| line.strip_prefix("  "))
        .filter(|l| l.contains(" channel "))
        .collect();
    assert!(!told.is_empty(), "{mail}");
    for line in told {
        let is_line = |of: &&Value| {
            let head = of["printhead"].as_str().unwrap();
            line == format!("{head} {}", of["sentence"].as_str().unwrap())
        };
        assert!(statements.iter().any(is_line), "{line} stands in no statement");
    }

    // 2. the metrics count its statements and signals
    let metrics = families(&house.text("m.prom"));
    let open: f64 = metrics["inkling_open_faults"].values().sum();
    assert_eq!(open, of_kinds(&account, &["fault"]).len() as f64);
    let signals = |key: &str| account["signals"][key].as_f64().unwrap();
    assert_eq!(metrics["inkling_signals_total"][""], signals("judged") + signals("not_judged"));
}
