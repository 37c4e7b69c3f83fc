//! `inkling report` over fifteen days of a simulated print run: six faulty channels are six lines with their onsets.

use crate::by_hand::START_S;
use crate::house::{House, shipped};
use crate::recipes::is_inert;
use crate::recorded::bursts;
use crate::several::fault;
use inkling::burst::Burst;
use serde_json::Value;

const HOUR_S: i64 = 3600;
const DAY_S: i64 = 24 * HOUR_S;

/// When a fault began, s since the start of the scenario.
fn began_s(fault: &Value) -> i64 {
    let began = fault["began_at"].as_str().expect("a time");
    chrono::DateTime::parse_from_rfc3339(began).expect("a time").timestamp() - START_S
}

/// Between two bursts of a channel, s.
const EVERY_S: i64 = 720;
const DAYS: i64 = 15;
/// Recordings begin every six hours, and take three.
const RECORDING_S: i64 = 6 * HOUR_S;

/// What is faulty from when (days) to when.
const FAULTS: [(&str, u32, &str, f64, f64); 5] = [
    ("cyan-1", 3, "IDN", 1.8, 8.3),
    ("cyan-1", 10, "PBN", 0.4, 2.55),
    ("magenta-1", 5, "EC", 0.35, 12.1),
    ("magenta-1", 7, "BN", 0.97, 5.6),
    ("magenta-1", 20, "AB3", 4.0, 13.9),
];
/// Dries every night, and is cured.
const EVERY_NIGHT: (&str, u32, &str, f64) = ("cyan-1", 17, "DDN", 2.5);

fn scenario() -> String {
    let text = shipped("sample_logs/scenarios/sample.toml");
    let (physics, _) = text.split_once("[print_run]").unwrap();
    let mut scenario = physics.replace("swing_c = 4.0", "swing_c = 0.5");
    let bursts = DAYS * DAY_S / EVERY_S;
    scenario += &format!(
        "[print_run]\nprintheads = 2\nnames = [\"cyan-1\", \"magenta-1\"]\nchannels = 24\n\
         bursts_per_channel = {bursts}\ninterval_s = {EVERY_S}.0\n"
    );
    let s = |days: f64| days * DAY_S as f64;
    for (head, channel, class, severity, from) in FAULTS {
        let span = (s(from), s(DAYS as f64));
        scenario += &fault((head, channel as usize), (class, severity), span);
    }
    let (head, channel, class, severity) = EVERY_NIGHT;
    for day in 0..DAYS {
        let span = (s(day as f64 + 0.74), s((day as f64 + 1.12).min(DAYS as f64)));
        scenario += &fault((head, channel as usize), (class, severity), span);
    }
    scenario
}

/// Of the long run, the first three of every six hours: 60 recordings.
fn record(house: &House) {
    house.write("scenario.toml", scenario());
    house.ok("simulate scenario.toml -o run");
    let all = bursts(&house.path("run/print_run.mcap"));
    let of = |b: &Burst| b.t_acq_ns / 1_000_000_000 - START_S;
    for k in 0..DAYS * DAY_S / RECORDING_S {
        let from = k * RECORDING_S;
        let within = |b: &&Burst| (from..from + RECORDING_S / 2).contains(&of(b));
        let some: Vec<Burst> = all.iter().filter(within).cloned().collect();
        house.record(&format!("rec/{k:02}.mcap"), &some);
    }
}

/// The first burst in a recording from a time on, s.
fn first_seen(from_s: i64) -> i64 {
    let burst = (from_s + EVERY_S - 1) / EVERY_S * EVERY_S;
    match burst % RECORDING_S {
        within if within < RECORDING_S / 2 => burst,
        _ => (burst / RECORDING_S + 1) * RECORDING_S,
    }
}

#[test]
fn sixty_recordings_with_six_faulty_channels_are_six_lines_with_their_onsets() {
    let house = House::new();
    record(&house);
    let ended = house.replay("rec").exits(0);
    let closing = ended.stdout();
    let (_, list) = closing.split_once("to clean after").expect("the list comes last");
    assert!(list.lines().count() < 15, "{list}");

    let told = house.ok("report out -o page/report.html");
    assert!(told.contains("6 channels"), "{told}");
    let told = house.json("report out --json");
    let found = told["faults"].as_array().expect("faults");
    let key = |fault: &Value| {
        let head = fault["printhead"].as_str().expect("a printhead").to_owned();
        (head, fault["channel"].as_u64().expect("a channel") as u32)
    };
    let mut channels: Vec<(String, u32)> = found.iter().map(key).collect();
    channels.sort_unstable();
    let mut truth: Vec<(String, u32)> = FAULTS.iter().map(|f| (f.0.to_owned(), f.1)).collect();
    truth.push((EVERY_NIGHT.0.to_owned(), EVERY_NIGHT.1));
    truth.sort_unstable();
    assert_eq!(channels, truth, "{found:#?}");

    let of = |head: &str, channel: u32| {
        found.iter().find(|fault| key(fault) == (head.to_owned(), channel)).unwrap()
    };
    // faults grow over five bursts, and the onset is an estimate
    let tolerance_s = 5 * EVERY_S;
    for (head, channel, class, _, from) in FAULTS {
        let fault = of(head, channel);
        let since = first_seen((from * DAY_S as f64) as i64);
        assert!((began_s(fault) - since).abs() <= tolerance_s, "{class} since {since} s: {fault}");
        assert!(fault["ended_at"].is_null() && fault["urgency"].as_f64() > Some(0.0), "{fault}");
        assert!(fault["recordings"].as_u64() >= Some(4), "{fault}");
        assert_eq!(fault["category"], inkling::fault::category(class), "{fault}");
    }
    let night = of(EVERY_NIGHT.0, EVERY_NIGHT.1);
    let since = first_seen((0.74 * DAY_S as f64) as i64);
    assert!((began_s(night) - since).abs() <= tolerance_s, "since {since} s: {night}");
    let is_told = night["sentence"].as_str().is_some_and(|of| of.contains("times"));
    assert!(is_told && night["episodes"].as_u64() >= Some(15), "cures are told: {night}");
    let urgency = |fault: &Value| fault["urgency"].as_f64();
    assert!(found.is_sorted_by(|a, b| urgency(a) >= urgency(b)), "most urgent first");

    let page = house.text("page/report.html");
    assert!(page.len() < 5_000_000, "{} bytes", page.len());
    for fault in found {
        let action = fault["action"].as_str().expect("an action");
        assert!(page.contains(&format!("<b>{action}</b>")), "{fault}");
    }
    assert_eq!(page.matches("data:image/png;base64,").count(), 2, "a map a printhead");
    is_inert(&page);
}
