//! A run whose recordings have not had their turn yet. If it fails before they have, `run.json` is of this run all
//! the same: otherwise page and mail would go on as if it had never been.
//!
//! In: what is known of the run so far, from `replay`. Out: `run.json`, in which nothing was reached. It is only
//! written where earlier runs left results, or this one holds the lock: a mistake in the first command line leaves
//! nothing behind.

use super::args::Args;
use super::settings;
use crate::cli::account::{Account, End, RUN_NAME, Row};
use crate::cli::exit::Failure;
use inkling_io::job::Job;
use inkling_io::journal::{JOURNAL_NAME, Means, Outcome};
use inkling_io::outputs::{self, ResultFile};
use inkling_io::run_lock::RunLock;
use inkling_io::stored;
use std::path::PathBuf;

pub struct Begun {
    /// `None`: the recordings have their turn, and whoever judges them accounts for the run.
    pub account: Option<Account>,
    /// The recordings, once they were found.
    pub jobs: Vec<Job>,
    pub lock: Option<RunLock>,
    /// The directory of results. `None`: nothing is to be written, or the settings do not say where.
    out: Option<PathBuf>,
    /// What the user named.
    named: Vec<String>,
}

impl Begun {
    pub fn by(args: &Args) -> Begun {
        let asked = settings::settings_of(args).ok().filter(|_| !args.dry_run);
        let (out, named) =
            asked.map(|of| (PathBuf::from(of.output.dir), of.input.recordings)).unzip();
        Begun {
            account: Some(Account::new(args.strict)),
            jobs: Vec::new(),
            lock: None,
            out,
            named: named.unwrap_or_default(),
        }
    }

    /// Writes the account of a run that failed. That it cannot be written is the lesser failure, and is not told.
    pub fn note(mut self, failure: &Failure) {
        let (Some(mut account), Some(out)) = (self.account.take(), self.out) else { return };
        let run = out.join(RUN_NAME);
        let is_ours = outputs::check_file(&run, ResultFile::Run).is_ok();
        let has_results = stored::is_file(&out.join(JOURNAL_NAME));
        let lock = match self.lock {
            None if has_results && is_ours => RunLock::take(&out).ok(),
            held => held,
        };
        let Some(lock) = lock.filter(|_| is_ours) else { return };
        let row = |recording: String| Row {
            recording,
            outcome: Outcome::NotReached,
            why: failure.message.clone(),
            ..Row::default()
        };
        account.rows = match self.jobs.is_empty() {
            true => self.named.into_iter().map(row).collect(),
            false => self.jobs.iter().map(|job| row(job.label())).collect(),
        };
        let _ = account.write(&out, &Means::default(), End::Broken, failure.exit);
        lock.over();
    }
}
