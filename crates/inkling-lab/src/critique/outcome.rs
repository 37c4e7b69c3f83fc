//! What a critique returns: an [`Outcome`], or a [`CritiqueError`] that says why there is none; and the model with its
//! causes, where it may become a design.
//!
//! A design must not learn from a mixture of healthy and faulty signals, nor detect worse than the one without its
//! extension. So `check` asks which causes were selected, how many signals were left out as outliers, and what the
//! causes buy on held-out signals.

use super::candidates::{Applied, Setting};
use super::catalogue::CauseId;
use super::covariates::Covariates;
use super::finding::{Critique, Detection, Gain, Verdict};
use super::model::Model;
use super::refit::{apply, refit};
use inkling_core::numbers::LITTLE;
use thiserror::Error;

/// Fewest signals, of all ink channels together, and fewest samples of each signal of any plant, that a
/// critique needs.
pub const FEWEST_SIGNALS: usize = 8;
pub const FEWEST_SAMPLES: usize = 16;

#[derive(Debug, Error)]
pub enum CritiqueError {
    #[error(
        "{found} usable signals of an ink channel: a critique needs {FEWEST_SIGNALS} at least (few, long decays \
         of something else: --plant oscillator)"
    )]
    TooFew { found: usize },
    #[error("signals of {samples} samples: a critique needs {FEWEST_SAMPLES} at least")]
    TooShort { samples: usize },
    #[error(
        "nothing rings in these signals: one damped oscillation explains less than a tenth of them, or no more than chance would"
    )]
    NoRing,
    #[error(
        "no burst holds all {outputs} outputs of the oscillator: each of its decays must be one burst of all of them"
    )]
    NoCompleteBurst { outputs: usize },
    #[error(
        "these are signals of {printheads} printheads, and all outputs of an oscillator are one system: criticise \
         one printhead at a time, by recordings of it alone or by --labels that name no other"
    )]
    SeveralPrintheads { printheads: usize },
    #[error(
        "{outputs} channels are more than the {most} outputs that an oscillator may have: record or convert fewer"
    )]
    ManyOutputs { outputs: usize, most: usize },
    #[error("output {channel} of the oscillator never moves: record the others alone")]
    StillOutput { channel: u32 },
}

pub struct Outcome {
    pub critique: Critique,
    /// For each row of the given observations whether the signal was left out as unlike the others.
    pub outlier: Vec<bool>,
    /// The model for a design's extension (ink channels only), or why there is none.
    pub extended: Result<Extended, NotExtended>,
}

pub struct Extended {
    pub causes: Vec<CauseId>,
    pub model: Model,
    /// Covariates of the signals that were kept.
    pub beside: Covariates,
}

impl Extended {
    pub fn new(model: Model, causes: &[Applied], beside: &Covariates) -> Extended {
        let causes = causes.iter().map(|cause| cause.id).collect();
        Extended { causes, model, beside: beside.clone() }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum NotExtended {
    #[error("the model is none of an ink channel")]
    NoInkChannel,
    #[error(
        "what was found changes nothing that is expected of a signal: a design with it would be the plain one"
    )]
    NothingExpected,
    #[error("what was found has no name, and what it is like explains it in part only")]
    NoName,
    #[error(
        "with what was found, signals that nothing was fitted to are not predicted better: it is not worth it"
    )]
    NotWorth,
    #[error("signals whose noise is correlated could not be fitted as they came")]
    Unfit,
    #[error(
        "{left_out} of {all} signals belong to channels that ring unlike the others: of a mixture of healthy and \
         faulty channels thresholds are learned that hide faults; say which are healthy (--labels)"
    )]
    Mixture { left_out: usize, all: usize },
    #[error(
        "on signals that nothing was fitted to it detects worse than the plain one (AUC {after:.3}, {before:.3} \
         without it)"
    )]
    DetectsWorse { before: f64, after: f64 },
}

#[derive(Clone, Copy, Debug)]
pub struct OutlierCount {
    pub signals: usize,
    pub all: usize,
}

impl OutlierCount {
    /// Whether so many were left out that the rest cannot be trusted to be healthy.
    pub fn is_mixture(self) -> bool {
        self.signals as f64 > LITTLE * self.all as f64
    }

    pub fn remarks(self) -> Vec<String> {
        let mut remarks = Vec::new();
        if self.signals > 0 {
            remarks.push(format!(
                "{} of {} signals ring unlike the others, or are of channels that at times do, and were left \
                 out: faulty channels, it seems",
                self.signals, self.all
            ));
        }
        if self.is_mixture() {
            remarks.push(
                "so many are a mixture of healthy and faulty channels, and what is said of the rest may be said of \
                 faults: tell which are healthy (--labels)"
                    .into(),
            );
        }
        remarks
    }
}

pub fn check(
    causes: &[Applied],
    left_out: OutlierCount,
    gain: &Gain,
    verdict: Verdict,
) -> Result<(), NotExtended> {
    if causes.is_empty() {
        return Err(NotExtended::NothingExpected);
    }
    if left_out.is_mixture() {
        return Err(NotExtended::Mixture { left_out: left_out.signals, all: left_out.all });
    }
    // one cause must surely predict held-out signals better, or detection must be better
    let measured: Vec<_> = causes.iter().filter_map(|cause| gain.worth(cause.id)).collect();
    let worth_it = measured.is_empty() || measured.iter().any(|worth| worth.is_sure());
    if !worth_it && gain.detection() != Detection::Better {
        return Err(NotExtended::NotWorth);
    }
    if gain.detection_gain_interval.is_some_and(|[_, high]| high < 0.0) {
        return Err(NotExtended::DetectsWorse {
            before: gain.before.detection_auc,
            after: gain.after.detection_auc,
        });
    }
    // causes of an unknown misfit only resemble what is wrong
    if verdict == Verdict::Unknown {
        return Err(NotExtended::NoName);
    }
    Ok(())
}

/// The model of signals as they came, whose noise is correlated (`setting`), with those causes that
/// are the same in these and in whitened signals: shapes of the mean are dropped. Fitted anew, with
/// the sizes in whitened signals as the start.
pub fn in_colour(mut causes: Vec<Applied>, setting: Setting) -> Result<Extended, NotExtended> {
    causes.retain(|cause| !cause.id.is_shape());
    if causes.is_empty() {
        return Err(NotExtended::NothingExpected);
    }
    let mut model = Model::fitted(setting.data, 2).ok_or(NotExtended::Unfit)?;
    causes.iter().for_each(|cause| apply(&mut model, cause, 1.0, setting));
    let refit = refit(model, causes, setting, 2, true);
    Ok(Extended::new(refit.model, &refit.causes, &setting.data.beside))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gain(by: f64) -> Gain {
        Gain {
            detection_gain: by,
            detection_gain_interval: Some([by - 0.01, by + 0.01]),
            ..Gain::default()
        }
    }

    #[test]
    fn a_mixture_makes_no_design_nor_does_what_detects_worse() {
        let causes = [Applied::rigid(CauseId::Tone, vec![], vec![])];
        let check = |left_out, gain: &Gain| check(&causes, left_out, gain, Verdict::Named);
        let few = OutlierCount { signals: 40, all: 1000 };
        assert_eq!(check(few, &gain(0.1)), Ok(()));
        assert_eq!(check(few, &gain(0.0)), Ok(()));
        assert!(matches!(check(few, &gain(-0.1)), Err(NotExtended::DetectsWorse { .. })));
        let mixture = OutlierCount { signals: 397, all: 1140 };
        let refused = Err(NotExtended::Mixture { left_out: 397, all: 1140 });
        assert_eq!(check(mixture, &gain(0.1)), refused);
        let unnamed = |causes| super::check(causes, few, &gain(0.1), Verdict::Unknown);
        assert_eq!(unnamed(&causes), Err(NotExtended::NoName));
        assert_eq!(unnamed(&[]), Err(NotExtended::NothingExpected));
    }
}
