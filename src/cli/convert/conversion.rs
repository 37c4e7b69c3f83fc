//! Makes the bursts of a recording from those of a table, one after another, and tells what became of the
//! table.
//!
//! In: from `input_bursts`, a decay per burst; from `args`, what the options
//! give. Out: a [`Burst`] per decay, which `convert` writes ([`Conversion::burst`]); at the end
//! what was made and what had to be assumed (`tell.rs`, or [`Made`] as JSON).

mod tell;

use super::super::exit::Failure;
use super::args::{Args, BurstValue, BurstValues, LONGEST_NAME};
use super::burst_clock::BurstClock;
use super::input_bursts::{InputBursts, Times};
use bytes::Bytes;
use inkling_core::burst::{Burst, Layout};
use inkling_io::printable;
use inkling_io::sampling::Sampled;
use inkling_io::table_file::Decay;
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Longest sample period, s: even tides, sampled every ten minutes, have a shorter one.
const LONGEST_PERIOD_S: f64 = 1000.0;
/// Most characters of a list of names.
const MOST_NAMED: usize = 400;
/// Times that move so often in a burst say its length to a tenth, whatever their digits.
const LEAST_MOVES: usize = 10;
/// Steps between regular times differ by less than this from their mean, relative; then a sample period is another one
/// from this factor on.
const MOST_UNEVEN: f64 = 0.1;
const MOST_OTHER: f64 = 1.03;

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
    /// The printheads whose bursts they are.
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
            printhead: args.name(&args.tables[0])?.into(),
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
            let what = format!("its outputs are {own}, those of the table before {other}");
            let what = printable::line(&what, MOST_NAMED);
            let advice = "write all in one unit and order, or convert each kind by itself";
            return Err(Failure::new(format!("{}: {what}: {advice}", table.display())));
        }
        // each name says when its own table began; any other start is that of them all
        if is_first || self.args.start.as_deref() == Some("name") {
            self.clock.start_at(start_ns, self.args.every);
        }
        self.table = table.into();
        self.printhead = self.args.name(table)?.into();
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

        if let Some((told_s, most)) = self.period_by_times(decay)
            && !(1.0 / most..=most).contains(&(told_s / period_s))
        {
            let what = format!(
                "its times say one sample every {told_s:.3e} s, --period-s {period_s} s: which is right? Without --period-s its times are taken"
            );
            return Err(of_burst(&what));
        }

        // the time of the burst, among those of its printhead
        let printhead = self.printhead_of(&decay.printhead)?;
        let period_ns = period_s * 1e9;
        let samples_per_channel = decay.outputs.first().map_or(0, Vec::len) as u32;
        let length_ns = f64::from(samples_per_channel) * period_ns;
        let time_ns = self.times.as_ref().and_then(|of| of.begin(decay));
        if time_ns.is_some_and(|(_, after)| !after.is_finite()) {
            return Err(of_burst("it has no time"));
        }
        if self.clock.mixes(time_ns) {
            let what = "of its times and those of bursts before only one kind counts from 1970: convert each kind by \
                        itself, or say by --every how far apart bursts begin";
            return Err(of_burst(what));
        }
        let t_acq_ns = self
            .clock
            .next(&printhead, time_ns, length_ns, period_ns)
            .ok_or_else(|| wrong("its times reach beyond the years 1970 to 2200"))?;

        // channel numbers must fit into u32
        let (first_channel, channels) = (args.first_channel, decay.outputs.len() as u32);
        if first_channel.checked_add(channels).is_none() {
            return Err(Failure::usage(format!(
                "--first-channel {first_channel}: {channels} channels more have no numbers"
            )));
        }
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
            topic: 0,
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

    /// The mean time between a burst's samples by the table's own times, s, and by which factor it may be wrong. `None`:
    /// it has none, or they number the samples and say no unit, or they hardly move, as times of bursts and such of few
    /// digits.
    fn period_by_times(&self, decay: &Decay) -> Option<(f64, f64)> {
        let [first, .., last] = decay.times[..] else { return None };
        let times = self.times.as_ref().filter(|_| self.sampled.is_some())?;
        let mean = (last - first) / (decay.times.len() - 1) as f64;
        let steps = || decay.times.windows(2).map(|pair| pair[1] - pair[0]);
        let moves = steps().filter(|step| *step != 0.0).count();
        let are_numbers = mean == 1.0 && !times.has_unit;
        let is_regular = steps().all(|step| (step / mean - 1.0).abs() < MOST_UNEVEN);
        let most = if is_regular { MOST_OTHER } else { 2.0 };
        (moves >= LEAST_MOVES && !are_numbers).then_some((mean * times.unit.ns / 1e9, most))
    }

    /// The printhead of a burst: the one that its row names, or else that of its table. `name`: the
    /// name in its row; empty: there is none.
    fn printhead_of(&mut self, name: &str) -> Result<Arc<str>, Failure> {
        let of_table = self.printhead.clone();
        let name = if name.is_empty() { &*of_table } else { name };
        if name.chars().count() > LONGEST_NAME {
            return Err(Failure::new("a printhead's name that long?"));
        }
        let known = self.made.printheads.get(name).cloned();
        let name = known.unwrap_or_else(|| name.into());
        self.made.printheads.insert(name.clone());
        Ok(name)
    }
}
