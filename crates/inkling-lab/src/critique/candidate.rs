//! A candidate for a cause after its test, whatever it acts on: the mean signal, codes, noise, or a decay.
//!
//! In: a test's statistic. Out: whether the candidate can be the cause (its `surprise` exceeds `THRESHOLD`,
//! and no `objection` speaks against it), its row of the evidence, and the cause that it becomes. An [`Objection`]
//! is a property of a candidate that fits but cannot be the cause; a [`WhyNot`] is the reason that a row tells.

use super::catalogue::CauseId;
use super::chance::{DETECTION_LIMIT, THRESHOLD, statistic_of, surprise};
use super::finding::{Cause, Evidence};
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

/// `Form`: the candidate's representation in the model; () for codes, noise and trigger, `Applied` for
/// signals, `Added` for decays.
#[derive(Clone, Debug)]
pub struct Candidate<Form = ()> {
    pub id: CauseId,
    /// Likelihood-ratio statistic: by how much -2 ln likelihood falls if the candidate is in the model, or
    /// less after corrections. Chi-squared with `degrees` where there is no effect.
    pub statistic: f64,
    pub degrees: usize,
    pub tried: f64,
    /// -ln of the probability of that statistic by chance, corrected for the shapes tried.
    pub surprise: f64,
    /// Size of the effect, as the parameter that the catalogue names; NaN where it was not estimated.
    pub value: f64,
    pub sd: f64,
    pub objection: Option<Objection>,
    pub form: Form,
}

impl Candidate {
    /// A finding whose surprise is not that of a chi-squared statistic; twice the surprise stands for that.
    pub fn by_chance(id: CauseId, surprise: f64, value: f64, sd: f64) -> Candidate {
        Candidate { surprise, value, sd, ..Candidate::plain(id, 2.0 * surprise, ()) }
    }

    pub fn nothing(id: CauseId) -> Candidate {
        Candidate::by_chance(id, 0.0, f64::NAN, f64::NAN)
    }

    pub fn untested(id: CauseId, why: &'static str) -> Candidate {
        Candidate { objection: Some(Objection::Untested(why)), ..Candidate::nothing(id) }
    }
}

impl<Form> Candidate<Form> {
    /// A candidate of one degree of freedom and one shape, whose size was not estimated.
    pub fn plain(id: CauseId, statistic: f64, form: Form) -> Candidate<Form> {
        Candidate {
            id,
            statistic,
            degrees: 1,
            tried: 1.0,
            surprise: surprise(statistic, 1, 1.0, f64::INFINITY),
            value: f64::NAN,
            sd: f64::NAN,
            objection: None,
            form,
        }
    }

    pub fn has_name(&self) -> bool {
        self.id.has_name()
    }

    pub fn able(&self) -> bool {
        self.objection.is_none()
    }

    pub fn is_significant(&self) -> bool {
        self.surprise > THRESHOLD
    }

    /// Whether it is the cause by its significance alone, as decided for codes, noise and trigger.
    pub fn accepted(&self) -> bool {
        self.is_significant() && self.able()
    }

    /// Why it is no cause, if no other candidate was chosen.
    pub fn why_not(&self) -> WhyNot {
        let passes =
            if self.is_significant() { WhyNot::NotLookedFor } else { WhyNot::NotSignificant };
        self.objection.map_or(passes, WhyNot::Objection)
    }

    pub fn strength_dl(&self) -> f64 {
        (self.statistic.max(0.0) / DETECTION_LIMIT).sqrt()
    }

    /// BIC of the model without it minus BIC with it (each parameter costs the logarithm of the number of
    /// samples, `ln_samples`).
    pub fn delta_bic(&self, ln_samples: f64) -> f64 {
        self.statistic - self.degrees as f64 * ln_samples
    }

    /// The cause with its normal 95 % interval, tied with none, whose sentence is still to be written.
    pub fn cause(&self, delta_bic: f64) -> Cause {
        let Candidate { id, value, sd, .. } = *self;
        Cause {
            id,
            parameter: id.row().parameter.into(),
            unit: id.row().unit.into(),
            value,
            ci95: [value - 1.96 * sd, value + 1.96 * sd],
            strength_dl: self.strength_dl(),
            delta_bic,
            tied_with: Vec::new(),
            tied_unnamed: Vec::new(),
            matters_for_detection: false,
            explains: None,
            sentence: String::new(),
        }
    }

    /// `step`: number of causes that had entered before. The threshold is the statistic that would just have been
    /// significant, if corrections reduced its plain surprise as much as they did here.
    pub fn evidence(&self, step: u32, ln_samples: f64) -> Evidence {
        let plain = |x: f64| surprise(x, self.degrees, self.tried, f64::INFINITY);
        let asked = THRESHOLD + (plain(self.statistic) - self.surprise).max(0.0);
        let is_tested = !matches!(self.objection, Some(Objection::Untested(_)));
        Evidence {
            step,
            id: self.id,
            statistic: self.statistic,
            threshold: if is_tested { statistic_of(asked, plain) } else { f64::NAN },
            p: (-self.surprise).exp(),
            delta_bic: self.delta_bic(ln_samples),
            strength_dl: self.strength_dl(),
            value: self.value,
            sd: self.sd,
            why_not: Some(self.why_not()),
        }
    }
}

#[derive(Clone, Debug)]
pub struct Chosen<Form> {
    /// Its statistic compares the model with it and the model without it.
    pub candidate: Candidate<Form>,
    /// When it entered.
    pub delta_bic: f64,
    /// Candidates that cannot be told apart from it: with a name, and without.
    pub tied_with: Vec<CauseId>,
    pub tied_unnamed: Vec<CauseId>,
}

impl<Form> Chosen<Form> {
    pub fn cause(&self) -> Cause {
        Cause {
            tied_with: self.tied_with.clone(),
            tied_unnamed: self.tied_unnamed.clone(),
            ..self.candidate.cause(self.delta_bic)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_statistic_is_beyond_its_threshold_where_its_surprise_is() {
        for (degrees, tried) in [(1, 1.0), (2, 20.0), (4, 20.0)] {
            for statistic in [1.0, 10.0, 13.0, 20.0, 40.0, 90.0] {
                for lowered in [0.0, 2.0, 20.0] {
                    let plain = Candidate::plain(CauseId::Tone, statistic, ());
                    let surprise = surprise(statistic, degrees, tried, f64::INFINITY) - lowered;
                    let one = Candidate { degrees, tried, surprise, ..plain };
                    let beyond = statistic > one.evidence(0, 1.0).threshold;
                    assert_eq!(beyond, one.is_significant(), "{degrees} {statistic} {lowered}");
                }
            }
        }
        let untested = Candidate::untested(CauseId::Tone, "more");
        assert!(untested.evidence(0, 1.0).threshold.is_nan());
    }
}
