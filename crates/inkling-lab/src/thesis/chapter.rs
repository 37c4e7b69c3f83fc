//! All that one run of `inkling thesis` found: a `Chapter`.
//!
//! In: the figures of each data set over its rounds (`Measured`), to which `Chapter::new` adds the
//! verdicts on the claims. Out: `tables.json`, which `write` puts beside `tables.md`.

use super::conclusions::{Conclusion, conclusions};
use super::outcome::{DataSet, Measured};
use serde::Serialize;
use serde_json::{Value, json};

/// What a round is in which figures are measured: a seed, or a part of recordings.
#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Rounds {
    Seeds(Vec<u64>),
    /// Recordings: the labelled channels in `number` parts, each of which is tested on once by what
    /// was learned on the others. `left_out`: in sentences, the classes and signals that were not
    /// used.
    Folds {
        number: usize,
        left_out: Vec<String>,
    },
}

/// Chapter 4 over all rounds, and what that says of the claims of chapter 5 and of this project.
#[derive(Clone, Debug)]
pub struct Chapter {
    pub rounds: Rounds,
    pub sets: Vec<Measured>,
    pub conclusions: Vec<Conclusion>,
}

impl Chapter {
    /// The chapter, with the verdicts on the claims that each data set can decide.
    pub fn new(rounds: Rounds, sets: Vec<Measured>) -> Chapter {
        let conclusions = sets.iter().flat_map(conclusions).collect();
        Chapter { rounds, sets, conclusions }
    }

    /// The figures of one data set; `None` if chapter 4 was not run on it.
    pub fn set(&self, set: DataSet) -> Option<&Measured> {
        self.sets.iter().find(|measured| measured.set == set)
    }

    /// The contents of `tables.json`.
    pub fn json(&self) -> Value {
        let sets: Vec<Value> = self.sets.iter().map(Measured::json).collect();
        json!({"version": 2, "rounds": self.rounds, "sets": sets, "conclusions": self.conclusions})
    }
}
