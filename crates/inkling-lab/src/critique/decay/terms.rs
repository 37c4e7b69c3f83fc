//! What may be added to the oscillator, one term at a time, and how many numbers each has.

use super::decays::Decays;
use super::motion::Form;
use super::unnamed;
use crate::critique::catalogue::CauseId;

/// Lines that are looked for at most.
const MOST_LINES: usize = 8;

/// An added oscillation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// A damped mode: every burst starts it anew.
    Mode,
    /// Undamped, and the same in all bursts: it comes from outside, and starts the decays.
    Tone,
    /// Undamped, and met by each burst wherever it is: it comes from outside.
    FreeTone,
    /// Two as far above the ring as below: what a gain or a time base that sways makes of it.
    SideBands,
}

impl Line {
    pub const ALL: [Line; 4] = [Line::Mode, Line::Tone, Line::FreeTone, Line::SideBands];

    pub fn is_damped(self) -> bool {
        matches!(self, Line::Mode | Line::SideBands)
    }

    /// Its frequencies, beside a ring of frequency `own`; `number`: the second of its numbers.
    pub fn frequencies(self, own: f64, number: f64) -> Vec<f64> {
        match self {
            Line::Mode | Line::Tone | Line::FreeTone => vec![number],
            Line::SideBands => vec![own + number, own - number],
        }
    }
}

/// What may be added to the oscillator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Term {
    Offset,
    Stiffness(Form),
    Drag,
    Friction,
    Line(Line),
    Unnamed(CauseId),
}

impl Term {
    /// Those that have a name, but for lines, which are looked for at many places.
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
            // one decay does not tell which
            Term::Line(Line::SideBands) => "a gain or a time base that sways",
            _ if self.id().has_name() => self.id().name(),
            _ => self.id().row().words,
        }
    }

    pub fn is_line(self) -> bool {
        matches!(self, Term::Line(_))
    }

    /// Independent places that it was looked for at.
    pub fn places(self, decays: &Decays) -> f64 {
        if self.is_line() { decays.samples as f64 / 2.0 } else { 1.0 }
    }

    /// Of an offset one of each output; of a line sigma (0 for a tone), omega (of side bands the distance to the ring's),
    /// then cosine and sine of each output (of each burst; of both side bands).
    pub fn numbers(self, decays: &Decays) -> usize {
        match self {
            Term::Offset => decays.outputs,
            Term::Stiffness(_) | Term::Drag | Term::Friction => 1,
            Term::Line(Line::Mode | Line::FreeTone) => 2 + 2 * decays.bursts * decays.outputs,
            Term::Line(Line::Tone) => 2 + 2 * decays.outputs,
            Term::Line(Line::SideBands) => 2 + 4 * decays.bursts * decays.outputs,
            Term::Unnamed(rival) => unnamed::numbers(rival),
        }
    }

    /// By how much one of its numbers is moved to learn what that changes, in decays of so many samples; `None`: the
    /// motion does not depend on it.
    pub fn step(self, number: usize, samples: usize) -> Option<f64> {
        match self {
            Term::Stiffness(_) | Term::Drag | Term::Friction => Some(1e-6),
            Term::Unnamed(rival) => Some(unnamed::step(rival, number, samples)),
            Term::Offset | Term::Line(_) => None,
        }
    }

    /// Whether it moves the phase, so that it must be followed from swing to swing.
    pub fn moves_phase(self) -> bool {
        match self {
            Term::Stiffness(_) | Term::Drag | Term::Friction => true,
            Term::Unnamed(rival) => unnamed::moves_phase(rival),
            Term::Offset | Term::Line(_) => false,
        }
    }

    /// Whether a model with these terms has room for it: of lines there may be several, of all else one.
    pub fn may_join(self, terms: &[Term]) -> bool {
        match self {
            Term::Line(line) if line != Line::SideBands => {
                terms.iter().filter(|term| term.is_line()).count() < MOST_LINES
            }
            _ => terms.iter().all(|term| term.id() != self.id()),
        }
    }
}
