//! Turns what the stages know of a signal into a row of the verdict table. In: from the gate, detections and
//! their judge (`test`); from the isolator, what is to be said of a signal. Out: cells in the columns of
//! `schemas/verdicts.md`, one function per kind of row: rejected, judged, and a run of healthy signals.
//!
//! After each row all columns but those of weights are equally long: `fill_up` adds the nulls.

use super::batches::Detected;
use inkling_core::burst::Burst;
use inkling_core::design::{Isolation, Judge, Severity, Tested, Thresholds};
use inkling_core::isolate::Likeness;
use inkling_core::verdict::{HealthyRun, Outcome, Part, Reason, Test, Tests, VerdictColumns};
use std::ops::Range;
use std::sync::Arc;

/// Index of a printhead among the batch's; it is added if it is new.
pub fn intern(columns: &mut VerdictColumns, printhead: &Arc<str>) -> u32 {
    // the last one is the likeliest; a batch has few
    let known = columns.printheads.iter().rposition(|p| p == printhead);
    known.unwrap_or_else(|| {
        columns.printheads.push(printhead.clone());
        columns.printheads.len() - 1
    }) as u32
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Id {
    /// Time of acquisition t_a, ns since the epoch.
    pub t_ns: i64,
    /// Index of its printhead among the batch's.
    pub printhead: u32,
    pub channel: u32,
}

pub struct Row<'a> {
    pub tested: Tested,
    /// Number of the model, its index in the metadata's list.
    pub model: u16,
    /// `None`: the signal was not isolated, as healthy ones mostly are not.
    pub isolation: Option<&'a Isolation>,
    /// The weight of each class; `None`: not to be written.
    pub weights: Option<&'a [f64]>,
    /// Resonance, Hz, and damping, 1/s; `None`: not known.
    pub ring: Option<[f64; 2]>,
    /// The fault's size; `None`: it was not sized, which only the posterior does.
    pub severity: Option<Severity>,
}

pub fn push_rejected(columns: &mut VerdictColumns, id: Id, reason: Reason) {
    push(columns, id, Outcome::Rejected);
    columns.reason.push(Some(reason));
    columns.fill_up();
}

/// Adds the row of a signal that was judged. A flagged signal that nothing names is undecided.
pub fn push_judged(columns: &mut VerdictColumns, id: Id, row: Row) {
    let Row { tested, model, isolation, weights, ring, severity } = row;
    // a flagged signal is faulty if isolation has named its class or category with certainty
    let flagged = tested.is_flagged();
    let decided = isolation.filter(|i| flagged && !i.is_uncertain());
    let (outcome, reason) = match (flagged, decided) {
        (false, _) => (Outcome::Healthy, None),
        (true, Some(_)) => (Outcome::Faulty, None),
        (true, None) => {
            let reason = match isolation.map(|i| i.likeness).unwrap_or_default() {
                Likeness::KnownClass => Reason::Uncertain,
                Likeness::NoClass => Reason::UnknownFault,
                Likeness::NoRing => Reason::NoRing,
            };
            (Outcome::Undecided, Some(reason))
        }
    };

    push(columns, id, outcome);
    columns.reason.push(reason);
    columns.category.push(decided.and_then(|i| i.category));
    columns.fault.push(decided.and_then(|i| i.fault));
    columns.candidate.push(isolation.and_then(|i| i.candidate));
    columns.certainty.push(isolation.and_then(|i| i.certainty));
    columns.statistic.push(Some(statistic(&tested)));
    let Tested { test, threshold, misfit, .. } = tested;
    columns.threshold.push(Some(threshold as f32));
    columns.test.push(Some(test));
    columns.misfit.push(misfit.is_finite().then(|| rounded(misfit)));
    columns.model.push(Some(model));
    columns.resonance_hz.push(ring.map(|[f, _]| f as f32));
    columns.damping_per_s.push(ring.map(|[_, damping]| damping as f32));
    let severity = severity.filter(|_| flagged);
    columns.severity.push(severity.map(|of| of.value as f32));
    columns.severity_sd.push(severity.map(|of| of.sd as f32));
    columns.fill_up();
    if let Some(weights) = weights {
        // rows before this one may lack weights; those after the last one with weights need no entry
        columns.weights_start.resize(columns.acquired_at_ns.len() - 1, None);
        columns.weights_start.push(Some(columns.weights.len() as u32));
        columns.weights.extend(weights.iter().map(|&v| v as f32));
    }
}

/// Adds the outcomes of the tests of a burst's signals to `tests`, for the gate. `judge`: `None` if
/// nobody judged the signals; `found`: for each signal its statistics, or why it has none.
pub fn test(judge: Option<&Judge>, found: &[Detected], tests: &mut Tests) {
    let from = tests.healthy.len();
    // every signal counts as not judged until its detection says otherwise
    tests.push_not_judged(found.len());
    let Some(judge) = judge else { return };
    for (found, signal) in found.iter().zip(from..) {
        let Ok(found) = found else { continue };
        let tested = judge.test(*found);
        tests.statistic[signal] = statistic(&tested);
        if tested.misfit.is_finite() {
            tests.misfit[signal] = rounded(tested.misfit);
        }
        tests.beside[signal] = tested.test == Test::Misfit;
        tests.healthy[signal] = !tested.is_flagged();
    }
}

/// How many of the 23 bits behind the first one a statistic and a misfit keep in the table. The others are
/// the signal's noise; nobody reads them, and no compressor makes them smaller.
const BITS: u32 = 13;

/// The nearest number that has so few bits, within 2^-14 of the value (.006 %).
fn rounded(value: f64) -> f32 {
    let left_out = (1 << (f32::MANTISSA_DIGITS - 1 - BITS)) - 1;
    f32::from_bits(((value as f32).to_bits() + left_out / 2 + 1) & !left_out)
}

/// The statistic as the table has it: rounded, unless that would pass the threshold.
fn statistic(of: &Tested) -> f32 {
    let near = rounded(of.statistic);
    let agrees = (near > of.threshold as f32) == of.is_flagged();
    if agrees { near } else { of.statistic as f32 }
}

/// Adds what was recorded with a burst to its rows, those from `from` on.
pub fn add_recorded(columns: &mut VerdictColumns, from: usize, burst: &Burst) {
    columns.temperature_c[from..].fill(burst.temperature_c.map(|t| t as f32));
    columns.drive_voltage_v[from..].fill(burst.drive_voltage_v.map(|v| v as f32));
}

/// A run of neighbouring healthy signals of a burst. `signals`: their indices in the batch.
pub fn healthy_run(first: Id, signals: Range<usize>, burst: &Burst, judge: &Judge) -> Part {
    let Thresholds { along, of_ring, beside } = judge.thresholds();
    Part::Healthy(HealthyRun {
        t_ns: first.t_ns,
        printhead: first.printhead,
        first_channel: first.channel,
        signals,
        model: judge.index,
        along,
        threshold: of_ring as f32,
        beside: beside as f32,
        temperature_c: burst.temperature_c.map(|t| t as f32),
        drive_voltage_v: burst.drive_voltage_v.map(|v| v as f32),
    })
}

fn push(columns: &mut VerdictColumns, id: Id, outcome: Outcome) {
    columns.acquired_at_ns.push(id.t_ns);
    columns.printhead.push(id.printhead);
    columns.channel.push(id.channel);
    columns.outcome.push(outcome);
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn no_statistic_is_rounded_past_its_threshold() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(11);
        for _ in 0..100_000 {
            let threshold = f64::from(10f32.powf(rng.random_range(-20.0..20.0)));
            let near = threshold * (1.0 + rng.random_range(-3e-4..3e-4));
            let tested = Tested { test: Test::Ring, statistic: near, threshold, misfit: f64::NAN };
            let told = statistic(&tested);
            // the two may be one number as f32
            let (near_as_f32, threshold) = (near as f32, threshold as f32);
            assert!(near_as_f32 == threshold || (told > threshold) == (near_as_f32 > threshold));
            assert!((f64::from(told) / near - 1.0).abs() <= 0.5f64.powi(14));
        }
    }
}
