//! `inspect` of a logger's own messages: every field, the layout by the samples, questions where nothing tells; and what is
//! said of ring-downs that are laid out wrongly.

use crate::dialects::writers::{self, Messages};
use crate::house::House;
use crate::recorded::{self, bursts, counts, rows, with_signals};
use inkling::burst::{Burst, Format, Layout};
use serde_json::{Value, json};
use std::path::Path;

fn sample() -> Vec<Burst> {
    bursts(&recorded::sample("print_run.mcap"))
}

/// The sample's bursts as messages in JSON.
fn record(path: &Path, message: impl Fn(&Burst) -> Value) {
    let mut messages = Messages::default();
    for burst in sample() {
        let topic = format!("/press/{}/ring", burst.printhead);
        let text = message(&burst).to_string();
        messages.add(&writers::json(), &topic, burst.t_acq_ns as u64, text.as_bytes());
    }
    std::fs::write(path, messages.finish()).unwrap();
}

fn stamp(burst: &Burst) -> String {
    chrono::DateTime::from_timestamp_nanos(burst.t_acq_ns).to_rfc3339()
}

#[test]
fn a_loggers_own_json_is_read_as_inspect_writes_it() {
    let house = House::new();
    record(&house.path("night.mcap"), |burst| {
        json!({
            "stamp": stamp(burst),
            "rate_hz": (1.0 / burst.sample_period_s).round(),
            "ink_temp_c": burst.temperature_c,
            "drive_voltage": burst.drive_voltage_v,
            "ok": true,
            "data": rows(burst),
        })
    });
    house
        .run("inspect night.mcap --write settings.toml")
        .exits(0)
        .says("rate_hz = \"rate_hz\"")
        .says("time = \"stamp\"")
        .says("temperature = \"ink_temp_c\"")
        .says("layout = \"channel-major\"  # by the samples")
        .says("channels = 48  # by the samples")
        .says("6 144 of it")
        .says("2025-01-01T08:00:00")
        .says("inkling replay ... --config settings.toml");
    house.run("inspect night.mcap --write settings.toml").exits(2).says("is there already");
    let judged = "--design sample_logs/design.json --force";
    house.ok(&format!("replay night.mcap --config settings.toml {judged} --out theirs"));
    house.ok(&format!("replay sample_logs/print_run.mcap {judged} --out ours"));
    let counts = |path: &str| house.read_json(path)["counts"]["faulty"].clone();
    let [theirs, ours] = ["theirs/night.summary.json", "ours/print_run.summary.json"].map(counts);
    assert_eq!(theirs, ours);
    assert!(ours.as_object().is_some_and(|faulty| faulty.len() > 5), "{ours}");
}

#[test]
fn layouts_are_tried_on_the_samples_and_what_nothing_tells_is_asked() {
    let house = House::new();
    record(&house.path("flat.mcap"), |burst| {
        let rows = rows(burst);
        let samples = 0..burst.samples_per_channel as usize;
        let flat: Vec<f64> = samples.flat_map(|k| rows.iter().map(move |row| row[k])).collect();
        json!({ "period_ns": burst.sample_period_s * 1e9, "values": flat })
    });
    let found = house.json("inspect flat.mcap --json");
    let block = found["dialects"][0].as_str().unwrap();
    assert!(block.contains("layout = \"sample-major\"  # by the samples"), "{block}");
    assert!(block.contains("channels = 48  # by the samples"), "{block}");
    // a dialect has no unit, so a period in ns is asked for
    assert!(block.contains("period_s = \"?\""), "{block}");
    assert_eq!(found["messages"][0]["open"], json!(["period_s"]));
    record(&house.path("bare.mcap"), |burst| json!({ "values": rows(burst)[0] }));
    let found = house.json("inspect bare.mcap --json");
    let fields = &found["messages"][0]["fields"];
    assert_eq!(fields, &json!([{"path": "values", "type": "number[]", "length": 128}]));
    assert_eq!(found["messages"][0]["open"], json!(["channels", "period_s"]));
    house.run("inspect bare.mcap --write open.toml").exits(0).says("fill in channels, period_s");
    house.run("replay bare.mcap --config open.toml --out out").exits(2).says("still a question");
}

#[test]
fn what_is_laid_out_wrongly_or_sampled_at_another_scale_is_told() {
    let house = House::new();
    let all = sample();
    // sample-major bytes that somebody calls channel-major
    let turn = |burst: &Burst| {
        let turned = with_signals(burst, &counts(burst), (Format::S16Le, Layout::SampleMajor));
        Burst { layout: Layout::ChannelMajor, ..turned }
    };
    house.record("turned.mcap", &all.iter().map(turn).collect::<Vec<_>>());
    house.run("replay turned.mcap --out out").says("these are no ring-downs as laid out");
    house.run("inspect turned.mcap").exits(0).says("these are no ring-downs as laid out");
    let slow = |b: &Burst| Burst { sample_period_s: b.sample_period_s * 1e3, ..b.clone() };
    house.record("slow.mcap", &all.iter().map(slow).collect::<Vec<_>>());
    house.run("replay slow.mcap --out out").says("periods in a signal").says("a resonance of 6");
    house.record("right.mcap", &all);
    let right = house.run("replay right.mcap --out out").exits(0);
    assert!(!right.stderr().contains("periods in a signal"), "{}", right.stderr());
    assert!(!right.stderr().contains("no ring-downs"), "{}", right.stderr());
    assert_eq!(house.json("inspect right.mcap --json")["doubts"], json!([]));
}
