//! The FD filter of an identified model: numerator (3-2), denominator by method I or as it was learned.
//!
//! In: an identified model, `[detect]`, for all but method I what training has learned from faults. Out: the
//! residual generator. thesis §3-2-1.

use super::DesignError;
use crate::detect::{Denominator, DetectSettings, ResidualGenerator, null_space, numerator, poles};
use crate::identify::GreyBoxSettings;
use crate::identify::grey_box::Identification;
use crate::model::InkChannel;
use serde::{Deserialize, Serialize};

/// Settings for learning a healthy model.
#[derive(Clone, Copy, Debug)]
pub struct LearnSettings<'a> {
    pub grey_box: &'a GreyBoxSettings,
    pub detect: &'a DetectSettings,
    /// Least share of a window's signals that must agree with each other; `None`: labels say that all are
    /// healthy.
    pub least_agreeing: Option<f64>,
    pub sample_period_s: f64,
    /// The part of the filter that methods II, III and the search have learned from faults; `None` with
    /// method I.
    pub filter: Option<&'a LearnedFilter>,
}

/// What methods II and III and the search learn from faults. A later model of the same printer keeps it: only
/// the numerator N L follows the model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LearnedFilter {
    /// alpha(z), descending powers.
    pub denominator: Vec<f64>,
    /// M(z) of Appendix A, descending powers; the constant 1 with methods that learn the denominator alone.
    pub enhancement: Vec<f64>,
}

/// The filter of an identified model for signals of `samples` samples. An error if the chosen denominator is
/// one that is learned from faults and nothing was learned.
pub(super) fn residual_generator(
    identification: &Identification,
    samples: usize,
    settings: LearnSettings,
    dt_s: f64,
) -> Result<ResidualGenerator, DesignError> {
    let LearnSettings { detect, filter, .. } = settings;
    match (detect.denominator, filter) {
        (Denominator::Resonance, _) => {
            let denominator = by_resonance(identification, samples, detect, dt_s)?;
            with_denominator(&identification.channel, denominator, dt_s)
        }
        (_, Some(LearnedFilter { denominator, enhancement })) => {
            // the degree that is left for N, so that M N has no higher degree than the denominator
            let degree = denominator.len().saturating_sub(enhancement.len());
            let n = null_space::numerator_of(&identification.channel, dt_s, degree)?;
            let m_n = numerator::product(enhancement, &n);
            Ok(ResidualGenerator::new(m_n, denominator.clone(), dt_s)?)
        }
        (_, None) => Err(DesignError::Invalid(
            "detect.denominator: all but \"resonance\" are learned from faults: give a design that was \
             trained with it, or use \"resonance\""
                .into(),
        )),
    }
}

/// The filter of a channel with this denominator, whose numerator has the same degree.
pub(super) fn with_denominator(
    channel: &InkChannel,
    denominator: Vec<f64>,
    dt_s: f64,
) -> Result<ResidualGenerator, DesignError> {
    let numerator = null_space::numerator_of(channel, dt_s, denominator.len() - 1)?;
    Ok(ResidualGenerator::new(numerator, denominator, dt_s)?)
}

/// The denominator alpha(z) of method I for a model: poles at the resonance that rings for a given number of
/// oscillations within a signal, by default for as many as the healthy ring has.
pub(super) fn by_resonance(
    identification: &Identification,
    samples: usize,
    detect: &DetectSettings,
    dt_s: f64,
) -> Result<Vec<f64>, DesignError> {
    let of_ring = poles::healthy_oscillations(identification.poles.frequency_hz, samples, dt_s);
    let oscillations =
        detect.oscillations.unwrap_or(of_ring * detect.oscillations_of_ring.unwrap_or(1.0));
    let omega_r = poles::resonance_of_oscillations(oscillations, samples, dt_s);
    Ok(poles::resonance(omega_r, &detect.other_poles_per_s, dt_s)?)
}
