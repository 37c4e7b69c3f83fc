//! What codes and noise, and what moves the expected signal, leave to each other: no model of a cause is exact, and
//! what is found beside a far stronger one is what that one's model leaves.
//!
//! In: what was found ([`Found`]). Out: the same, with what is leftover not accepted any more.

use super::catalogue::CauseId;
use super::chance::DETECTION_LIMIT;
use super::found::{Found, accepted};
use super::model::Model;
use super::selection::Selected;

/// Share of what a cause explains that its model may leave to others: what is found in the noise, in codes,
/// and, to the noise alone, what moves what is expected.
pub const LEFT_OF_NOISE: f64 = 0.1;
const LEFT_OF_CODES: f64 = 0.005;
const LEFT_OF_SHAPES: f64 = 0.007;
/// Lines within so many periods of the signal are at one frequency.
const OWN_PERIODS: f64 = 1.0;

/// The other tests of the noise take its variance for the same all over the signal: what they find must be
/// large beside noise that grows with the signal.
pub fn beyond_growing_noise(of_noise: &mut [Found]) {
    const GROWS: CauseId = CauseId::HeteroscedasticNoise;
    let grows = of_noise.iter().find(|f| f.is(GROWS) && f.evidence.accepted);
    let Some(least) = grows.map(|f| LEFT_OF_NOISE * f.evidence.statistic) else { return };
    for f in of_noise.iter_mut().filter(|f| !f.is(GROWS)) {
        if f.evidence.accepted && f.evidence.statistic < least {
            f.leave_out("what growing noise leaves");
        }
    }
}

/// What is found in codes and noise, as the rest is judged beside it: the statistic that another cause must
/// have. Beside either, less than one detection limit is chance or what its model leaves.
pub fn beside_codes_and_noise(of_codes: &[Found], of_noise: &[Found]) -> f64 {
    let of = |found: &[Found], share: f64| {
        let accepted = found.iter().filter(|f| f.evidence.accepted);
        accepted.map(|f| (share * f.evidence.statistic).max(DETECTION_LIMIT)).fold(0.0, f64::max)
    };
    // where the signal is largest, the noise's variance is so many times what is taken for it
    let growth = accepted(of_noise, CauseId::HeteroscedasticNoise).map_or(0.0, |h| 1.0 + h);
    of(of_codes, LEFT_OF_CODES).max(of(of_noise, LEFT_OF_NOISE)).max(growth * DETECTION_LIMIT)
}

/// A random tone at the ring's own frequency may be the ring itself, bent by something that has no name yet: it is
/// looked for again beside the causes. Whether there is one.
pub fn at_the_ring(of_noise: &mut [Found], model: &Model, length_s: f64) -> bool {
    let own_hz = model.mean[1].exp() / (std::f64::consts::TAU * length_s);
    let tone = of_noise.iter_mut().find(|f| f.is(CauseId::RandomTone) && f.evidence.accepted);
    let near = |f: &&mut Found| (f.evidence.value - own_hz).abs() * length_s < OWN_PERIODS;
    let Some(tone) = tone.filter(near) else { return false };
    tone.leave_out("it is looked for beside the causes");
    true
}

/// What bends the ring leaves more at its frequency.
pub fn at_the_ring_beside(of_noise: &mut [Found], of_shapes: f64) {
    for f in of_noise.iter_mut().filter(|f| f.is(CauseId::RandomTone) && f.evidence.accepted) {
        if f.evidence.statistic <= LEFT_OF_NOISE * of_shapes {
            f.leave_out("what bends the ring leaves so much at its frequency");
        }
    }
}

/// The largest statistic of what moves what is expected.
pub fn largest(selected: &Selected) -> f64 {
    selected.causes.iter().map(|c| c.statistic).fold(0.0, f64::max)
}

/// Noise that the named causes' models explain is none: what they leave in single signals looked like it.
pub fn still_there(of_noise: &mut [Found], again: &[Found]) {
    for f in of_noise.iter_mut().filter(|f| f.evidence.accepted) {
        let id = f.evidence.id;
        // a correlation was taken out, and what is left of it is none
        let gone = id != CauseId::CorrelatedNoise
            && again.iter().any(|a| a.is(id) && !a.evidence.accepted);
        if gone {
            f.leave_out("what other causes leave in single signals");
        }
    }
}

/// What is found in the noise beside something that explains so much more is what that one's model leaves.
/// `of_shapes`: the largest statistic of what moves what is expected.
pub fn beyond_others(of_noise: &mut [Found], of_codes: &[Found], of_shapes: f64) {
    let named = |f: &&Found| f.evidence.accepted;
    let by_codes = of_codes.iter().filter(named).count();
    let largest = of_noise.iter().filter(named).map(|f| f.evidence.statistic).fold(0.0, f64::max);
    let others = of_noise.iter().filter(named).count() + by_codes;
    for f in of_noise.iter_mut().filter(|f| f.evidence.accepted) {
        let alone = others == 1 && of_shapes == 0.0;
        let share = (LEFT_OF_SHAPES * of_shapes).max(LEFT_OF_NOISE * largest);
        if !alone && f.evidence.statistic < share.max(DETECTION_LIMIT.min(largest)) {
            f.leave_out("what a stronger cause leaves");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::CauseId::*;
    use super::*;

    #[test]
    fn beside_noise_that_grows_little_is_no_cause() {
        let of = |growth: f64, rho: f64| {
            let each = [(HeteroscedasticNoise, growth), (CorrelatedNoise, rho)];
            let mut all: Vec<Found> =
                each.map(|(id, x)| Found::of(id, x / 2.0, x, 1.0, 0.1)).into();
            beyond_growing_noise(&mut all);
            all.iter().map(|f| f.evidence.accepted).collect::<Vec<bool>>()
        };
        assert_eq!(of(700.0, 20.0), [true, false]);
        assert_eq!(of(700.0, 200.0), [true, true]);
        assert_eq!(of(10.0, 20.0), [false, true], "noise that does not grow leaves nothing");
    }

    fn all(each: &[(CauseId, f64)]) -> Vec<Found> {
        each.iter().map(|(id, x)| Found::of(*id, x / 2.0, *x, 1.0, 0.1)).collect()
    }

    fn named(all: &[Found]) -> Vec<CauseId> {
        all.iter().filter(|f| f.evidence.accepted).map(|f| f.evidence.id).collect()
    }

    #[test]
    fn beside_a_strong_cause_weak_noise_is_what_it_leaves() {
        let judged = |each: &[(CauseId, f64)], of_shapes: f64| {
            let mut noise = all(each);
            beyond_others(&mut noise, &[], of_shapes);
            named(&noise)
        };
        let weak = [(TriggerJitter, 41.0)];
        assert_eq!(judged(&weak, 0.0), [TriggerJitter]);
        assert_eq!(judged(&weak, 1_000.0), [TriggerJitter]);
        assert_eq!(judged(&weak, 18_000.0), [], "crosstalk of 30 detection limits");
        assert_eq!(judged(&[(TriggerJitter, 18.0)], 0.0), [TriggerJitter], "alone it stays");
        let two = [(RandomTone, 900.0), (TriggerJitter, 41.0)];
        assert_eq!(judged(&two, 0.0), [RandomTone]);
    }

    #[test]
    fn noise_that_the_causes_explain_is_none() {
        let mut noise = all(&[(RandomTone, 90.0), (CorrelatedNoise, 90.0)]);
        let again = all(&[(RandomTone, 3.0), (CorrelatedNoise, 1.0)]);
        still_there(&mut noise, &again);
        // of a correlation that was taken out, nothing must be left
        assert_eq!(named(&noise), [CorrelatedNoise]);
    }

    #[test]
    fn beside_codes_and_noise_more_is_asked_of_a_cause() {
        let asked = |codes: &[(CauseId, f64)], noise: &[(CauseId, f64)]| {
            beside_codes_and_noise(&all(codes), &all(noise))
        };
        assert_eq!(asked(&[], &[]), 0.0);
        assert_eq!(asked(&[(CoarseLsb, 20_000.0)], &[]), 100.0);
        assert_eq!(asked(&[], &[(RandomTone, 1_000.0)]), 100.0);
        assert_eq!(asked(&[(Clipping, 40.0)], &[]), DETECTION_LIMIT);
        // h = 1: the variance is up to twice what is taken for it
        assert_eq!(asked(&[], &[(HeteroscedasticNoise, 100.0)]), 2.0 * DETECTION_LIMIT);
    }
}
