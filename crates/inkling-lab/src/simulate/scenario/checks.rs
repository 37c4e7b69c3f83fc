//! Checks a scenario, so that simulating it cannot fail, fill the memory or run for ever. In: [`Scenario`],
//! as `read.rs` has made it. Out: nothing, or the first thing that is wrong, as an error with its key and
//! what would be right.
//!
//! The simulator relies on these checks: where its code says "checked", one of the functions below made sure.
//! Comparisons are written such that NaN fails them.

use super::{Classes, Dataset, Kind, Physics, PrintRun, RecordingOptions, Scenario, ScenarioError};
use crate::simulate::dataset::PRINTHEAD;
use crate::simulate::print_run::{LEAST_FAULT_BURSTS, first_random_burst, step_at};
use inkling_core::fault::{CLASSES, HEALTHY};
use inkling_core::model::faults::{self, Law};
use std::collections::HashSet;

/// Smallest value of what must be above 0.
const TINY: f64 = 1e-9;
/// Largest number of channels, and of signals of a set. The truth is kept for each of them in memory.
const MOST_CHANNELS: f64 = 1e6;
/// Largest number of signals of a print run: 256 GB with 128 samples each.
const MOST_SIGNALS: f64 = 1e9;
/// Smallest and largest number of samples of a signal; each printhead keeps one decay in memory.
const SAMPLES: [f64; 2] = [8.0, 16_384.0];
const MOST_COUNTS: f64 = 32_767.0;
/// Largest size of a burst, 64 MiB.
const MOST_BURST_BYTES: f64 = 67_108_864.0;
/// Latest time in s since the epoch, in the year 2200; in ns it leaves room in i64.
const LATEST_S: f64 = 7.258e9;

type Check = Result<(), ScenarioError>;

/// A number of the scenario: its key, its value, and the smallest and the largest that are allowed.
type Number<'a> = (&'a str, f64, f64, f64);

/// An error for `key` unless `ok`. `why`: what is wrong, in words.
pub fn require(ok: bool, key: &str, why: impl Into<String>) -> Check {
    if ok { Ok(()) } else { Err(ScenarioError::value(key, why)) }
}

fn within<'a>(numbers: impl IntoIterator<Item = Number<'a>>) -> Check {
    numbers.into_iter().try_for_each(|(key, x, low, high)| {
        require(low <= x && x <= high, key, format!("{x:?} is not within {low:?} and {high:?}"))
    })
}

/// Checks a whole scenario: `[recording]`, then what its kind has.
pub(super) fn check(scenario: &Scenario) -> Check {
    let recording = &scenario.recording;
    within([("recording.start in s", recording.start_ns as f64 * 1e-9, 0.0, LATEST_S)])?;
    match &scenario.kind {
        Kind::Physics(physics) => check_physics(physics, recording),
        Kind::Classes(classes) => check_classes(classes),
    }
}

/// Checks a physics scenario, table by table.
fn check_physics(physics: &Physics, recording: &RecordingOptions) -> Check {
    let Physics { channel, spread, shot, acquisition: signal, temperature, .. } = physics;
    let change = temperature.swing_c * temperature.viscosity_per_k.abs();
    within([
        ("channel.a_per_s2", channel.a_per_s2, TINY, 1e18),
        ("channel.b_per_s2", channel.b_per_s2, TINY, 1e18),
        ("channel.g_per_s", channel.g_per_s, TINY, 1e18),
        ("channel.d_per_s", channel.d_per_s, TINY, 1e18),
        ("acquisition.pulse_us", signal.pulse_us, TINY, 1e4),
        ("acquisition.delay_us", signal.delay_us, 0.0, 1e4),
        ("acquisition.sample_period_us", signal.sample_period_us, TINY, 1e4),
        ("acquisition.samples", signal.samples as f64, SAMPLES[0], SAMPLES[1]),
        ("acquisition.largest_healthy_counts", signal.largest_healthy_counts, TINY, MOST_COUNTS),
        ("acquisition.noise_sd_counts", signal.noise_sd_counts, 0.0, MOST_COUNTS),
        ("spread.a", spread.a, 0.0, 0.9),
        ("spread.b", spread.b, 0.0, 0.9),
        ("spread.g", spread.g, 0.0, 0.9),
        ("spread.d", spread.d, 0.0, 0.9),
        ("spread.gain", spread.gain, 0.0, 0.9),
        ("shot.gain", shot.gain, 0.0, 0.9),
        ("shot.state", shot.state, 0.0, 0.9),
        ("temperature.swing_c", temperature.swing_c, 0.0, 100.0),
        ("temperature.period_s", temperature.period_s, TINY, 1e9),
        // the viscosity must stay positive at every temperature of the run
        ("temperature: swing_c x viscosity_per_k", change, 0.0, 0.9),
    ])?;
    check_ring(physics)?;
    check_drive(physics)?;
    check_fault_ranges(physics)?;
    if let Some(dataset) = &physics.dataset {
        check_dataset(dataset, physics)?;
    }
    if let Some(run) = &physics.print_run {
        check_print_run(run, physics, recording)?;
    }
    if let Some(hidden) = &physics.hidden {
        let idle = hidden.idle_times_us.iter();
        within(idle.map(|us| ("hidden.idle_times_us", *us, 1.0, 1e4)))?;
        within([
            ("hidden.frequency_sd", hidden.frequency_sd, 0.0, 0.1),
            ("hidden.damping_sd", hidden.damping_sd, 0.0, 0.1),
        ])?;
    }
    let something = physics.dataset.is_some() || physics.print_run.is_some();
    require(something, "dataset", "there is neither [dataset] nor [print_run]: nothing to simulate")
}

/// The nominal channel must ring, and be sampled at least twice in a period.
fn check_ring(physics: &Physics) -> Check {
    let frequency_hz = physics.channel.poles().map_or(f64::NAN, |poles| poles.frequency_hz);
    let why = "with these rates the channel does not ring (overdamped)";
    require(!frequency_hz.is_nan(), "channel", why)?;
    let per_period = 1.0 / (frequency_hz * physics.acquisition.sample_period_s());
    let why = format!("{per_period} samples per period of {frequency_hz} Hz: fewer than 2");
    require(per_period >= 2.0, "acquisition.sample_period_us", why)
}

/// Drive levels must be positive, with as many shares, which add up to 1.
fn check_drive(physics: &Physics) -> Check {
    let (levels, shares) = (&physics.drive.levels_v, &physics.drive.shares);
    let as_many = !levels.is_empty() && levels.len() == shares.len();
    let why = "levels_v and shares must have the same number of entries, at least one";
    require(as_many, "drive", why)?;
    within(levels.iter().map(|v| ("drive.levels_v", *v, TINY, 1e4)))?;
    within(shares.iter().map(|share| ("drive.shares", *share, 0.0, 1.0)))?;
    let sum: f64 = shares.iter().sum();
    require((sum - 1.0).abs() < 1e-6, "drive.shares", format!("they add up to {sum:?}, not 1"))
}

/// Requires a fault class, and a severity at or above the one that changes nothing, which leaves moderate
/// positive rates.
fn check_severity(class: &str, severity: f64, physics: &Physics, key: &str) -> Check {
    let why = format!("there is no fault class {class:?}; there are {}", CLASSES.join(", "));
    require(CLASSES.contains(&class), key, why)?;
    let none = faults::law(class).map_or(0.0, Law::none);
    let faulty = faults::apply(class, severity, &physics.channel);
    let moderate = faulty.is_some_and(|c| c.a_per_s2 + c.b_per_s2 < 1e18 && c.d_per_s < 1e18);
    let change = faults::law(class).map_or("", |law| &law.change);
    let why = format!("{severity:?} is no severity of {class}: {change}");
    require(severity >= none && moderate, key, why)
}

/// Each `[fault.CLASS]` must be a known class with a valid range.
fn check_fault_ranges(physics: &Physics) -> Check {
    for (class, fault) in &physics.fault {
        let key = format!("fault.{class}.range");
        let [low, high] = fault.range;
        require(low <= high, &key, format!("{low:?} is not below {high:?}"))?;
        check_severity(class, low, physics, &key)?;
        check_severity(class, high, physics, &key)?;
    }
    Ok(())
}

/// The sets must have a moderate size, and fault classes if they have faulty signals.
fn check_dataset(dataset: &Dataset, physics: &Physics) -> Check {
    let signals = dataset.healthy as f64 + dataset.per_fault as f64 * physics.fault.len() as f64;
    within([
        ("dataset", signals, 1.0, MOST_CHANNELS),
        ("dataset.calibration_test", dataset.calibration_test as f64, 0.0, MOST_CHANNELS),
    ])?;
    let needs_faults = dataset.per_fault > 0 || dataset.calibration_test > 0;
    let why = "faulty signals need at least one [fault.CLASS] with a range";
    require(!needs_faults || !physics.fault.is_empty(), "dataset", why)
}

/// Checks `[print_run]`: its size, that its bursts do not overlap in time, its end, its names and faults.
fn check_print_run(run: &PrintRun, physics: &Physics, recording: &RecordingOptions) -> Check {
    let signal = &physics.acquisition;
    let busy_us =
        signal.pulse_us + signal.delay_us + signal.sample_period_us * signal.samples as f64;
    let (bursts, printheads) = (run.bursts_per_channel as f64, run.printheads as f64);
    let channels = printheads * run.channels as f64;
    let end_s = recording.start_ns as f64 * 1e-9 + bursts * run.interval_s;
    // all channels of a printhead are sensed together, as int16
    let burst_bytes = (run.channels * signal.samples) as f64 * 2.0;
    within([
        ("print_run.printheads", printheads, 1.0, 1024.0),
        ("print_run: printheads x channels", channels, 1.0, MOST_CHANNELS),
        ("print_run: channels x bursts_per_channel", channels * bursts, 1.0, MOST_SIGNALS),
        ("print_run: channels x samples in bytes", burst_bytes, 0.0, MOST_BURST_BYTES),
        ("print_run.interval_s", run.interval_s, busy_us * 1e-6, LATEST_S),
        ("print_run: start + bursts_per_channel x interval_s", end_s, 0.0, LATEST_S),
        ("print_run.faulty_channels", run.faulty_channels, 0.0, 1.0),
    ])?;
    check_names(run)?;
    if run.faulty_channels > 0.0 {
        let why =
            "give either a share of channels with drawn faults, or [[print_run.fault]], not both";
        require(run.fault.is_empty(), "print_run.faulty_channels", why)?;
        let why = "drawn faults need at least one [fault.CLASS] with a range";
        require(!physics.fault.is_empty(), "print_run.faulty_channels", why)?;
        let least = first_random_burst(run) + LEAST_FAULT_BURSTS;
        let why = format!(
            "a fault begins after a tenth of the run and lasts {LEAST_FAULT_BURSTS} bursts: this run needs {least} bursts at least"
        );
        require(run.bursts_per_channel >= least, "print_run.bursts_per_channel", why)?;
    }
    check_explicit_faults(run, physics)
}

/// Names must be as many as printheads, and unlike each other.
fn check_names(run: &PrintRun) -> Check {
    let Some(names) = &run.names else { return Ok(()) };
    let unlike: HashSet<&String> = names.iter().collect();
    let why = format!("{} names, {} of them unlike", names.len(), unlike.len());
    let right = names.len() == run.printheads && unlike.len() == names.len();
    require(right, "print_run.names", format!("{why}, for {} printheads", run.printheads))?;
    // a burst without a name has its topic's, and `dataset` is the printhead of the sets
    let usable = |name: &String| (1..=200).contains(&name.len()) && name != PRINTHEAD;
    let why = format!("a name has 1 to 200 bytes, and is not {PRINTHEAD:?}");
    require(names.iter().all(usable), "print_run.names", why)
}

/// Each listed fault must be possible in the run.
fn check_explicit_faults(run: &PrintRun, physics: &Physics) -> Check {
    let names: Vec<String> = (0..run.printheads).map(|p| run.name(p)).collect();
    for (i, fault) in run.fault.iter().enumerate() {
        let key = format!("print_run.fault[{i}]");
        let why =
            format!("there is no printhead {:?}; there are {}", fault.printhead, names.join(", "));
        require(names.contains(&fault.printhead), &key, why)?;
        let why = format!("channel {} of {}: they count from 0", fault.channel, run.channels);
        require((fault.channel as usize) < run.channels, &key, why)?;
        for severity in [Some(fault.severity), fault.to_severity].into_iter().flatten() {
            check_severity(&fault.class, severity, physics, &key)?;
        }
        let (from_s, to_s) = (fault.from_s, fault.to_s);
        let why =
            format!("no burst of the run lies between from_s = {from_s:?} and to_s = {to_s:?}");
        let is_span = 0.0 <= from_s && step_at(run, from_s) < step_at(run, to_s);
        require(is_span, &key, why)?;
    }
    Ok(())
}

/// Checks a classes scenario; each range of a box must go upwards from 0 or more.
fn check_classes(classes: &Classes) -> Check {
    let faulty = classes.n_per_fault as f64 * classes.classes.faults.len() as f64;
    within([
        ("T_us", classes.t_us, TINY, 1e8),
        ("N", classes.n as f64, SAMPLES[0], SAMPLES[1]),
        ("phi0_rad", classes.phi0_rad, -10.0, 10.0),
        ("rho", classes.rho, -100.0, 100.0),
        ("lambda_per_s", classes.lambda_per_s, 0.0, 1e12),
        ("noise_sd_counts", classes.noise_sd_counts, 0.0, MOST_COUNTS),
        ("n_healthy", classes.n_healthy as f64 + faulty, 1.0, MOST_CHANNELS),
    ])?;
    let faults = classes.classes.faults.iter().map(|(name, class)| (name.as_str(), class));
    for (name, class) in faults.chain([(HEALTHY, &classes.classes.healthy)]) {
        for (key, [low, high]) in [
            ("amplitude_counts", class.amplitude_counts),
            ("sigma_per_s", class.sigma_per_s),
            ("freq_hz", class.freq_hz),
        ] {
            let key = &format!("classes.{name}.{key}");
            within([(key.as_str(), low, 0.0, 1e12), (key.as_str(), high, low, 1e12)])?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::fixtures::{SAMPLE, THESIS};

    #[test]
    fn absurd_and_contradictory_scenarios_are_refused_with_their_key() {
        let of_classes = [
            ("N = 128", "N = 0", "N"),
            ("T_us = 100", "T_us = -1", "T_us"),
            ("n_healthy = 2475", "n_healthy = 4000000000", "n_healthy"),
            (
                "sigma_per_s = [27000.0, 31000.0]",
                "sigma_per_s = [31000.0, 27000.0]",
                "healthy.sigma",
            ),
        ];
        let of_physics = [
            ("schema = 1", "schema = 2", "schema"),
            ("schema = 1", "schema = 1\nkind = \"optics\"", "kind"),
            ("a_per_s2 = 5.6e10", "a_per_s2 = nan", "channel.a_per_s2"),
            (
                "g_per_s = 1.6e4                 # R_r/I_r\nd_per_s = 8.0e4",
                "g_per_s = 5e6\nd_per_s = 4e6",
                "overdamped",
            ),
            ("samples = 128", "samples = 1000000000", "acquisition.samples"),
            ("sample_period_us = 0.78125", "sample_period_us = 10", "sample_period_us"),
            ("healthy = 600", "healthy = 9000000000000000000", "dataset"),
            ("printheads = 3", "printheads = 1000000000000", "print_run.printheads"),
            ("channels = 48", "channels = 100000000", "print_run"),
            ("bursts_per_channel = 60", "bursts_per_channel = 1000000000000", "bursts_per_channel"),
            ("interval_s = 1.0", "interval_s = 1e300", "interval_s"),
            ("interval_s = 1.0", "interval_s = 1e-5", "interval_s"),
            ("interval_s = 1.0", "interval_s = 1.0\nfaulty_channels = 0.05", "faulty_channels"),
            ("\"cyan-1\"", "\"black-2\"", "print_run.names"),
            ("levels_v = [24.0, 30.0]", "levels_v = []", "drive"),
            ("shares = [0.3, 0.7]", "shares = [0.3, 0.3]", "drive.shares"),
            ("range = [0.2, 0.5]", "range = [0.2, 1.0]", "fault.EC.range"),
            ("range = [1.10, 1.40]", "range = [0.10, 1.40]", "fault.SDN.range"),
            ("[fault.EC]", "[fault.EX]", "fault.EX"),
            ("compression = \"zstd\"", "layout = \"sample_major\"", "layout"),
            ("compression = \"zstd\"", "start = \"today\"", "today"),
            ("compression = \"zstd\"", "start = \"1900-01-01T00:00:00Z\"", "start"),
        ];
        let rows = of_physics.map(|row| (SAMPLE, row)).into_iter();
        for (text, (from, to, key)) in rows.chain(of_classes.map(|row| (THESIS, row))) {
            assert!(text.contains(from), "{from}");
            let refused = Scenario::from_toml(&text.replacen(from, to, 1)).expect_err(to);
            assert!(refused.to_string().contains(key), "{to}: {refused}");
        }
    }

    #[test]
    fn explicit_faults_must_fit_into_the_run() {
        let fault = |printhead: &str, channel: u32, class: &str, s: &str, from: f64, to: f64| {
            format!(
                "\n[[print_run.fault]]\nprinthead = {printhead:?}\nchannel = {channel}\n\
                 class = {class:?}\nseverity = {s}\nfrom_s = {from}\nto_s = {to}\n"
            )
        };
        let read = |faults: &str| Scenario::from_toml(&format!("{SAMPLE}{faults}"));
        let dried = fault("cyan-1", 47, "DDN", "2.0", 3.0, 9.0);
        read(&dried).unwrap();
        // the fault may grow, and another may join it
        let bubble = fault("cyan-1", 47, "AB2", "0.3", 8.0, 20.0);
        read(&format!("{dried}to_severity = 3.0{bubble}")).unwrap();
        for faults in [
            fault("cyan-9", 47, "DDN", "2.0", 3.0, 9.0),
            fault("cyan-1", 48, "DDN", "2.0", 3.0, 9.0),
            fault("cyan-1", 47, "healthy", "2.0", 3.0, 9.0),
            fault("cyan-1", 47, "DDN", "0.5", 3.0, 9.0),
            fault("cyan-1", 47, "BN", "1.0", 3.0, 9.0),
            fault("cyan-1", 47, "BN", "nan", 3.0, 9.0),
            fault("cyan-1", 47, "DDN", "2.0", 9.0, 3.0),
            fault("cyan-1", 47, "DDN", "2.0", 99.0, 103.0),
            fault("cyan-1", 47, "DDN", "2.0", 3.2, 3.4),
            format!("{dried}to_severity = 0.5\n"),
        ] {
            let refusal = read(&faults).expect_err(&faults).to_string();
            assert!(refusal.contains("print_run.fault["), "{refusal}");
        }
    }
}
