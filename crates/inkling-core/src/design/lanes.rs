//! Fast detection: a model's statistic in f32 for many signals at once, one in each lane. It settles most healthy
//! signals of a stream; the rest is judged by the f64 reference.

use super::HealthyModel;
use crate::detect::kernel::LaneFilter;
use crate::detect::lane_sensitivity::{LaneSensitivity, Limits};
use crate::detect::tuned::{clearly_far, second_look};

/// `detect.method` in f32: of signals transposed to a tile, or of signals as they lie.
#[derive(Clone, Debug)]
pub enum Lanes {
    ResidualEnergy(LaneFilter),
    Sensitivity(Box<LaneSensitivity>),
}

impl Lanes {
    /// `None` where f32 cannot serve, or the statistic is neither of these.
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

    /// Samples of a signal.
    pub fn samples(&self) -> usize {
        match self {
            Lanes::ResidualEnergy(lanes) => lanes.samples(),
            Lanes::Sensitivity(lanes) => lanes.samples(),
        }
    }

    /// Between the near and the far limit of the squared distance, and above that of the misfit, the reference fits a
    /// ring; elsewhere the first-order statistics decide.
    pub fn limits(model: &HealthyModel) -> Limits {
        let threshold = model.threshold.value;
        Limits {
            near: threshold.min(second_look()),
            far: threshold.max(clearly_far()),
            unexplained: model.misfit.as_ref().map_or(f64::INFINITY, |m| m.settled_square()),
        }
    }
}
