//! Fast detection: a model's statistic in f32 for many signals at once, one in each lane.
//!
//! In: a healthy model. Out: [`Lanes`], which the filter stage (`pipeline/statistics.rs`) runs on
//! bursts, and the limits within which their result counts. A signal is *settled* if a bound on
//! the rounding (`detect/lane_sensitivity.rs`, `detect/kernel.rs`) proves that the f64 reference
//! ([`super::Judge::detect`]) would decide alike without a fit; the reference judges the rest.

use super::HealthyModel;
use crate::detect::kernel::LaneFilter;
use crate::detect::lane_sensitivity::{LaneSensitivity, Limits};
use crate::detect::sensitivity::{CLEARLY_FAR, SECOND_LOOK};

/// The statistic of `detect.method` in f32. The residual energy takes signals that were transposed
/// to a tile, the squared distance takes them as they lie in their bursts.
#[derive(Clone, Debug)]
pub enum Lanes {
    ResidualEnergy(LaneFilter),
    Sensitivity(Box<LaneSensitivity>),
}

impl Lanes {
    /// `None`: out of the range of f32, another statistic, or disturbances are decoupled.
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

    pub fn samples(&self) -> usize {
        match self {
            Lanes::ResidualEnergy(lanes) => lanes.samples(),
            Lanes::Sensitivity(lanes) => lanes.samples(),
        }
    }

    /// What is settled by first order with `detect.method` = `sensitivity` lies surely on one side
    /// of the threshold: the near limit is not above it and the far one not below it.
    pub fn limits(model: &HealthyModel) -> Limits {
        let threshold = model.threshold.value;
        Limits {
            near: threshold.min(SECOND_LOOK),
            far: threshold.max(CLEARLY_FAR),
            unexplained: model.misfit.as_ref().map_or(f64::INFINITY, |m| m.settled_square()),
        }
    }
}
