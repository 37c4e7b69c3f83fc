//! The detection statistic of a model in lanes: what settles most healthy signals of a stream.

use super::HealthyModel;
use crate::detect::kernel::{LaneFilter, LaneStatistics};
use crate::detect::lane_sensitivity::{LaneSensitivity, RowCondition};
use crate::detect::sensitivity::{CLEARLY_FAR, SECOND_LOOK};
use crate::detect::tile::{Instructions, Tile};

/// `detect.method` in lanes.
#[derive(Clone, Debug)]
pub enum Lanes {
    ResidualEnergy(LaneFilter),
    Sensitivity(Box<LaneSensitivity>),
}

impl Lanes {
    /// `None` where f32 cannot serve.
    pub fn of(model: &HealthyModel) -> Option<Lanes> {
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

    /// Nearer than the first and farther than the second first order settles a squared distance:
    /// between them the reference looks a second time.
    pub fn limits(threshold: f64) -> [f64; 2] {
        [threshold.min(SECOND_LOOK), threshold.max(CLEARLY_FAR)]
    }

    /// Statistics of a tile's signals, and which of them are surely what the reference gives, on its
    /// side of the threshold.
    pub fn judge(
        &self,
        tile: &mut Tile,
        threshold: f64,
        rails: [f64; 2],
        instructions: Instructions,
    ) -> LaneStatistics {
        match self {
            Lanes::ResidualEnergy(lanes) => lanes.judge(tile, threshold, rails, instructions),
            Lanes::Sensitivity(lanes) => {
                lanes.judge(tile, Lanes::limits(threshold), rails, instructions)
            }
        }
    }
}
