//! All that `inkling thesis` found. In: data sets over rounds. Out: [`Chapter`], also as JSON.

use super::conclusions::{Conclusion, conclusions};
use super::outcome::{DataSet, Measured};
use serde::Serialize;
use serde_json::{Value, json};

/// The rounds that figures are measured in; a [`Measured`] keeps those of each.
#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Rounds {
    Seeds(Vec<u64>),
    /// The labelled channels in `number` parts, each of which is tested once by what was learned on the others.
    /// `left_out`: in sentences, the classes and signals that were not used.
    Folds {
        number: usize,
        left_out: Vec<String>,
    },
}

/// Chapter 4 over all rounds, and what that says of the conclusions of chapter 5 and of this project's claims.
#[derive(Clone, Debug)]
pub struct Chapter {
    pub rounds: Rounds,
    pub sets: Vec<Measured>,
    pub conclusions: Vec<Conclusion>,
}

impl Chapter {
    pub fn new(rounds: Rounds, sets: Vec<Measured>) -> Chapter {
        let conclusions = sets.iter().flat_map(conclusions).collect();
        Chapter { rounds, sets, conclusions }
    }

    pub fn set(&self, set: DataSet) -> Option<&Measured> {
        self.sets.iter().find(|measured| measured.set == set)
    }

    /// The contents of `tables.json`.
    pub fn json(&self) -> Value {
        let sets: Vec<Value> = self.sets.iter().map(Measured::json).collect();
        json!({"version": 2, "rounds": self.rounds, "sets": sets, "conclusions": self.conclusions})
    }
}
