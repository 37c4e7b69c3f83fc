//! The catalogue of causes: identifiers, parameters and units are the contract's.

use super::covariates::{Covariates, NEIGHBOURS, POSITION, TEMPERATURE, TIME};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs {
    Nothing,
    DriveScan,
    Temperature,
    Idle,
    Neighbours,
    Time,
    Channels,
    Codes,
    SharedBursts,
}

/// One row.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    pub id: &'static str,
    pub parameter: &'static str,
    pub unit: &'static str,
    pub needs: Needs,
    /// What is wrong, in words; the number follows.
    pub words: &'static str,
}

const fn entry(
    id: &'static str,
    parameter: &'static str,
    unit: &'static str,
    needs: Needs,
    words: &'static str,
) -> Entry {
    Entry { id, parameter, unit, needs, words }
}

#[rustfmt::skip]
pub const CATALOGUE: [Entry; 22] = [
    entry("offset", "offset", "counts", Needs::Nothing, "the sensor has an offset that does not scale with the drive"),
    entry("droop", "rate", "1/s", Needs::DriveScan, "the charge amplifier droops (a high-pass that is reset at t_a)"),
    entry("meniscus", "compliance_ratio", "1", Needs::DriveScan, "surface tension in the nozzle pulls the meniscus back"),
    entry("lowpass", "rate", "1/s", Needs::Nothing, "the sensor amplifier's low-pass has a transient in the first samples"),
    entry("second_mode", "frequency", "Hz", Needs::DriveScan, "a second mode rings along"),
    entry("quadratic_drag", "damping_change", "1", Needs::DriveScan, "damping grows with amplitude: quadratic drag at the nozzle"),
    entry("dry_friction", "damping_change", "1", Needs::DriveScan, "damping grows as the amplitude falls: dry friction"),
    entry("cubic_stiffness", "frequency_change", "1", Needs::DriveScan, "the frequency changes with amplitude: the stiffness is not linear"),
    entry("fractional_damping", "eta", "1", Needs::Nothing, "part of the loss is a boundary layer's (half-order damping)"),
    entry("tone", "frequency", "Hz", Needs::Nothing, "an interference of fixed phase is added"),
    entry("random_tone", "frequency", "Hz", Needs::Nothing, "an interference whose phase differs from burst to burst is added"),
    entry("trigger_jitter", "sd", "s", Needs::SharedBursts, "the trigger jitters: t_a of a burst's channels shifts from burst to burst"),
    entry("clipping", "level", "counts", Needs::Codes, "large samples are clipped"),
    entry("coarse_lsb", "step", "counts", Needs::Codes, "the converter misses codes: its resolution is coarse"),
    entry("previous_tail", "gain", "1", Needs::Idle, "the ring of the previous actuation has not died away at t_a"),
    entry("crosstalk", "kappa", "1", Needs::Neighbours, "channels that fire beside it are heard"),
    entry("temperature", "damping_change", "1/K", Needs::Temperature, "damping follows the ink's temperature"),
    entry("ageing", "damping_change", "1", Needs::Time, "damping drifts over the recording"),
    entry("position_gradient", "frequency_change", "1", Needs::Channels, "the resonance changes along the printhead"),
    entry("clock_drift", "rate_change", "1", Needs::Time, "all rates drift together: the sampling clock drifts"),
    entry("correlated_noise", "rho", "1", Needs::Nothing, "the noise of neighbouring samples is correlated"),
    entry("heteroscedastic_noise", "h", "1", Needs::Nothing, "the noise grows with the signal"),
];

pub fn entry_of(id: &str) -> &'static Entry {
    // ids come from this table; another one is a slip of ours, and the first row does no harm
    CATALOGUE.iter().find(|e| e.id == id).unwrap_or(&CATALOGUE[0])
}

/// What the data lack for this entry; `None`: it can be tested.
pub fn lacking(
    needs: Needs,
    beside: &Covariates,
    integer: bool,
    units: usize,
) -> Option<&'static str> {
    let missing = match needs {
        Needs::Nothing => return None,
        Needs::DriveScan => {
            (!beside.drive_scan, "drive_voltage_v, recorded and varied by 3 % or more")
        }
        Needs::Temperature => (!beside.present[TEMPERATURE], "temperature_c, recorded and varied"),
        Needs::Idle => (!beside.idle, "idle_time_s"),
        Needs::Neighbours => (!beside.present[NEIGHBOURS], "neighbours_fired, recorded and varied"),
        Needs::Time => (!beside.present[TIME], "bursts at several times"),
        Needs::Channels => (!beside.present[POSITION] || units < 6, "six channels or more"),
        Needs::Codes => (!integer, "whole counts"),
        Needs::SharedBursts => (!beside.shared_bursts, "bursts of several channels each"),
    };
    missing.0.then_some(missing.1)
}

/// Causes that may honestly end as a tie.
pub fn same_class(p: &str, q: &str) -> bool {
    const CLASSES: [&[&str]; 2] =
        [&["offset", "droop", "meniscus"], &["lowpass", "fractional_damping"]];
    CLASSES.iter().any(|class| class.contains(&p) && class.contains(&q))
}

/// Causes that act through the amplitude.
pub fn by_amplitude(id: &str) -> bool {
    matches!(id, "quadratic_drag" | "dry_friction" | "cubic_stiffness")
}

/// The experiment that would split a tie.
pub fn experiment(p: &str, q: &str) -> String {
    let has = |id: &str| p == id || q == id;
    if has("temperature") || has("ageing") || has("clock_drift") {
        "heat the ink while the time runs on (or repeat the run at a constant temperature)".into()
    } else if has("offset") {
        "repeat at half the drive voltage: an offset stays, what rings shrinks with it".into()
    } else if has("lowpass") {
        "start the acquisition some microseconds later: a transient of the amplifier follows the \
         start, the boundary layer's loss does not"
            .into()
    } else {
        "record longer decays and a wider range of drive voltages".into()
    }
}
