//! `inkling convert`: makes a recording of bursts from tables.
//!
//! In: tables (CSV, Parquet), and the options (`args`). Out: a recording, and what had to be
//! assumed. `input_bursts` reads a file and gives one decay per burst; `conversion` makes a burst of each; `burst_clock` gives each burst its time.

mod args;
mod burst_clock;
mod conversion;
mod input_bursts;

pub use args::Args;

use super::exit::{Exit, Failure};
use conversion::Conversion;
use inkling_io::recording_writer::{RecordingWriter, WriterOptions};
use inkling_io::{outputs, table_order};
use input_bursts::InputBursts;
use serde_json::json;

/// Checks the options, then converts burst by burst. What was assumed is told at the end.
pub fn run(mut args: Args) -> Result<Exit, Failure> {
    args.by_number = table_order::in_order_of_numbers(&mut args.tables);
    let values = args.values()?;
    args.check(&values)?;
    outputs::check_file(&args.out, outputs::ResultFile::Recording)?;
    let mut conversion = Conversion::new(&args, &values)?;
    // nothing is written before the first table was read
    let mut writer = None;
    for table in &args.tables {
        let start_ns = args.start_ns(table)?;
        let input = InputBursts::open(table, &args, &values.columns)?;
        conversion.begin(table, &input, start_ns)?;
        let create = || RecordingWriter::create(&args.out, WriterOptions::default());
        let writer = match &mut writer {
            Some(writer) => writer,
            none => none.insert(create().map_err(Failure::new)?),
        };
        for decay in input.decays {
            let burst = conversion.burst(&decay)?;
            writer.write(&burst, burst.t_acq_ns as u64).map_err(Failure::new)?;
        }
    }
    if let Some(writer) = writer {
        writer.finish().map_err(Failure::new)?;
    }
    match args.json {
        true => super::output::event(&json!(conversion.made))?,
        false => conversion.tell()?,
    }
    Ok(Exit::Done)
}
