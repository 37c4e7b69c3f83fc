//! Tables as other programs read them: rings in every mode.

use crate::house::House;
use crate::recorded::{self, cells};
use arrow_array::RecordBatch;
use arrow_array::types::Float32Type;

fn batches(house: &House, name: &str) -> Vec<RecordBatch> {
    recorded::batches(&house.path(name))
}

fn texts(batches: &[RecordBatch], name: &str) -> Vec<Option<String>> {
    has(batches, name);
    batches.iter().flat_map(|batch| recorded::texts(batch, name)).collect()
}

fn numbers(batches: &[RecordBatch], name: &str) -> Vec<Option<f32>> {
    has(batches, name);
    batches.iter().flat_map(|batch| cells::<Float32Type>(batch, name)).collect()
}

#[track_caller]
fn has(batches: &[RecordBatch], name: &str) {
    assert!(batches.iter().all(|batch| batch.column_by_name(name).is_some()), "no column {name}");
}

#[test]
fn flagged_signals_have_their_ring_in_every_mode_and_all_have_where_that_is_asked_for() {
    let house = House::new();
    let by_design = "--design sample_logs/design.json";
    let thesis = "--preset thesis --set identify.labels=sample_logs/labels.csv";
    for mode in ["", by_design, thesis] {
        let table = "out/print_run.verdicts.parquet";
        house.ok(&format!("replay sample_logs/print_run.mcap --out out --force {mode}"));
        let flagged = batches(&house, table);
        let resonances = numbers(&flagged, "resonance_hz");
        let dampings = numbers(&flagged, "damping_per_s");
        let outcomes = texts(&flagged, "outcome");
        let is_healthy = |row: usize| outcomes[row].as_deref() == Some("healthy");
        for row in 0..outcomes.len() {
            let has = (resonances[row].is_some(), dampings[row].is_some());
            let is_flagged = !is_healthy(row) && outcomes[row].as_deref() != Some("rejected");
            assert_eq!(has, (is_flagged, is_flagged), "row {row} of replay {mode}");
        }
        house.ok(&format!(
            "replay sample_logs/print_run.mcap --out out --force {mode} --set output.ring=all"
        ));
        let all = batches(&house, table);
        assert_eq!(texts(&all, "outcome"), outcomes, "{mode}");
        for column in ["statistic", "threshold", "certainty", "severity"] {
            assert!(numbers(&all, column) == numbers(&flagged, column), "{column} of {mode}");
        }
        let models = house.read_json("out/print_run.summary.json")["models"].clone();
        let models = models.as_array().unwrap().iter();
        let known = models.filter_map(|m| m["poles"]["frequency_hz"].as_f64());
        let (low, high) = known.fold((f64::MAX, 0.0f64), |(l, h), f| (l.min(f), h.max(f)));
        let rings = numbers(&all, "resonance_hz").into_iter().enumerate();
        let mut healthy: Vec<f64> = rings
            .filter(|(row, _)| is_healthy(*row))
            .map(|(_, f)| f64::from(f.expect("a resonance")))
            .collect();
        healthy.sort_by(f64::total_cmp);
        let median = healthy[healthy.len() / 2];
        assert!((0.99 * low..1.01 * high).contains(&median), "{median} Hz, models {low} to {high}");
    }
}
