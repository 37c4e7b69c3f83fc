//! `inkling convert`: makes a recording of bursts from a table.
//!
//! In: a table (CSV, Parquet), and the options (`args`). Out: a recording, and what had to be
//! assumed. `input_bursts` reads the file and gives one decay per burst; `conversion` makes a burst of each; `burst_clock` gives each burst its time.

mod args;
mod burst_clock;
mod conversion;
mod input_bursts;

pub use args::Args;

use super::exit::{Exit, Failure};
use conversion::Conversion;
use inkling_io::outputs;
use inkling_io::recording_writer::{RecordingWriter, WriterOptions};
use input_bursts::InputBursts;
use serde_json::json;

/// Checks the options, then converts burst by burst. What was assumed is told at the end.
pub fn run(args: Args) -> Result<Exit, Failure> {
    let start_ns = args.start_ns()?;
    let values = args.values();
    args.check(&values)?;
    outputs::check_file(&args.out, outputs::ResultFile::Recording)?;
    let input = InputBursts::open(&args, &values.columns)?;
    let mut conversion = Conversion::new(&args, &values, &input, start_ns)?;
    let mut writer =
        RecordingWriter::create(&args.out, WriterOptions::default()).map_err(Failure::new)?;
    for decay in input.decays {
        let burst = conversion.burst(&decay)?;
        writer.write(&burst, burst.t_acq_ns as u64).map_err(Failure::new)?;
    }
    writer.finish().map_err(Failure::new)?;
    match args.json {
        true => super::output::event(&json!(conversion.made))?,
        false => conversion.tell(input.sampled.as_ref())?,
    }
    Ok(Exit::Done)
}
