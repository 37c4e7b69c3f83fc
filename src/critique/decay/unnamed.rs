//! Rivals without a name in a long decay: how each bends the motion or what is seen of it.
//!
//! In: the first [`IN_DECAYS`] rivals of the catalogue and their strengths. Out: forces, rates, what the sensor gives.

use crate::critique::catalogue::{CATALOGUE, CauseId, IN_DECAYS, RIVALS};

pub fn unnamed() -> impl Iterator<Item = CauseId> {
    RIVALS[..IN_DECAYS].iter().map(|rival| rival.id)
}

/// Per sample, not per unit of the motion.
pub fn is_a_rate(what: CauseId) -> bool {
    matches!(what, CauseId::LossFollowsTime | CauseId::FrequencyFollowsTime)
}

/// Whether it moves the phase, so that it must be followed from swing to swing.
pub fn moves_phase(what: CauseId) -> bool {
    use CauseId::{EvenSpring, FrequencyFollowsTime, OneSidedSpring, SpringWithGap};
    matches!(what, EvenSpring | OneSidedSpring | SpringWithGap | FrequencyFollowsTime)
}

/// How strong each is; rates per sample. Springs: k of k x^2; of k x where x > 0; the d within +-d of which there is no
/// force. Sensors: c of c x^2 and c x^3; of a gain 1/(1 + c a) with the amplitude a of the motion; the d within +-d of
/// which it is deaf.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Strengths([f64; IN_DECAYS]);

impl Strengths {
    pub const NONE: Strengths = Strengths([0.0; IN_DECAYS]);

    fn place(what: CauseId) -> usize {
        what as usize - CATALOGUE.len()
    }

    pub fn set(&mut self, what: CauseId, strength: f64) {
        self.0[Strengths::place(what)] = strength;
    }

    fn of(&self, what: CauseId) -> f64 {
        self.0[Strengths::place(what)]
    }

    /// What the spring has beyond its own curve, over its rate.
    pub fn spring(&self, x: f64) -> f64 {
        let gap = self.of(CauseId::SpringWithGap);
        let stop = self.of(CauseId::OneSidedSpring) * x.max(0.0);
        let even = self.of(CauseId::EvenSpring) * x * x;
        even + stop - x.max(-gap.abs()).min(gap.abs()) * gap.signum()
    }

    pub fn bends(&self) -> bool {
        use CauseId::{EvenSpring, OneSidedSpring, SpringWithGap};
        [EvenSpring, OneSidedSpring, SpringWithGap].iter().any(|w| self.of(*w) != 0.0)
    }

    /// Of sigma (added) and of omega (relative) from one sample to the next.
    pub fn per_sample(&self) -> [f64; 2] {
        [CauseId::LossFollowsTime, CauseId::FrequencyFollowsTime].map(|what| self.of(what))
    }

    pub fn curves(&self) -> bool {
        use CauseId::{DeafSensor, EvenSensor, GainFollowsAmplitude, OddSensor};
        [EvenSensor, OddSensor, GainFollowsAmplitude, DeafSensor].iter().any(|w| self.of(*w) != 0.0)
    }

    /// x as the sensor gives it.
    pub fn seen(&self, [x, u]: [f64; 2]) -> f64 {
        let deaf = self.of(CauseId::DeafSensor);
        let even = self.of(CauseId::EvenSensor) * x * x;
        let odd = self.of(CauseId::OddSensor) * x * x * x;
        let gain = 1.0 / (1.0 + self.of(CauseId::GainFollowsAmplitude) * x.hypot(u));
        gain * x + even + odd - x.max(-deaf.abs()).min(deaf.abs()) * deaf.signum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_strength_is_its_own_and_changes_one_thing() {
        for what in unnamed() {
            let mut of = Strengths::NONE;
            of.set(what, 0.1);
            let changes = [of.bends(), of.per_sample() != [0.0; 2], of.curves()];
            assert_eq!(changes.iter().filter(|c| **c).count(), 1, "{what:?}");
            assert_eq!(of.spring(0.5) != 0.0, of.bends(), "{what:?}");
            assert_eq!(of.seen([0.5, 0.2]) != 0.5, of.curves(), "{what:?}");
        }
    }
}
