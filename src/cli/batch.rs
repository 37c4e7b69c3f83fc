//! Takes the recordings of a run in their order: each one is skipped, refused or judged. A recording that fails
//! does not stop the others, unless nothing more can be written.
//!
//! In: the planned recordings (`plan`) and a `Judge`, from `replay`. Out: the exit status. What becomes true on
//! disk, and in which order, is the `ledger`'s; what people are told is the `teller`'s.

use super::account::{End, Row};
use super::exit::{Exit, Failure};
use super::judge::{Judge, Judged, NotJudged, Run};
use super::ledger::{Ledger, Stop};
use super::teller::Teller;
use crate::pipeline::PipelineError;
use inkling_io::job::{Decision, Job, JudgeReason};
use inkling_io::journal::{Entry, Outcome};
use inkling_io::printable;

const MOST_OF_AN_ERROR: usize = 2000;

/// A run over planned recordings, and what it needs.
pub struct Batch<'a> {
    pub judge: &'a mut dyn Judge,
    pub run: Run<'a>,
    pub ledger: Ledger<'a>,
    pub teller: Teller<'a>,
}

impl Batch<'_> {
    /// Judges the planned recordings in this order, then closes the account of the run. Returns the exit status; a
    /// failure if the run was stopped or nothing could be judged.
    pub fn run(mut self, jobs: &[Job]) -> Result<Exit, Failure> {
        let lost = self.teller.account.rows.len();
        let stopped = self.all(jobs).err();
        if let Some(Stop { failure, .. }) = &stopped {
            let why = printable::line(&failure.message, MOST_OF_AN_ERROR);
            let rows = &mut self.teller.account.rows;
            let left = &jobs[rows.len() - lost..];
            let entry = |job: &Job| job.without_verdicts(self.run.means, Outcome::NotReached, &why);
            rows.extend(left.iter().map(|job| Row::of(job, &entry(job))));
        }
        self.teller.close(&self.run, stopped)
    }

    /// Hands all recordings that are to be judged to the judge, then takes the planned ones in turn. The error is
    /// why the run stops before the last.
    fn all(&mut self, jobs: &[Job]) -> Result<(), Stop> {
        self.teller.lost()?;
        let to_judge: Vec<Job> = jobs.iter().filter(|job| job.is_to_be_judged()).cloned().collect();
        // a judge may write any of the results from now on: those of what has changed since look current no longer
        let changed =
            |job: &&Job| matches!(job.decision, Decision::Judge(JudgeReason::RecordingChanged));
        to_judge.iter().filter(changed).for_each(|job| self.set_aside(job));
        // a failure to begin stops the run only at the first recording that is to be judged, so
        // that those before it are still told as skipped
        let mut begun = self.judge.begin(&self.run, &to_judge);
        let mut nth = 0; // number of recordings handed to the judge so far
        for job in jobs {
            match &job.decision {
                Decision::Finished { entry, moved } => self.skip(job, entry, *moved)?,
                Decision::Refuse(why) => self.fail(job, why, false, Failure::new(why))?,
                Decision::Judge(_) => {
                    std::mem::replace(&mut begun, Ok(()))?;
                    self.judge(job, nth)?;
                    nth += 1;
                }
            }
        }
        Ok(())
    }

    /// Leaves a recording as it is with which an earlier run was done. `moved`: what the journal says of its place is out of date.
    fn skip(&mut self, job: &Job, entry: &Entry, moved: bool) -> Result<(), Stop> {
        if moved {
            self.ledger.note_moved(job, entry)?;
        }
        self.teller.entered(job, entry)?;
        if entry.outcome.is_judged() { self.teller.annotate(job) } else { Ok(()) }
    }

    /// Judges one recording, and keeps what came of it. `nth`: index among the recordings that are to be judged.
    fn judge(&mut self, job: &Job, nth: usize) -> Result<(), Stop> {
        self.run.replay.begin_recording(job.source.starts_at_ns);
        match self.judge.judge(&self.run, nth, job) {
            Ok(judged) => self.keep(job, judged),
            Err(NotJudged::Failed { why, usage, by_content }) => {
                // what earlier runs wrote of it no longer belongs to what the journal says
                self.set_aside(job);
                if !by_content {
                    self.ledger.wait_for(job);
                }
                let failure = if usage { Failure::usage(&why) } else { Failure::new(&why) };
                self.fail(job, &why, by_content, failure)
            }
            Err(NotJudged::NoRoom(what)) => Err(Stop::no_room(&what, self.run.out)),
            Err(NotJudged::Broken(what)) => Err(Failure::new(what).into()),
            Err(NotJudged::Interrupted) => {
                Err(Stop { end: End::Interrupted, failure: PipelineError::Interrupted.into() })
            }
        }
    }

    fn keep(&mut self, job: &Job, mut judged: Judged) -> Result<(), Stop> {
        let replaced = self.ledger.commit(job, &mut judged)?;
        // what the journal calls finished has its row and is told, whatever became of the state
        self.teller.judged(job, &judged)?;
        replaced?;
        if judged.baselines.is_some() {
            self.run.replay.baselines = judged.baselines;
        }
        self.teller.annotate(job)
    }

    /// Notes a recording that failed or is refused. If it is the only one of the run, the run fails with it.
    fn fail(
        &mut self,
        job: &Job,
        why: &str,
        by_content: bool,
        failure: Failure,
    ) -> Result<(), Stop> {
        let why = printable::line(why, MOST_OF_AN_ERROR);
        let entry = self.ledger.note_failure(job, &why, by_content)?;
        self.teller.entered(job, &entry)?;
        if self.teller.is_alone {
            return Err(Stop { end: End::Finished, failure });
        }
        if !self.teller.account.rows.last().is_some_and(|row| row.acknowledged) {
            self.teller.complain(&why);
        }
        Ok(())
    }

    fn set_aside(&self, job: &Job) {
        self.ledger.set_aside(job).iter().for_each(|stays| self.teller.fail(stays));
    }
}
