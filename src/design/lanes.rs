//! The detection statistic of a model in lanes: what settles most healthy signals of a stream.

use super::HealthyModel;
use crate::detect::kernel::{LaneFilter, LaneStatistics};
use crate::detect::lane_sensitivity::{LaneSensitivity, Limits, RowCondition};
use crate::detect::sensitivity::{CLEARLY_FAR, SECOND_LOOK};
use crate::detect::tile::{Instructions, Tile};

/// `detect.method` in lanes.
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

    /// What is expected of int16 signals that lie one after the other; `None`: they must be turned.
    pub fn rows(&self, drive: f64, warmer: f64) -> Option<(&LaneSensitivity, RowCondition)> {
        match self {
            Lanes::ResidualEnergy(_) => None,
            Lanes::Sensitivity(lanes) => Some((lanes, lanes.condition(drive, warmer))),
        }
    }

    /// Nearer than one and farther than the other first order settles a squared distance: between them
    /// the reference looks a second time, and where much lies beside the ring.
    pub fn limits(model: &HealthyModel) -> Limits {
        let threshold = model.threshold.value;
        Limits {
            near: threshold.min(SECOND_LOOK),
            far: threshold.max(CLEARLY_FAR),
            unexplained: model.misfit.as_ref().map_or(f64::INFINITY, |m| m.settled_square()),
        }
    }

    /// Statistics of a tile's signals, and which of them are surely what the reference gives, on its
    /// side of the thresholds.
    pub fn judge(
        &self,
        tile: &mut Tile,
        model: &HealthyModel,
        rails: [f64; 2],
        instructions: Instructions,
    ) -> LaneStatistics {
        match self {
            Lanes::ResidualEnergy(lanes) => {
                lanes.judge(tile, model.threshold.value, rails, instructions)
            }
            Lanes::Sensitivity(lanes) => {
                lanes.judge(tile, Lanes::limits(model), rails, instructions)
            }
        }
    }
}
