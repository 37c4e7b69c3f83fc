//! Rivals without a name: what a decay may do that the catalogue does not hold but would give a name to.
//!
//! Each has one parameter, as most names have, and competes with them on the same scale. Where one is
//! likelier the misfit keeps no name; the reader is told what it is like.

/// What may be in a decay beside the catalogue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unnamed {
    /// Spring + k x^2.
    Even,
    /// Spring + k x where x > 0.
    OneSided,
    /// Spring that does not pull within +-d.
    Gap,
    /// Damping rate + c t.
    LossFollowsTime,
    /// Frequency (1 + c t).
    FrequencyFollowsTime,
    /// Sensor + c x^2.
    EvenSensor,
    /// Sensor + c x^3.
    OddSensor,
    /// Sensor whose gain is 1/(1 + c a), with the amplitude a of the motion: a gain control.
    GainFollowsAmplitude,
    /// Sensor that is deaf within +-d.
    DeafSensor,
}

pub const UNNAMED: [Unnamed; 9] = [
    Unnamed::Even,
    Unnamed::OneSided,
    Unnamed::Gap,
    Unnamed::LossFollowsTime,
    Unnamed::FrequencyFollowsTime,
    Unnamed::EvenSensor,
    Unnamed::OddSensor,
    Unnamed::GainFollowsAmplitude,
    Unnamed::DeafSensor,
];

impl Unnamed {
    pub fn words(self) -> &'static str {
        match self {
            Unnamed::Even => "a spring of even order",
            Unnamed::OneSided => "a spring that is stiffer on one side",
            Unnamed::Gap => "a spring with a gap",
            Unnamed::LossFollowsTime => "a damping that changes with time",
            Unnamed::FrequencyFollowsTime => "a frequency that changes with time",
            Unnamed::EvenSensor => "a sensor curve of even order",
            Unnamed::OddSensor => "a sensor curve of odd order",
            Unnamed::GainFollowsAmplitude => "a gain that follows the amplitude",
            Unnamed::DeafSensor => "a sensor that is deaf about its zero",
        }
    }

    /// Per sample, not per unit of the motion.
    pub fn is_a_rate(self) -> bool {
        matches!(self, Unnamed::LossFollowsTime | Unnamed::FrequencyFollowsTime)
    }

    /// Whether it moves the phase, so that it must be followed from swing to swing.
    pub fn moves_phase(self) -> bool {
        use Unnamed::{Even, FrequencyFollowsTime, Gap, OneSided};
        matches!(self, Even | OneSided | Gap | FrequencyFollowsTime)
    }
}

/// How strong each is, in the order of [`UNNAMED`]; rates per sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Strengths(pub [f64; UNNAMED.len()]);

impl Strengths {
    fn of(&self, what: Unnamed) -> f64 {
        self.0[what as usize]
    }

    /// What the spring has beyond its own curve, over its rate.
    pub fn spring(&self, x: f64) -> f64 {
        let gap = self.of(Unnamed::Gap);
        let stop = self.of(Unnamed::OneSided) * x.max(0.0);
        self.of(Unnamed::Even) * x * x + stop - x.clamp(-gap.abs(), gap.abs()) * gap.signum()
    }

    pub fn bends(&self) -> bool {
        [Unnamed::Even, Unnamed::OneSided, Unnamed::Gap].iter().any(|w| self.of(*w) != 0.0)
    }

    /// Of sigma (added) and of omega (relative) from one sample to the next.
    pub fn per_sample(&self) -> [f64; 2] {
        [self.of(Unnamed::LossFollowsTime), self.of(Unnamed::FrequencyFollowsTime)]
    }

    pub fn curves(&self) -> bool {
        use Unnamed::{DeafSensor, EvenSensor, GainFollowsAmplitude, OddSensor};
        [EvenSensor, OddSensor, GainFollowsAmplitude, DeafSensor].iter().any(|w| self.of(*w) != 0.0)
    }

    /// x as the sensor gives it.
    pub fn seen(&self, [x, u]: [f64; 2]) -> f64 {
        let deaf = self.of(Unnamed::DeafSensor);
        let even = self.of(Unnamed::EvenSensor) * x * x;
        let odd = self.of(Unnamed::OddSensor) * x * x * x;
        let gain = 1.0 / (1.0 + self.of(Unnamed::GainFollowsAmplitude) * x.hypot(u));
        gain * x + even + odd - x.clamp(-deaf.abs(), deaf.abs()) * deaf.signum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_strength_is_its_own_and_changes_one_thing() {
        for (k, what) in UNNAMED.into_iter().enumerate() {
            assert_eq!(what as usize, k, "{what:?}");
            let mut of = Strengths::default();
            of.0[k] = 0.1;
            let changes = [of.bends(), of.per_sample() != [0.0; 2], of.curves()];
            assert_eq!(changes.iter().filter(|c| **c).count(), 1, "{what:?}");
            assert_eq!(of.spring(0.5) != 0.0, of.bends(), "{what:?}");
            assert_eq!(of.seen([0.5, 0.2]) != 0.5, of.curves(), "{what:?}");
        }
    }
}
