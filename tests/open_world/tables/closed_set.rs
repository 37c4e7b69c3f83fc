//! The known classes alone: misses, false alarms, isolation, and how often a known class is said to
//! be unknown; on the thesis form, and wherever something about all signals is different.

use super::difference::Allowance;
use super::{STATED, Shown};
use crate::open_world::chance::Rate;
use crate::open_world::lab::{Lab, Library, Mode, Program, Refusal, Signals};
use crate::open_world::plant::Plant;
use crate::open_world::recording::{HEALTHY, Rows};
use std::collections::BTreeMap;

const FAULTY_OF_SET: f64 = 2025.0;

pub struct Plan {
    pub seed: u64,
    /// Training and test sets of the thesis's size.
    pub sets: usize,
}

#[derive(Default)]
pub struct Row {
    pub what: String,
    /// Faulty signals called healthy.
    pub misses: Rate,
    pub false_alarms: Rate,
    /// Of all faulty signals, flagged or not, the best class is the true one.
    pub isolated: Rate,
    /// Of those named with certainty.
    pub certain_right: Rate,
    /// Named with certainty, of all faulty signals.
    pub certain: Rate,
    /// Faulty signals that end `unknown_fault` or `no_ring`, class by class.
    pub foreign: BTreeMap<String, Rate>,
    pub refusals: Vec<Refusal>,
}

impl Row {
    pub fn worst_foreign(&self) -> Option<(&String, Rate)> {
        let worst = self.foreign.iter().max_by(|a, b| a.1.share().total_cmp(&b.1.share()));
        worst.map(|(class, rate)| (class, *rate))
    }
}

pub fn measure(program: &Program, what: &str, plant: &Plant, plan: &Plan) -> Row {
    let mut row = Row { what: what.into(), ..Row::default() };
    for set in 0..plan.sets as u64 {
        if let Err(refusal) = add_set(program, plant, plan.seed + 10 * set, &mut row) {
            row.refusals.push(refusal);
        }
    }
    row
}

fn add_set(program: &Program, plant: &Plant, seed: u64, row: &mut Row) -> Result<(), Refusal> {
    let lab = Lab::new(program);
    lab.train(&Library::THESIS, plant, seed)?;
    let test = Signals::of(&Library::THESIS, plant, seed + 1);
    lab.write("test", Rows::USUAL, plant, test.samples);
    let ungated = "--set isolate.gate=false";
    for (verdict, state) in lab.judge_known("test", Mode::Design, ungated, &test.states)? {
        if state == HEALTHY {
            row.false_alarms.add(verdict.is_flagged());
            continue;
        }
        row.misses.add(!verdict.is_flagged());
        row.isolated.add(verdict.candidate.as_ref() == Some(state));
        row.foreign.entry(state.clone()).or_default().add(verdict.is_foreign());
        row.certain.add(verdict.certain_class().is_some());
        if let Some(class) = verdict.certain_class() {
            row.certain_right.add(class == state);
        }
    }
    Ok(())
}

/// Against the goals; the first row is the thesis form. Of no class may more than 1 % be unknown.
pub fn missed(rows: &[Row], allowed: impl Fn(&Row) -> Allowance) -> Vec<String> {
    let Some(same) = rows.first() else { return Vec::new() };
    let mut missed = Vec::new();
    for row in rows {
        let (what, allowed) = (&row.what, allowed(row));
        missed.extend(row.refusals.first().map(|said| format!("{what}: {said}")));
        if row.misses.of == 0 {
            continue;
        }
        let more = (row.misses.share() - same.misses.share()) * FAULTY_OF_SET;
        if more > allowed.misses_per_set {
            missed.push(format!("{what}: {more:.0} misses more"));
        }
        missed.extend(row.false_alarms.beyond(2.0 * STATED, &format!("{what}: false alarms")));
        let less = same.isolated.share() - row.isolated.share();
        if less > allowed.isolation {
            missed.push(format!("{what}: isolation {less:.3} less"));
        }
        let unknown = row.foreign.iter().filter(|(_, rate)| !rate.is_at_most(0.01));
        missed.extend(unknown.map(|(class, rate)| format!("{what}: {class} unknown {rate}")));
    }
    missed
}

/// Of the thesis form itself, against the figures of `docs/measured.md`.
pub fn missed_of_thesis_form(row: &Row) -> Vec<String> {
    let missed = [
        row.misses.beyond(25.0 / FAULTY_OF_SET, "misses"),
        row.false_alarms.beyond(1.5 / 2475.0, "false alarms"),
        row.isolated.below(0.91, "isolation"),
        row.certain_right.below(0.97, "certain and right"),
        row.certain.below(0.78, "certain"),
    ];
    missed.into_iter().flatten().map(|missed| format!("{}: {missed}", row.what)).collect()
}

pub fn show(title: &str, rows: &[Row]) -> Shown {
    let title =
        format!("Known classes, {title}: means per set of 2025 faulty and 2475 healthy signals");
    let head = "what | sets | misses | false alarms | isolation | certain right | certain of | \
                worst unknown | unknown | refused";
    Shown::of(title, head, rows, |row| {
        let sets = row.misses.of as f64 / FAULTY_OF_SET;
        let per_set = |rate: Rate| format!("{:.1}", rate.count as f64 / sets.max(1e-9));
        let (count, of) = row.foreign.values().fold((0, 0), |(c, n), r| (c + r.count, n + r.of));
        let worst = row.worst_foreign();
        vec![
            row.what.clone(),
            format!("{sets:.0}"),
            per_set(row.misses),
            per_set(row.false_alarms),
            format!("{:.3}", row.isolated.share()),
            format!("{:.3}", row.certain_right.share()),
            format!("{:.3}", row.certain.share()),
            worst.map_or(String::new(), |(class, rate)| format!("{class} {:.3}", rate.share())),
            format!("{:.4}", Rate { count, of }.share()),
            row.refusals.first().map_or(String::new(), |said| {
                let said = said.rsplit("inkling: ").next().unwrap_or(said);
                format!("{}: {}", row.refusals.len(), said.lines().last().unwrap_or_default())
            }),
        ]
    })
}
