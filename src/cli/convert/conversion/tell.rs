//! Tells what became of tables: bursts, channels and printheads, and what had to be assumed.
//!
//! In: what a conversion made. Out: lines for the user.

use super::super::args::SOME_START;
use super::super::input_bursts::Times;
use super::{Conversion, MOST_NAMED};
use crate::cli::progress::{counted, thousands};
use crate::cli::report::printable;
use crate::cli::{contents, output};
use inkling_io::sampling::Sampled;
use inkling_io::{printable as shown, when};
use std::io::Write;

/// From 1904, where LabVIEW begins to count, to 1970.
const BEGIN_1904_NS: i64 = 2_082_844_800_000_000_000;

impl Conversion<'_> {
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
        let names: Vec<&str> = made.printheads.iter().map(|name| &**name).collect();
        let names = shown::line(&names.join(", "), MOST_NAMED);
        match made.printheads.len() {
            1 if self.args.tables.len() == 1 => {}
            1 if self.args.printhead.is_none() => writeln!(
                out,
                "  printhead {names}: names of tables that differ in a number or a time are of one (--printhead name: each of its own)"
            )?,
            n => writeln!(out, "  {}: {names}", counted(n as u64, "printhead"))?,
        }
        let [shortest, longest] = made.samples_per_channel;
        if shortest < longest {
            write!(out, "  bursts have {shortest} to {longest} samples a channel; ")?;
            writeln!(out, "a design takes one length, the others are `design_mismatch`")?;
        }
        if made.cells_missing > 0 {
            write!(out, "  {} cells have no value: ", thousands(made.cells_missing as u64))?;
            let advice = match self.args.period_s {
                None => "; --resample interpolates",
                Some(_) => "",
            };
            writeln!(out, "signals with one are rejected (`non_finite`){advice}")?;
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
            writeln!(
                out,
                "  {n} bursts begin where an earlier one of their printhead has not ended: put after it"
            )?;
        }
        Ok(())
    }
}
