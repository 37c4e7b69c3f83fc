//! The covariates of signals, standardised: what was recorded beside them.
//!
//! In: what was recorded beside each signal ([`Beside`]). Out: [`Covariates`]: per signal its drive relative
//! to the mean drive, and a row of z = (x - mean) / sd; beside these the constant 1. A covariate that does not
//! vary, or was not recorded of at least nine tenths of the signals, is absent, and z is 0 for all signals; a
//! single signal of which it is unknown has z = 0 as well.

use super::tuned::DRIVE_SCAN;
use inkling_core::burst::Beside;
use inkling_core::numbers::LITTLE;

/// Indices of the covariates. `POSITION` is the channel's number, `IDLE` the logarithm of the time since the
/// previous actuation.
pub const ONE: usize = 0;
pub const TIME: usize = 1;
pub const TEMPERATURE: usize = 2;
pub const POSITION: usize = 3;
pub const NEIGHBOURS: usize = 4;
pub const IDLE: usize = 5;
pub const DRIVE: usize = 6;
pub const COVARIATES: usize = 7;

pub const NAMES: [&str; COVARIATES] =
    ["one", "time", "temperature", "channel", "neighbours", "idle", "drive"];

#[derive(Clone, Debug, Default)]
pub struct Covariates {
    /// Drive relative to the mean drive; 1 where it was not recorded.
    pub drive: Vec<f64>,
    /// Mean drive, V; `None` where too few signals have one.
    pub drive_mean_v: Option<f64>,
    pub z: Vec<[f64; COVARIATES]>,
    /// Whether a covariate was recorded and varies.
    pub present: [bool; COVARIATES],
    /// Mean and standard deviation that were used to standardise, in the covariate's unit.
    pub mean: [f64; COVARIATES],
    pub sd: [f64; COVARIATES],
    pub span: [f64; COVARIATES],
    /// Whether the drive varies enough to tell what scales with it from what does not.
    pub drive_scan: bool,
    pub idle: bool,
    /// Whether bursts hold two channels or more on average.
    pub shared_bursts: bool,
}

/// The value of a covariate, NaN if it was not recorded. `first_ns`: the time of the first signal.
fn value(which: usize, beside: &Beside, first_ns: i64) -> f64 {
    match which {
        ONE => 1.0,
        TIME => beside.t_acq_ns.saturating_sub(first_ns) as f64 * 1e-9,
        TEMPERATURE => beside.temperature_c,
        POSITION => f64::from(beside.channel),
        NEIGHBOURS => beside.neighbours,
        IDLE => beside.ln_idle(),
        _ => beside.drive_v,
    }
}

impl Covariates {
    /// Some rows, not standardised anew.
    pub fn select(&self, keep: impl Fn(usize) -> bool) -> Covariates {
        let rows: Vec<usize> = (0..self.z.len()).filter(|&i| keep(i)).collect();
        Covariates {
            drive: rows.iter().map(|&i| self.drive[i]).collect(),
            z: rows.iter().map(|&i| self.z[i]).collect(),
            ..self.clone()
        }
    }

    pub fn drives(&self) -> [f64; 2] {
        let all = || self.drive.iter().copied();
        [all().fold(f64::INFINITY, f64::min), all().fold(0.0, f64::max)]
    }

    fn standardise(&mut self, which: usize, values: &[f64]) {
        let known = || values.iter().copied().filter(|x| x.is_finite());
        let count = known().count() as f64;
        if count < (1.0 - LITTLE) * self.z.len().max(1) as f64 {
            return;
        }
        let mean = known().sum::<f64>() / count;
        let square = known().map(|x| (x - mean).powi(2)).sum::<f64>() / count;
        let (low, high) =
            (known().fold(f64::INFINITY, f64::min), known().fold(-f64::INFINITY, f64::max));
        self.mean[which] = mean;
        self.span[which] = high - low;
        if square.sqrt() <= 1e-9 * mean.abs().max(1e-300) || square <= 0.0 {
            return; // it does not vary
        }
        self.sd[which] = square.sqrt();
        self.present[which] = true;
        for (z, x) in self.z.iter_mut().zip(values).filter(|(_, x)| x.is_finite()) {
            z[which] = (x - mean) / square.sqrt();
        }
    }

    pub fn of(recorded: &[Beside], bursts: usize) -> Covariates {
        let n = recorded.len().max(1) as f64;
        let enough = |count: usize| count as f64 >= (1.0 - LITTLE) * n;
        let first_ns = recorded.iter().map(|of| of.t_acq_ns).min().unwrap_or(0);
        let drives = || recorded.iter().map(|of| of.drive_v).filter(|v| *v > 0.0);
        let drive_mean_v =
            enough(drives().count()).then(|| drives().sum::<f64>() / drives().count() as f64);
        let drive: Vec<f64> = recorded
            .iter()
            .map(|of| match drive_mean_v {
                Some(mean) if of.drive_v > 0.0 => of.drive_v / mean,
                _ => 1.0,
            })
            .collect();
        let spread = drive.iter().map(|s| (s - 1.0).powi(2)).sum::<f64>() / n;
        let mut new = Covariates {
            drive,
            drive_mean_v,
            z: vec![[0.0; COVARIATES]; recorded.len()],
            sd: [1.0; COVARIATES],
            drive_scan: spread.sqrt() > DRIVE_SCAN,
            idle: enough(recorded.iter().filter(|of| !of.idle_s.is_nan()).count()),
            shared_bursts: recorded.len() >= 2 * bursts,
            ..Covariates::default()
        };
        new.z.iter_mut().for_each(|z| z[ONE] = 1.0);
        new.present[ONE] = true;
        for which in ONE + 1..COVARIATES {
            let values: Vec<f64> =
                recorded.iter().map(|beside| value(which, beside, first_ns)).collect();
            new.standardise(which, &values);
        }
        new
    }
}
