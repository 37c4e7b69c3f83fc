//! What the FD filter learns from faults: methods II and III, and the search. thesis §3-2-1.
//!
//! In: a healthy model and signals of faults. Out: [`LearnedFilter`].

use super::fd_filter::{LearnSettings, LearnedFilter, by_resonance};
use super::healthy_model::deviations;
use super::{DesignError, FaultClass, HealthyModel};
use crate::detect::{
    Denominator, ResidualGenerator, appendix, denominator_search, linear_programme, null_space,
    numerator, poles,
};
use crate::identify::averaging::SignalSet;

/// Degree of the numerator where there is room for it: 3 states are observable, and the fourth root rejects a
/// constant sensor offset.
const OFFSET_DEGREE: usize = 4;

impl LearnedFilter {
    /// Learns the filter from the class `detect.fault`. `healthy`: a model by method I, and its signals;
    /// `sets`: the class's signals, each set with the healthy model of its printhead.
    pub(super) fn learn(
        healthy: (&HealthyModel, &SignalSet),
        class: &FaultClass,
        sets: &[(&HealthyModel, &SignalSet)],
        settings: LearnSettings,
    ) -> Result<LearnedFilter, DesignError> {
        let (model, signals) = healthy;
        let (detect, dt_s) = (settings.detect, settings.sample_period_s);
        let degree = 2 + detect.other_poles_per_s.len();
        // Method II: the denominator has the eigenvalues of the faulty channel.
        if detect.denominator == Denominator::Eigenvalues {
            let fault = class.identify(model, settings.grey_box, dt_s)?;
            // check() has seen at least one other pole
            let filler = detect.other_poles_per_s.first().copied().unwrap_or(2e5);
            let denominator = poles::eigenvalues(&fault.channel.a(), filler, degree, dt_s)?;
            return Ok(LearnedFilter { denominator, enhancement: vec![1.0] });
        }

        // All others have method I's denominator and learn the factor M of the numerator.
        let denominator = by_resonance(&model.identification, signals.samples, detect, dt_s)?;
        let channel = &model.identification.channel;
        // N has at least one degree less than the denominator, which is the room for M.
        let n = || null_space::numerator_of(channel, dt_s, OFFSET_DEGREE.min(degree - 1));
        let enhancement = match detect.denominator {
            Denominator::Lp => {
                let fault = class.identify(model, settings.grey_box, dt_s)?.channel;
                linear_programme::most_sensitive(channel, &fault, dt_s, degree)?
            }
            Denominator::AppendixA => {
                let n = n()?;
                // N z^k is biproper beside the denominator
                let mut padded = n.clone();
                padded.resize(degree + 1, 0.0);
                let plain = ResidualGenerator::new(padded, denominator.clone(), dt_s)?;
                let mut residual = vec![0.0; signals.samples];
                plain.filter(&class.deviation, &mut residual);
                appendix::as_written(&residual, degree + 1 - n.len())?
            }
            // Method III by the deviations of healthy and faulty signals.
            _ => {
                let (healthy, faulty) = (deviations(&[(model, signals)]), deviations(sets));
                numerator::enhancement(&n()?, &denominator, &healthy, &faulty, dt_s)?
            }
        };
        Ok(LearnedFilter { denominator, enhancement })
    }

    /// Searches the denominator. `healthy`: a model by method I, and its signals; `sets`: signals of every
    /// labelled fault, each set with the healthy model of its printhead.
    pub(super) fn search(
        (model, signals): (&HealthyModel, &SignalSet),
        sets: &[(&HealthyModel, &SignalSet)],
        settings: LearnSettings,
    ) -> Result<LearnedFilter, DesignError> {
        let (dt_s, identification) = (settings.sample_period_s, &model.identification);
        let degree = 2 + settings.detect.other_poles_per_s.len();
        let numerator = null_space::numerator_of(&identification.channel, dt_s, degree)?;
        let (healthy, faulty) = (spread_out(&[(model, signals)]), spread_out(sets));
        let frequency_hz = identification.poles.frequency_hz;
        let found = denominator_search::search(&numerator, frequency_hz, &healthy, &faulty, dt_s)?;
        let denominator = found.choice.denominator(degree, dt_s);
        Ok(LearnedFilter { denominator, enhancement: vec![1.0] })
    }
}

/// Deviations for the search: at most `MOST` of them, evenly over all that there are, since the search looks
/// at each a hundred times.
fn spread_out(sets: &[(&HealthyModel, &SignalSet)]) -> Vec<Vec<f64>> {
    const MOST: usize = 4096;
    let all = deviations(sets);
    let step = all.len().div_ceil(MOST).max(1);
    all.into_iter().step_by(step).collect()
}
