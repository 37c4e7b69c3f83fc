//! Checks a scenario, so that simulating it cannot fail, fill the memory or run for ever. In: [`Scenario`],
//! as `read.rs` has made it. Out: nothing, or the first thing that is wrong, as an error with its key and
//! what would be right.
//!
//! The simulator relies on these checks: where its code says "checked", one of the functions below made sure.
//! Comparisons are written such that NaN fails them.

use super::{
    Acquisition, Classes, Dataset, ExplicitFault, Kind, Physics, PrintRun, RecordingOptions,
    Scenario, ScenarioError,
};
use crate::simulate::dataset::{CHANNELS_PER_BURST, PRINTHEAD};
use crate::simulate::print_run::{LEAST_FAULT_BURSTS, first_random_burst, step_at};
use inkling_core::fault::{CLASSES, HEALTHY, category};
use inkling_core::model::faults::{self, Law};
use std::collections::HashSet;
use std::fmt::{Debug, Display};

/// Largest number of channels, and of signals of a set. The truth is kept for each of them in memory.
const MOST_CHANNELS: usize = 1_000_000;
/// Largest number of signals of a print run: 256 GB with 128 samples each.
const MOST_SIGNALS: u64 = 1_000_000_000;
/// Smallest number of samples of a signal.
const LEAST_SAMPLES: usize = 8;
/// Largest number of samples of a signal; each printhead keeps one decay in memory.
const MOST_SAMPLES: usize = 16_384;
const MOST_PRINTHEADS: usize = 1024;
/// Largest size of a burst, 64 MiB.
const MOST_BURST_BYTES: u64 = 64 << 20;
/// Latest time in ns since the epoch, in the year 2200; it leaves room in i64.
const LATEST_NS: f64 = 7.258e18;

type Check = Result<(), ScenarioError>;

/// An error for `key` unless `ok`. `why`: what is wrong, in words.
pub fn require(ok: bool, key: &str, why: impl Into<String>) -> Check {
    if ok { Ok(()) } else { Err(ScenarioError::value(key, why)) }
}

/// Requires `low` <= `x` <= `high`.
fn within<T: PartialOrd + Display + Debug>(x: T, low: T, high: T, key: &str) -> Check {
    let is_within = low <= x && x <= high;
    require(is_within, key, format!("{x:?} is not within {low} and {high}"))
}

/// Requires 0 < `x` <= `high`.
fn positive(x: f64, high: f64, key: &str) -> Check {
    require(0.0 < x && x <= high, key, format!("{x:?} is not above 0 and at most {high:e}"))
}

/// Checks a whole scenario: `[recording]`, then what its kind has.
pub(super) fn check(scenario: &Scenario) -> Check {
    let recording = &scenario.recording;
    let latest = (0.0..LATEST_NS).contains(&(recording.start_ns as f64));
    require(latest, "recording.start", "must lie between 1970 and 2200")?;
    let chunk = (1 << 10..=64 << 20).contains(&recording.chunk_bytes);
    require(chunk, "recording.chunk_bytes", "must lie between 1 KiB and 64 MiB")?;
    let channels = recording.channels_per_burst.is_none_or(|c| (1..=65_536).contains(&c));
    require(channels, "recording.channels_per_burst", "must lie between 1 and 65536")?;
    match &scenario.kind {
        Kind::Physics(physics) => check_physics(physics, recording),
        Kind::Classes(classes) => check_classes(classes, recording),
    }
}

/// Requires that a burst of so many channels x samples is not larger than `MOST_BURST_BYTES`.
fn check_burst_size(channels: usize, samples: usize, recording: &RecordingOptions) -> Check {
    let bytes = channels as u64 * samples as u64 * recording.format.bytes() as u64;
    let why = format!(
        "a burst of {channels} channels x {samples} samples has {bytes} bytes, more than 64 MiB: use fewer channels_per_burst"
    );
    require(bytes <= MOST_BURST_BYTES, "recording", why)
}

/// Checks a physics scenario, table by table.
fn check_physics(physics: &Physics, recording: &RecordingOptions) -> Check {
    check_channel(physics)?;
    check_acquisition(&physics.acquisition)?;
    let (spread, shot) = (&physics.spread, &physics.shot);
    for (key, x) in [
        ("spread.a", spread.a),
        ("spread.b", spread.b),
        ("spread.g", spread.g),
        ("spread.d", spread.d),
        ("spread.gain", spread.gain),
        ("shot.gain", shot.gain),
        ("shot.state", shot.state),
    ] {
        within(x, 0.0, 0.9, key)?;
    }
    // the viscosity must stay positive at every temperature of the run
    let temperature = &physics.temperature;
    within(temperature.swing_c, 0.0, 100.0, "temperature.swing_c")?;
    positive(temperature.period_s, 1e9, "temperature.period_s")?;
    within(temperature.viscosity_per_k, -1.0, 1.0, "temperature.viscosity_per_k")?;
    let swing = temperature.swing_c * temperature.viscosity_per_k.abs();
    let why =
        format!("swing_c * viscosity_per_k = {swing:?} changes the viscosity by 90 % or more");
    require(swing < 0.9, "temperature", why)?;
    check_drive(physics)?;
    check_fault_ranges(physics)?;
    if let Some(dataset) = &physics.dataset {
        check_dataset(dataset, physics)?;
        let per_burst = recording.channels_per_burst.unwrap_or(CHANNELS_PER_BURST) as usize;
        check_burst_size(per_burst, physics.acquisition.samples, recording)?;
    }
    if let Some(run) = &physics.print_run {
        check_print_run(run, physics, recording)?;
        let per_burst = recording.channels_per_burst.map_or(run.channels, |c| c as usize);
        check_burst_size(per_burst.min(run.channels), physics.acquisition.samples, recording)?;
        // all channels of a printhead are sensed together, whatever the size of the bursts
        check_burst_size(run.channels, physics.acquisition.samples, recording)?;
    }
    if let Some(hidden) = &physics.hidden {
        for us in &hidden.idle_times_us {
            within(*us, 1.0, 1e4, "hidden.idle_times_us")?;
        }
        within(hidden.frequency_sd, 0.0, 0.1, "hidden.frequency_sd")?;
        within(hidden.damping_sd, 0.0, 0.1, "hidden.damping_sd")?;
    }
    let something = physics.dataset.is_some() || physics.print_run.is_some();
    require(something, "dataset", "there is neither [dataset] nor [print_run]: nothing to simulate")
}

/// The nominal channel must have positive rates, ring, and be sampled at least twice in a period.
fn check_channel(physics: &Physics) -> Check {
    let channel = &physics.channel;
    for (key, x) in [
        ("channel.a_per_s2", channel.a_per_s2),
        ("channel.b_per_s2", channel.b_per_s2),
        ("channel.g_per_s", channel.g_per_s),
        ("channel.d_per_s", channel.d_per_s),
    ] {
        positive(x, 1e18, key)?;
    }
    let frequency_hz = channel.poles().map_or(f64::NAN, |poles| poles.frequency_hz);
    let why = "with these rates the channel does not ring (overdamped)";
    require(!frequency_hz.is_nan(), "channel", why)?;
    let per_period = 1.0 / (frequency_hz * physics.acquisition.sample_period_s());
    let why = format!("{per_period} samples per period of {frequency_hz} Hz: fewer than 2");
    require(per_period >= 2.0, "acquisition.sample_period_us", why)
}

/// The numbers of `[acquisition]` must be positive and moderate.
fn check_acquisition(acquisition: &Acquisition) -> Check {
    positive(acquisition.pulse_us, 1e4, "acquisition.pulse_us")?;
    within(acquisition.delay_us, 0.0, 1e4, "acquisition.delay_us")?;
    positive(acquisition.sample_period_us, 1e4, "acquisition.sample_period_us")?;
    within(acquisition.samples, LEAST_SAMPLES, MOST_SAMPLES, "acquisition.samples")?;
    positive(acquisition.largest_healthy_counts, 32_767.0, "acquisition.largest_healthy_counts")?;
    within(acquisition.noise_sd_counts, 0.0, 32_767.0, "acquisition.noise_sd_counts")
}

/// Drive levels must be positive, with as many shares, which add up to 1.
fn check_drive(physics: &Physics) -> Check {
    let (levels, shares) = (&physics.drive.levels_v, &physics.drive.shares);
    let as_many = !levels.is_empty() && levels.len() == shares.len();
    let why = "levels_v and shares must have the same number of entries, at least one";
    require(as_many, "drive", why)?;
    levels.iter().try_for_each(|v| positive(*v, 1e4, "drive.levels_v"))?;
    shares.iter().try_for_each(|s| within(*s, 0.0, 1.0, "drive.shares"))?;
    let sum: f64 = shares.iter().sum();
    require((sum - 1.0).abs() < 1e-6, "drive.shares", format!("they add up to {sum:?}, not 1"))
}

/// `class` must be one of the fault classes.
fn check_class(class: &str, key: &str) -> Check {
    let why = format!("there is no fault class {class:?}; there are {}", CLASSES.join(", "));
    require(CLASSES.contains(&class), key, why)
}

/// A severity must be at or above the one that changes nothing, and must leave moderate positive rates.
fn check_severity(class: &str, severity: f64, physics: &Physics, key: &str) -> Check {
    let none = faults::law(class).map_or(0.0, Law::none);
    let faulty = faults::apply(class, severity, &physics.channel);
    let moderate = faulty.is_some_and(|c| c.a_per_s2 + c.b_per_s2 < 1e18 && c.d_per_s < 1e18);
    let change = faults::law(class).map_or("", |law| &law.change);
    let why = format!("{severity:?} is no severity of {class}: {change}");
    require(severity >= none && moderate, key, why)
}

/// Each `[fault.CLASS]` must be a known class with a valid range; its `change`, if given, this program's.
fn check_fault_ranges(physics: &Physics) -> Check {
    for (class, fault) in &physics.fault {
        let key = format!("fault.{class}");
        check_class(class, &key)?;
        if let Some(change) = &fault.change {
            let ours = faults::law(class).map_or("", |law| &law.change);
            let why = format!("this program simulates {ours:?}; leave `change` out or write that");
            require(change == ours, &format!("{key}.change"), why)?;
        }
        let key = format!("{key}.range");
        let [low, high] = fault.range;
        require(low <= high, &key, format!("{low:?} is not below {high:?}"))?;
        check_severity(class, low, physics, &key)?;
        check_severity(class, high, physics, &key)?;
    }
    Ok(())
}

/// A set must have at least one signal and at most `MOST_CHANNELS`.
fn check_set_size(signals: usize, key: &str) -> Check {
    let why = format!("a set of {signals} signals; it must have between 1 and {MOST_CHANNELS}");
    require((1..=MOST_CHANNELS).contains(&signals), key, why)
}

/// The sets must have a moderate size, and fault classes if they have faulty signals.
fn check_dataset(dataset: &Dataset, physics: &Physics) -> Check {
    let faulty = dataset.per_fault.saturating_mul(physics.fault.len());
    check_set_size(dataset.healthy.saturating_add(faulty), "dataset")?;
    check_set_size(dataset.calibration_test.max(1), "dataset.calibration_test")?;
    let needs_faults = dataset.per_fault > 0 || dataset.calibration_test > 0;
    let why = "faulty signals need at least one [fault.CLASS] with a range";
    require(!needs_faults || !physics.fault.is_empty(), "dataset", why)
}

/// Checks `[print_run]`: its size, that its bursts do not overlap in time, its end, its names and faults.
fn check_print_run(run: &PrintRun, physics: &Physics, recording: &RecordingOptions) -> Check {
    within(run.printheads, 1, MOST_PRINTHEADS, "print_run.printheads")?;
    let channels = run.printheads.saturating_mul(run.channels);
    let why = format!(
        "{} x {} channels; there must be between 1 and {MOST_CHANNELS}",
        run.printheads, run.channels
    );
    require((1..=MOST_CHANNELS).contains(&channels), "print_run", why)?;
    let signals = (channels as u64).saturating_mul(run.bursts_per_channel as u64);
    let why = format!("{signals} signals; there must be between 1 and {MOST_SIGNALS}");
    require((1..=MOST_SIGNALS).contains(&signals), "print_run.bursts_per_channel", why)?;

    let acquisition = &physics.acquisition;
    let busy_us = acquisition.pulse_us
        + acquisition.delay_us
        + acquisition.sample_period_us * acquisition.samples as f64;
    let why =
        format!("{} s is shorter than actuation and acquisition, {busy_us} us", run.interval_s);
    require(run.interval_s * 1e6 >= busy_us, "print_run.interval_s", why)?;
    let end_ns = recording.start_ns as f64 + run.bursts_per_channel as f64 * run.interval_s * 1e9;
    require(end_ns < LATEST_NS, "print_run.interval_s", "the run ends after the year 2200")?;

    check_names(run, physics)?;
    within(run.faulty_channels, 0.0, 1.0, "print_run.faulty_channels")?;
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

/// Names must be as many as printheads, unlike each other, and unlike that of the sets.
fn check_names(run: &PrintRun, physics: &Physics) -> Check {
    let key = "print_run.names";
    let Some(names) = &run.names else { return Ok(()) };
    let why = format!("{} names for {} printheads", names.len(), run.printheads);
    require(names.len() == run.printheads, key, why)?;
    let mut seen = HashSet::new();
    for name in names {
        require((1..=200).contains(&name.len()), key, "a name has between 1 and 200 bytes")?;
        require(seen.insert(name), key, format!("{name:?} is there twice"))?;
        let taken = physics.dataset.is_some() && name == PRINTHEAD;
        require(!taken, key, format!("{name:?} is the printhead of the sets: choose another"))?;
    }
    Ok(())
}

/// Each listed fault must be possible in the run; faults of one category on one channel must not overlap.
fn check_explicit_faults(run: &PrintRun, physics: &Physics) -> Check {
    let names: Vec<String> = (0..run.printheads).map(|p| run.name(p)).collect();
    require(run.fault.len() <= MOST_CHANNELS, "print_run.fault", "too many faults")?;
    let mut by_channel: Vec<(usize, &ExplicitFault)> = run.fault.iter().enumerate().collect();
    for (i, fault) in &by_channel {
        let key = format!("print_run.fault[{i}]");
        let why =
            format!("there is no printhead {:?}; there are {}", fault.printhead, names.join(", "));
        require(names.contains(&fault.printhead), &key, why)?;
        let why = format!("channel {} of {}: they count from 0", fault.channel, run.channels);
        require((fault.channel as usize) < run.channels, &key, why)?;
        check_class(&fault.class, &key)?;
        check_severity(&fault.class, fault.severity, physics, &key)?;
        if let Some(to) = fault.to_severity {
            check_severity(&fault.class, to, physics, &format!("{key}.to_severity"))?;
        }
        let why = format!("from_s = {:?} and to_s = {:?} are no span", fault.from_s, fault.to_s);
        require(0.0 <= fault.from_s && fault.from_s < fault.to_s, &key, why)?;
        let why =
            format!("no burst of the run lies within {} s and {} s", fault.from_s, fault.to_s);
        require(step_at(run, fault.from_s) < step_at(run, fault.to_s), &key, why)?;
    }
    // Faults of several categories may be on at once, thesis (2-1); two of one category would be one fault.
    // In this order only neighbours can overlap.
    let place = |f: &ExplicitFault| (f.printhead.clone(), f.channel, category(&f.class).to_owned());
    by_channel
        .sort_by(|(_, x), (_, y)| place(x).cmp(&place(y)).then(x.from_s.total_cmp(&y.from_s)));
    for pair in by_channel.windows(2) {
        let ((i, x), (j, y)) = (pair[0], pair[1]);
        let apart = place(x) != place(y) || x.to_s <= y.from_s;
        let why =
            format!("overlaps fault[{j}] of the same category on the same channel: one at a time");
        require(apart, &format!("print_run.fault[{i}]"), why)?;
    }
    Ok(())
}

/// Checks a classes scenario; each range of a box must go upwards from 0 or more.
fn check_classes(classes: &Classes, recording: &RecordingOptions) -> Check {
    positive(classes.t_us, 1e8, "T_us")?;
    within(classes.n, LEAST_SAMPLES, MOST_SAMPLES, "N")?;
    within(classes.phi0_rad, -10.0, 10.0, "phi0_rad")?;
    within(classes.rho, -100.0, 100.0, "rho")?;
    within(classes.lambda_per_s, 0.0, 1e12, "lambda_per_s")?;
    within(classes.noise_sd_counts, 0.0, 32_767.0, "noise_sd_counts")?;
    let faulty = classes.n_per_fault.saturating_mul(classes.classes.faults.len());
    check_set_size(classes.n_healthy.saturating_add(faulty), "n_healthy")?;
    let per_burst = recording.channels_per_burst.unwrap_or(CHANNELS_PER_BURST) as usize;
    check_burst_size(per_burst, classes.n, recording)?;
    let faults = classes.classes.faults.iter().map(|(name, class)| (name.as_str(), class));
    for (name, class) in faults.chain([(HEALTHY, &classes.classes.healthy)]) {
        for (key, range) in [
            ("amplitude_counts", class.amplitude_counts),
            ("sigma_per_s", class.sigma_per_s),
            ("freq_hz", class.freq_hz),
        ] {
            let key = format!("classes.{name}.{key}");
            within(range[0], 0.0, 1e12, &key)?;
            within(range[1], range[0], 1e12, &key)?;
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
            ("sigma_per_s = [27000.0, 31000.0]", "sigma_per_s = [inf, inf]", "healthy.sigma"),
            ("[classes.healthy]", "[classes.fine]", "healthy"),
        ];
        let of_physics = [
            ("schema = 1", "schema = 2", "schema"),
            ("schema = 1", "schema = 1\nkind = \"optics\"", "kind"),
            ("schema = 1", "schema = 1\ncolour = 3", "colour"),
            ("a_per_s2 = 5.6e10", "a_per_s2 = nan", "channel.a_per_s2"),
            ("a_per_s2 = 5.6e10", "a_per_s2 = 5.6e10\nz = 1", "z"),
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
            ("\"cyan-1\"", "\"dataset\"", "print_run.names"),
            ("levels_v = [24.0, 30.0]", "levels_v = []", "drive"),
            ("shares = [0.3, 0.7]", "shares = [0.3, 0.3]", "drive.shares"),
            ("range = [0.2, 0.5]", "range = [0.2, 1.0]", "fault.EC.range"),
            ("range = [1.10, 1.40]", "range = [0.10, 1.40]", "fault.SDN.range"),
            ("change = \"d * s\"", "change = \"d + s\"", "change"),
            ("[fault.EC]", "[fault.EX]", "fault.EX"),
            ("compression = \"zstd\"", "compression = \"rar\"", "rar"),
            ("compression = \"zstd\"", "channels_per_burst = 0", "channels_per_burst"),
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
    fn explicit_faults_must_fit_into_the_run_one_at_a_time() {
        let fault = |printhead: &str, channel: u32, class: &str, s: &str, from: f64, to: f64| {
            format!(
                "\n[[print_run.fault]]\nprinthead = {printhead:?}\nchannel = {channel}\n\
                 class = {class:?}\nseverity = {s}\nfrom_s = {from}\nto_s = {to}\n"
            )
        };
        let read = |faults: &str| Scenario::from_toml(&format!("{SAMPLE}{faults}"));
        let dried = fault("cyan-1", 47, "DDN", "2.0", 3.0, 9.0);
        read(&dried).unwrap();
        // the fault may grow, and a fault of another category may join it
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
            format!("{dried}{}", fault("cyan-1", 47, "IDN", "1.5", 8.0, 20.0)),
            format!("{dried}to_severity = 0.5\n"),
        ] {
            let refusal = read(&faults).expect_err(&faults).to_string();
            assert!(refusal.contains("print_run.fault["), "{refusal}");
        }
    }
}
