//! The extended design at work: where an effect was one of a covariate, detection with it comes near to
//! detection on the same run without the effect.

use super::{Case, Effect, Family, Hidden, NOTHING};
use crate::house::House;
use crate::recorded::with_samples;
use inkling::burst::Burst;
use inkling::io::verdict_reader::VerdictReader;

/// More damping on every fifth signal: e^{-FAULT t} of a whole signal. Where half of a head's signals had it, nobody could tell
/// which half is healthy.
const FAULT: f64 = 0.25;

fn is_faulty(burst: usize, channel: usize) -> bool {
    (burst + channel) % 5 == 1
}

fn with_faults(bursts: &[Burst]) -> Vec<Burst> {
    let of = |(number, burst): (usize, &Burst)| {
        let n = f64::from(burst.samples_per_channel);
        let first = burst.first_channel as usize;
        with_samples(burst, |row, k, y| match is_faulty(number, first + row) {
            true => y * (-FAULT * k as f64 / n).exp(),
            false => y,
        })
    };
    bursts.iter().enumerate().map(of).collect()
}

/// Area under the ROC curve of the statistic: the chance that a faulty signal's is the larger.
fn auc(house: &House, recording: &str, design: &str) -> f64 {
    house.ok(&format!(
        "replay {recording}.mcap --design {design} --identify design --out {design}.d"
    ));
    let (mut healthy, mut faulty) = (Vec::new(), Vec::new());
    let path = house.path(&format!("{design}.d/{recording}.verdicts.parquet"));
    for columns in VerdictReader::open(&path).unwrap() {
        let c = columns.unwrap();
        for i in 0..c.len() {
            let statistic = f64::from(c.statistic[i].unwrap());
            let burst = i / 8; // in file order, eight channels each
            match is_faulty(burst, c.channel[i] as usize) {
                true => faulty.push(statistic),
                false => healthy.push(statistic),
            }
        }
    }
    let below: usize = faulty.iter().map(|f| healthy.iter().filter(|h| *h < f).count()).sum();
    below as f64 / (healthy.len() * faulty.len()) as f64
}

#[test]
fn a_design_that_knows_the_cause_detects_as_if_it_were_not_there() {
    let (mut spoiled, mut mended) = (0, 0);
    // what this generator makes of tails and gradients is larger than what the extension stands for: docs/critique.md
    let effects = [Effect::Crosstalk, Effect::Ageing, Effect::Temperature];
    // of turn 0: bursts of eight channels
    for (effect, seed) in effects.into_iter().zip(0..) {
        let house = House::new();
        let hidden = Hidden { effect, strength: 8.0 };
        let bursts = |hidden| Case { family: Family::Tied, hidden, seed }.heard().bursts();
        let (run, clean) = (bursts(hidden), bursts(NOTHING));
        house.record("faulty.mcap", &with_faults(&run));
        house.record("healthy.mcap", &run);
        house.write("labels.csv", "printhead,channel,from,to,state,severity\n*,*,,,healthy,\n");
        house.ok("critique healthy.mcap -o critique");
        house.ok("train healthy.mcap --labels labels.csv -o plain.json");
        // the same run as it is without the effect
        house.record("clean_faulty.mcap", &with_faults(&clean));
        house.record("clean.mcap", &clean);
        house.ok("train clean.mcap --labels labels.csv -o clean.json");
        let design = "critique/extended.design.json";
        // where the cause is not worth modelling there is none, and the plain one stays
        let design = if house.path(design).exists() { design } else { "plain.json" };
        let (before, after) = (auc(&house, "faulty", "plain.json"), auc(&house, "faulty", design));
        let without = auc(&house, "clean_faulty", "clean.json");
        println!(
            "{effect:?}: {before:.3} before, {after:.3} after, {without:.3} without the effect"
        );
        assert!(after > without - 0.03 && after > before - 0.03, "{effect:?}");
        spoiled += usize::from(before < without - 0.1);
        mended += usize::from(before < without - 0.1 && after > before + 0.1);
    }
    assert!(spoiled > 0 && mended == spoiled, "{mended} of {spoiled} that an effect spoiled");
}
