//! The terms that may be added to the oscillator, one at a time: the catalogue's cause of each, how many
//! numbers (parameters) it has, and whether it may join others. `plant.rs` says what each adds.
//!
//! Rivals without a name, the first [`IN_DECAYS`] of the catalogue, bend the motion, or what is seen of it: forces of
//! springs ([`Strengths::spring`]), rates at a time (`loss_after`, `frequency_after`), and what the sensor shows of a
//! path (`through_sensor`). Each has a strength, which is 0 if it is absent, and three of them a second number: a place,
//! a lag, or a rate of settling. Time counts in samples; displacements are in the scale of the decays.

use super::decays::Decays;
use super::motion::Form;
use crate::critique::catalogue::{CATALOGUE, CauseId, IN_DECAYS, RIVALS};
use crate::critique::tuned::{MOST_HARMONIC, MOST_LINES};
use crate::critique::unmodelled::{lagging, past, sensed, within};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// A damped mode, which every burst starts anew.
    Mode,
    /// An undamped line.
    Tone,
    /// Two lines, as far above the ring as below it: a gain or a time base that sways.
    SideBands,
    /// A power of the ring itself: so many times its frequency and damping.
    Harmonic(u8),
}

impl Line {
    pub fn all() -> impl Iterator<Item = Line> {
        let single = [Line::Mode, Line::Tone, Line::SideBands];
        single.into_iter().chain((2..=MOST_HARMONIC).map(Line::Harmonic))
    }

    pub fn is_damped(self) -> bool {
        matches!(self, Line::Mode | Line::SideBands)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Term {
    Stiffness(Form),
    Drag,
    Friction,
    Line(Line),
    /// A rival without a name.
    Unnamed(CauseId),
}

impl Term {
    /// The terms that have a name, but lines, which are tried at many frequencies.
    pub const NAMED: [Term; 4] =
        [Term::Stiffness(Form::Cubic), Term::Stiffness(Form::Sine), Term::Drag, Term::Friction];

    pub fn id(self) -> CauseId {
        match self {
            Term::Stiffness(_) => CauseId::CubicStiffness,
            Term::Drag => CauseId::QuadraticDrag,
            Term::Friction => CauseId::DryFriction,
            Term::Line(Line::Mode) => CauseId::SecondMode,
            Term::Line(Line::Tone) => CauseId::Tone,
            Term::Line(Line::SideBands) => CauseId::GainSways,
            Term::Line(Line::Harmonic(_)) => CauseId::OwnShape,
            Term::Unnamed(rival) => rival,
        }
    }

    pub fn words(self) -> &'static str {
        match self {
            // a single decay does not tell which of the two
            Term::Line(Line::SideBands) => "a gain or a time base that sways",
            Term::Line(Line::Harmonic(_)) => "a harmonic of the ring",
            _ if self.id().has_name() => self.id().name(),
            _ => self.id().row().words,
        }
    }

    pub fn is_line(self) -> bool {
        matches!(self, Term::Line(_))
    }

    pub fn places(self, decays: &Decays) -> f64 {
        match self {
            Term::Line(Line::Harmonic(_)) => f64::from(MOST_HARMONIC),
            Term::Line(_) => decays.samples as f64 / 2.0,
            _ => 1.0,
        }
    }

    /// How many numbers it has, beside the amplitudes of its waves. A mode has sigma and omega, a tone omega,
    /// side bands sigma and the distance to the ring's omega. Any other term has its strength, and some rivals a second
    /// number.
    pub fn numbers(self) -> usize {
        match self {
            Term::Line(Line::Harmonic(_)) => 0,
            Term::Line(Line::Tone) => 1,
            Term::Line(Line::Mode | Line::SideBands) => 2,
            _ => self.id().row().seconds.len().min(2),
        }
    }

    /// Step of a number's central difference; `None`: the motion does not depend on the number.
    pub fn step(self, number: usize, samples: usize) -> Option<f64> {
        let length = samples as f64;
        match (self.id(), number) {
            _ if self.is_line() => None,
            (CauseId::LossFollowsTime | CauseId::FrequencyFollowsTime, 0) => {
                Some(1e-3 / (length * length))
            }
            (CauseId::FrequencyFollowsTime, _) => Some(1e-3 / length),
            (CauseId::GainFollowsAmplitude, 1) => Some(1e-5 * length),
            _ => Some(1e-6),
        }
    }

    /// Whether it moves the phase, so that a fit must follow it from swing to swing.
    pub fn moves_phase(self) -> bool {
        match self {
            Term::Stiffness(_) | Term::Drag | Term::Friction => true,
            Term::Unnamed(rival) => {
                SPRINGS.contains(&rival) || rival == CauseId::FrequencyFollowsTime
            }
            Term::Line(_) => false,
        }
    }

    /// Whether it may be added to a model with these terms: there may be several lines.
    pub fn may_join(self, terms: &[Term]) -> bool {
        match self {
            Term::Line(Line::Mode | Line::Tone) => {
                terms.iter().filter(|term| term.is_line()).count() < MOST_LINES
            }
            Term::Line(_) => !terms.contains(&self),
            _ => terms.iter().all(|term| term.id() != self.id()),
        }
    }
}

pub fn unnamed() -> impl Iterator<Item = CauseId> {
    RIVALS[..IN_DECAYS].iter().map(|rival| rival.id)
}

pub const SPRINGS: [CauseId; 3] =
    [CauseId::EvenSpring, CauseId::OneSidedSpring, CauseId::SpringWithGap];
pub const RATES: [CauseId; 2] = [CauseId::LossFollowsTime, CauseId::FrequencyFollowsTime];
pub const SENSORS: [CauseId; 4] =
    [CauseId::EvenSensor, CauseId::OddSensor, CauseId::GainFollowsAmplitude, CauseId::DeafSensor];

/// Second numbers from which the search begins; a single value, which is not used, if there are none.
pub fn second_numbers(what: CauseId, samples: usize) -> Vec<f64> {
    let length = samples as f64;
    let in_samples = |second: &f64| match what {
        CauseId::GainFollowsAmplitude => second * length,
        CauseId::FrequencyFollowsTime => second / length,
        _ => *second,
    };
    what.row().seconds.iter().map(in_samples).collect()
}

/// Strength of each rival, and its second number if it has one.
///
/// Springs: k of k x^2; k of k (x - d) beyond a place d, on that side; the d within +-d of which there is no
/// force. Rates: what is added to sigma per sample; the relative slope of omega, and the rate at which that
/// slope falls. Sensors: c of c x^2 and c of c x^3; c of a gain 1/(1 + c a) with the amplitude a of the
/// motion, and the number of samples by which it lags; the d within +-d of which it is deaf.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Strengths([[f64; 2]; IN_DECAYS]);

impl Strengths {
    pub fn set(&mut self, what: CauseId, numbers: &[f64]) {
        self.0[what as usize - CATALOGUE.len()][..numbers.len()].copy_from_slice(numbers);
    }

    fn of(&self, what: CauseId) -> [f64; 2] {
        self.0[what as usize - CATALOGUE.len()]
    }

    /// Force of the rivals' springs at the displacement x, over the rate omega² of the spring itself; added
    /// to x.
    pub fn spring(&self, x: f64) -> f64 {
        let [gap, _] = self.of(CauseId::SpringWithGap);
        let [stop, place] = self.of(CauseId::OneSidedSpring);
        let [even, _] = self.of(CauseId::EvenSpring);
        even * x * x + stop * past(x, place) - within(x, gap)
    }

    pub fn has(&self, some: &[CauseId]) -> bool {
        some.iter().any(|what| self.of(*what)[0] != 0.0)
    }

    /// What has been added to sigma by a time.
    pub fn loss_after(&self, time: f64) -> f64 {
        self.of(CauseId::LossFollowsTime)[0] * time
    }

    /// Relative change of omega by a time: slope times time, or settling, slope (1 - e^{-rate time}) / rate.
    pub fn frequency_after(&self, time: f64) -> f64 {
        let [slope, rate] = self.of(CauseId::FrequencyFollowsTime);
        let run = if (rate * time).abs() < 1e-9 { time } else { -(-rate * time).exp_m1() / rate };
        slope * run
    }

    pub fn through_sensor(&self, path: &mut [[f64; 2]]) {
        let amplitudes = path.iter().map(|[x, u]| x.hypot(*u));
        let levels = lagging(amplitudes, self.of(CauseId::GainFollowsAmplitude)[1]);
        for ([x, _], level) in path.iter_mut().zip(levels) {
            let added = SENSORS.map(|sensor| sensed(sensor, self.of(sensor)[0], *x, level));
            *x += added.iter().sum::<f64>();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn second_numbers_are_a_place_a_lag_and_a_rate() {
        let mut of = Strengths::default();
        of.set(CauseId::OneSidedSpring, &[2.0, 0.3]);
        assert_eq!([of.spring(0.2), of.spring(-0.9)], [0.0; 2]);
        assert!((of.spring(0.8) - 1.0).abs() < 1e-12);
        of.set(CauseId::OneSidedSpring, &[2.0, -0.3]);
        assert!((of.spring(-0.8) + 1.0).abs() < 1e-12);

        let mut of = Strengths::default();
        of.set(CauseId::FrequencyFollowsTime, &[1e-3, 0.0]);
        assert_eq!(of.frequency_after(50.0), 0.05);
        of.set(CauseId::FrequencyFollowsTime, &[1e-3, 0.1]);
        assert!((of.frequency_after(1e4) - 0.01).abs() < 1e-12, "it settles");

        let mut of = Strengths::default();
        of.set(CauseId::GainFollowsAmplitude, &[1.0, 10.0]);
        let mut path = [[1.0, 0.0]; 200];
        of.through_sensor(&mut path);
        assert!(path[0][0] > 0.9 && (path[199][0] - 0.5).abs() < 1e-6, "it falls with a lag");
        of.set(CauseId::GainFollowsAmplitude, &[1.0, -10.0]);
        let mut path = [[1.0, 0.0]; 2];
        of.through_sensor(&mut path);
        assert!((path[0][0] - 0.5).abs() < 1e-12, "it has settled before");
    }
}
