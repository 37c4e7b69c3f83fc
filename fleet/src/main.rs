//! `inkling-fleet`: many machines judge recordings that they all see, each once; Apache DataFusion
//! Ballista hands them out. `docs/fleet.md` tells how, `fleet/README.md` why.
//!
//! ```text
//! submit   what `inkling replay` does, but for judging: plans, hands out, notes in the journal
//!   │  plan: which recordings           ▲  rows: what became of each
//!   ▼                                   │  (both under <out>/.fleet/, with the design and settings)
//! scheduler ◀── asks for recordings ── executors: the library's own replay
//! ```

mod chains;
mod client;
mod codec;
mod driver;
mod executor;
mod fleet;
mod node;
mod roots;
mod row;
mod run_dir;
mod scheduler;
mod security;
mod submit;
mod watchdog;
mod worker;

use clap::{Parser, Subcommand};
use inkling::cli::exit::{Exit, Failure};
use inkling::cli::{parsed, run_verb};
use std::future::Future;
use std::process::ExitCode;

/// Which of Ballista's own messages are shown, unless RUST_LOG asks for others. What becomes of a job is told
/// by its client; that a scheduler is gone matters only while an executor works, and then the work fails.
const TOLD: &str = "error,ballista_scheduler=off,ballista_executor::executor_process=off";

#[derive(Debug, Parser)]
#[command(
    name = "inkling-fleet",
    version,
    propagate_version = true,
    about = "Judges recordings on many machines that see the same files",
    after_help = "Examples:
  inkling-fleet scheduler
  inkling-fleet executor --scheduler 127.0.0.1:50050 --root /srv/printer
  inkling-fleet submit --scheduler 127.0.0.1:50050 archive/ --design design.json \\
      --out verdicts

Exit status of submit: that of `inkling replay`. 0 done; 1 failed; 2 wrong usage or settings; \
3 finished, but some input was newly found damaged or rejected, or one of several recordings failed; 4 finished, but of a \
printhead nothing, or of a recording less than half of the signals, could be judged."
)]
struct Cli {
    /// Tell only what fails
    #[arg(long, short, global = true)]
    quiet: bool,
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Hand out recordings to executors
    Scheduler(scheduler::Args),
    /// Judge recordings that a scheduler hands out
    Executor(executor::Args),
    /// `inkling replay`, judged by a fleet
    Submit(Box<submit::Args>),
}

fn main() -> ExitCode {
    let cli: Cli = match parsed(std::env::args_os()) {
        Ok(cli) => cli,
        Err(ended) => return ended.into(),
    };
    let told = env_logger::Env::default().default_filter_or(TOLD);
    env_logger::Builder::from_env(told).init();
    run_verb(cli.quiet, || match cli.verb {
        Verb::Scheduler(args) => serve(scheduler::run(args)),
        Verb::Executor(args) => serve(executor::run(args)),
        Verb::Submit(args) => submit::run(*args),
    })
    .into()
}

/// Runs a service until it ends, on threads of its own.
fn serve(service: impl Future<Output = Result<Exit, Failure>>) -> Result<Exit, Failure> {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()
        .map_err(|e| Failure::new(format!("no threads: {e}")))?;
    let ended = runtime.block_on(service);
    // a recording that is still at work has been given to somebody else
    runtime.shutdown_timeout(std::time::Duration::from_secs(1));
    ended
}

/// Returns at Ctrl-C, or when the process is asked to terminate.
async fn asked_to_end() {
    use tokio::signal::unix::{SignalKind, signal};
    match signal(SignalKind::terminate()) {
        Ok(mut terminate) => tokio::select! {
            _ = tokio::signal::ctrl_c() => {}
            _ = terminate.recv() => {}
        },
        Err(_) => drop(tokio::signal::ctrl_c().await),
    }
}
