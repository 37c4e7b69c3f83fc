//! The detection statistic of a model in lanes: what settles most healthy signals of a stream.

use super::HealthyModel;
use crate::detect::kernel::{LaneFilter, LaneStatistics};
use crate::detect::lane_sensitivity::LaneSensitivity;
use crate::detect::sensitivity::SECOND_LOOK;
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

    /// Statistics of a tile's signals, and which of them are surely what the reference gives, at or
    /// below the threshold.
    pub fn judge(
        &self,
        tile: &mut Tile,
        threshold: f64,
        rails: [f64; 2],
        instructions: Instructions,
    ) -> LaneStatistics {
        match self {
            Lanes::ResidualEnergy(lanes) => lanes.judge(tile, threshold, rails, instructions),
            // beyond, the reference looks a second time
            Lanes::Sensitivity(lanes) => {
                lanes.judge(tile, threshold.min(SECOND_LOOK), rails, instructions)
            }
        }
    }
}
