//! Says how a recording's models came to be, in its summary and with `--timings`.

use super::learner::Learner;
use serde::Serialize;

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Identified {
    pub how: ModelSource,
    /// The reason for which models were not learned while the signals flowed; `None`: they were.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
}

/// How the models of a recording came to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ModelSource {
    /// From the design, with windows only for printheads that it does not know.
    Design,
    /// From windows, while the signals flowed.
    InStream,
    /// From windows, in passes before the stages started.
    TwoPasses,
}

impl Identified {
    /// `why`: the reason for which models were learned before the stages started; `None`: they were not.
    pub fn by(learner: &Learner, why: Option<String>) -> Identified {
        let how = match why {
            _ if learner.knows_by_design() => ModelSource::Design,
            None => ModelSource::InStream,
            Some(_) => ModelSource::TwoPasses,
        };
        Identified { how, why }
    }

    /// A sentence about it; `None`: there is nothing to say.
    pub fn in_words(&self) -> Option<String> {
        let why = self.why.as_ref()?;
        Some(format!("models and baselines were learned in passes of their own: {why}"))
    }
}
