//! The rings in tables of verdicts, in every mode.

use crate::house::House;
use crate::recorded::each_row;
use inkling::verdict::{Outcome, VerdictColumns};

#[test]
fn flagged_signals_have_their_ring_in_every_mode_and_all_have_where_that_is_asked_for() {
    let house = House::new();
    let by_design = "--design sample_logs/design.json";
    let thesis = "--preset thesis --set identify.labels=sample_logs/labels.csv";
    // what is judged, and the ring
    let said = |c: &VerdictColumns, i: usize| {
        let numbers = [c.statistic[i], c.threshold[i], c.certainty[i], c.severity[i]];
        ((c.outcome[i], numbers), [c.resonance_hz[i], c.damping_per_s[i]])
    };
    for mode in ["", by_design, thesis] {
        let replayed = |more: &str| {
            house.ok(&format!("replay sample_logs/print_run.mcap --out out --force {mode} {more}"));
            each_row(&house.path("out/print_run.verdicts.parquet"), said)
        };
        let (flagged, all) = (replayed(""), replayed("--set output.ring=all"));
        for (of, ((outcome, _), ring)) in &flagged {
            let is_flagged = matches!(outcome, Outcome::Faulty | Outcome::Undecided);
            assert_eq!(ring.map(|v| v.is_some()), [is_flagged; 2], "{of:?} of replay {mode}");
        }
        let judged = flagged.iter().map(|(_, (judged, _))| judged);
        let is_same = judged.eq(all.iter().map(|(_, (judged, _))| judged));
        assert!(is_same, "{mode}: a ring changes no verdict");

        let models = house.read_json("out/print_run.summary.json")["models"].clone();
        let models = models.as_array().unwrap().iter();
        let known = models.filter_map(|m| m["poles"]["frequency_hz"].as_f64());
        let (low, high) = known.fold((f64::MAX, 0.0f64), |(l, h), f| (l.min(f), h.max(f)));
        let healthy = all.iter().filter(|(_, ((outcome, _), _))| *outcome == Outcome::Healthy);
        let mut healthy: Vec<f64> =
            healthy.map(|(_, (_, ring))| ring[0].expect("a resonance").into()).collect();
        healthy.sort_by(f64::total_cmp);
        let median = healthy[healthy.len() / 2];
        assert!((0.99 * low..1.01 * high).contains(&median), "{median} Hz, models {low} to {high}");
    }
}
