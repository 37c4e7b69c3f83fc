//! The terms that may be added to the oscillator, one at a time: the catalogue's cause of each, how many
//! numbers (parameters) it has, and whether it may join others. `plant.rs` says what each adds.

use super::decays::Decays;
use super::motion::Form;
use super::unnamed::SPRINGS;
use crate::critique::catalogue::CauseId;

/// Largest number of lines beside the ring.
const MOST_LINES: usize = 11;
pub const MOST_HARMONIC: u8 = 5;

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
    Offset,
    Stiffness(Form),
    Drag,
    Friction,
    Line(Line),
    /// A slow exponential beside the ring, or nearly a straight line: a zero that drifts, or settles.
    Drift,
    /// A rival without a name (`unnamed.rs`).
    Unnamed(CauseId),
}

impl Term {
    /// The terms that have a name, but lines, which are tried at many frequencies.
    pub const NAMED: [Term; 4] =
        [Term::Stiffness(Form::Cubic), Term::Stiffness(Form::Sine), Term::Drag, Term::Friction];

    pub fn id(self) -> CauseId {
        match self {
            Term::Offset => CauseId::Offset,
            Term::Stiffness(_) => CauseId::CubicStiffness,
            Term::Drag => CauseId::QuadraticDrag,
            Term::Friction => CauseId::DryFriction,
            Term::Line(Line::Mode) => CauseId::SecondMode,
            Term::Line(Line::Tone) => CauseId::Tone,
            Term::Line(Line::SideBands) => CauseId::GainSways,
            Term::Line(Line::Harmonic(_)) => CauseId::OwnShape,
            Term::Drift => CauseId::Drift,
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

    /// Whether neither the equation nor the list of modes holds it.
    pub fn is_untold(self) -> bool {
        !self.id().has_name() && self != Term::Drift
    }

    pub fn places(self, decays: &Decays) -> f64 {
        match self {
            Term::Line(Line::Harmonic(_)) => f64::from(MOST_HARMONIC),
            Term::Line(_) => decays.samples as f64 / 2.0,
            _ => 1.0,
        }
    }

    /// How many numbers it has, beside the amplitudes of its waves. A mode has sigma and omega, a tone omega,
    /// side bands sigma and the distance to the ring's omega, a drift its rate. Any other term that is no line has its
    /// strength, and some rivals a second number.
    pub fn numbers(self) -> usize {
        match self {
            Term::Offset | Term::Line(Line::Harmonic(_)) => 0,
            Term::Line(Line::Tone) => 1,
            Term::Line(Line::Mode | Line::SideBands) => 2,
            _ => self.id().row().seconds.len().min(2),
        }
    }

    /// Step of a number's central difference; `None`: the motion does not depend on the number.
    pub fn step(self, number: usize, samples: usize) -> Option<f64> {
        let length = samples as f64;
        match (self.id(), number) {
            _ if matches!(self, Term::Offset | Term::Drift | Term::Line(_)) => None,
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
            Term::Offset | Term::Drift | Term::Line(_) => false,
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
