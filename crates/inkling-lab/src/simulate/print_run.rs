//! Simulates print runs: printheads that print for a while, with channels that become faulty meanwhile. In:
//! `[print_run]` of a physics scenario. Out: one recording of bursts in time order, one acquisition per
//! printhead and time step, and labels with the truth.
//!
//! After thesis (2-1), (2-2) over time; every channel fires in every burst. The steps: list all faults (drawn,
//! or those of the file); per printhead, draw the channels; per step, draw temperature error and drive, change
//! each channel's rates by viscosity and by its faults of that step, and sense its signal (`sensor.rs`).
//!
//! Departs: (2-1) adds B_f f of faults that a channel has at once. Two large ones together would make a rate
//! negative; here each fault changes the rates that the faults before it leave.

use super::draws::{Purpose, part, stream};
use super::scenario::{Drive, Physics, PrintRun, RecordingOptions};
use super::sensor::{Channel, NOMINAL_TEMPERATURE_C, Sensor, at_viscosity};
use super::simulated::{SimulatedRecording, burst_of, healthy_heads};
use inkling_core::burst::Burst;
use inkling_core::fault::CLASSES;
use inkling_core::labels::{Channels, Label};
use inkling_core::model::faults::Law;
use inkling_core::model::{InkChannel, faults};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use std::collections::{BTreeSet, HashMap};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Smallest number of bursts that a drawn fault lasts.
pub const LEAST_FAULT_BURSTS: usize = 20;
/// Number of bursts over which a fault grows from none to its severity (its ramp).
const RAMP_BURSTS: usize = 5;
/// Standard deviation of the error with which the ink temperature is recorded, K.
pub const RECORDED_TEMPERATURE_SD_K: f64 = 0.05;

/// The first burst at which a drawn fault may begin: a tenth of the run, which is healthy, lies before it.
pub fn first_random_burst(run: &PrintRun) -> usize {
    run.bursts_per_channel.div_ceil(10)
}

/// One fault of one channel; it lasts from burst `from` to burst `to` (exclusive).
#[derive(Clone, Debug, PartialEq)]
struct Fault {
    printhead: usize,
    channel: u32,
    /// Class at the beginning, such as `SDN`.
    class: String,
    /// Full severity at `from`, in the class's unit.
    severity: f64,
    /// Severity at `to`, which is reached linearly; `None`: the severity stays.
    to_severity: Option<f64>,
    from: usize,
    to: usize,
}

impl Fault {
    /// The severity at burst `step`, with `from` <= `step` < `to`: a ramp of `RAMP_BURSTS` bursts from none to
    /// the full severity, which itself may change linearly from `severity` to `to_severity`.
    fn severity_at(&self, step: usize) -> f64 {
        let none = faults::law(&self.class).map_or(0.0, Law::none);
        // how much of the ramp is done, and how much of the fault's time has passed
        let grown = (step - self.from + 1).min(RAMP_BURSTS) as f64 / RAMP_BURSTS as f64;
        let passed = (step - self.from) as f64 / (self.to - self.from) as f64;
        let to = self.to_severity.unwrap_or(self.severity);
        let full = self.severity + (to - self.severity) * passed;
        if grown < 1.0 { none + (full - none) * grown } else { full }
    }

    /// The burst (exclusive) until which the severity changes from burst to burst.
    fn grows_until(&self) -> usize {
        match self.to_severity {
            Some(_) => self.to,
            None => self.to.min(self.from + RAMP_BURSTS),
        }
    }

    /// The fault's class at burst `step`. A fault with `to_severity` whose severity has left the range of its
    /// class takes the class of the same kind whose range holds it, if there is one.
    fn class_at(&self, step: usize) -> &str {
        let severity = self.severity_at(step);
        // whether the severity lies in the range of a class; a range may be written from high to low
        let is_meant = |law: &Law| {
            let [a, b] = law.range;
            (a.min(b)..=a.max(b)).contains(&severity)
        };
        let grows = faults::law(&self.class).filter(|_| self.to_severity.is_some());
        let Some(own) = grows.filter(|own| !is_meant(own)) else { return &self.class };
        let is_now = |class: &&str| {
            faults::law(class).is_some_and(|law| law.is_kind_of(own) && is_meant(law))
        };
        CLASSES.into_iter().find(is_now).unwrap_or(&self.class)
    }

    /// The channel's rates with the fault, at burst `step`.
    fn rates(&self, healthy: &InkChannel, step: usize) -> InkChannel {
        // the severities of a scenario are checked, and those of the ramp lie between them and none
        faults::apply(&self.class, self.severity_at(step), healthy).unwrap_or(*healthy)
    }
}

/// Time of burst `step`, ns since the epoch; checked: the end of the run fits into i64.
pub fn time_ns(run: &PrintRun, start_ns: i64, step: usize) -> i64 {
    start_ns + (step as f64 * run.interval_s * 1e9).round() as i64
}

/// Number of the first burst at or after `seconds` from the first one on; at most that of all bursts.
pub fn step_at(run: &PrintRun, seconds: f64) -> usize {
    // a rounding error must not turn a whole number of intervals into the next one
    ((seconds / run.interval_s - 1e-9).ceil().max(0.0) as usize).min(run.bursts_per_channel)
}

/// All faults of the run, listed or else drawn, sorted by printhead, channel and begin.
fn faults_of(physics: &Physics, run: &PrintRun, seed: u64) -> Vec<Fault> {
    let mut faults = if run.fault.is_empty() {
        drawn_faults(physics, run, seed)
    } else {
        let number: HashMap<String, usize> =
            (0..run.printheads).map(|p| (run.name(p), p)).collect();
        let explicit = run.fault.iter().map(|fault| Fault {
            printhead: number.get(&fault.printhead).copied().unwrap_or(0), // checked: it exists
            channel: fault.channel,
            class: fault.class.clone(),
            severity: fault.severity,
            to_severity: fault.to_severity,
            from: step_at(run, fault.from_s),
            to: step_at(run, fault.to_s),
        });
        explicit.filter(|fault| fault.from < fault.to).collect()
    };
    faults.sort_by_key(|fault| (fault.printhead, fault.channel, fault.from));
    faults
}

/// Draws one fault for each of a share (`faulty_channels`) of all channels, uniform in all it has.
fn drawn_faults(physics: &Physics, run: &PrintRun, seed: u64) -> Vec<Fault> {
    let ranges = physics.severity_ranges();
    let channels = run.printheads * run.channels;
    let count = (run.faulty_channels * channels as f64).round() as usize;
    if count == 0 || ranges.is_empty() {
        return Vec::new();
    }
    let mut rng = stream(seed, Purpose::Truth, part::PRINT_RUN);
    let chosen = rand::seq::index::sample(&mut rng, channels, count);
    // `place`: number of a channel over all printheads
    let draw = |place: usize| {
        let (class, [low, high]) = ranges[rng.random_range(0..ranges.len())].clone();
        let last = run.bursts_per_channel;
        let from = rng.random_range(first_random_burst(run)..=last - LEAST_FAULT_BURSTS);
        Fault {
            printhead: place / run.channels,
            channel: (place % run.channels) as u32,
            class,
            severity: low + (high - low) * rng.random::<f64>(),
            to_severity: None,
            from,
            to: rng.random_range(from + LEAST_FAULT_BURSTS..=last),
        }
    };
    chosen.iter().map(draw).collect()
}

/// The labels of a run: a healthy row per printhead; then, for each channel with faults, a row for each burst
/// in which one of them grows, and a row for each span of bursts in which none does. Several faults at once
/// are one label without a severity, `AB2+SDN`. Spans begin and end midway between bursts, so that rounding
/// of times does not matter.
pub(super) fn labels(physics: &Physics, options: &RecordingOptions, seed: u64) -> Vec<Label> {
    let Some(run) = &physics.print_run else { return Vec::new() };
    let mut labels = healthy_heads(run);
    let at = |step| time_ns(run, options.start_ns, step);
    let half_ns = (run.interval_s * 0.5e9) as i64;
    let faults = faults_of(physics, run, seed);
    for of_channel in faults.chunk_by(|a, b| (a.printhead, a.channel) == (b.printhead, b.channel)) {
        // times at which the label changes: begin and end of each fault, and every burst while it grows
        let edges = |fault: &Fault| (fault.from..=fault.grows_until()).chain([fault.to]);
        let edges: BTreeSet<usize> = of_channel.iter().flat_map(edges).collect();
        // between two edges, the faults that are on stay the same, and so does the severity
        for (&from, &to) in edges.iter().zip(edges.iter().skip(1)) {
            let on: Vec<&Fault> =
                of_channel.iter().filter(|fault| (fault.from..fault.to).contains(&from)).collect();
            let [first, rest @ ..] = &on[..] else { continue };
            let mut classes: Vec<&str> = on.iter().map(|fault| fault.class_at(from)).collect();
            classes.sort_unstable();
            classes.dedup();
            labels.push(Label {
                printhead: run.name(first.printhead),
                channel: Channels::One(first.channel),
                from_ns: Some(at(from) - half_ns),
                to_ns: Some(at(to) - half_ns),
                state: classes.join("+"),
                severity: rest.is_empty().then(|| first.severity_at(from)),
            });
        }
    }
    labels
}

/// A printhead's constants over the run, and its random streams.
struct Printhead {
    name: Arc<str>,
    channels: Vec<Channel>,
    /// Faults of its channels, sorted by channel and begin; a fault is removed when it is over.
    faults: Vec<Fault>,
    temperature_phase_rad: f64,
    sensor: Sensor,
    temperature: ChaCha8Rng,
    drive: ChaCha8Rng,
    neighbours: ChaCha8Rng,
}

impl Printhead {
    /// Simulates the acquisition at burst `step`, whose time is `t_ns`; steps must be asked for in order.
    fn acquire(&mut self, physics: &Physics, run: &PrintRun, step: usize, t_ns: i64) -> Burst {
        // temperature: the true one changes the viscosity, the recorded one has an error
        let sine = &physics.temperature;
        let phase = TAU * step as f64 * run.interval_s / sine.period_s + self.temperature_phase_rad;
        let above_c = sine.swing_c * phase.sin();
        let viscosity = 1.0 + sine.viscosity_per_k * above_c;
        let misread: f64 = self.temperature.sample(StandardNormal);
        let drive_v = draw_level(&physics.drive, &mut self.drive);

        // faults that are on, by channel
        self.faults.retain(|fault| step < fault.to);
        let on = self.faults.iter().filter(|fault| fault.from <= step);
        let mut faulty: HashMap<u32, Vec<&Fault>> = HashMap::new();
        on.for_each(|fault| faulty.entry(fault.channel).or_default().push(fault));

        // each channel's rates now, and its signal
        let n = physics.acquisition.samples;
        let mut counts = Vec::with_capacity(self.channels.len() * n);
        for (channel, number) in self.channels.iter().zip(0..) {
            let rates = at_viscosity(&channel.rates, viscosity);
            let on = faulty.get(&number).into_iter().flatten();
            let rates = on.fold(rates, |rates, fault| fault.rates(&rates, step));
            self.sensor.sense(&rates, channel.gain, drive_v, &mut counts);
        }

        // what is recorded beside the signals; the neighbours have no effect in this simulation
        let fired = |_| self.neighbours.random_range(0..=2u8);
        let beside = Burst {
            t_acq_ns: t_ns,
            printhead: self.name.clone(),
            sample_period_s: physics.acquisition.sample_period_s(),
            samples_per_channel: n as u32,
            temperature_c: Some(
                NOMINAL_TEMPERATURE_C + above_c + RECORDED_TEMPERATURE_SD_K * misread,
            ),
            drive_voltage_v: Some(drive_v),
            idle_time_s: vec![if step == 0 { f32::NAN } else { run.interval_s as f32 }],
            neighbours_fired: (0..self.channels.len()).map(fired).collect(),
            ..Burst::default()
        };
        burst_of(beside, &counts)
    }
}

/// Draws one of the drive levels (V), each with the probability of its share.
pub(super) fn draw_level(drive: &Drive, rng: &mut ChaCha8Rng) -> f64 {
    let mut left: f64 = rng.random();
    let drawn = drive.levels_v.iter().zip(&drive.shares).find(|(_, share)| {
        left -= **share;
        left < 0.0
    });
    // shares add up to 1 but for rounding; checked: there is a level
    drawn.map_or(drive.levels_v[drive.levels_v.len() - 1], |(level, _)| *level)
}

/// The recording of the scenario's print run, not yet made; `None` if the scenario has no print run.
pub(super) fn recording(
    physics: &Arc<Physics>,
    options: &RecordingOptions,
    seed: u64,
) -> Option<SimulatedRecording> {
    let run = physics.print_run.clone()?;
    let mut faults: Vec<Vec<Fault>> = vec![Vec::new(); run.printheads];
    for fault in faults_of(physics, &run, seed) {
        faults[fault.printhead].push(fault);
    }
    let printhead = |(number, faults): (usize, Vec<Fault>)| {
        let part = part::PRINT_RUN + number as u32;
        let mut spread = stream(seed, Purpose::Spread, part);
        let mut temperature = stream(seed, Purpose::Temperature, part);
        Printhead {
            name: run.name(number).into(),
            channels: (0..run.channels).map(|_| Channel::draw(physics, &mut spread)).collect(),
            faults,
            temperature_phase_rad: TAU * temperature.random::<f64>(),
            sensor: Sensor::new(physics, seed, part),
            temperature,
            drive: stream(seed, Purpose::Drive, part),
            neighbours: stream(seed, Purpose::Neighbours, part),
        }
    };
    let mut printheads: Vec<Printhead> = faults.into_iter().enumerate().map(printhead).collect();
    let (physics, start_ns) = (physics.clone(), options.start_ns);
    Some(SimulatedRecording::of_run(&run.clone(), options.clone(), move |number, step| {
        printheads[number].acquire(&physics, &run, step, time_ns(&run, start_ns, step))
    }))
}
