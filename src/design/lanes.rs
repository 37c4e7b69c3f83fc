//! Fast detection: a model's statistic in f32 for many signals at once, one in each SIMD lane. It settles most healthy
//! signals of a stream; the rest is judged by the f64 reference.

use super::HealthyModel;
use crate::detect::kernel::{LaneFilter, LaneStatistics};
use crate::detect::lane_sensitivity::{LaneSensitivity, Limits, RowCondition};
use crate::detect::sensitivity::{CLEARLY_FAR, SECOND_LOOK};
use crate::detect::tile::{Instructions, Tile};

/// `detect.method` in f32, for tiles of signals.
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

    /// For projections straight from a burst's channel-major int16 signals, the expected signal at a relative drive and
    /// `warmer` K above the model; `None`: signals must be transposed to a tile.
    pub fn rows(&self, drive: f64, warmer: f64) -> Option<(&LaneSensitivity, RowCondition)> {
        match self {
            Lanes::ResidualEnergy(_) => None,
            Lanes::Sensitivity(lanes) => Some((lanes, lanes.condition(drive, warmer))),
        }
    }

    /// Between the near and the far limit of the squared distance, and above that of the misfit, the reference fits a
    /// ring; elsewhere the first-order statistics decide.
    pub fn limits(model: &HealthyModel) -> Limits {
        let threshold = model.threshold.value;
        Limits {
            near: threshold.min(SECOND_LOOK),
            far: threshold.max(CLEARLY_FAR),
            unexplained: model.misfit.as_ref().map_or(f64::INFINITY, |m| m.settled_square()),
        }
    }

    /// Statistics of a tile's signals, and which of them are settled: proved to lie on the same side of the thresholds
    /// as the reference's.
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
