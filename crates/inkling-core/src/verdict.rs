//! What is said of one signal: outcome, deciding test, reason, appearance. One signal is one row of
//! the verdict table. `schemas/verdicts.md` is the contract: the names here are the table's.
//!
//! At or below its thresholds a signal is *healthy*. A flagged one is *faulty* if its class or its
//! category was named with certainty, else *undecided*. A signal that was not analysed is *rejected*.

pub mod at_once;
mod columns;
mod judged;

pub use columns::{COLUMNS, Cells, CellsAt, Column, VerdictColumns};
pub use judged::{HealthyRun, Part, Tests, Verdicts};

use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// An enum with the names that tables write: lines `Variant "name";` or `Variant "name" "words";`.
macro_rules! named {
    ($(#[$about:meta])* $type:ident { $($(#[$of:meta])* $one:ident $name:literal $($words:literal)?;)* }) => {
        $(#[$about])*
        pub enum $type { $($(#[$of])* $one,)* }

        impl $type {
            pub const ALL: [$type; [$($name),*].len()] = [$($type::$one),*];

            pub fn as_str(self) -> &'static str {
                match self { $($type::$one => $name,)* }
            }

            pub fn of(name: &str) -> Option<$type> {
                $type::ALL.into_iter().find(|one| one.as_str() == name)
            }
        }

        named!(words $type { $($one $($words)?;)* });
    };
    // nothing where there are no words, else `in_words`
    (words $type:ident { $($one:ident;)* }) => {};
    (words $type:ident { $($one:ident $words:literal;)* }) => {
        impl $type {
            /// The variant in words, as the end of a sentence: `rejected, because ...`.
            pub fn in_words(self) -> &'static str {
                match self { $($type::$one => $words,)* }
            }
        }
    };
}

pub(crate) use named;

named! {
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    Outcome {
        Healthy "healthy";
        Faulty "faulty";
        Undecided "undecided";
        Rejected "rejected";
    }
}

named! {
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    Test {
        /// A distance of the ring's features from healthy ones.
        Ring "ring";
        /// The misfit beside the ring: what no ring explains.
        Misfit "misfit";
        /// The size of the FD filter's residual: its energy, thesis e(r), or its largest sample.
        Energy "energy";
    }
}

/// What a signal looks like that is of no class, or may as well be; *healthy* is the model's ring.
#[derive(Clone, Debug, PartialEq)]
pub enum Appearance {
    NoiseAlone,
    Constant,
    /// A healthy ring, this many times as large.
    OtherGain(f64),
    /// A healthy ring with frequency and damping this many times as large, as on another clock.
    OtherClock(f64),
    /// A healthy ring that begins this many seconds late.
    Late(f64),
    /// A ring of a channel all of whose rates a, b, g, d are a little off.
    AllOff,
    /// Something else that happens to channels and is no class, by its name.
    Like(Arc<str>),
    /// A steady tone of this frequency, Hz, beside the ring or instead of it.
    Tone(f64),
    Jumps,
    /// A slow shape: an offset, a step, a drift.
    Slow,
    /// A ring with nothing beside it, as no known fault makes it.
    OtherRing,
    Other,
}

impl Appearance {
    /// Least share of the likeliest class's probability or density at which no class is as likely.
    pub const AS_WELL: f64 = 0.25;
}

named! {
    /// Why a signal was rejected, or why a faulty one is undecided.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    Reason {
        // of a signal, or of a whole burst (`is_of_burst`): rejected
        NonFinite "non_finite" "samples are no numbers";
        Saturated "saturated" "samples lie at the converter's limits";
        WrongLength "wrong_length" "bursts are longer or shorter than they say";
        UnknownFormat "unknown_format" "the format of the samples is not known";
        UnknownLayout "unknown_layout" "the layout of the samples is not known";
        NoChannels "no_channels" "bursts have no channels";
        BadPeriod "bad_period" "the sample period is no positive number";
        TooLarge "too_large" "bursts are larger than is read";
        Undecodable "undecodable" "messages cannot be decoded";
        NoModel "no_model" "no healthy window gave a model";
        DesignMismatch "design_mismatch" "the design does not fit them";
        // of a flagged signal: undecided
        Uncertain "uncertain" "no class is certain enough";
        UnknownFault "unknown_fault" "they ring like no known class";
        /// No ring explains the signal: sensor or acquisition.
        NoRing "no_ring" "no ring explains them";
        // either
        /// The whole printhead is not the one that the design or its own past knows.
        HeadChanged "head_changed" "the printhead is not the one that the design or its past knows";
        /// The channel repeats the same bits again and again.
        Frozen "frozen" "the same samples come again and again";
    }
}

impl Reason {
    /// Whether the reason is that of a whole unusable burst, for which one row stands.
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

    /// Whether the reason is about the printhead or its reading: nothing is known of the nozzle.
    pub fn is_of_head(self) -> bool {
        matches!(self, Reason::HeadChanged | Reason::Frozen)
    }
}

/// A number of this magnitude or more stands for no number: instruments write 9.9e37 for infinity and 9.91e37
/// for not-a-number (SCPI).
pub const NO_VALUE: f64 = 9.8e37;

/// Why a signal cannot be judged, by its samples (counts) alone: one is none, or two or more
/// consecutive ones are at or beyond a rail, the lower or the upper limit of the converter.
pub fn unusable_signal(signal: &[f64], rails: [f64; 2]) -> Option<Reason> {
    let at_rail = |y: f64| (y <= rails[0]) | (y >= rails[1]);
    let (finite, railed) = signal.iter().fold((true, false), |(finite, railed), &y| {
        (finite & (y.abs() < NO_VALUE), railed | at_rail(y))
    });
    if !finite {
        return Some(Reason::NonFinite);
    }
    let saturated = railed && signal.windows(2).any(|w| at_rail(w[0]) && at_rail(w[1]));
    saturated.then_some(Reason::Saturated)
}
