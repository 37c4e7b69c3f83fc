//! Parameters from data: the signals of a healthy window are averaged (thesis Fig. 3-2), and the
//! model of thesis (2-2) with its acquisition state is fitted to the average, thesis (3-1).
//!
//! In: a [`SignalSet`], the signals of one window of one printhead. Out:
//! [`identification::Identification`], the model with its covariance and with what is not
//! identifiable. No signal is judged here, and no fault is known. Training, the identify stage and
//! `inkling identify` call:
//!
//! 1. `reservoir` keeps a bounded sample of the window's signals.
//! 2. `averaging` leaves out those that disagree, and averages the rest.
//! 3. `grey_box` solves (3-1): `damped_cosine` finds the time scale, `rate_search` searches the
//!    rates (with decays by `cubic`), `identifiability` states the covariance, and `scatter`
//!    corrects for channels that differ.
//! 4. What else an average or its signals tell: `tangent` (what temperature does to the signal),
//!    `whiteness` (whether the misfit is noise).
//!
//! This file holds the settings of the fit (`[identify.grey_box]`) and the errors.

pub mod averaging;
mod cubic;
pub mod damped_cosine;
pub mod grey_box;
pub mod identifiability;
pub mod identification;
mod rate_search;
pub mod reservoir;
pub mod scatter;
mod signal_set;
pub mod tangent;
pub mod whiteness;

pub use signal_set::SignalSet;

use crate::model::InkChannel;
use crate::ranges::check;
use serde::{Deserialize, Serialize};
use std::ops::Bound;
use thiserror::Error;

/// The table `[identify.grey_box]` of `pipeline.toml`. Of the guessed channel the ratios of rates
/// matter; its time scale is fitted to the signal (`damped_cosine`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GreyBoxSettings {
    pub a_per_s2: f64,
    pub b_per_s2: f64,
    /// The ratio g/d is held: one decay cannot tell it.
    pub g_per_s: f64,
    pub d_per_s: f64,
    /// The search is bounded to guess / factor .. guess * factor, at the signal's time scale.
    pub bound_factor: f64,
    /// Bounds of some of the rates a, b, d instead, which are not scaled with the guess.
    #[serde(skip_serializing_if = "Bounds::is_empty")]
    pub bounds: Bounds,
    /// Follows (3-1) to the letter: fits the plain mean, not corrected for channels that differ.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub plain_mean: bool,
}

/// Bounds of each rate, thesis (3-1); absent: by `bound_factor`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Bounds {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub a_per_s2: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub b_per_s2: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub d_per_s: Option<[f64; 2]>,
}

impl Bounds {
    fn is_empty(&self) -> bool {
        *self == Bounds::default()
    }
}

impl Default for GreyBoxSettings {
    fn default() -> Self {
        GreyBoxSettings {
            a_per_s2: 5.6e10,
            b_per_s2: 1.11e11,
            g_per_s: 1.6e4,
            d_per_s: 8.0e4,
            bound_factor: 8.0,
            bounds: Bounds::default(),
            plain_mean: false,
        }
    }
}

impl GreyBoxSettings {
    pub fn channel(&self) -> InkChannel {
        let GreyBoxSettings { a_per_s2, b_per_s2, g_per_s, d_per_s, .. } = *self;
        InkChannel { a_per_s2, b_per_s2, g_per_s, d_per_s }
    }

    pub fn check(&self) -> Result<(), String> {
        let keys = ["a_per_s2", "b_per_s2", "g_per_s", "d_per_s"];
        for (key, value) in keys.into_iter().zip(self.channel().rates()) {
            let rates = (Bound::Excluded(0.0), Bound::Excluded(f64::INFINITY));
            check(key, value, rates, "a positive rate")?;
        }
        let factors = (Bound::Excluded(1.0), Bound::Included(1e3));
        check("bound_factor", self.bound_factor, factors, "1 .. 1000")?;
        for (key, guess, bounds) in [
            ("a_per_s2", self.a_per_s2, self.bounds.a_per_s2),
            ("b_per_s2", self.b_per_s2, self.bounds.b_per_s2),
            ("d_per_s", self.d_per_s, self.bounds.d_per_s),
        ] {
            let Some([low, high]) = bounds else { continue };
            if !(0.0 < low && low < guess && guess < high && high.is_finite()) {
                return Err(format!(
                    "bounds.{key} = [{low:?}, {high:?}]: give a positive lowest and a finite highest on either side of \
                     the guess, {guess:e}"
                ));
            }
        }
        if (self.g_per_s / self.d_per_s - 1.0).abs() < 0.01 {
            return Err("g_per_s = d_per_s: at equal rates the real pole is unobservable; \
                        give the ratio A_r/A_n of the cross-sections"
                .into());
        }
        Ok(())
    }
}

#[derive(Clone, Debug, PartialEq, Error)]
pub enum IdentifyError {
    /// Root mean square of what the model and the best damped cosine leave of the average, counts.
    #[error(
        "the model leaves {model:.3} counts of the average signal, a free damped cosine at \
         {frequency_hz:.4e} Hz {cosine:.3}: it did not find the ring; give identify.grey_box rates whose \
         ratios fit the channel, or a larger bound_factor"
    )]
    WorseThanACosine { model: f64, cosine: f64, frequency_hz: f64 },
    #[error("{found} usable healthy signals are too few, {needed} are needed")]
    TooFewSignals { found: usize, needed: usize },
    #[error(
        "only {inliers} of {signals} signals agree with each other, and identify.least_agreeing = {least}: \
         choose another window, or say by identify.labels which signals are healthy"
    )]
    NoMajority { inliers: usize, signals: usize, least: f64 },
    #[error("{samples} samples per signal: identification of 6 numbers needs at least {needed}")]
    TooFewSamples { samples: usize, needed: usize },
    #[error("the average signal is zero or constant: nothing rings in this window")]
    NoRingDown,
    #[error("no start converged: {0}")]
    NotConverged(String),
}

impl IdentifyError {
    /// The error with what helps against it. `labelled`: labels tell what is healthy.
    pub fn advice(&self, labelled: bool) -> String {
        match (self, labelled) {
            (IdentifyError::TooFewSignals { found, needed }, true) => format!(
                "{found} usable signals are labelled `healthy`, {needed} are needed: label more channels or longer times"
            ),
            (IdentifyError::TooFewSignals { .. }, false) => format!("{self}: widen the window"),
            _ => self.to_string(),
        }
    }
}
