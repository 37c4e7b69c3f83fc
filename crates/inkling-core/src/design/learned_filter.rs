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
        if detect.denominator == Denominator::Lp {
            let fault = class.identify(model, settings.grey_box, dt_s)?.channel;
            let channel = &model.identification.channel;
            let enhancement = linear_programme::most_sensitive(channel, &fault, dt_s, degree)?;
            return Ok(LearnedFilter { denominator, enhancement });
        }
        let (a, c) = (model.identification.channel.a(), model.identification.channel.c());
        // N has at least one degree less than the denominator, which is the room for M.
        let n = null_space::numerator(&a, &c, dt_s, OFFSET_DEGREE.min(degree - 1))?;
        if detect.denominator == Denominator::AppendixA {
            let room = degree + 1 - n.len();
            let plain =
                ResidualGenerator::new(numerator::padded(&n, degree), denominator.clone(), dt_s)?;
            let mut residual = vec![0.0; signals.samples];
            plain.filter(&class.deviation, &mut residual);
            let enhancement = appendix::as_written(&residual, room)?;
            return Ok(LearnedFilter { denominator, enhancement });
        }

        // Method III by the deviations of healthy and faulty signals.
        let healthy = deviations(&[(model, signals)]);
        let faulty = deviations(sets);
        let (healthy, faulty) = (rows(&healthy), rows(&faulty));
        let enhancement = numerator::enhancement(&n, &denominator, &healthy, &faulty, dt_s)?;
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
        let (a, c) = (identification.channel.a(), identification.channel.c());
        let numerator = null_space::numerator(&a, &c, dt_s, degree)?;
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

fn rows(signals: &[Vec<f64>]) -> Vec<&[f64]> {
    signals.iter().map(Vec::as_slice).collect()
}
