//! Why a candidate is not the cause, as values with their words: an [`Objection`] is a property of a
//! candidate that fits but cannot be the cause; a [`WhyNot`] is the reason that a row of the evidence tells.
//! Tests set objections, `search.rs` and `candidate.rs` the reasons.

use super::catalogue::CauseId;
use thiserror::Error;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Objection {
    /// The data cannot test it; the words say what it needs.
    #[error("{0}")]
    Untested(&'static str),
    #[error("its coefficient has the unphysical sign")]
    UnphysicalSign,
    // objections to what is added to signals, or moves their parameters
    /// It shows in how a shape scales with the drive, which did not vary enough.
    #[error("needs a drive scan")]
    NoDriveScan,
    /// Its own parameter does not follow the covariate significantly; only the amplitudes at t_a do.
    #[error("what follows is the acquisition state alone")]
    StateAlone,
    #[error("its line lies at the model's own frequency or a multiple of it")]
    OwnLine,
    #[error("it is so slow that it may be no line")]
    SlowLine,
    #[error("its best size lies where the range ends that is looked at")]
    AtTheEnd,
    /// It passed the linear test, but no refit was better.
    #[error("its refit leads nowhere")]
    LeadsNowhere,
    // objections to findings in codes, noise and trigger
    #[error("codes are missing, but not those between the multiples of a step")]
    NoLattice,
    #[error("its higher lags or its levels are not those of an autoregression")]
    NoAutoregression,
    #[error("what other causes leave")]
    LeftByOthers,
    /// A jitter whose bursts may vary as much across the shift in time as along it.
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
    #[error("it is no line of the spectrum")]
    NoLine,
    /// In a coloured misfit anything takes some of it: a line must take a tenth, another cause 3 %.
    #[error("it is little of what is left")]
    TooWeak,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum WhyNot {
    #[error("not significant")]
    NotSignificant,
    #[error("{0}")]
    Objection(Objection),
    /// It was refitted and lost against something without a name.
    #[error("another cause explains more")]
    AnotherExplainsMore,
    #[error("{0} explains more")]
    ExplainsMore(CauseId),
    /// Its statistic is beyond the threshold, but this cause was chosen without a refit of it.
    #[error("explained by {0}")]
    ExplainedBy(CauseId),
    /// Its statistic is beyond the threshold in a step in which nothing was chosen.
    #[error("passes, but no further cause is looked for")]
    NotLookedFor,
}
