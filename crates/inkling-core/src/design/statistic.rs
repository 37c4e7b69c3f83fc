//! Detection statistics other than distance and residual energy.

use crate::detect::key_numbers::KeyRange;
use serde::{Deserialize, Serialize};

/// `detect.method` = `residual-maximum` or `practice`, as a model has learned it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Statistic {
    /// The largest sample of the FD filter's residual, counts.
    ResidualMaximum,
    /// How far frequency and damping lie from the middle of the healthy range, in its half-widths.
    Practice(KeyRange),
}
