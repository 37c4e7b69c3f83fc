//! `inkling report` over fifteen days of a simulated print run: six faulty channels are six lines with their onsets.

use crate::by_hand::START_S;
use crate::house::{House, root, shipped};
use crate::recipes::is_inert;
use crate::recorded::{batches, bursts, cells, texts};
use crate::several::fault;
use arrow_array::RecordBatch;
use arrow_array::types::{Float32Type, TimestampNanosecondType, UInt32Type};
use inkling::burst::Burst;

const HOUR_S: i64 = 3600;
const DAY_S: i64 = 24 * HOUR_S;

/// A row of `report.faults.parquet`.
#[derive(Clone, Debug)]
struct Row {
    printhead: String,
    channel: u32,
    category: Option<String>,
    /// s since the start of the scenario.
    began_s: i64,
    is_on: bool,
    recordings: u32,
    episodes: u32,
    urgency: f32,
    action: String,
    sentence: String,
}

fn rows(batch: &RecordBatch) -> Vec<Row> {
    let text = |name: &str| texts(batch, name);
    let time = |name: &str| cells::<TimestampNanosecondType>(batch, name);
    let count = |name: &str| cells::<UInt32Type>(batch, name);
    (0..batch.num_rows())
        .map(|i| Row {
            printhead: text("printhead")[i].clone().unwrap(),
            channel: count("channel")[i].unwrap(),
            category: text("category")[i].clone(),
            began_s: time("began_at")[i].unwrap() / 1_000_000_000 - START_S,
            is_on: time("ended_at")[i].is_none(),
            recordings: count("recordings")[i].unwrap(),
            episodes: count("episodes")[i].unwrap(),
            urgency: cells::<Float32Type>(batch, "urgency")[i].unwrap(),
            action: text("action")[i].clone().unwrap(),
            sentence: text("sentence")[i].clone().unwrap(),
        })
        .collect()
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
fn counts_of_other_verdicts_or_damaged_ones_are_made_anew() {
    let house = House::new();
    let all = bursts(&root().join("sample_logs/print_run.mcap"));
    house.record("rec/a.mcap", &all);
    house.record("rec/b.mcap", &all[..all.len() / 2]);
    house.ok("replay rec --design sample_logs/design.json --out out");
    let told = || house.json("report out --json");
    let (whole, counts) = (told(), house.read("out/.a.counts"));
    let mut damaged = counts.clone();
    let last = damaged.len() - 9;
    damaged[last] ^= 1;
    house.write("out/.a.counts", &damaged);
    assert_eq!(told(), whole);
    house.write("out/.a.counts", &counts);
    assert_eq!(told(), whole);
    // the table of another recording in the place of this one's
    house.write("out/a.verdicts.parquet", house.read("out/b.verdicts.parquet"));
    let other = told();
    assert_ne!(other, whole);
    house.remove("out/.a.counts");
    assert_eq!(told(), other);
}

#[test]
fn of_tables_of_a_recording_by_other_settings_the_newer_one_counts() {
    let house = House::new();
    house.copy("print_run.mcap", "rec/a.mcap");
    house.ok("replay rec --design sample_logs/design.json --out out");
    house.copy("print_run.mcap", "rec/moved/a.mcap");
    house.remove("rec/a.mcap");
    house.ok("replay rec --design sample_logs/design.json --out out --set isolate.certainty=0.99");
    let notes = house.json("report out --json")["notes"].to_string();
    assert!(notes.contains("out/a.verdicts.parquet: verdicts of a recording"), "{notes}");
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
    let found = batches(&house.path("page/report.faults.parquet"));
    let found: Vec<Row> = found.iter().flat_map(rows).collect();
    let mut channels: Vec<(&str, u32)> =
        found.iter().map(|row| (row.printhead.as_str(), row.channel)).collect();
    channels.sort_unstable();
    let mut truth: Vec<(&str, u32)> = FAULTS.iter().map(|f| (f.0, f.1)).collect();
    truth.push((EVERY_NIGHT.0, EVERY_NIGHT.1));
    truth.sort_unstable();
    assert_eq!(channels, truth, "{found:#?}");

    let row = |head: &str, channel: u32| {
        found.iter().find(|row| row.printhead == head && row.channel == channel).unwrap()
    };
    // faults grow over five bursts, and the onset is an estimate
    let tolerance_s = 5 * EVERY_S;
    for (head, channel, class, _, from) in FAULTS {
        let row = row(head, channel);
        let since = first_seen((from * DAY_S as f64) as i64);
        assert!((row.began_s - since).abs() <= tolerance_s, "{class} since {since} s: {row:?}");
        assert!(row.is_on && row.recordings >= 4 && row.urgency > 0.0, "{row:?}");
        assert_eq!(row.category.as_deref(), Some(inkling::fault::category(class)), "{row:?}");
    }
    let night = row(EVERY_NIGHT.0, EVERY_NIGHT.1);
    let since = first_seen((0.74 * DAY_S as f64) as i64);
    assert!((night.began_s - since).abs() <= tolerance_s, "since {since} s: {night:?}");
    assert!(night.sentence.contains("times"), "cures are told: {night:?}");
    assert!(night.episodes >= 15, "{night:?}");
    assert!(found.is_sorted_by(|a, b| a.urgency >= b.urgency), "most urgent first");

    // the page says what the table says
    let page = house.text("page/report.html");
    assert!(page.len() < 5_000_000, "{} bytes", page.len());
    for row in &found {
        assert!(page.contains(&format!("<b>{}</b>", row.action)), "{row:?}");
    }
    assert_eq!(page.matches("data:image/png;base64,").count(), 2, "a map a printhead");
    is_inert(&page);
}
