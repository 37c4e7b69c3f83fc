//! Decides whether a weak finding beside strong ones is a cause of its own: no model of a cause is exact, so
//! a strong cause leaves some misfit that the test of another may pick up.
//!
//! In: all findings with their likelihood-ratio statistics. Out: whether each is beyond what the others may
//! leave. The rule ([`Finding::is_beyond`]): beside every other finding, a finding must have at least the
//! share of the other's statistic that the other's model may leave to it (`leaves_to`: 0, .6, 3 or 10 %, the
//! square of a relative error), and beside a stronger one also one detection limit.

use super::candidate::{Candidate, Objection};
use super::catalogue::{Acts, CauseId};
use super::chance::DETECTION_LIMIT;
use super::covariates::{TEMPERATURE, TIME};
use super::tuned::{LEFT_TO_SHAPES, LEFT_TO_UNLIKE};
use inkling_core::numbers::LITTLE;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Shows {
    InCodes,
    /// In the scatter of samples, signals or bursts.
    InNoise,
    InTheMean,
    ByACovariate,
}

#[derive(Clone, Debug)]
pub struct Finding {
    pub id: CauseId,
    pub tied_with: Vec<CauseId>,
    pub statistic: f64,
    /// For noise that grows with the signal: its largest variance over that where signals are 0, else 1. The
    /// tests assume one variance, so chance gives statistics up to this factor larger.
    pub growth: f64,
}

impl Finding {
    pub fn of<Form>(candidate: &Candidate<Form>, tied_with: &[CauseId]) -> Finding {
        let Candidate { id, statistic, value, .. } = *candidate;
        let growth = if id == CauseId::HeteroscedasticNoise { 1.0 + value } else { 1.0 };
        Finding { id, tied_with: tied_with.to_vec(), statistic, growth }
    }

    fn shows(&self) -> Shows {
        match self.id.row().acts {
            Acts::Codes => Shows::InCodes,
            Acts::Noise | Acts::Trigger => Shows::InNoise,
            Acts::Mean(_) => Shows::InTheMean,
            Acts::Rates { .. } | Acts::Ring { .. } | Acts::PreviousRing => Shows::ByACovariate,
        }
    }

    /// Whether both causes act through the same covariate, or one through time and the other through a
    /// temperature that the data cannot tell from it, or both through the amplitude.
    fn is_alike(&self, other: &Finding) -> bool {
        let by_either = |id: CauseId| matches!(id.follows(), Some(TIME | TEMPERATURE));
        let of_tied = |x: &Finding| x.tied_with.iter().any(|id| id.follows() != x.id.follows());
        let collinear =
            by_either(self.id) && by_either(other.id) && (of_tied(self) || of_tied(other));
        let followed = self.id.follows().is_some() && self.id.follows() == other.id.follows();
        followed || collinear || self.id.by_amplitude() && other.id.by_amplitude()
    }

    fn leaves_to(&self, other: &Finding) -> f64 {
        use Shows::{ByACovariate, InCodes, InNoise, InTheMean};
        match (self.shows(), other.shows()) {
            (_, InCodes) | (InCodes, InNoise) => 0.0,
            (InNoise, _) => LITTLE,
            _ if self.is_alike(other) => LITTLE,
            (InTheMean, InTheMean) | (ByACovariate, ByACovariate) => LEFT_TO_SHAPES,
            (InTheMean, ByACovariate) | (ByACovariate, InTheMean) => 0.0,
            // a coarse step leaves out codes whatever a covariate does; which samples are clipped depends on
            // the amplitude
            (InCodes, ByACovariate) if self.id == CauseId::CoarseLsb => 0.0,
            (InCodes, _) | (_, InNoise) => LEFT_TO_UNLIKE,
        }
    }

    /// Beside a stronger cause, it must also reach one detection limit (times that cause's `growth`), unless
    /// it is in codes, or in noise beside codes.
    pub fn is_beyond<'a>(&self, others: impl IntoIterator<Item = &'a Finding>) -> bool {
        others.into_iter().filter(|other| other.id != self.id).all(|other| {
            let chance = match (other.shows(), self.shows()) {
                (_, Shows::InCodes) | (Shows::InCodes, Shows::InNoise) => 0.0,
                _ => other.growth * DETECTION_LIMIT,
            };
            let least = chance.min(other.statistic);
            self.statistic >= least.max(other.leaves_to(self) * other.statistic)
        })
    }
}

/// The value of a cause if it is among `found` and accepted.
pub fn accepted(found: &[Candidate], id: CauseId) -> Option<f64> {
    found.iter().find(|f| f.id == id && f.accepted()).map(|f| f.value)
}

/// What was tested in codes, and in noise and trigger, accepted or not.
#[derive(Clone, Debug, Default)]
pub struct Artefacts {
    pub codes: Vec<Candidate>,
    pub noise: Vec<Candidate>,
    /// `Outliers::shape_surprise`; 0: nothing odd.
    pub odd_signals: f64,
}

impl Artefacts {
    pub fn all(&self) -> impl Iterator<Item = &Candidate> {
        self.codes.iter().chain(&self.noise)
    }

    pub fn accepted(&self) -> impl Iterator<Item = &Candidate> {
        self.all().filter(|f| f.accepted())
    }

    pub fn findings(&self) -> Vec<Finding> {
        self.accepted().map(|f| Finding::of(f, &[])).collect()
    }
}

/// Withdraws findings in noise and trigger that are no more than what others, or `chosen` ones, may leave.
pub fn leave_out(artefacts: &mut Artefacts, chosen: Vec<Finding>) {
    let mut all = artefacts.findings();
    all.extend(chosen);
    for f in artefacts.noise.iter_mut().filter(|f| f.accepted()) {
        if !Finding::of(f, &[]).is_beyond(&all) {
            f.objection = Some(Objection::LeftByOthers);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::CauseId::*;
    use super::*;

    fn one(id: CauseId, statistic: f64) -> Finding {
        Finding { id, tied_with: vec![], statistic, growth: 1.0 }
    }

    /// Which of these findings are beyond what the others leave.
    fn kept<const N: usize>(all: [(CauseId, f64); N]) -> [bool; N] {
        let all = all.map(|(id, statistic)| one(id, statistic));
        all.each_ref().map(|own| own.is_beyond(&all))
    }

    #[test]
    fn what_a_strong_cause_leaves_is_no_cause_of_its_own() {
        // 2 % of another shape's statistic is what that shape leaves; the same beside a shape, in a
        // covariate, is a cause
        assert_eq!(kept([(Tone, 5000.0), (Offset, 100.0)]), [true, false]);
        assert_eq!(kept([(Tone, 5000.0), (Temperature, 100.0)]), [true, true]);
        // of two causes that follow the same covariate, or act through the amplitude, the weaker needs a
        // larger share
        assert_eq!(kept([(Ageing, 1000.0), (ClockDrift, 80.0)]), [true, false]);
        assert_eq!(kept([(CubicStiffness, 1000.0), (DryFriction, 80.0)]), [true, false]);
        // a weak cause stays alone, but not beside a stronger one
        assert_eq!(kept([(Tone, 18.0)]), [true]);
        assert_eq!(kept([(Tone, 60.0), (Offset, 18.0)]), [true, false]);
        // jitter beside other noise, and beside causes of different strength
        assert_eq!(kept([(RandomTone, 900.0), (TriggerJitter, 41.0)]), [true, false]);
        assert_eq!(kept([(Crosstalk, 18_000.0), (TriggerJitter, 41.0)]), [true, false]);
        assert_eq!(kept([(Crosstalk, 1000.0), (TriggerJitter, 41.0)]), [true, true]);
        // codes stay whatever else there is; what they leave depends on what they are
        assert_eq!(kept([(CoarseLsb, 20.0), (Offset, 90.0), (RandomTone, 90.0)]), [true; 3]);
        assert_eq!(kept([(CoarseLsb, 20_000.0), (Offset, 90.0)]), [true, false]);
        assert_eq!(kept([(CoarseLsb, 20_000.0), (Temperature, 90.0)]), [true, true]);
        assert_eq!(kept([(Clipping, 20_000.0), (Temperature, 90.0)]), [true, false]);
    }

    #[test]
    fn beside_a_temperature_that_follows_time_both_are_one() {
        let tied = Finding { tied_with: vec![Ageing], ..one(Temperature, 1000.0) };
        assert!(!one(ClockDrift, 80.0).is_beyond([&tied]));
        assert!(one(ClockDrift, 80.0).is_beyond([&one(Temperature, 1000.0)]));
    }

    /// Where the signal is largest, the noise has twice the variance that it has without a signal.
    #[test]
    fn beside_noise_that_grows_more_is_asked() {
        let growing = Finding { growth: 2.0, ..one(HeteroscedasticNoise, 100.0) };
        assert!(!one(Offset, 1.9 * DETECTION_LIMIT).is_beyond([&growing]));
        assert!(one(Offset, 2.1 * DETECTION_LIMIT).is_beyond([&growing]));
    }
}
