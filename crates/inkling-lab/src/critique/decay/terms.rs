//! The terms that may be added to the oscillator, one at a time: the catalogue's cause of each, how many
//! numbers (parameters) it has, and whether it may join others. `plant.rs` says what each adds.

use super::decays::Decays;
use super::motion::Form;
use super::unnamed::SPRINGS;
use crate::critique::catalogue::CauseId;

const MOST_LINES: usize = 8;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// A damped mode, which every burst starts anew.
    Mode,
    /// An undamped line, the same in all bursts: the decays are triggered by it.
    Tone,
    /// An undamped line that each burst meets at another phase.
    FreeTone,
    /// Two lines, as far above the ring as below it: a gain or a time base that sways.
    SideBands,
}

impl Line {
    pub const ALL: [Line; 4] = [Line::Mode, Line::Tone, Line::FreeTone, Line::SideBands];

    pub fn is_damped(self) -> bool {
        matches!(self, Line::Mode | Line::SideBands)
    }

    /// Its frequencies beside a ring of frequency `own`, rad per sample. `number`: the frequency itself, or
    /// of side bands the distance to the ring's.
    pub fn frequencies(self, own: f64, number: f64) -> Vec<f64> {
        match self {
            Line::Mode | Line::Tone | Line::FreeTone => vec![number],
            Line::SideBands => vec![own + number, own - number],
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Term {
    Offset,
    Stiffness(Form),
    Drag,
    Friction,
    Line(Line),
    /// A rival without a name (`unnamed.rs`).
    Unnamed(CauseId),
}

impl Term {
    /// The terms that have a name, but lines, which are tried at many frequencies.
    pub const NAMED: [Term; 5] = [
        Term::Offset,
        Term::Stiffness(Form::Cubic),
        Term::Stiffness(Form::Sine),
        Term::Drag,
        Term::Friction,
    ];

    pub fn id(self) -> CauseId {
        match self {
            Term::Offset => CauseId::Offset,
            Term::Stiffness(_) => CauseId::CubicStiffness,
            Term::Drag => CauseId::QuadraticDrag,
            Term::Friction => CauseId::DryFriction,
            Term::Line(Line::Mode) => CauseId::SecondMode,
            Term::Line(Line::Tone | Line::FreeTone) => CauseId::Tone,
            Term::Line(Line::SideBands) => CauseId::GainSways,
            Term::Unnamed(rival) => rival,
        }
    }

    pub fn words(self) -> &'static str {
        match self {
            // a single decay does not tell which of the two
            Term::Line(Line::SideBands) => "a gain or a time base that sways",
            _ if self.id().has_name() => self.id().name(),
            _ => self.id().row().words,
        }
    }

    pub fn is_line(self) -> bool {
        matches!(self, Term::Line(_))
    }

    pub fn places(self, decays: &Decays) -> f64 {
        if self.is_line() { decays.samples as f64 / 2.0 } else { 1.0 }
    }

    /// How many numbers it has. An offset has one for each output. A line has sigma (0 for a tone), omega
    /// (side bands: the distance to the ring's), then the amplitudes of a cosine and a sine for each output;
    /// all lines but a plain tone for each burst, and side bands for each of two bands. Any other term has
    /// its strength, and some rivals a second number.
    pub fn numbers(self, decays: &Decays) -> usize {
        match self {
            Term::Offset => decays.outputs,
            Term::Line(Line::Mode | Line::FreeTone) => 2 + 2 * decays.bursts * decays.outputs,
            Term::Line(Line::Tone) => 2 + 2 * decays.outputs,
            Term::Line(Line::SideBands) => 2 + 4 * decays.bursts * decays.outputs,
            _ => self.id().row().seconds.len().min(2),
        }
    }

    /// Step of a number's central difference; `None`: the motion does not depend on the number.
    pub fn step(self, number: usize, samples: usize) -> Option<f64> {
        let length = samples as f64;
        match (self.id(), number) {
            _ if self == Term::Offset || self.is_line() => None,
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
            Term::Offset | Term::Line(_) => false,
        }
    }

    /// Whether it may be added to a model with these terms: there may be several lines.
    pub fn may_join(self, terms: &[Term]) -> bool {
        match self {
            Term::Line(line) if line != Line::SideBands => {
                terms.iter().filter(|term| term.is_line()).count() < MOST_LINES
            }
            _ => terms.iter().all(|term| term.id() != self.id()),
        }
    }
}
