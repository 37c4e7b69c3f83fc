//! What the FD filter learns from faults by all methods but method I. thesis §3-2-1.
//!
//! In, from `train`: a healthy model by method I, its signals, and signals of faults. Out:
//! [`LearnedFilter`]: alpha(z) and M(z) of the filter M N L / alpha. Where nothing is said, alpha
//! is by method I and M = 1:
//! * `eigenvalues` (II): alpha has the eigenvalues of the identified faulty channel;
//! * `enhanced` (III): M maximises faulty over healthy residual energy;
//! * `lp`: M N L is the row of the null space that is most sensitive to the fault, (3-3b).
//!
//! Polynomials in z have descending powers. Every alpha has the degree 2 + number of
//! `other_poles_per_s`, so that methods can be compared.

use super::fd_filter::{LearnSettings, LearnedFilter, by_resonance};
use super::healthy_model::deviations;
use super::{FaultClass, HealthyModel, Result};
use crate::detect::{Denominator, linear_programme, null_space, numerator, poles};
use crate::identify::SignalSet;

/// Degree of N, if there is room: 3 observable states, and a root z = 1 against a constant offset.
const OFFSET_DEGREE: usize = 4;

impl LearnedFilter {
    /// Learns from the class `detect.fault`. `healthy`: a model by method I, and its signals. An
    /// error if the class's dynamics cannot be identified, or if the degree leaves no room.
    pub(super) fn learn(
        healthy: (&HealthyModel, &SignalSet),
        class: &FaultClass,
        sets: &[(&HealthyModel, &SignalSet)],
        settings: LearnSettings,
    ) -> Result<LearnedFilter> {
        let (model, signals) = healthy;
        let (detect, dt_s) = (settings.detect, settings.sample_period_s);
        let degree = 2 + detect.other_poles_per_s.len();

        let denominator = by_resonance(&model.identification, signals.samples, detect, dt_s)?;
        let channel = &model.identification.channel;
        match detect.denominator {
            Denominator::Resonance => Ok(LearnedFilter { denominator, enhancement: vec![1.0] }),
            // method II; degrees that the eigenvalues do not fill get poles at `filler`, 1/s
            Denominator::Eigenvalues => {
                let fault = class.identify(model, settings.grey_box, dt_s)?;
                // `DetectSettings::check` has refused none
                let filler = detect.other_poles_per_s.first().copied().unwrap_or(2e5);
                let denominator = poles::eigenvalues(&fault.channel, filler, degree, dt_s)?;
                Ok(LearnedFilter { denominator, enhancement: vec![1.0] })
            }
            // method III; N has at least one degree less than the denominator: room for M
            Denominator::Enhanced => {
                let n = null_space::numerator_of(channel, dt_s, OFFSET_DEGREE.min(degree - 1))?;
                let (healthy, faulty) = (deviations(&[(model, signals)]), deviations(sets));
                let enhancement =
                    numerator::enhancement(&n, &denominator, &healthy, &faulty, dt_s)?;
                Ok(LearnedFilter { denominator, enhancement })
            }
            Denominator::Lp => {
                let fault = class.identify(model, settings.grey_box, dt_s)?.channel;
                let enhancement = linear_programme::most_sensitive(channel, &fault, dt_s, degree)?;
                Ok(LearnedFilter { denominator, enhancement })
            }
        }
    }
}
