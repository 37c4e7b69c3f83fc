//! `inkling replay`: judges recordings. This file turns options and settings into a plan and the means of
//! judging; `batch` does the work.
//!
//! In: the options of the command line (`args`), the settings, the design, labels and baselines that
//! they name (`settings`), and the journal of earlier runs in the directory of results. Out: the
//! exit status; `batch` writes the results.
//!
//! The order (`judged_by`): everything that can be wrong is checked; the lock is taken; the plan is
//! made (what is judged, what is skipped); what killed runs left is removed; the recordings are
//! judged. So a mistake is told before anything is written. `--dry-run` ends after the plan.

mod args;
mod begun;
mod settings;

pub use args::{Args, PRESETS};
pub use settings::{judging, settings_of};

use super::account::{Account, RUN_NAME, Row, UnreadFile};
use super::acknowledge;
use super::batch::Batch;
use super::collected::checked_dialects;
use super::exit::{Exit, Failure};
use super::follow::{self, FollowJudge};
use super::judge::{Detail, Judge, ReplayJudge, Run};
use super::ledger::Ledger;
use super::live;
use super::plan::{self, Chained, Planner};
use super::progress::{Progress, interruptible};
use super::report::printable_path;
use super::report_page::ACCOUNT_NAME;
use super::teller::Teller;
use crate::pipeline::resume::Resume;
use crate::settings::Settings;
use begun::Begun;
use inkling_core::state::Memory;
use inkling_io::baseline_file::BaselineFile;
use inkling_io::dialect::Dialects;
use inkling_io::file_error::FileError;
use inkling_io::inputs::{self, Input};
use inkling_io::job::{self, Job};
use inkling_io::journal::{JOURNAL_NAME, Journal, JournalWriter};
use inkling_io::outputs::{self, ResultFile};
use inkling_io::run_lock::{LOCK_NAME, RunLock, ToJudge};
use inkling_io::unread_file;
use std::path::{Path, PathBuf};

/// Judges recordings in this process: the verb `replay` of the command line.
pub fn run(args: Args) -> Result<Exit, Failure> {
    judged_by(args, None)
}

/// Has recordings judged by other processes that see the same files: the fleet (`fleet/`) calls
/// this with a `judge` that hands recordings out. Those processes decide on their own pace and
/// threads, so `--pace` and `--threads` are refused here, and so is `--follow`.
pub fn run_elsewhere(args: Args, judge: &mut dyn Judge) -> Result<Exit, Failure> {
    let why = "has no effect here: whoever judges the recordings decides on it";
    match (&args.threads, &args.pace, args.follow) {
        (Some(_), ..) => Err(Failure::usage(format!("--threads: {why}"))),
        (_, Some(_), _) => Err(Failure::usage(format!("--pace: {why}"))),
        (.., true) => Err(Failure::usage("--follow: whoever writes the recording is not here")),
        _ => judged_by(args, Some(judge)),
    }
}

/// The whole run. One that fails before its recordings have their turn is accounted for, too.
fn judged_by(args: Args, elsewhere: Option<&mut dyn Judge>) -> Result<Exit, Failure> {
    let mut begun = Begun::by(&args);
    let ended = checked_and_judged(args, elsewhere, &mut begun);
    if let Err(failure) = &ended {
        begun.note(failure);
    }
    ended
}

/// Checks everything, plans, and judges. Mistakes in options and settings are found before
/// anything is written. `elsewhere`: who judges the recordings; `None`: this process does.
fn checked_and_judged(
    args: Args,
    elsewhere: Option<&mut dyn Judge>,
    begun: &mut Begun,
) -> Result<Exit, Failure> {
    // 1. all that may be wrong is looked at first
    let (settings, design) = settings::with_design(&args)?;
    let out = PathBuf::from(&settings.output.dir);
    if args.follow {
        follow::check(&settings, args.dry_run)?;
    }
    let serve = live::check(args.serve.as_deref(), args.serve_token.as_deref(), args.follow)?;
    let NamedRecordings { jobs, lost, unread, dialects } =
        named_recordings(&args, &settings, &out)?;
    begun.jobs.clone_from(&jobs);
    let (mut replay, mut baseline_file, means) = settings::load(settings, design, &args)?;

    let acknowledged = acknowledge::read(&out);
    replay.replaced.clone_from(&acknowledged.replaced);

    // 2. the lock, which keeps other runs from the same directory
    let control = if args.follow { follow::until_enough() } else { interruptible() };
    if !args.dry_run {
        begun.lock = Some(RunLock::take(&out)?);
    }
    // the journal is read again, since another run may have written to it before the lock was taken
    let journal = read_journal(&out)?;
    let planning = Progress::new(1, 0);
    if begun.lock.as_ref().is_some_and(|lock| lock.blind) {
        let out = out.display();
        planning.say(&format!("warning: {out}: no locks here: a second run would not be noticed"));
    }

    // 3. the plan: which recordings are to be judged, in which order
    let planner = Planner {
        // handed out to others, those of one printhead stay together
        printheads: elsewhere.is_some(),
        resume: Resume {
            out: &out,
            journal: &journal,
            means: &means,
            with_baselines: baseline_file.is_some(),
            force: args.force,
            verify: args.verify,
        },
        dialects: &dialects,
        progress: &planning,
        control: &control,
    };
    let jobs = planner.plan(jobs)?;
    let Chained { jobs, waits_for, latest, is_anew } = match &baseline_file {
        Some(file) => planner.chain(jobs, &file.digest())?,
        None => Chained { jobs, ..Chained::default() },
    };
    if args.dry_run {
        return plan::print(&jobs, &lost, args.json);
    }
    let other = baseline_file.as_ref().and_then(|file| file.of_another_design.as_ref());
    let begun_anew = other.map(|what| {
        let file = &replay.settings.input.baseline;
        format!("--baseline: {what}: that file is kept as {file}.stale, and all begins anew")
    });
    if let Some(file) = baseline_file.as_mut().filter(|_| is_anew || begun_anew.is_some()) {
        // a run that is killed from here on is gone on with as if somebody had removed the file
        file.begin_anew()?;
        replay.baselines = replay.baselines.map(|of| Memory::new(of.design));
    }

    // 4. what killed runs left is removed, and the journal opened
    let to_judge: Vec<&Job> = jobs.iter().filter(|job| job.is_to_be_judged()).collect();
    if let Some(lock) = &mut begun.lock {
        let noted = |job: &&Job| ToJudge { recording: job.label(), path: job.source.path.clone() };
        let noted: Vec<ToJudge> = to_judge.iter().map(noted).collect();
        lock.plan(&noted).map_err(FileError::unwritten(&out.join(LOCK_NAME)))?;
    }
    plan::sweep(&jobs, &out);
    baseline_file.iter().for_each(BaselineFile::sweep);
    let bytes = to_judge.iter().filter_map(|this| Some(this.source.stamp?.bytes));
    let progress = Progress::new(to_judge.len(), bytes.sum());
    let writer = JournalWriter::open(&out);
    let journal = writer.map_err(FileError::unwritten(&out.join(JOURNAL_NAME)))?;

    // 5. the judge, and the live view; then the batch judges everything
    let followed = &replay.settings.input.recordings[0]; // there is one, as `settings` checked
    let classes = replay.classes();
    let live = serve.map(|port| live::start(port, followed, classes, &control)).transpose()?;
    live.iter()
        .try_for_each(|live| follow::tell_address(live.port.address, args.json, &progress))?;
    let mut following = FollowJudge { json: args.json, live };
    // a single recording is reported in full, and no table over all recordings follows
    let is_alone = jobs.len() == 1 && lost.is_empty();
    // from here on the batch accounts for the run
    let mut account = begun.account.take().unwrap_or_else(|| Account::new(args.strict));
    (account.rows, account.unread, account.acknowledged) = (lost, unread, acknowledged);
    let batch = Batch {
        judge: match elsewhere {
            Some(judge) => judge,
            None if args.follow => &mut following,
            None => &mut ReplayJudge,
        },
        run: Run {
            out: &out,
            replay,
            means: &means,
            dialects: &dialects,
            detail: if is_alone { Detail::All } else { Detail::Line },
            force: args.force,
            progress: &progress,
            control: &control,
        },
        ledger: Ledger {
            out: &out,
            means: &means,
            journal,
            state: baseline_file,
            begun_anew,
            waits_for,
            latest,
        },
        teller: Teller {
            out: &out,
            progress: &progress,
            account,
            json: args.json,
            annotate: args.annotate,
            is_alone,
            tells_all: !args.is_told_by_others,
            failures: 0,
        },
    };
    let ended = batch.run(&jobs);
    begun.lock.take().into_iter().for_each(RunLock::over);
    ended
}

/// The recordings that the settings name.
struct NamedRecordings {
    /// Those that exist, and where their results lie.
    jobs: Vec<Job>,
    /// Rows of the account for names that lead to no recording: these do not stop the run.
    lost: Vec<Row>,
    /// What lies beside them and is not read, without what was judged before it was compressed.
    unread: Vec<UnreadFile>,
    /// How messages of other loggers become bursts, checked against the recordings.
    dialects: Dialects,
}

/// Finds the recordings, and checks where their results go (`out`).
fn named_recordings(
    args: &Args,
    settings: &Settings,
    out: &Path,
) -> Result<NamedRecordings, Failure> {
    let found = inputs::find_each_recording(&settings.input.recordings)?;
    outputs::check_place(out)?;
    let files = [ResultFile::Run, ResultFile::Journal, ResultFile::Account];
    for (name, kind) in [RUN_NAME, JOURNAL_NAME, ACCOUNT_NAME].into_iter().zip(files) {
        outputs::check_file(&out.join(name), kind)?;
    }
    // the journal says where earlier results lie, and which recordings need not be opened
    let journal = read_journal(out)?;
    let is_known = |input: &Input| !args.force && plan::is_known(input, &journal, settings);
    let dialects = checked_dialects(settings, &found.inputs, is_known)?;
    let jobs = plan::place(found.inputs, settings.output.layout, &journal, &dialects);
    job::refuse_shared(&jobs).map_err(Failure::usage)?;
    let lost = found.lost.iter().map(plan::lost).collect();
    let unread = found.unread.into_iter().filter(|(path, _)| !is_judged(path, &journal));
    let unread = unread
        .map(|(path, why)| UnreadFile { recording: printable_path(&path.to_string_lossy()), why });
    Ok(NamedRecordings { jobs, lost, unread: unread.collect(), dialects })
}

/// Whether what a compressed file holds was judged before it was compressed, or lies beside it as it was.
fn is_judged(compressed: &Path, journal: &Journal) -> bool {
    let name = compressed.file_name().unwrap_or_default().to_string_lossy();
    let plain = compressed.with_file_name(unread_file::decompressed(&name));
    let at = plain.parent().and_then(|dir| dir.canonicalize().ok());
    let source = at.zip(plain.file_name()).map(|(dir, name)| dir.join(name));
    let entry = source.and_then(|of| journal.of_recording(&of.to_string_lossy()).cloned());
    plain != compressed && plain.exists() || entry.is_some_and(|entry| entry.outcome.is_judged())
}

/// What earlier runs did in the directory of results.
fn read_journal(out: &Path) -> Result<Journal, Failure> {
    let path = out.join(JOURNAL_NAME);
    Journal::read(out).map_err(|e| Failure::new(format!("{}: cannot be read: {e}", path.display())))
}
