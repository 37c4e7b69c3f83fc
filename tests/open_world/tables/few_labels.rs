//! What a stated certainty is worth where a class was learned from a handful of signals.

use super::Shown;
use crate::open_world::chance::Rate;
use crate::open_world::lab::{Lab, Library, Mode, Program, Refusal, Signals};
use crate::open_world::plant::Plant;
use crate::open_world::recording::{HEALTHY, Rows};

pub struct Plan {
    pub seed: u64,
    /// Training sets of each kind.
    pub sets: usize,
    pub labels: Vec<usize>,
}

#[derive(Clone, Copy, Debug)]
pub enum Names {
    /// The thesis's.
    Known,
    /// A user's own: `K1` and so on.
    Own,
}

pub struct Row {
    pub labels: usize,
    pub names: Names,
    /// Of those named with certainty.
    pub right: Rate,
    /// Named with certainty, of all flagged.
    pub certain: Rate,
    pub foreign: Rate,
}

pub fn measure(program: &Program, plan: &Plan) -> Result<Vec<Row>, Refusal> {
    let mut rows = Vec::new();
    for names in [Names::Known, Names::Own] {
        let plant = named(names);
        for &labels in &plan.labels {
            let mut row = Row {
                labels,
                names,
                right: Rate::default(),
                certain: Rate::default(),
                foreign: Rate::default(),
            };
            for set in 0..plan.sets as u64 {
                add_set(program, &plant, plan.seed + 10 * set, &mut row)?;
            }
            rows.push(row);
        }
    }
    Ok(rows)
}

fn named(names: Names) -> Plant {
    let plant = Plant::thesis_form();
    match names {
        Names::Known => plant,
        Names::Own => {
            let own = (1..).map(|i| format!("K{i}"));
            Plant { faults: own.zip(plant.faults.into_values()).collect(), ..plant }
        }
    }
}

fn add_set(program: &Program, plant: &Plant, seed: u64, row: &mut Row) -> Result<(), Refusal> {
    let lab = Lab::new(program);
    let library = Library { per_class: row.labels, ..Library::THESIS };
    lab.train(&library, plant, seed)?;
    // faulty signals alone, but for a few
    let unseen = Library { healthy: 100, per_class: 100, ..Library::THESIS };
    let test = Signals::of(&unseen, plant, seed + 1);
    lab.write("test", Rows::USUAL, plant, test.samples);
    for (verdict, state) in lab.judge_known("test", Mode::Design, "", &test.states)? {
        if state == HEALTHY || !verdict.is_flagged() {
            continue;
        }
        row.foreign.add(verdict.is_foreign());
        row.certain.add(verdict.certain_class().is_some());
        if let Some(class) = verdict.certain_class() {
            row.right.add(class == state);
        }
    }
    Ok(())
}

/// Against the goal: right in 95 %. With ten labels something must still be said.
pub fn missed(rows: &[Row]) -> Vec<String> {
    let mut missed = Vec::new();
    for row in rows {
        let at = format!("{} labels, {:?} names", row.labels, row.names);
        missed.extend(row.right.below(0.95, &format!("{at}: right")));
        if row.labels >= 10 && row.certain.share() < 0.2 {
            missed.push(format!("{at}: certain of {}", row.certain));
        }
    }
    missed
}

pub fn show(rows: &[Row]) -> Shown {
    let head = "labels per class | names | certain right | certain of flagged | unknown";
    Shown::of("Few labels: of flagged signals of known classes", head, rows, |row| {
        vec![
            row.labels.to_string(),
            format!("{:?}", row.names),
            row.right.to_string(),
            format!("{:.3}", row.certain.share()),
            row.foreign.to_string(),
        ]
    })
}
