//! Why a candidate is not the cause: objections to one that fits, and the reasons that the evidence tells.

use super::catalogue::CauseId;
use thiserror::Error;

/// Why a candidate cannot be the cause although it fits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Objection {
    #[error("{0}")]
    Untested(&'static str),
    #[error("its coefficient has the unphysical sign")]
    UnphysicalSign,
    // objections to what is added to signals, or moves their parameters
    #[error("needs a drive scan")]
    NoDriveScan,
    #[error("what follows is the acquisition state alone")]
    StateAlone,
    #[error("its line lies at the model's own frequency or a multiple of it")]
    OwnLine,
    #[error("it is so slow that it may be no line")]
    SlowLine,
    #[error("its best size lies where the range ends that is looked at")]
    AtTheEnd,
    #[error("its refit leads nowhere")]
    LeadsNowhere,
    // objections to findings in codes, noise and trigger
    #[error("codes are missing, but not those between the multiples of a step")]
    NoLattice,
    #[error("what a stronger cause leaves")]
    LeftByAStronger,
    #[error("what other causes leave in single signals")]
    LeftInSignals,
    #[error("it is looked for beside the causes")]
    LookedForLater,
    #[error("what bends the ring leaves so much at its frequency")]
    LeftAtTheRing,
    #[error("bursts may differ as much in amplitude")]
    AnyDirection,
    // objections to causes of decays
    #[error("the viscous damping beside it would be negative")]
    NegativeDamping,
    #[error(
        "one of the two modes would have a negative damping: an alias of a frequency or a damping that changes \
         with amplitude"
    )]
    Alias,
    #[error("the spring would push away at the largest amplitude")]
    PushesAway,
    #[error("its damping cannot be told from none")]
    Undamped,
    #[error("it is no line of the spectrum")]
    NoLine,
    #[error("it is too near to the frequency of the ring to be told from it")]
    NearTheRing,
    #[error("it lies on {0} times the frequency of the ring")]
    Multiple(i32),
    #[error("it lies on {0} times the frequency of the ring, folded")]
    Folded(i32),
    #[error("it cannot be told from a line that is in the model")]
    Known,
    #[error("it does not oscillate")]
    Overdamped,
    #[error("it is little of what is left")]
    Little,
}

/// Why a candidate was not accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum WhyNot {
    #[error("not significant")]
    NotSignificant,
    #[error("{0}")]
    Objection(Objection),
    #[error("another cause explains more")]
    AnotherExplainsMore,
    #[error("{0} explains more")]
    ExplainsMore(CauseId),
    /// It passes, but is no more than what this one leaves.
    #[error("explained by {0}")]
    ExplainedBy(CauseId),
    #[error("passes, but no further cause is looked for")]
    NotLookedFor,
}
