//! The result of `inkling identify` for one printhead. In: the printhead's healthy signals,
//! channels and bursts together. Out: an [`Identified`], which `identify` writes as JSON, prints,
//! and draws.
//!
//! The steps ([`Identified::of`]): the healthy signals are chosen and averaged (thesis Fig. 3-2);
//! rates and acquisition state are fitted to the average (thesis (3-1)); what the fit leaves is
//! tested for whiteness; and with a geometry the individual parameters of thesis (2-3)..(2-5)
//! follow. All computing is done in `inkling_core::identify`.

use super::exit::Failure;
use super::report::printable;
use crate::settings::{IdentifySettings, Settings};
use inkling_core::design::{DesignError, Detectability, TrainingSet};
use inkling_core::identify::IdentifyError;
use inkling_core::identify::SignalSet;
use inkling_core::identify::averaging;
use inkling_core::identify::grey_box::{self, Identification};
use inkling_core::identify::whiteness::{self, Whiteness};
use inkling_core::model::Geometry;
use inkling_lab::plot::{Figure, Mark, Series};
use serde::Serialize;
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::io::Write;
use std::path::Path;

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
    /// The individual parameters; `None`: the settings give no geometry.
    physical: Option<Physical>,
    /// Which faults could be found; only with `--detectability`.
    #[serde(skip_serializing_if = "Option::is_none")]
    detectability: Option<Detectability>,
    /// The signals of the average.
    #[serde(skip)]
    healthy: Cow<'a, SignalSet>,
    /// The average, and the signal of the model that was fitted to it; N samples each, counts.
    #[serde(skip)]
    average: Vec<f64>,
    #[serde(skip)]
    simulated: Vec<f64>,
}

impl<'a> Identified<'a> {
    /// Fits the average of a printhead's healthy signals. `labelled`: whether labels say that
    /// `signals` are healthy. Without labels the signals that agree with the majority are taken for
    /// healthy, unless the settings ask for a plain mean. `set`: what all printheads have in common
    /// (sampling, drive).
    pub fn of(
        printhead: &'a str,
        signals: &'a SignalSet,
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
            physical: settings.geometry.map(|g| Physical::of(&fit, &g)),
            identification: fit,
            detectability: None,
            healthy,
            average: mean.y,
            simulated,
        })
    }

    /// Also looks which faults an FD filter of method I (thesis §3-2-1) could find
    /// (`--detectability`).
    pub fn detect(&mut self, settings: &Settings) -> Result<(), DesignError> {
        let (grey_box, detect) = (&settings.identify.grey_box, &settings.detect);
        let (fit, dt_s) = (&self.identification, self.sample_period_s);
        let found = Detectability::of(fit, &self.healthy, dt_s, grey_box, detect)?;
        self.detectability = Some(found);
        Ok(())
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
        self.physical.iter().try_for_each(|physical| physical.print(out))?;
        self.detectability.iter().try_for_each(|found| print_detectable(found, out))
    }

    /// Draws measured against simulated signal, as in Fig. 3-3 of the thesis. `names`: the names of
    /// the figures drawn before, which this one's is added to.
    pub fn plot(&self, dir: &Path, names: &mut BTreeSet<String>) -> Result<(), Failure> {
        std::fs::create_dir_all(dir)
            .map_err(|e| Failure::new(format!("{}: {e}", dir.display())))?;
        let (name, percent) = (printable(self.printhead), self.identification.fit_percent);
        let title =
            format!("{name}: the identified model fits {percent:.2} % of the average signal");
        let dt_s = self.sample_period_s;
        let series = vec![
            Series::over_time("measured, average", Mark::Points, &self.average, dt_s),
            Series::over_time("simulated", Mark::Line, &self.simulated, dt_s),
        ];
        let figure = Figure::over_time(title, "sensor signal, counts", series);
        let name = figure_name(self.printhead, names);
        figure.write(dir, &format!("identify_{name}")).map_err(Failure::new)
    }
}

/// What a printhead is called in the name of its figure: a name may hold characters that a file
/// name cannot, and be too long. Where an earlier figure is called so already, a number is added.
/// `names`: the earlier ones, in lower case, as some file systems know no other; the new one is
/// added.
fn figure_name(printhead: &str, names: &mut BTreeSet<String>) -> String {
    let safe = |c: char| if c.is_alphanumeric() || c == '-' { c } else { '_' };
    let safe: String = printhead.chars().map(safe).take(80).collect();
    let numbered = (2..).map(|number| format!("{safe}_{number}"));
    let mut all = std::iter::once(safe.clone()).chain(numbered);
    all.find(|name| names.insert(name.to_lowercase())).unwrap_or_default()
}

/// Prints which filters there are, at which frequencies they are blind, and which faults they could find.
fn print_detectable(found: &Detectability, out: &mut impl Write) -> std::io::Result<()> {
    let Detectability { degree, nullity, blind_hz, promise, .. } = found;
    writeln!(out, "  filters of degree {degree} that a healthy signal does not excite: {nullity}")?;
    if blind_hz.is_empty() {
        writeln!(out, "  blind at no frequency")?;
    }
    for [from, to] in blind_hz {
        match to > from {
            true => writeln!(out, "  blind from {from:.0} to {to:.0} Hz")?,
            false => writeln!(out, "  blind at {from:.0} Hz")?,
        }
    }
    if let Some(promise) = promise {
        return crate::report::print_promise(promise, inkling_io::printable::line, out);
    }
    let why = "these signals are too few to tell how channels differ";
    writeln!(out, "  how small a fault would be found: {why}")
}

/// The individual parameters of thesis (2-3)..(2-5). One decay gives only ratios of these
/// parameters, so they rest on the restrictor's inertance and on A_n/A_r as given by the geometry.
#[derive(Debug, Serialize)]
struct Physical {
    restrictor_inertance_kg_per_m4: f64,
    nozzle_inertance_kg_per_m4: f64,
    restrictor_resistance_pa_s_per_m3: f64,
    nozzle_resistance_pa_s_per_m3: f64,
    compliance_m3_per_pa: f64,
    /// The compliance from the geometry alone, for comparison.
    compliance_by_geometry_m3_per_pa: f64,
    rests_on: &'static str,
}

impl Physical {
    /// The parameters that the identified rates have where I_r is that of the geometry.
    fn of(fit: &Identification, geometry: &Geometry) -> Physical {
        let rates = fit.channel;
        let prior = geometry.ink_channel();
        let by_geometry = geometry.compliance_m3_per_pa();
        // a = 1 / (I_r B_t) with a and B_t of the geometry gives I_r; then the identified a and b give B_t
        // and I_n, and g = R_r / I_r and d = R_n / I_n give the resistances
        let i_r = 1.0 / (prior.a_per_s2 * by_geometry);
        let b_t = 1.0 / (rates.a_per_s2 * i_r);
        let i_n = 1.0 / (rates.b_per_s2 * b_t);
        Physical {
            restrictor_inertance_kg_per_m4: i_r,
            nozzle_inertance_kg_per_m4: i_n,
            restrictor_resistance_pa_s_per_m3: rates.g_per_s * i_r,
            nozzle_resistance_pa_s_per_m3: rates.d_per_s * i_n,
            compliance_m3_per_pa: b_t,
            compliance_by_geometry_m3_per_pa: by_geometry,
            rests_on: "the restrictor's inertance and the ratio A_n/A_r of identify.geometry",
        }
    }

    fn print(&self, out: &mut impl Write) -> std::io::Result<()> {
        let mut line = |what: &str, value: f64, unit: &str| {
            writeln!(out, "  {what:<22} {value:>13.6e} {unit}  prior-dependent")
        };
        line("I_r (as given)", self.restrictor_inertance_kg_per_m4, "kg/m^4")?;
        line("I_n", self.nozzle_inertance_kg_per_m4, "kg/m^4")?;
        line("R_r", self.restrictor_resistance_pa_s_per_m3, "Pa s/m³")?;
        line("R_n", self.nozzle_resistance_pa_s_per_m3, "Pa s/m³")?;
        line("B_t", self.compliance_m3_per_pa, "m³/Pa")?;
        writeln!(out, "  these rest on {}", self.rests_on)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_printheads_have_one_figure() {
        let mut names = BTreeSet::new();
        let long = "k".repeat(80);
        let heads = ["a/b", "a_b", "A_B", "a_b_2", &format!("{long}1"), &format!("{long}2")];
        let called = heads.map(|head| figure_name(head, &mut names));
        let second = format!("{long}_2");
        assert_eq!(called, ["a_b", "a_b_2", "A_B_3", "a_b_2_2", &long, &second]);
    }
}
