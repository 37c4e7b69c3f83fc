//! The detection statistics of the two methods that have neither a squared distance along
//! sensitivities nor a residual energy, as a healthy model keeps them (`HealthyModel::statistic`).
//! `learn` makes them, `judge` and `residual` compute them for a signal.

use crate::detect::key_numbers::KeyRange;
use serde::{Deserialize, Serialize};

/// What `detect.method` = `residual-maximum` or `practice` computes, as a model has learned it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Statistic {
    /// The largest |r| of the FD filter's residual, counts, thesis §3-2.
    ResidualMaximum,
    /// The current practice with which the thesis compares: how far frequency and damping of a
    /// signal, by Fourier transform, lie from the middle of the healthy range, in half-widths of
    /// the range.
    Practice(KeyRange),
}
