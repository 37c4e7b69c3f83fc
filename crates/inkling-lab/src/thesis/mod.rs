//! Chapter 4 of the thesis again: its tables beside this program's.
//!
//! In: seeds (`simulated`), or a user's own labelled signals (`Recorded::chapter`). Out: a
//! `Chapter`, and from it (`write`) a directory with `tables.md`, `tables.json` and a picture of the mean
//! residuals.
//!
//! The steps, each a file here:
//! 1. `datasets` makes a `Part`, signals to learn from and to test on, for each seed or fold.
//! 2. `measure` trains every method of `methods` on the part and tests it; they are the product's own
//!    ([`inkling_core::design`]). `practice` is the baseline. The result is `Figures`.
//! 3. `outcome` gathers the figures of all rounds into a `Measured` for each data set.
//! 4. `published` compares with the thesis's numbers.
//! 5. `tables` writes the page; `mean_residuals` draws.

mod datasets;
mod mean_residuals;
mod measure;
mod methods;
mod outcome;
mod practice;
mod published;
mod tables;

use inkling_core::side_by_side::side_by_side;
use outcome::Figures;
use std::path::Path;

pub use datasets::Recorded;
pub use outcome::{Chapter, Confusion, DataSet, Measured, Rounds, Spread, ThesisError};

/// Names of the files that `write` makes. The first one tells that the others are of an earlier run.
pub const FILES: [&str; 3] = ["tables.json", "tables.md", "mean_residuals.svg"];

/// Runs every seed on each set of simulated data, at most `threads` at a time, with `done` after each.
pub fn simulated(
    seeds: &[u64],
    threads: usize,
    done: impl Fn() + Sync,
) -> Result<Chapter, ThesisError> {
    let jobs: Vec<(DataSet, u64)> = DataSet::SIMULATED
        .iter()
        .flat_map(|&set| seeds.iter().map(move |&seed| (set, seed)))
        .collect();
    let each =
        measured(threads, jobs, done, |(set, seed)| measure::figures(&datasets::part(set, seed)?))?;
    let sets = DataSet::SIMULATED.iter().zip(each.chunks(seeds.len().max(1)));
    let sets = sets.map(|(&set, each)| Measured::of(set, each)).collect();
    Ok(Chapter { rounds: Rounds::Seeds(seeds.to_vec()), sets })
}

/// The figures of all jobs in their order, at most `threads` at a time, with `done` after each; or the first
/// error.
fn measured<J: Send>(
    threads: usize,
    jobs: Vec<J>,
    done: impl Fn() + Sync,
    figures: impl Fn(J) -> Result<Figures, ThesisError> + Sync,
) -> Result<Vec<Figures>, ThesisError> {
    let each = side_by_side(threads, jobs, |job| figures(job).inspect(|_| done()));
    each.into_iter().collect()
}

impl Recorded {
    /// Tests on every part once, at most `threads` at a time, with `done` after each.
    pub fn chapter(&self, threads: usize, done: impl Fn() + Sync) -> Result<Chapter, ThesisError> {
        let each = measured(threads, self.parts.iter().collect(), done, measure::figures)?;
        let rounds = Rounds::Folds { number: each.len(), left_out: self.left_out.clone() };
        Ok(Chapter { rounds, sets: vec![Measured::of(DataSet::Recordings, &each)] })
    }
}

/// Writes `FILES` into `dir`, which is made if need be. `recorded`: the user's signals, if the chapter is
/// about them. The picture is of the first seed, or of the first part.
pub fn write(
    chapter: &Chapter,
    recorded: Option<&Recorded>,
    dir: &Path,
) -> Result<(), ThesisError> {
    let failed =
        |path: &Path, source| ThesisError::Write { path: path.display().to_string(), source };
    std::fs::create_dir_all(dir).map_err(|e| failed(dir, e))?;
    let picture = match (&chapter.rounds, recorded.and_then(|recorded| recorded.parts.first())) {
        (_, Some(part)) => mean_residuals::picture(part)?,
        (Rounds::Seeds(seeds), None) => {
            let seed = seeds.first().copied().unwrap_or(1);
            mean_residuals::picture(&datasets::part(DataSet::ThesisForm, seed)?)?
        }
        (Rounds::Folds { .. }, None) => String::new(),
    };
    let json = serde_json::to_string_pretty(&chapter.json()).unwrap_or_default();
    for (name, text) in FILES.into_iter().zip([json, tables::markdown(chapter), picture]) {
        let path = dir.join(name);
        std::fs::write(&path, text + "\n").map_err(|e| failed(&path, e))?;
    }
    Ok(())
}
