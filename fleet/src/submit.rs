//! `inkling-fleet submit`: what `inkling replay` does, with its recordings judged by a fleet.
use crate::driver::Patience;
use crate::fleet::Fleet;
use crate::security::{Scheduler, TlsArgs};
use inkling::cli::exit::{Exit, Failure};
use inkling::cli::replay;
use std::time::Duration;

#[derive(Debug, clap::Args)]
#[group(skip)]
#[command(
    after_help = "Executors must see recordings and --out under the same names as this command.
What `inkling replay` takes is taken, but for --threads and --pace, which executors decide on."
)]
pub struct Args {
    #[command(flatten)]
    replay: replay::Args,
    /// Where the scheduler listens
    #[arg(long, value_name = "HOST:PORT", help_heading = "Fleet")]
    scheduler: String,
    /// A job in which no recording is finished or read on for so long is submitted again
    #[arg(long, value_name = "SECONDS", default_value_t = 300, help_heading = "Fleet", value_parser = clap::value_parser!(u64).range(1..))]
    patience: u64,
    /// So long a scheduler that does not answer is waited for
    #[arg(long, value_name = "SECONDS", default_value_t = 60, help_heading = "Fleet", value_parser = clap::value_parser!(u64).range(1..))]
    wait: u64,
    #[command(flatten, next_help_heading = "Fleet")]
    tls: TlsArgs,
}

/// Runs `replay` with a fleet as the judge.
pub fn run(args: Args) -> Result<Exit, Failure> {
    let tls = args.tls.load().map_err(Failure::new)?;
    let scheduler = Scheduler::new(&args.scheduler, tls).map_err(Failure::usage)?;
    scheduler.endpoint().map_err(Failure::new)?; // a certificate that cannot be used is told now
    scheduler.warning().iter().for_each(|warning| eprintln!("{warning}"));
    let seconds = Duration::from_secs;
    let patience = Patience { job: seconds(args.patience), scheduler: seconds(args.wait) };
    replay::run_elsewhere(args.replay, &mut Fleet::new(scheduler, patience))
}
