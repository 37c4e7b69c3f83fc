//! Tests what the analogue-digital converter does to the numbers: clipping and missing codes (a code is one
//! of the values that a sample can have).
//!
//! In: signals and the fitted model. Out: one [`Candidate`] for `clipping` and one for `coarse_lsb`; and,
//! where one is accepted, a change of the model: samples that may be clipped are left out of what is fitted
//! afterwards (`Model::rails`), and what is expected is rounded to a coarse step (`Model::lattice`). Both
//! tests compare the histogram of codes with what the model expects in normal noise:
//!
//! - clipping: the probability that no sample lies beyond the largest (or smallest) code, although the model
//!   expects samples there; the code itself must hold those that are missing;
//! - coarse step: the probability that some codes are never met, although the model expects each of them
//!   often; the codes that are met must be multiples of one step.
//!
//! Floating-point samples have codes, too, where few distinct values are met.

use super::candidate::Candidate;
use super::catalogue::CauseId;
use super::chance::THRESHOLD;
use super::model::{Linear, Model, Rail};
use super::objection::Objection;
use super::observations::Observations;
use super::tuned::CLIPPED_SHARE;
use inkling_core::model::normal::ln_upper_tail;
use inkling_core::numbers::LITTLE;
use std::collections::BTreeMap;

/// Floating-point values nearer than this, in amplitudes of the ring, are one code.
const FLOAT_DIGITS: f64 = 1e-6;

/// Tests clipping (at the more surprising end) and a coarse step, and returns both candidates in this order.
/// Writes what is accepted to the model.
pub fn test(data: &Observations, model: &mut Model) -> Vec<Candidate> {
    // floating-point values are told apart as far as their own digits go
    let unit = if data.integer { 1.0 } else { FLOAT_DIGITS * model.amplitude() };
    let mut histogram: BTreeMap<i64, u64> = BTreeMap::new();
    for i in 0..data.len() {
        for y in data.signal(i) {
            *histogram.entry((f64::from(*y) / unit).round() as i64).or_default() += 1;
        }
    }
    let coarse = lattice(data, model, &histogram, unit);
    let step = if coarse.accepted() { coarse.value } else { 1.0 };
    // what lies within half a step beyond the last code is rounded to that, not clipped
    let half = if data.integer { 0.5 * step } else { 0.0 };
    let (expected, sd) = (expected(data, model), model.noise_var.sqrt());
    let rails = [1.0, -1.0].map(|side| clipping(&expected, sd, &histogram, [unit, half], side));
    model.rails = rails.iter().filter(|(f, _)| f.accepted()).map(|(_, rail)| *rail).collect();
    let [upper, lower] = rails.map(|(f, _)| f);
    vec![if lower.surprise > upper.surprise { lower } else { upper }, coarse]
}

fn expected(data: &Observations, model: &Model) -> Vec<f64> {
    model.of_each(data, |i, linear| linear.expected(data.signal(i))).concat()
}

/// Marks the samples that may be clipped, and those after them, which whitening mixes with them, as lost.
pub fn unclipped(mut data: Observations, model: &Model) -> Observations {
    let lost = model.of_each(&data, |_, Linear { counts, .. }| -> Vec<bool> {
        let clipped = |k: usize| counts[k] == 0.0;
        (0..counts.len()).map(|k| clipped(k) || k > 0 && clipped(k - 1)).collect()
    });
    data.lost = lost.concat();
    data
}

/// Tests whether samples are clipped at the last code: how probable is it that none lies beyond, although so
/// much is expected there? Each sample stays below with probability 1 - tail(z), with the distance z of the
/// last code from the expected value in standard deviations of the noise; the surprise is -ln of the product
/// over all samples.
///
/// `expected`: of every sample; `sd`: of the noise; `unit`, `half`: distance of neighbouring codes, and half
/// of the converter's step; `side`: 1 for the largest code, -1 for the smallest. Returns the candidate, whose
/// value is the level of the last code, and the rail for the model.
fn clipping(
    expected: &[f64],
    sd: f64,
    histogram: &BTreeMap<i64, u64>,
    [unit, half]: [f64; 2],
    side: f64,
) -> (Candidate, Rail) {
    let mut codes = histogram.iter();
    let last = if side > 0.0 { codes.next_back() } else { codes.next() };
    let (&last, &at_last) = last.unwrap_or((&0, &0)); // signals have samples, so there is one
    let level = last as f64 * unit;

    // `beyond`: number of samples that are expected beyond the last code; clipped samples pull the fit
    // towards zero, so it is rather too small
    let (mut surprise, mut beyond) = (0.0, 0.0);
    for expected in expected {
        let z = (side * (level - expected) + half) / sd;
        if z < 6.0 {
            let tail = ln_upper_tail(z);
            surprise -= (1.0 - tail.exp()).max(1e-12).ln();
            beyond += tail.exp();
        }
    }

    // the last code must hold more than half of those that are missing beyond it, and four (a rule of thumb)
    let crowded = at_last as f64 > 4.0 + 0.5 * beyond;
    // only a share counts: the level is free, and scatter of the largest signals is not modelled
    let surprise: f64 = if crowded { CLIPPED_SHARE * surprise } else { 0.0 };
    let f = Candidate::by_chance(CauseId::Clipping, surprise, level, 0.25 * unit);
    (f, Rail { side, level, from: level - side * 3.0 * sd })
}

/// Codes that were met, without those at either end that hold about 2 % of the `total` samples: there, codes
/// are missing by chance.
fn met_often(histogram: &BTreeMap<i64, u64>, total: u64) -> Vec<i64> {
    let (mut low, mut high, mut run) = (0, 0, 0_u64);
    let from = total / 50;
    for (&code, &n) in histogram {
        if run < from {
            low = code;
        }
        run += n;
        if run <= total - from {
            high = code;
        }
    }
    histogram.range(low..=high.max(low)).map(|(&code, _)| code).collect()
}

/// The value is the step, the mean distance of the codes that are met. The step of floating-point samples is
/// coarse if its rounding makes more than half of the noise.
fn lattice(
    data: &Observations,
    model: &mut Model,
    histogram: &BTreeMap<i64, u64>,
    unit: f64,
) -> Candidate {
    let coarse =
        |surprise, value, sd| Candidate::by_chance(CauseId::CoarseLsb, surprise, value, sd);
    let total: u64 = histogram.values().sum();
    // floating-point values lie on a lattice if few distinct values are met often
    if !data.integer && histogram.len() as f64 > 0.2 * total as f64 {
        return Candidate::nothing(CauseId::CoarseLsb);
    }
    let met = met_often(histogram, total);
    if met.len() < 5 {
        return Candidate::nothing(CauseId::CoarseLsb);
    }

    let codes = ((met[met.len() - 1] - met[0]) as f64).max(1.0);
    let step = codes / (met.len() - 1) as f64;
    let inside: u64 = histogram.range(met[0]..=met[met.len() - 1]).map(|(_, n)| n).sum();
    let per_code = inside as f64 / (codes + 1.0);
    if !data.integer {
        let value = step * unit;
        let sd = model.noise_var.sqrt();
        // rounding has the variance step²/12; the surprise of 50 only means "certain"
        let is_coarse = value * value / 12.0 > 0.5 * sd * sd;
        let surprise = if is_coarse && per_code < 0.5 { 50.0 } else { 0.0 };
        return coarse(surprise, value, 1e-3 * value);
    }

    // A code that should be met `often` times is missed with a probability of e^-often (Poisson), so the
    // surprise of several is the sum of `often`; three must be missing, and only half of the sum counts, for
    // errors of the expectation (heuristic). The expectation is the model's, because steep flanks of signals
    // that are all alike leave codes out, too.
    let often = expected_counts(data, model, met[0], codes as usize + 1);
    let missed = often
        .iter()
        .zip(met[0]..)
        .filter(|(often, code)| **often > THRESHOLD && !histogram.contains_key(code));
    let (missing, chances) = missed.fold((0, 0.0), |(n, sum), (often, _)| (n + 1, sum + often));
    let surprise = if missing > 2 { 0.5 * chances } else { 0.0 };

    // the model learns of the lattice where its step is a whole number
    let whole = step.round().max(1.0);
    let mut f = coarse(surprise, step * unit, step / codes.max(1.0));
    if f.accepted() && !is_lattice(&met, step) {
        f.objection = Some(Objection::NoLattice);
    }
    if f.accepted() && met.iter().all(|code| (code - met[0]) % whole as i64 == 0) {
        model.lattice = Some([whole, (met[0] % whole as i64) as f64]);
    }
    f
}

/// Whether codes are the rounded multiples of one step: all gaps between neighbours differ from it by less
/// than 1, but a few, since a code may be missed by chance; fewer if the step is near 1, where nearly every
/// gap passes.
fn is_lattice(met: &[i64], step: f64) -> bool {
    let gaps = met.windows(2).map(|pair| (pair[1] - pair[0]) as f64);
    let odd = gaps.filter(|gap| (gap - step).abs() >= 1.0).count();
    odd as f64 <= LITTLE * (met.len() - 1) as f64 * (step - 1.0).min(1.0)
}

/// How many times the model expects each of so many `codes` from `first` on (whole counts only): the
/// histogram of all expected samples, in quarters of a code, convolved with the noise's normal density.
fn expected_counts(data: &Observations, model: &Model, first: i64, codes: usize) -> Vec<f64> {
    const PER_CODE: usize = 4;
    let sd = model.noise_var.sqrt();
    let reach = (4.0 * sd).ceil() as usize + 1;
    // it begins `reach` codes before `first`
    let mut places = vec![0.0; (codes + 2 * reach) * PER_CODE];
    for expected in expected(data, model) {
        let from_edge = expected - first as f64 + reach as f64;
        // a place below the edge is cast to 0, far from every code that counts
        if let Some(place) = places.get_mut((from_edge * PER_CODE as f64).round() as usize) {
            *place += 1.0;
        }
    }
    let norm = 1.0 / (sd * std::f64::consts::TAU.sqrt());
    let near = 2 * reach * PER_CODE;
    let bell: Vec<f64> = (0..=near)
        .map(|k| {
            let z = (k as f64 / PER_CODE as f64 - reach as f64) / sd;
            norm * (-0.5 * z * z).exp()
        })
        .collect();
    (0..codes)
        .map(|code| {
            let places = places[code * PER_CODE..].iter().zip(&bell);
            places.map(|(n, p)| n * p).sum()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::generator::{Run, draw};
    use super::*;

    fn tested(effect: Option<CauseId>, size: f64) -> (Vec<Candidate>, Model) {
        let run = Run { channels: 12, bursts: 4, effect, size, ..Run::default() };
        let data = draw(&run, 12);
        let mut model = Model::fitted(&data, 1).unwrap();
        (test(&data, &mut model), model)
    }

    #[test]
    fn clipping_and_missing_codes_are_met_where_they_are() {
        let accepted = |found: &[Candidate]| -> Vec<CauseId> {
            let all = found.iter().filter(|f| f.accepted());
            all.map(|f| f.id).collect()
        };
        let (healthy, model) = tested(None, 0.0);
        assert!(accepted(&healthy).is_empty() && model.rails.is_empty());
        let (clipped, model) = tested(Some(CauseId::Clipping), 70.0);
        assert_eq!(accepted(&clipped), [CauseId::Clipping]);
        assert_eq!(clipped[0].value, 70.0);
        assert!(
            matches!(model.rails[..], [Rail { side: 1.0, from, .. }] if from < 70.0),
            "near the rail nothing is fitted"
        );
        let (coarse, model) = tested(Some(CauseId::CoarseLsb), 3.0);
        assert_eq!(accepted(&coarse), [CauseId::CoarseLsb]);
        assert!((coarse[1].value - 3.0).abs() < 0.1);
        assert_eq!(model.lattice, Some([3.0, 0.0]));
    }

    #[test]
    fn codes_of_a_step_are_a_lattice_and_others_are_not() {
        let met =
            |keep: &dyn Fn(i64) -> bool| -> Vec<i64> { (-80..80).filter(|k| keep(*k)).collect() };
        let step = |met: &[i64]| (met[met.len() - 1] - met[0]) as f64 / (met.len() - 1) as f64;
        let of = |met: Vec<i64>| is_lattice(&met, step(&met));
        assert!(of(met(&|k| k % 3 == 0)));
        assert!(of((-40..40).map(|k| (f64::from(k) * 2.5).round() as i64).collect()));
        // one of the lattice's codes was missed by chance
        assert!(of(met(&|k| k % 3 == 0 && k != 60)));
        // two neighbouring codes of sixteen never occur, or one bit never changes
        assert!(!of(met(&|k| !matches!(k.rem_euclid(16), 3 | 4))));
        assert!(!of(met(&|k| k & 4 == 0)));
    }

    /// With one drive level and channels that are all alike, the flank jumps over codes between two samples.
    #[test]
    fn codes_that_no_signal_comes_by_are_not_missing() {
        let spread = [0.0, 0.0, 0.0];
        let run = Run { channels: 12, bursts: 16, spread, ..Run::default() };
        let mut accepted = 0;
        for seed in 40..44 {
            let mut data = draw(&run, seed);
            // a drive scan would fill the gaps, so one drive level is kept
            let keep = data.rows.iter().map(|r| r.beside.drive_v).fold(0.0, f64::max);
            let rows: Vec<bool> = data.rows.iter().map(|r| r.beside.drive_v == keep).collect();
            data = data.select(|i| rows[i]).standardised();
            let mut model = Model::fitted(&data, 1).unwrap();
            accepted += test(&data, &mut model).iter().filter(|f| f.accepted()).count();
        }
        assert_eq!(accepted, 0);
    }
}
