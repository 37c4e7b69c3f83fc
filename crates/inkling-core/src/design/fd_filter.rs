//! The FD (fault detection) filter of a model: numerator N L, which cancels healthy signals, thesis
//! (3-2), and denominator alpha by method I or as it was learned from faults, §3-2-1.
//!
//! In: an identified model, the settings `[detect]`, and what training has learned from faults
//! ([`LearnedFilter`]). Out: the [`ResidualGenerator`] r = (M N L / alpha) d, discretised exactly:
//! each pole s becomes z = e^(s dt). `learn` asks for a whole filter, others for parts of one.

use super::Result;
use crate::detect::{Denominator, DetectSettings, ResidualGenerator, null_space, numerator, poles};
use crate::identify::GreyBoxSettings;
use crate::identify::grey_box::Identification;
use crate::model::InkChannel;
use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug)]
pub struct LearnSettings<'a> {
    pub grey_box: &'a GreyBoxSettings,
    pub detect: &'a DetectSettings,
    /// Least share of a window's signals that must agree; `None`: labels say that all are healthy.
    pub least_agreeing: Option<f64>,
    pub sample_period_s: f64,
    /// What was learned from faults; `None` with method I.
    pub filter: Option<&'a LearnedFilter>,
}

/// What all methods but method I learn from faults (`learned_filter.rs`); N L is each model's own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LearnedFilter {
    /// alpha(z), descending powers.
    pub denominator: Vec<f64>,
    /// M(z), a factor of the numerator (thesis §3-2-1 III), descending powers; `[1]`: none.
    pub enhancement: Vec<f64>,
}

/// An error if the denominator must be learned from faults and was not, or if N has no room.
pub(super) fn residual_generator(
    identification: &Identification,
    samples: usize,
    settings: LearnSettings,
    dt_s: f64,
) -> Result<ResidualGenerator> {
    let LearnSettings { detect, filter, .. } = settings;
    match (detect.denominator, filter) {
        (Denominator::Resonance, _) => {
            let denominator = by_resonance(identification, samples, detect, dt_s)?;
            with_denominator(&identification.channel, denominator, dt_s)
        }
        (_, Some(LearnedFilter { denominator, enhancement })) => {
            // M N has the degree of the denominator
            let degree = denominator.len().saturating_sub(enhancement.len());
            let n = null_space::numerator_of(&identification.channel, dt_s, degree)?;
            let m_n = numerator::product(enhancement, &n);
            Ok(ResidualGenerator::new(m_n, denominator.clone(), dt_s)?)
        }
        (_, None) => Err(
            "detect.denominator: all but \"resonance\" are learned from faults: give a design that was \
             trained with it, or use \"resonance\""
                .into(),
        ),
    }
}

/// The filter N L / alpha of a healthy or faulty channel; N L and alpha have the same degree.
pub(super) fn with_denominator(
    channel: &InkChannel,
    denominator: Vec<f64>,
    dt_s: f64,
) -> Result<ResidualGenerator> {
    let numerator = null_space::numerator_of(channel, dt_s, denominator.len() - 1)?;
    Ok(ResidualGenerator::new(numerator, denominator, dt_s)?)
}

/// The denominator alpha(z) of method I, descending powers: an undamped pair at 2 pi n_o / T, and
/// the settings' other poles. n_o, the number of oscillations within a signal of length T, is
/// `detect.oscillations`, or `detect.oscillations_of_ring` (by default 1) times the healthy ring's.
pub(super) fn by_resonance(
    identification: &Identification,
    samples: usize,
    detect: &DetectSettings,
    dt_s: f64,
) -> Result<Vec<f64>> {
    let of_ring = poles::healthy_oscillations(identification.poles.frequency_hz, samples, dt_s);
    let oscillations =
        detect.oscillations.unwrap_or(of_ring * detect.oscillations_of_ring.unwrap_or(1.0));
    let omega_r = poles::resonance_of_oscillations(oscillations, samples, dt_s);
    Ok(poles::resonance(omega_r, &detect.other_poles_per_s, dt_s)?)
}
