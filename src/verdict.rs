//! One row per signal: outcomes, reasons, and the columns of the verdict table.

mod columns;
mod judged;

pub use columns::{COLUMNS, Cells, CellsAt, Column, VerdictColumns};
pub use judged::{HealthyRun, OfBurst, Part, Tests, Verdicts};

use crate::burst::Unusable;
use std::sync::Arc;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    Healthy,
    /// Faulty, and its class or its category is certain.
    Faulty,
    /// Faulty, but neither class nor category is certain enough.
    Undecided,
    /// Not analysed.
    Rejected,
}

impl Outcome {
    pub const ALL: [Outcome; 4] =
        [Outcome::Healthy, Outcome::Faulty, Outcome::Undecided, Outcome::Rejected];

    pub fn as_str(self) -> &'static str {
        match self {
            Outcome::Healthy => "healthy",
            Outcome::Faulty => "faulty",
            Outcome::Undecided => "undecided",
            Outcome::Rejected => "rejected",
        }
    }
}

/// Which test a signal's statistic and threshold are of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Test {
    /// Along the model's sensitivities.
    Ring,
    /// Beside them: what no ring explains.
    Misfit,
    /// Residual energy, thesis e(r).
    Energy,
}

impl Test {
    pub const ALL: [Test; 3] = [Test::Ring, Test::Misfit, Test::Energy];

    pub fn as_str(self) -> &'static str {
        match self {
            Test::Ring => "ring",
            Test::Misfit => "misfit",
            Test::Energy => "energy",
        }
    }
}

/// What a signal looks like that belongs to no known class.
#[derive(Clone, Debug, PartialEq)]
pub enum Appearance {
    /// Nothing rings: noise about zero, or about a constant.
    NoiseAlone,
    Constant,
    /// A healthy ring, so many times as large.
    OtherGain(f64),
    /// A healthy ring whose frequency and damping are both so many times as large, as on another clock.
    OtherClock(f64),
    /// A healthy ring so many seconds late.
    Late(f64),
    /// A ring whose rates are all a little off.
    AllOff,
    /// What else happens to channels, by its name.
    Like(Arc<str>),
    /// A steady tone of that frequency, Hz, beside the ring or instead of it.
    Tone(f64),
    /// A few samples that stand out.
    Jumps,
    /// A slow shape: an offset, a step, a drift.
    Slow,
    /// A ring and nothing beside it, as no known fault makes it.
    OtherRing,
    /// None of these.
    Other,
}

impl Appearance {
    /// What is no class is told beside the likeliest one from this share of its probability on: a twin that no decay tells apart.
    pub const AS_WELL: f64 = 0.25;
}

/// Why a signal was rejected, or why a faulty one is undecided. The names are the contract's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Reason {
    NonFinite,
    Saturated,
    WrongLength,
    UnknownFormat,
    UnknownLayout,
    NoChannels,
    BadPeriod,
    TooLarge,
    Undecodable,
    NoModel,
    DesignMismatch,
    Uncertain,
    /// A ring, but of no known class.
    UnknownFault,
    /// No ring explains it: sensor or acquisition.
    NoRing,
    /// The whole printhead is not the one that the design or its own past knows.
    HeadChanged,
    /// The same bits again and again.
    Frozen,
}

impl Reason {
    pub const ALL: [Reason; 16] = [
        Reason::NonFinite,
        Reason::Saturated,
        Reason::WrongLength,
        Reason::UnknownFormat,
        Reason::UnknownLayout,
        Reason::NoChannels,
        Reason::BadPeriod,
        Reason::TooLarge,
        Reason::Undecodable,
        Reason::NoModel,
        Reason::DesignMismatch,
        Reason::Uncertain,
        Reason::UnknownFault,
        Reason::NoRing,
        Reason::HeadChanged,
        Reason::Frozen,
    ];

    pub fn as_str(self) -> &'static str {
        match self {
            Reason::NonFinite => "non_finite",
            Reason::Saturated => "saturated",
            Reason::WrongLength => "wrong_length",
            Reason::UnknownFormat => "unknown_format",
            Reason::UnknownLayout => "unknown_layout",
            Reason::NoChannels => "no_channels",
            Reason::BadPeriod => "bad_period",
            Reason::TooLarge => "too_large",
            Reason::Undecodable => "undecodable",
            Reason::NoModel => "no_model",
            Reason::DesignMismatch => "design_mismatch",
            Reason::Uncertain => "uncertain",
            Reason::UnknownFault => "unknown_fault",
            Reason::NoRing => "no_ring",
            Reason::HeadChanged => "head_changed",
            Reason::Frozen => "frozen",
        }
    }
}

impl Reason {
    /// The one of that name.
    pub fn of(name: &str) -> Option<Reason> {
        Reason::ALL.into_iter().find(|reason| reason.as_str() == name)
    }

    /// The whole burst was unusable, and this row stands for it.
    pub fn is_of_burst(self) -> bool {
        matches!(
            self,
            Reason::WrongLength
                | Reason::UnknownFormat
                | Reason::UnknownLayout
                | Reason::NoChannels
                | Reason::BadPeriod
                | Reason::TooLarge
                | Reason::Undecodable
        )
    }

    /// It is told of the printhead as a whole: nothing is known of its nozzles, whether the row is undecided or
    /// rejected.
    pub fn is_of_head(self) -> bool {
        matches!(self, Reason::HeadChanged | Reason::Frozen)
    }

    /// In words, as the end of a sentence: `rejected, because ...`.
    pub fn in_words(self) -> &'static str {
        match self {
            Reason::NonFinite => "samples are no numbers",
            Reason::Saturated => "samples lie at the converter's limits",
            Reason::WrongLength => "bursts are longer or shorter than they say",
            Reason::UnknownFormat => "the format of the samples is not known",
            Reason::UnknownLayout => "the layout of the samples is not known",
            Reason::NoChannels => "bursts have no channels",
            Reason::BadPeriod => "the sample period is no positive number",
            Reason::TooLarge => "bursts are larger than is read",
            Reason::Undecodable => "messages cannot be decoded",
            Reason::NoModel => "no healthy window gave a model",
            Reason::DesignMismatch => "the design does not fit them",
            Reason::Uncertain => "no class is certain enough",
            Reason::UnknownFault => "they ring like no known class",
            Reason::NoRing => "no ring explains them",
            Reason::HeadChanged => "the printhead is not the one that the design or its past knows",
            Reason::Frozen => "the same samples come again and again",
        }
    }
}

impl From<Unusable> for Reason {
    fn from(why: Unusable) -> Reason {
        match why {
            Unusable::WrongLength => Reason::WrongLength,
            Unusable::UnknownFormat => Reason::UnknownFormat,
            Unusable::UnknownLayout => Reason::UnknownLayout,
            Unusable::NoChannels => Reason::NoChannels,
            Unusable::BadPeriod => Reason::BadPeriod,
            Unusable::TooLarge => Reason::TooLarge,
            Unusable::Undecodable => Reason::Undecodable,
        }
    }
}

/// Why a signal alone cannot be judged: a sample that is no number, or two or more consecutive
/// samples at or beyond a rail.
pub fn unusable_signal(signal: &[f64], rails: [f64; 2]) -> Option<Reason> {
    let at_rail = |y: f64| (y <= rails[0]) | (y >= rails[1]);
    // without a branch per sample: hardly a signal has any
    let (finite, railed) = signal.iter().fold((true, false), |(finite, railed), &y| {
        (finite & (y.abs() < f64::INFINITY), railed | at_rail(y))
    });
    if !finite {
        return Some(Reason::NonFinite);
    }
    let saturated = railed && signal.windows(2).any(|w| at_rail(w[0]) && at_rail(w[1]));
    saturated.then_some(Reason::Saturated)
}
