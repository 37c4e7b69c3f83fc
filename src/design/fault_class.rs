//! A fault class as its mean deviation from the healthy model (thesis §3-3-2, rho before filtering).

use super::HealthyModel;
use crate::identify::averaging::SignalSet;
use serde::{Deserialize, Serialize};

/// Departs: thesis §3-3-2 keeps mean residuals. r = F (y - y_hat) is affine in y, so a mean
/// deviation is kept and filtered by whichever model judges: it survives re-identification.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FaultClass {
    pub name: String,
    pub category: String,
    pub n_signals: u64,
    /// Mean of y/s - y_hat per unit drive, counts.
    pub deviation: Vec<f64>,
}

impl FaultClass {
    /// From the class's signals, each set with the healthy model of its printhead.
    pub fn learn(name: &str, sets: &[(&HealthyModel, &SignalSet)]) -> FaultClass {
        let samples = sets.first().map_or(0, |(_, set)| set.samples);
        let (mut sum, mut weight, mut n) = (vec![0.0; samples], 0.0, 0);
        let mut expected = vec![0.0; samples];
        for (model, set) in sets {
            for i in 0..set.len() {
                let s = set.drive[i];
                model.expect(s, set.temperature_c[i], &mut expected);
                for (k, &y) in set.signal(i).iter().enumerate() {
                    sum[k] += s * (f64::from(y) - expected[k]);
                }
                weight += s * s;
                n += 1;
            }
        }
        sum.iter_mut().for_each(|v| *v /= weight);
        FaultClass {
            name: name.into(),
            category: crate::fault::category(name).into(),
            n_signals: n,
            deviation: sum,
        }
    }
}
