//! The detection statistics of the methods that have neither a distance nor a residual energy.

use crate::detect::key_numbers::KeyRange;
use serde::{Deserialize, Serialize};

/// What `detect.method` = `residual-maximum` or `practice` computes, as a model has learned it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Statistic {
    /// The largest sample of the FD filter's residual, counts.
    ResidualMaximum,
    /// How far frequency and damping lie from the middle of the healthy range, in its half-widths.
    Practice(KeyRange),
}
