//! The command line, with one file per verb. Results go to stdout, messages and progress to stderr.
//!
//! In: the words of the command line, from `main` or, within another program, from `called`. Out:
//! the exit status ([`exit::Exit`]).
//!
//! ```text
//! verb       its files                                   what it shares with other verbs
//! replay     replay/ plan batch judge ledger teller      collected (check of dialects)
//!            account notes follow live annotate report
//! train      train                                       collected (signals by label)
//! identify   identify identified                         collected
//! critique   critique extended_design                    collected
//! thesis     thesis                                      collected
//! inspect    inspect contents topics                     collected (check of dialects)
//! report     report_page changes_since lost              results, copies (verdict tables)
//! score      score scored score_critiques                results, copies
//! convert    convert
//! simulate   simulate
//! night      night metrics                               replay, report_page, changes_since
//! acknowledge acknowledge                           (its table is read by replay and report)
//! generate   generate
//! several    effect (refuses --set without effect), exit, output, progress
//! ```

mod account;
mod acknowledge;
mod annotate;
mod batch;
pub mod called;
mod changes_since;
mod collected;
mod contents;
mod convert;
mod copies;
mod counts_file;
mod critique;
mod effect;
pub mod exit;
mod extended_design;
mod follow;
mod generate;
mod identified;
mod identify;
mod inspect;
pub mod judge;
mod ledger;
mod live;
mod lost;
mod metrics;
mod night;
mod notes;
mod output;
mod plan;
mod progress;
pub mod replay;
mod report;
mod report_page;
mod results;
mod score;
mod score_critiques;
mod scored;
mod simulate;
mod teller;
mod thesis;
mod topics;
mod train;

use crate::settings::removed_option;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Arg, Command, CommandFactory, Parser, Subcommand};
use exit::{Exit, Failure};
use progress::COMPLAINED;
use std::ffi::OsString;
use std::sync::atomic::Ordering;

// The `///` of `Cli` and `Verb` are help texts, and no comments.
#[derive(Debug, Parser)]
#[command(
    name = "inkling",
    version,
    propagate_version = true,
    about = "Tells from piezo ring-downs which ink channels are faulty, with what and how badly",
    after_help = "Examples:
  inkling replay                                  what ./pipeline.toml says
  inkling replay night.mcap --design design.json --out verdicts
  inkling replay logs/ --design design.json --identify windows
  inkling train library.mcap --labels labels.csv -o design.json
  inkling report verdicts/ -o report.html         what to clean, since when
  inkling night                                   both, and what changed: a line of cron
  inkling score verdicts/ --labels labels.csv
  inkling simulate scenario.toml -o run/

Exit status: 0 done; 1 failed; 2 wrong usage or settings; 3 finished, but some input was newly \
found damaged or rejected, or one of several recordings failed (and the output says what); 4 finished, but of a printhead \
nothing, or of a recording less than half of the signals, could be judged. Faults found are a result, not a failure. `inkling \
VERB --help` says more."
)]
struct Cli {
    /// Tell only what fails (where the result is a file)
    #[arg(long, short, global = true)]
    quiet: bool,
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Judge recordings: one verdict per channel and burst, to Parquet
    Replay(replay::Args),
    /// Learn a design from labelled recordings
    Train(train::Args),
    /// Grey-box identification alone, with what is and is not identifiable
    Identify(identify::Args),
    /// A table of time and outputs becomes a recording
    Convert(convert::Args),
    /// What the model gets wrong, why, the extended model, the gain
    Critique(critique::Args),
    /// Make recordings with known truth from a scenario
    Simulate(simulate::Args),
    /// Verdicts against labels: detection, isolation, calibration
    Score(score::Args),
    /// What is in a recording, and whether it is whole
    Inspect(inspect::Args),
    /// What to clean, since when, and how far to trust it: one page over any number of recordings
    Report(report_page::Args),
    /// The nightly job in one command, from pipeline.toml: replay with the state, page, what changed
    Night(night::Args),
    /// Say what is known of results: a damaged file, a replaced channel, a fault; it is no news any more
    Acknowledge(acknowledge::Args),
    /// The thesis's chapter 4 again: its tables beside ours, any seeds
    Thesis(thesis::Args),
    /// Man pages or shell completions, for packagers
    Generate(generate::Args),
}

/// Runs the command line `args`, and returns its exit status.
pub fn run(args: impl IntoIterator<Item = OsString>) -> Exit {
    match parsed::<Cli>(args) {
        Ok(cli) => run_verb(cli.quiet, || cli.verb.run()),
        Err(ended) => ended,
    }
}

impl Verb {
    /// Runs the verb with its options.
    fn run(self) -> Result<Exit, Failure> {
        // the others look at a control
        if matches!(
            self,
            Verb::Convert(_)
                | Verb::Score(_)
                | Verb::Acknowledge(_)
                | Verb::Thesis(_)
                | Verb::Generate(_)
        ) {
            progress::end_when_asked();
        }
        match self {
            Verb::Replay(args) => replay::run(args),
            Verb::Train(args) => train::run(args),
            Verb::Identify(args) => identify::run(args),
            Verb::Convert(args) => convert::run(args),
            Verb::Critique(args) => critique::run(args),
            Verb::Simulate(args) => simulate::run(args),
            Verb::Score(args) => score::run(args),
            Verb::Inspect(args) => inspect::run(args),
            Verb::Report(args) => report_page::run(args),
            Verb::Night(args) => night::run(args),
            Verb::Acknowledge(args) => acknowledge::run(args),
            Verb::Thesis(args) => thesis::run(args),
            Verb::Generate(args) => generate::run(args, Cli::command()),
        }
    }
}

/// Lets options take negative numbers as values: otherwise `-5` would be parsed as an option, and the option
/// before it could not say what is wrong with the number.
fn with_negative_numbers(command: Command) -> Command {
    let takes_one = |arg: &Arg| arg.get_action().takes_values() && !arg.is_positional();
    let command = command.mut_args(|arg| match takes_one(&arg) {
        true => arg.allow_negative_numbers(true),
        false => arg,
    });
    command.mut_subcommands(with_negative_numbers)
}

/// The error in one line if it is about an option that earlier versions had: what to use instead.
fn with_what_instead(e: clap::Error) -> clap::Error {
    let Some(ContextValue::String(option)) = e.get(ContextKind::InvalidArg) else { return e };
    match removed_option(option).filter(|_| e.kind() == ErrorKind::UnknownArgument) {
        Some(instead) => {
            let what = format!("{option} is no longer there: {instead}\n");
            clap::Error::raw(ErrorKind::UnknownArgument, what)
        }
        None => e,
    }
}

/// Parses a command line. The error is a message about wrong usage, or the help that was asked for.
fn parse<C: Parser>(
    args: impl IntoIterator<Item = impl Into<OsString> + Clone>,
) -> Result<C, clap::Error> {
    let command = with_negative_numbers(C::command());
    let parsed = command.try_get_matches_from(args);
    parsed.and_then(|mut of| C::from_arg_matches_mut(&mut of)).map_err(with_what_instead)
}

/// Parses a command line. The error is the exit status after help or a message about wrong usage has been
/// printed.
pub fn parsed<C: Parser>(args: impl IntoIterator<Item = OsString>) -> Result<C, Exit> {
    parse(args).map_err(|e| {
        let _ = e.print(); // nowhere left to complain if this fails
        if e.use_stderr() { Exit::Usage } else { Exit::Done }
    })
}

/// Runs a verb with what every command line of inkling needs around it: quiet output, file size
/// limits as errors, and a message about the failure. The fleet's command line (`fleet/`) runs its
/// verbs by it, too.
pub fn run_verb(quiet: bool, verb: impl FnOnce() -> Result<Exit, Failure>) -> Exit {
    if quiet {
        output::be_quiet();
    }
    exit::outlive_file_size_limits();
    match verb() {
        Ok(exit @ (Exit::Incomplete | Exit::NotJudged))
            if quiet && !COMPLAINED.load(Ordering::Relaxed) =>
        {
            progress::complain(
                "inkling: some of the input was damaged or could not be used; without --quiet the output says what",
            );
            exit
        }
        Ok(exit) => exit,
        // the reader of the output has gone away, which is no failure
        Err(Failure { exit: Exit::Done, .. }) => Exit::Done,
        Err(failure) => {
            progress::complain(&format!("inkling: {}", failure.message));
            failure.exit
        }
    }
}
