//! The result of `inkling identify` for one printhead. In: the printhead's healthy signals,
//! channels and bursts together. Out: an [`Identified`], which `identify` writes as JSON and prints.
//!
//! The steps ([`Identified::of`]): the healthy signals are chosen and averaged (thesis Fig. 3-2);
//! rates and acquisition state are fitted to the average (thesis (3-1)); and what the fit leaves
//! is tested for whiteness. All computing is done in `inkling_core::identify`.

use super::report::printable;
use crate::settings::IdentifySettings;
use inkling_core::design::TrainingSet;
use inkling_core::identify::IdentifyError;
use inkling_core::identify::SignalSet;
use inkling_core::identify::averaging;
use inkling_core::identify::grey_box::{self, Identification};
use inkling_core::identify::whiteness::{self, Whiteness};
use serde::Serialize;
use std::io::Write;

/// Number of parameters that (3-1) fits to an average; the whiteness test takes off as many degrees
/// of freedom.
const FITTED: usize = 6;

/// The identification of one printhead, as the file of models has it.
#[derive(Serialize)]
pub struct Identified<'a> {
    printhead: &'a str,
    /// Number of signals of the average.
    signals: usize,
    /// Number of signals from which those of the average were chosen.
    of: usize,
    sample_period_s: f64,
    samples: usize,
    /// Mean drive voltage of the signals, at which the model expects its signals; `None`: not
    /// recorded.
    drive_voltage_v: Option<f64>,
    /// What was fitted: rates, poles, acquisition state, with standard deviations.
    pub identification: Identification,
    /// Whether the misfit of the average is white noise; `None`: it cannot be told.
    whiteness: Option<Whiteness>,
}

impl<'a> Identified<'a> {
    /// Fits the average of a printhead's healthy signals. `labelled`: whether labels say that
    /// `signals` are healthy. Without labels the signals that agree with the majority are taken for
    /// healthy, unless the settings ask for a plain mean. `set`: what all printheads have in common
    /// (sampling, drive).
    pub fn of(
        printhead: &'a str,
        signals: &SignalSet,
        labelled: bool,
        set: &TrainingSet,
        settings: &IdentifySettings,
    ) -> Result<Identified<'a>, IdentifyError> {
        let (grey_box, dt_s) = (&settings.grey_box, set.sample_period_s);
        let is_chosen = !(labelled || grey_box.plain_mean);
        let healthy = averaging::healthy(signals, is_chosen.then_some(settings.least_agreeing))?;
        let mean = averaging::average(&healthy)?;
        let fit = grey_box::identify_scattered(&healthy, &mean, dt_s, grey_box, None)?;
        // the misfit: what the fitted model leaves of the average signal
        let simulated = fit.expected(dt_s, set.samples);
        let misfit: Vec<f64> = mean.y.iter().zip(&simulated).map(|(y, s)| y - s).collect();
        Ok(Identified {
            printhead,
            signals: mean.n_signals,
            of: signals.len(),
            sample_period_s: dt_s,
            samples: set.samples,
            drive_voltage_v: set.drive_voltage_v,
            whiteness: whiteness::whiteness(&misfit, FITTED),
            identification: fit,
        })
    }

    /// Prints the identification: rates with 95 % intervals, how the search ended, whether the misfit is
    /// white, and what could not be identified.
    pub fn print(&self, out: &mut impl Write) -> std::io::Result<()> {
        let Identified { identification: fit, signals, of, .. } = self;
        let (name, percent) = (printable(self.printhead), fit.fit_percent);
        writeln!(out, "{name}: average of {signals} of {of} signals, fit {percent:.2} %")?;

        // poles, then the coefficients p2, p1, p0 of the cubic whose roots the poles are
        let (poles, sd) = (&fit.poles, &fit.uncertainty);
        let mut line = |what: &str, value: f64, sd: f64, unit: &str| {
            writeln!(out, "  {what:<22} {value:>13.6e} ± {:>9.2e} {unit} (95 %)", 1.96 * sd)
        };
        line("resonance f", poles.frequency_hz, sd.frequency_sd_hz, "Hz")?;
        line("damping sigma", poles.damping_per_s, sd.damping_sd_per_s, "1/s")?;
        line("real pole lambda", poles.lambda_per_s, sd.lambda_sd_per_s, "1/s")?;
        for (k, unit) in ["1/s", "1/s²", "1/s³"].iter().enumerate() {
            line(&format!("p{}", 2 - k), fit.cubic[k], sd.cubic_sd[k], unit)?;
        }
        let Identification { convergence, iterations, starts_agreeing, starts, .. } = fit;
        write!(out, "  ended by {convergence:?} after {iterations} steps, ")?;
        write!(out, "{starts_agreeing} of {starts} starts agree; ")?;
        writeln!(out, "misfit {:.3} counts rms", fit.misfit_rms)?;
        if let Some(Whiteness { ljung_box, lags, p_value }) = &self.whiteness {
            let found = match *p_value < 0.01 {
                true => "not white: the model misses something",
                false => "white",
            };
            write!(out, "  misfit {found} (Ljung-Box {ljung_box:.1} over {lags} lags, ")?;
            writeln!(out, "p = {p_value:.2e})")?;
        }
        let listed = [
            ("held fixed", &fit.held_fixed),
            ("at its bound", &fit.at_bounds),
            ("not identifiable", &fit.not_identifiable),
        ];
        for (what, items) in listed {
            for item in items {
                writeln!(out, "  {what}: {item}")?;
            }
        }
        Ok(())
    }
}
