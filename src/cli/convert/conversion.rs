//! Makes the bursts of a recording from those of a table, one after another, and tells what became of the
//! table.
//!
//! In: from `input_bursts`, a decay per burst; from `args`, what the options
//! give. Out: a [`Burst`] per decay, which `convert` writes ([`Conversion::burst`]); at the end
//! what was made and what had to be assumed ([`Conversion::tell`], or [`Made`] as JSON).

use super::super::contents;
use super::super::exit::Failure;
use super::super::output;
use super::super::progress::{counted, thousands};
use super::super::report::printable;
use super::args::{Args, BurstValue, BurstValues, LONGEST_NAME, SOME_START};
use super::burst_clock::BurstClock;
use super::input_bursts::{InputBursts, Times};
use bytes::Bytes;
use inkling_core::burst::{Burst, Layout};
use inkling_io::sampling::Sampled;
use inkling_io::table_file::Decay;
use inkling_io::when;
use serde::Serialize;
use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Longest sample period, s: even tides, sampled every ten minutes, have a shorter one.
const LONGEST_PERIOD_S: f64 = 1000.0;
/// From 1904, where LabVIEW begins to count, to 1970.
const BEGIN_1904_NS: i64 = 2_082_844_800_000_000_000;
/// Times that move so often in a burst say its length to a tenth, whatever their digits.
const LEAST_MOVES: usize = 10;

/// A conversion under way: the means by which bursts are made, and what was made so far.
pub struct Conversion<'a> {
    args: &'a Args,
    /// The printhead of bursts whose rows name none.
    printhead: Arc<str>,
    values: &'a BurstValues,
    /// The sample period, s: the one of the option, or else that of the table's own times; `None`:
    /// nothing gives it.
    period: Option<BurstValue>,
    /// What the table's times mean; `None`: it has no column of times.
    times: Option<Times>,
    clock: BurstClock,
    /// How regular the times of all tables are, if they are times of samples.
    sampled: Option<Sampled>,
    /// The table whose bursts are made.
    table: PathBuf,
    pub made: Made<'a>,
}

/// What was made of a table, as `--json` tells it.
#[derive(Serialize)]
pub struct Made<'a> {
    recording: &'a Path,
    bursts: u64,
    samples: u64,
    /// The shortest and the longest sample period of a burst, s.
    sample_period_s: [f64; 2],
    /// Samples per channel of the shortest and the longest burst.
    samples_per_channel: [u32; 2],
    /// Names of the channels.
    outputs: Vec<String>,
    /// The printheads that rows of the table name.
    printheads: BTreeSet<Arc<str>>,
    /// Number of cells without a value.
    cells_missing: usize,
    /// Columns that are no outputs, though nobody said so.
    left_out: Vec<String>,
    /// The unit in which times were read.
    times_in: Option<&'static str>,
}

impl<'a> Conversion<'a> {
    /// A conversion that has made no burst yet.
    pub fn new(args: &'a Args, values: &'a BurstValues) -> Result<Conversion<'a>, Failure> {
        Ok(Conversion {
            args,
            printhead: args.name()?.into(),
            values,
            period: None,
            times: None,
            clock: BurstClock::default(),
            sampled: None,
            table: PathBuf::new(),
            made: Made {
                recording: &args.out,
                bursts: 0,
                samples: 0,
                sample_period_s: [f64::INFINITY, 0.0],
                samples_per_channel: [u32::MAX, 0],
                outputs: Vec::new(),
                printheads: BTreeSet::new(),
                cells_missing: 0,
                left_out: Vec::new(),
                times_in: None,
            },
        })
    }

    /// Begins with the next table. `start_ns`: time of its first burst by `--start`. A failure if it is no more
    /// of the same as the table before.
    pub fn begin(
        &mut self,
        table: &Path,
        input: &InputBursts,
        start_ns: Option<i64>,
    ) -> Result<(), Failure> {
        let is_first = self.table.as_os_str().is_empty();
        if !is_first && self.made.outputs != input.outputs {
            let [other, own] = [&self.made.outputs, &input.outputs].map(|of| of.join(", "));
            let what =
                printable(&format!("its outputs are {own}, those of the table before {other}"));
            return Err(Failure::new(format!("{}: {what}", table.display())));
        }
        // each name says when its own table began; any other start is that of them all
        if is_first || self.args.start.as_deref() == Some("name") {
            self.clock.start_at(start_ns, self.args.every);
        }
        self.table = table.into();
        self.period = self.values.period_s.or(input.period_s.map(BurstValue::Constant));
        self.times.clone_from(&input.times);
        self.made.outputs.clone_from(&input.outputs);
        self.made.left_out.clone_from(&input.left_out);
        self.made.times_in = input.times.as_ref().map(|times| times.unit.name);
        self.made.cells_missing += input.missing;
        if let Some(new) = &input.sampled {
            self.sampled.get_or_insert_default().add(new);
        }
        Ok(())
    }

    /// Makes the next burst from a decay. A failure if its sample period or its time is
    /// not plausible, which names the burst by its number from 0 on.
    pub fn burst(&mut self, decay: &Decay) -> Result<Burst, Failure> {
        let (args, n, table) = (self.args, self.made.bursts, self.table.clone());
        let wrong = |what: &str| Failure::new(format!("{}: {what}", table.display()));
        let of_burst = |what: &str| wrong(&format!("burst {n}: {what}"));
        let nobody = || Failure::usage("--period-s: nothing else says the sample period");
        // the sample period: plausible, and known for this burst
        let period_s = self.period.ok_or_else(nobody)?.in_burst(decay);
        if !(period_s.is_finite() && period_s > 0.0) {
            return Err(of_burst(&format!("{period_s} s is no sample period")));
        }
        if period_s > LONGEST_PERIOD_S {
            let what = "s between samples: if that is a rate, give the period, which is 1 / rate";
            return Err(of_burst(&format!("{period_s} {what}")));
        }

        if let Some(told_s) = self.period_by_times(decay)
            && !(0.5..=2.0).contains(&(told_s / period_s))
        {
            let what = format!(
                "its times say one sample every {told_s:.3e} s, --period-s {period_s} s: which is right? Without --period-s its times are taken"
            );
            return Err(of_burst(&what));
        }

        // the time of the burst
        let period_ns = period_s * 1e9;
        let samples_per_channel = decay.outputs.first().map_or(0, Vec::len) as u32;
        let length_ns = f64::from(samples_per_channel) * period_ns;
        let time_ns = self.times.as_ref().and_then(|of| of.begin(decay));
        if time_ns.is_some_and(|(_, after)| !after.is_finite()) {
            return Err(of_burst("it has no time"));
        }
        let t_acq_ns = self
            .clock
            .next(time_ns, length_ns, period_ns)
            .ok_or_else(|| wrong("its times reach beyond the years 1970 to 2200"))?;

        // channel numbers must fit into u32
        let (first_channel, channels) = (args.first_channel, decay.outputs.len() as u32);
        if first_channel.checked_add(channels).is_none() {
            return Err(Failure::usage(format!(
                "--first-channel {first_channel}: {channels} channels more have no numbers"
            )));
        }
        let printhead = self.printhead_of(&decay.printhead)?;
        let samples = decay.samples().ok_or_else(|| wrong("a burst too large"))?;

        // what is told at the end
        self.made.bursts += 1;
        self.made.samples += u64::from(channels) * u64::from(samples_per_channel);
        let [shortest, longest] = self.made.samples_per_channel;
        self.made.samples_per_channel =
            [shortest.min(samples_per_channel), longest.max(samples_per_channel)];
        let [least_s, most_s] = self.made.sample_period_s;
        self.made.sample_period_s = [least_s.min(period_s), most_s.max(period_s)];

        // a temperature or voltage that is not finite counts as not measured
        let measured =
            |value: Option<BurstValue>| value.map(|v| v.in_burst(decay)).filter(|x| x.is_finite());
        Ok(Burst {
            t_acq_ns,
            logged_ns: t_acq_ns,
            printhead,
            first_channel,
            channels,
            samples_per_channel,
            sample_period_s: period_s,
            format: samples.format,
            layout: Layout::ChannelMajor,
            temperature_c: measured(self.values.temperature),
            drive_voltage_v: measured(self.values.voltage),
            idle_time_s: Vec::new(),
            neighbours_fired: Bytes::new(),
            samples: samples.bytes,
        })
    }

    /// The mean time between a burst's samples by the table's own times, s. `None`: it has none, or they number the
    /// samples, or they hardly move, as times of bursts and such of few digits.
    fn period_by_times(&self, decay: &Decay) -> Option<f64> {
        let [first, .., last] = decay.times[..] else { return None };
        let unit_ns = self.times.as_ref().filter(|_| self.sampled.is_some())?.unit.ns;
        let steps = (decay.times.len() - 1) as f64;
        let moves = decay.times.windows(2).filter(|pair| pair[0] != pair[1]).count();
        let are_numbers = last - first == steps;
        (moves >= LEAST_MOVES && !are_numbers).then(|| (last - first) * unit_ns / 1e9 / steps)
    }

    /// The printhead of a burst: the one that its row names, or else that of all bursts. `name`: the
    /// name in its row; empty: there is none.
    fn printhead_of(&mut self, name: &str) -> Result<Arc<str>, Failure> {
        if name.is_empty() {
            return Ok(self.printhead.clone());
        }
        if name.chars().count() > LONGEST_NAME {
            return Err(Failure::new("a printhead's name that long?"));
        }
        let known = self.made.printheads.get(name).cloned();
        let name = known.unwrap_or_else(|| name.into());
        self.made.printheads.insert(name.clone());
        Ok(name)
    }

    /// Prints what became of the table, and which of its properties had to be assumed.
    pub fn tell(&self) -> std::io::Result<()> {
        let made = &self.made;
        let mut out = output::report();
        let path = self.args.out.display();
        let (bursts, samples) = (counted(made.bursts, "burst"), thousands(made.samples));
        // in f32, so that rounding of the period does not show
        let [least, most] = made.sample_period_s.map(|s| s as f32);
        let to_most = if least == most { String::new() } else { format!(" to {most}") };
        writeln!(out, "{path}: {bursts}, {samples} samples, one every {least}{to_most} s")?;
        if let (true, [first, .., last]) = (self.args.by_number, &self.args.tables[..]) {
            let [first, last] = [first, last].map(|of| printable(&of.display().to_string()));
            writeln!(out, "  tables are taken in the order of their numbers: {first} to {last}")?;
        }
        for (n, output) in (0u64..).zip(&made.outputs) {
            let channel = n + u64::from(self.args.first_channel);
            writeln!(out, "  channel {channel}: {}", printable(output))?;
        }
        if let Some(Sampled { interpolated, missing, most_off_grid, segments, .. }) = &self.sampled
        {
            if *segments > 0 {
                writeln!(out, "  {segments} bursts are segments: times jump between them")?;
            }
            if self.args.resample {
                write!(out, "  resampled: {interpolated} of {samples} samples interpolated, ")?;
                writeln!(out, "{missing} cells were missing")?;
            } else if self.args.period_s.is_none() {
                writeln!(out, "  times within {most_off_grid:.3} periods of a regular grid")?;
            }
        }
        if let Some(Times { unit, why, .. }) = &self.times {
            writeln!(out, "  times are taken as {}, {}", unit.name, printable(why))?;
        }
        if let Some(ns) = self.clock.latest_ns.filter(|ns| when::is_far_ahead(*ns)) {
            let [told, since_1904] = [ns, ns - BEGIN_1904_NS].map(contents::time);
            write!(
                out,
                "  times reach to {told}, years from now: if they count since 1904, as LabVIEW "
            )?;
            writeln!(out, "does, that is {since_1904}; --start says when the first burst began")?;
        }
        if !made.left_out.is_empty() {
            let left_out: Vec<String> =
                made.left_out.iter().map(|name| format!("{name:?}")).collect();
            let left_out = printable(&left_out.join(", "));
            writeln!(
                out,
                "  no outputs, as they number rows, repeat times or are remarks: {left_out} (--outputs)"
            )?;
        }
        if !made.printheads.is_empty() {
            writeln!(out, "  printheads by their column: {}", made.printheads.len())?;
        }
        let [shortest, longest] = made.samples_per_channel;
        if shortest < longest {
            write!(out, "  bursts have {shortest} to {longest} samples a channel; ")?;
            writeln!(out, "a design takes one length, the others are `design_mismatch`")?;
        }
        if made.cells_missing > 0 {
            write!(out, "  {} cells have no value: ", thousands(made.cells_missing as u64))?;
            writeln!(out, "signals with one are rejected (`non_finite`); --resample interpolates")?;
        }
        if self.clock.invented() {
            writeln!(out, "  nothing says when: the first burst is put at {SOME_START} (--start)")?;
        }
        if self.clock.in_a_row() {
            let put = "put one after the other without a gap (--time, --every)";
            writeln!(out, "  nothing says when bursts begin: {put}")?;
        }
        if self.clock.moved > 0 {
            let n = self.clock.moved;
            writeln!(out, "  {n} bursts begin where an earlier one has not ended: put after it")?;
        }
        Ok(())
    }
}
