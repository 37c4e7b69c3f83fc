//! Fast detection: a model's statistic in f32 for many signals at once, one in each lane. It settles most
//! healthy signals of a stream; the rest is judged by the f64 reference.

use super::HealthyModel;
use crate::detect::kernel::LaneFilter;
use crate::detect::lane_sensitivity::{LaneSensitivity, Limits};
use crate::detect::sensitivity::{CLEARLY_FAR, SECOND_LOOK};

/// The statistic of `detect.method` in f32, for many signals at once. The residual energy takes signals
/// transposed to a tile, the sensitivity signals as they lie in memory.
#[derive(Clone, Debug)]
pub enum Lanes {
    ResidualEnergy(LaneFilter),
    Sensitivity(Box<LaneSensitivity>),
}

impl Lanes {
    /// The lanes of a model. `None`: f32 cannot serve, or the statistic is neither of the two.
    pub fn of(model: &HealthyModel) -> Option<Lanes> {
        if model.statistic.is_some() || model.decoupled.is_some() {
            return None;
        }
        let (expected, response) = (&model.expected, model.temperature_response.as_deref());
        match &model.sensitivity {
            None => {
                LaneFilter::new(&model.generator, expected, response).map(Lanes::ResidualEnergy)
            }
            Some(sensitivity) => LaneSensitivity::new(sensitivity, expected, response)
                .map(|lanes| Lanes::Sensitivity(Box::new(lanes))),
        }
    }

    /// Number of samples of a signal.
    pub fn samples(&self) -> usize {
        match self {
            Lanes::ResidualEnergy(lanes) => lanes.samples(),
            Lanes::Sensitivity(lanes) => lanes.samples(),
        }
    }

    /// The limits of what the first-order statistics decide. Between the near and the far limit of the
    /// squared distance, and above the limit of the misfit, the reference fits a ring.
    pub fn limits(model: &HealthyModel) -> Limits {
        let threshold = model.threshold.value;
        Limits {
            near: threshold.min(SECOND_LOOK),
            far: threshold.max(CLEARLY_FAR),
            unexplained: model.misfit.as_ref().map_or(f64::INFINITY, |m| m.settled_square()),
        }
    }
}
