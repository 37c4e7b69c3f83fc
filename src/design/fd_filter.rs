//! The FD filter of an identified model: numerator (3-2), denominator by method I, II or III, or searched.
//!
//! In: an identified model, `[detect]`, for all but method I what training has learned from
//! faults. Out: the residual generator. thesis §3-2-1.

use super::{DesignError, FaultClass, HealthyModel, LearnSettings};
use crate::detect::{
    Denominator, DetectSettings, ResidualGenerator, null_space, numerator, poles, search,
};
use crate::identify::averaging::SignalSet;
use crate::identify::grey_box::Identification;
use crate::model::Plant;
use serde::{Deserialize, Serialize};

/// What methods II and III and the search learn from faults. A later model of the same printer keeps it: only the
/// numerator N L follows the model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LearnedFilter {
    /// alpha(z), descending powers.
    pub denominator: Vec<f64>,
    /// M(z) of Appendix A, descending powers; the constant 1 but with method III.
    pub enhancement: Vec<f64>,
}

/// Numerator degree where there is room for it: 3 states are observable, the fourth root rejects a
/// constant sensor offset.
const OFFSET_DEGREE: usize = 4;

pub(super) fn residual_generator(
    identification: &Identification,
    samples: usize,
    settings: LearnSettings,
    dt_s: f64,
) -> Result<ResidualGenerator, DesignError> {
    let (a, c) = (identification.channel.a(), identification.channel.c());
    let LearnSettings { detect, filter, .. } = settings;
    match (detect.denominator, filter) {
        (Denominator::Resonance, _) => {
            let denominator = by_resonance(identification, samples, detect, dt_s)?;
            let numerator = null_space::numerator(&a, &c, dt_s, denominator.len() - 1)?;
            Ok(ResidualGenerator::new(numerator, denominator, dt_s)?)
        }
        (_, Some(LearnedFilter { denominator, enhancement })) => {
            let degree = denominator.len().saturating_sub(enhancement.len());
            let n = null_space::numerator(&a, &c, dt_s, degree)?;
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

/// alpha(z) of method I for a model.
pub(super) fn by_resonance(
    identification: &Identification,
    samples: usize,
    detect: &DetectSettings,
    dt_s: f64,
) -> Result<Vec<f64>, DesignError> {
    let oscillations = detect.oscillations.unwrap_or_else(|| {
        poles::healthy_oscillations(identification.poles.frequency_hz, samples, dt_s)
    });
    let omega_r = poles::resonance_of_oscillations(oscillations, samples, dt_s);
    Ok(poles::resonance(omega_r, &detect.other_poles_per_s, dt_s)?)
}

impl LearnedFilter {
    /// From the class `detect.fault`. `healthy`: a model by method I, and its signals; `sets`: the
    /// class's signals, each set with the healthy model of its printhead.
    pub(super) fn learn(
        healthy: (&HealthyModel, &SignalSet),
        class: &FaultClass,
        sets: &[(&HealthyModel, &SignalSet)],
        settings: LearnSettings,
    ) -> Result<LearnedFilter, DesignError> {
        let (model, signals) = healthy;
        let (detect, dt_s) = (settings.detect, settings.sample_period_s);
        let degree = 2 + detect.other_poles_per_s.len();
        if detect.denominator == Denominator::Eigenvalues {
            let fault = class.identify(model, settings.grey_box, dt_s)?;
            // check() has seen at least one other pole
            let filler = detect.other_poles_per_s.first().copied().unwrap_or(2e5);
            let denominator = poles::eigenvalues(&fault.channel.a(), filler, degree, dt_s)?;
            return Ok(LearnedFilter { denominator, enhancement: vec![1.0] });
        }
        let denominator = by_resonance(&model.identification, signals.samples, detect, dt_s)?;
        let (a, c) = (model.identification.channel.a(), model.identification.channel.c());
        // one degree less than the denominator at least: room for M
        let n = null_space::numerator(&a, &c, dt_s, OFFSET_DEGREE.min(degree - 1))?;
        let healthy = deviations(&[(model, signals)]);
        let faulty = deviations(sets);
        let (healthy, faulty) = (rows(&healthy), rows(&faulty));
        let enhancement = numerator::enhancement(&n, &denominator, &healthy, &faulty, dt_s)?;
        Ok(LearnedFilter { denominator, enhancement })
    }

    /// The search over denominators. `healthy`, `sets`: as above, of every labelled fault.
    pub(super) fn search(
        (model, signals): (&HealthyModel, &SignalSet),
        sets: &[(&HealthyModel, &SignalSet)],
        settings: LearnSettings,
    ) -> Result<LearnedFilter, DesignError> {
        let (dt_s, identification) = (settings.sample_period_s, &model.identification);
        let degree = 2 + settings.detect.other_poles_per_s.len();
        let (a, c) = (identification.channel.a(), identification.channel.c());
        let numerator = null_space::numerator(&a, &c, dt_s, degree)?;
        let (healthy, faulty) = (spread_out(&[(model, signals)]), spread_out(sets));
        let frequency_hz = identification.poles.frequency_hz;
        let found = search::search(&numerator, frequency_hz, &healthy, &faulty, dt_s)?;
        let denominator = found.choice.denominator(degree, dt_s);
        Ok(LearnedFilter { denominator, enhancement: vec![1.0] })
    }
}

/// Deviations for the search, which looks at each a hundred times: evenly over all that there are.
fn spread_out(sets: &[(&HealthyModel, &SignalSet)]) -> Vec<Vec<f64>> {
    const MOST: usize = 4096;
    let all = deviations(sets);
    let step = all.len().div_ceil(MOST).max(1);
    all.into_iter().step_by(step).collect()
}

/// Deviations per unit drive of every signal, counts.
pub(super) fn deviations(sets: &[(&HealthyModel, &SignalSet)]) -> Vec<Vec<f64>> {
    let mut all = Vec::new();
    for (model, set) in sets {
        for i in 0..set.len() {
            let drive = set.drive[i];
            let mut d = vec![0.0; set.samples];
            model.expect(drive, set.temperature_c[i], &mut d);
            for (d, &y) in d.iter_mut().zip(set.signal(i)) {
                *d = (f64::from(y) - *d) / drive;
            }
            all.push(d);
        }
    }
    all
}

fn rows(signals: &[Vec<f64>]) -> Vec<&[f64]> {
    signals.iter().map(Vec::as_slice).collect()
}
