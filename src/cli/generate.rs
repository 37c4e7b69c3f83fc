//! `inkling generate`: man pages and shell completions, from the command line itself.

use super::exit::{Exit, Failure};
use crate::io::outputs;
use clap::Command;
use clap_complete::Shell;
use std::io::Write;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling generate man -o man/
  inkling generate completions bash > /etc/bash_completion.d/inkling")]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, clap::Subcommand)]
enum What {
    /// inkling.1 and one page per verb
    Man {
        /// Where they go
        #[arg(short, long, value_name = "DIR")]
        output: PathBuf,
    },
    /// Of a shell, to stdout
    Completions { shell: Shell },
}

pub fn run(args: Args, command: Command) -> Result<Exit, Failure> {
    match args.what {
        What::Man { output } => man(&output, command),
        What::Completions { shell } => {
            let mut script = Vec::new(); // the generator panics where stdout is closed
            let mut command = command;
            clap_complete::generate(shell, &mut command, "inkling", &mut script);
            std::io::stdout().lock().write_all(&script)?;
            Ok(Exit::Done)
        }
    }
}

fn man(dir: &Path, command: Command) -> Result<Exit, Failure> {
    outputs::check_directory(dir).map_err(Failure::of_place)?;
    let failed = |e: std::io::Error| Failure::new(format!("{}: {e}", dir.display()));
    std::fs::create_dir_all(dir).map_err(failed)?;
    clap_mangen::generate_to(command, dir).map_err(failed)?;
    Ok(Exit::Done)
}
