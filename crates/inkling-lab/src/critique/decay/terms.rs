//! What may be added to the oscillator, one term at a time.

use super::motion::Form;
use super::plant::{Decays, Line, Structure};
use crate::critique::catalogue::CauseId;

/// Lines that are looked for at most.
const MOST_LINES: usize = 8;

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
            Term::Line(Line::Tone) => CauseId::Tone,
            Term::Unnamed(rival) => rival,
        }
    }

    pub fn words(self) -> &'static str {
        if self.id().has_name() { self.id().name() } else { self.id().row().words }
    }

    /// Independent places that it was looked for at.
    pub fn places(self, decays: &Decays) -> f64 {
        match self {
            Term::Line(_) => decays.samples as f64 / 2.0,
            _ => 1.0,
        }
    }

    pub fn put(self, structure: &Structure) -> Structure {
        let mut with = structure.clone();
        match self {
            Term::Offset => with.offset = true,
            Term::Stiffness(form) => with.stiffness = Some(form),
            Term::Drag => with.drag = true,
            Term::Friction => with.friction = true,
            Term::Line(line) => with.lines.push(line),
            Term::Unnamed(what) => with.unnamed.push(what),
        }
        with
    }

    pub fn is_in(self, structure: &Structure) -> bool {
        match self {
            Term::Offset => structure.offset,
            Term::Stiffness(_) => structure.stiffness.is_some(),
            Term::Drag => structure.drag,
            Term::Friction => structure.friction,
            Term::Line(_) => structure.lines.len() >= MOST_LINES,
            Term::Unnamed(what) => structure.unnamed.contains(&what),
        }
    }
}
