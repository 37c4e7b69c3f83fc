//! `inkling generate`: man pages and shell completions, made from the definition of the command
//! line. In: that definition, from `cli`. Out: a page per verb in a directory, or a script on
//! stdout; for packagers.

use super::exit::{Exit, Failure};
use clap::Command;
use clap_complete::Shell;
use clap_mangen::Man;
use inkling_io::outputs::{self, ResultFile};
use std::collections::BTreeMap;
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

/// Runs the verb. `command`: the definition of the whole command line.
pub fn run(args: Args, mut command: Command) -> Result<Exit, Failure> {
    match args.what {
        What::Man { output } => man(&output, command),
        What::Completions { shell } => {
            let mut script = Vec::new(); // the generator panics where stdout is closed
            clap_complete::generate(shell, &mut command, "inkling", &mut script);
            std::io::stdout().lock().write_all(&script)?;
            Ok(Exit::Done)
        }
    }
}

fn man(dir: &Path, command: Command) -> Result<Exit, Failure> {
    let failed = |e: std::io::Error| Failure::new(format!("{}: {e}", dir.display()));
    // `build` derives what is inherited, such as the names of subcommands; pages are rendered before any is
    // written
    let mut command = command.disable_help_subcommand(true);
    command.build();
    let mut pages = BTreeMap::new();
    add_pages(&command, &mut pages).map_err(failed)?;
    let files = pages.keys().map(|name| (name.as_str(), ResultFile::Manual));
    outputs::check_files(dir, files)?;
    std::fs::create_dir_all(dir).map_err(failed)?;
    let mut pages = pages.iter();
    pages.try_for_each(|(name, page)| std::fs::write(dir.join(name), page)).map_err(failed)?;
    Ok(Exit::Done)
}

/// Adds the pages of a command and of all its subcommands, by the names of their files.
fn add_pages(command: &Command, pages: &mut BTreeMap<String, String>) -> std::io::Result<()> {
    let verbs = command.get_subcommands().filter(|verb| !verb.is_hide_set());
    verbs.into_iter().try_for_each(|verb| add_pages(verb, pages))?;
    let man = Man::new(command.clone());
    let mut page = Vec::new();
    man.render(&mut page)?;
    pages.insert(man.get_filename(), with_examples(&String::from_utf8_lossy(&page)));
    Ok(())
}

/// Marks the lines of a page that begin with a space, which are examples, so that `man` does not
/// fill them to the width of the page. `page`: in roff, as it was rendered.
fn with_examples(page: &str) -> String {
    let mut text = String::new();
    // `.nf` begins unfilled text and `.fi` ends it
    let mut is_example = false;
    for line in page.replace(".SH EXTRA\nExamples:\n", ".SH EXAMPLES\n").lines() {
        let begins = line.starts_with(' ');
        text += match (is_example, begins) {
            (false, true) => ".nf\n",
            (true, false) => ".fi\n",
            _ => "",
        };
        is_example = begins;
        text += line;
        text.push('\n');
    }
    text
}
