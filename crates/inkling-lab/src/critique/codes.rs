//! Tests what the analogue-digital converters do to the numbers: clipping and missing codes (a code is one of
//! the values that a sample can have).
//!
//! In: signals and the fitted model. Out: one [`Candidate`] for `clipping` and one for `coarse_lsb`; and,
//! where one is accepted, a change of the model (`Model::codes`): samples that may be clipped are left out of
//! what is fitted afterwards, and what is expected is rounded to a coarse step. Each printhead has a converter
//! of its own and is tested alone; what is most surprising is told. Both tests look at the histogram of codes:
//!
//! - clipping: the probability that no sample lies beyond the largest (or smallest) code, although the model
//!   expects samples there; the code itself must hold those that are missing;
//! - coarse step: the probability that some codes are never met, although codes beside them are met often; the
//!   codes that are met must be those of a `lattice`. Whole counts have the step 1.
//!
//! Of fractions of counts only clipping is looked for. The work depends on the number of samples and not on how
//! large they are.

use super::candidate::{Candidate, Objection};
use super::catalogue::CauseId;
use super::chance::THRESHOLD;
use super::lattice::Lattice;
use super::model::{Codes, Linear, Model, Rail};
use super::observations::Observations;
use super::tuned::{CLIPPED_SHARE, CROWDED};
use inkling_core::model::normal::ln_upper_tail;
use std::collections::BTreeMap;

/// Floating-point values nearer than this, in amplitudes of the ring, are one code.
const FLOAT_DIGITS: f64 = 1e-6;
/// In a gap of more codes than this only the first ones are looked at.
const MOST_OF_A_GAP: i64 = 16;
/// Standard deviations of the noise within which nearly all of it lies: all but 6e-5.
const FARTHEST: f64 = 4.0;

/// Tests clipping (at the more surprising end) and a coarse step, and returns both candidates in this order.
/// Writes what is accepted to the model.
pub fn test(data: &Observations, model: &mut Model) -> Vec<Candidate> {
    let sd = model.noise_var.sqrt();
    let expected = model.of_each(data, |i, linear| linear.expected(data.signal(i))).concat();
    let mut codes = vec![Codes::default(); data.printheads.len()];
    let (mut clippings, mut steps) = (Vec::new(), Vec::new());
    let mut from = 0;
    for rows in data.rows.chunk_by(|p, q| p.printhead == q.printhead) {
        let of_head = from..from + rows.len();
        from = of_head.end;
        let sampled = || of_head.clone().flat_map(|i| data.signal(i));
        // one converter may give whole counts beside another's fractions, which are told apart as far as their
        // own digits go
        let integer = sampled().all(|y| y.fract() == 0.0);
        let unit = if integer { 1.0 } else { FLOAT_DIGITS * model.amplitude() };
        let mut met = BTreeMap::new();
        for y in sampled() {
            *met.entry((f64::from(*y) / unit).round() as i64).or_default() += 1;
        }
        let samples = of_head.start * data.samples..of_head.end * data.samples;
        let expected = &expected[samples];
        let head = Head { met, expected, integer, unit, sd };
        let (coarse, lattice) = head.coarse_step();
        let step = if coarse.accepted() { coarse.value } else { 1.0 };
        let rails = [1.0, -1.0].map(|side| head.clipping(step, side));
        if let Some(codes) = codes.get_mut(rows[0].printhead) {
            let clips = rails.iter().filter(|(f, _)| f.accepted());
            *codes = Codes { rails: clips.map(|(_, rail)| *rail).collect(), lattice };
        }
        clippings.extend(rails.map(|(f, _)| f));
        steps.push(coarse);
    }
    model.codes = codes;
    vec![most_surprising(clippings, CauseId::Clipping), most_surprising(steps, CauseId::CoarseLsb)]
}

/// Of the candidates of all printheads that which is accepted, if one is, with the largest surprise.
fn most_surprising(all: Vec<Candidate>, id: CauseId) -> Candidate {
    let by_rank = |p: &Candidate, q: &Candidate| {
        p.accepted().cmp(&q.accepted()).then(p.surprise.total_cmp(&q.surprise))
    };
    all.into_iter().rev().max_by(by_rank).unwrap_or_else(|| Candidate::nothing(id))
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

/// The samples of one printhead.
struct Head<'a> {
    /// How often each code was met.
    met: BTreeMap<i64, u64>,
    /// What the model expects of each sample, counts.
    expected: &'a [f64],
    integer: bool,
    /// Distance of neighbouring codes, and the noise's standard deviation; counts.
    unit: f64,
    sd: f64,
}

impl Head<'_> {
    /// Tests whether samples are clipped at the last code: how probable is it that none lies beyond, although
    /// so much is expected there? Each sample stays below with probability 1 - tail(z), with the distance z of
    /// the last code from the expected value in standard deviations of the noise; the surprise is -ln of the
    /// product over all samples.
    ///
    /// `step`: the converter's; `side`: 1 for the largest code, -1 for the smallest. Returns the candidate,
    /// whose value is the level of the last code, and the rail for the model.
    fn clipping(&self, step: f64, side: f64) -> (Candidate, Rail) {
        let Head { expected, unit, sd, .. } = *self;
        let mut codes = self.met.iter();
        let last = if side > 0.0 { codes.next_back() } else { codes.next() };
        let (&last, &at_last) = last.unwrap_or((&0, &0)); // signals have samples, so there is one
        let level = last as f64 * unit;
        // what lies within half a step beyond the last code is rounded to that, not clipped
        let half = if self.integer { 0.5 * step } else { 0.0 };

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

        let [fewest, share] = CROWDED;
        let crowded = at_last as f64 > fewest + share * beyond;
        // only a share counts: the level is free, and scatter of the largest signals is not modelled
        let surprise: f64 = if crowded { CLIPPED_SHARE * surprise } else { 0.0 };
        let f = Candidate::by_chance(CauseId::Clipping, surprise, level, 0.25 * unit);
        (f, Rail { side, level, from: level - side * 3.0 * sd })
    }

    /// Tests whether codes of whole counts are missing as a coarse step leaves them out. Returns the candidate, whose value is
    /// the step, and for the model `[step, first]`, where the step is a whole number of counts.
    fn coarse_step(&self) -> (Candidate, Option<[f64; 2]>) {
        let nothing = Candidate::nothing(CauseId::CoarseLsb);
        let total: u64 = self.met.values().sum();
        let met = met_often(&self.met, total);
        if !self.integer || met.len() < 5 {
            return (nothing, None);
        }

        // A code that should be met `often` times is missed with a probability of e^-often (Poisson), so the
        // surprise of several is the sum of `often`; three must be missing, and only half of the sum counts
        // (heuristic).
        let (missing, often) = self.missed(&met);
        let surprise = if missing > 2.0 { 0.5 * often } else { 0.0 };
        if surprise <= THRESHOLD {
            return (Candidate::by_chance(CauseId::CoarseLsb, surprise, 1.0, f64::NAN), None);
        }
        let Some(Lattice { step, sd }) = Lattice::of(&met) else {
            let objection = Some(Objection::NoLattice);
            let f = Candidate::by_chance(CauseId::CoarseLsb, surprise, f64::NAN, f64::NAN);
            return (Candidate { objection, ..f }, None);
        };
        // now that the step is known: as many as whole counts would have brought between its multiples
        let surprise = 0.5 * total as f64 * (1.0 - 1.0 / step);
        let whole = step.round().max(1.0);
        let is_whole = met.iter().all(|code| (code - met[0]) % whole as i64 == 0);
        let lattice = is_whole.then_some([whole, (met[0] % whole as i64) as f64]);
        (Candidate::by_chance(CauseId::CoarseLsb, surprise, step, sd), lattice)
    }

    /// Number of codes between those that were `met` which should be met more than `THRESHOLD` times, and the sum
    /// of how often each should be at least. A sample scatters by the noise about its own place, which lies
    /// within `FARTHEST` standard deviations. So the code at a distance of d standard deviations from one that
    /// was met n times should be met n e^{-d (d + 2 FARTHEST)/2} times at least, wherever the places are: codes
    /// that no signal comes by are not missed, and nothing is asked of the model but its noise.
    fn missed(&self, met: &[i64]) -> (f64, f64) {
        let kept = |codes: i64| {
            let d = codes as f64 / self.sd;
            (-0.5 * d * (d + 2.0 * FARTHEST)).exp()
        };
        let (mut missing, mut sum) = (0.0, 0.0);
        for gap in met.windows(2) {
            let times = |code| self.met.get(code).map_or(0.0, |n| *n as f64);
            let (left, right, width) = (times(&gap[0]), times(&gap[1]), gap[1] - gap[0]);
            for k in 1..width.min(MOST_OF_A_GAP) {
                let often = (left * kept(k)).max(right * kept(width - k));
                if often > THRESHOLD {
                    (missing, sum) = (missing + 1.0, sum + often);
                }
            }
        }
        (missing, sum)
    }
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

#[cfg(test)]
mod tests {
    use super::super::generator::{Run, draw};
    use super::super::observations::Sampler;
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

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
        assert!(accepted(&healthy).is_empty() && model.codes[0].rails.is_empty());
        let (clipped, model) = tested(Some(CauseId::Clipping), 70.0);
        assert_eq!(accepted(&clipped), [CauseId::Clipping]);
        assert_eq!(clipped[0].value, 70.0);
        assert!(
            matches!(model.codes[0].rails[..], [Rail { side: 1.0, from, .. }] if from < 70.0),
            "near the rail nothing is fitted"
        );
        let (coarse, model) = tested(Some(CauseId::CoarseLsb), 3.0);
        assert_eq!(accepted(&coarse), [CauseId::CoarseLsb]);
        assert!((coarse[1].value - 3.0).abs() < 0.1);
        assert_eq!(model.codes[0].lattice, Some([3.0, 0.0]));
    }

    /// Each printhead has its own converter: one of them rounds to three counts, and the other is clipped.
    #[test]
    fn what_one_converter_does_is_not_said_of_another() {
        let effects = [(CauseId::CoarseLsb, 3.0), (CauseId::Clipping, 70.0)];
        let mut both = Sampler::new(1e-6, usize::MAX);
        for (head, (effect, size)) in ["a", "b"].into_iter().zip(effects) {
            let run = Run { channels: 12, bursts: 4, effect: Some(effect), size, ..Run::default() };
            let data = draw(&run, 12);
            for (i, row) in data.rows.iter().enumerate() {
                let signal: Vec<f64> = data.signal(i).iter().map(|y| f64::from(*y)).collect();
                both.offer(head, row.beside, &signal);
            }
        }
        let data = both.finish();
        let mut model = Model::fitted(&data, 1).unwrap();
        let found = test(&data, &mut model);
        assert!(found.iter().all(Candidate::accepted));
        let [a, b] = &model.codes[..] else { panic!("two converters") };
        assert_eq!((a.rails.len(), a.lattice), (0, Some([3.0, 0.0])));
        assert_eq!((b.rails.len(), b.lattice), (1, None));
    }

    /// Rings that are all alike stand in clusters of codes; those between them are not missing.
    #[test]
    fn whole_counts_have_no_coarse_step_however_large_and_wherever_they_lie() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for sd in [2.0, 12.0, 20_000.0] {
            let mut met = BTreeMap::new();
            for k in 0..100_000_i64 {
                let noise: f64 = StandardNormal.sample(&mut rng);
                let place = ((k % 60).pow(2) * 7919 % 1000) as f64;
                *met.entry((sd * (place + noise)).round() as i64).or_default() += 1;
            }
            let head = Head { met, expected: &[], integer: true, unit: 1.0, sd };
            let (f, lattice) = head.coarse_step();
            assert!(f.surprise <= THRESHOLD && lattice.is_none(), "{sd}: {}", f.surprise);
        }
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
