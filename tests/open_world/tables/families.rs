//! What is said of signals that belong to no class, family by family.

use super::{Shown, percent};
use crate::open_world::chance::Rate;
use crate::open_world::family::Family;
use crate::open_world::lab::{Lab, Library, Mode, Mutant, Program, Refusal, Signals};
use crate::open_world::plant::{Plant, random};
use crate::open_world::recording::Rows;
use crate::open_world::verdicts::{Outcome, Reason, Test, Verdict};
use std::collections::BTreeMap;

pub struct Plan {
    pub seed: u64,
    /// Signals of each family and level.
    pub signals: usize,
    /// Noise variances that no healthy ring explains.
    pub levels: Vec<f64>,
    pub modes: Vec<Mode>,
    /// Measures what is left without a part of the method.
    pub mutant: Option<Mutant>,
}

#[derive(Clone, Debug, Default)]
pub struct Tally {
    pub of: usize,
    pub healthy: usize,
    /// Named with certainty, by class.
    pub named: BTreeMap<String, usize>,
    /// Only a category is certain.
    pub categories: usize,
    pub uncertain: usize,
    pub unknown_fault: usize,
    pub no_ring: usize,
    pub rejected: usize,
    /// Where the table says which test it was.
    pub by_misfit: usize,
    pub misfits: Vec<f32>,
}

impl Tally {
    fn add(&mut self, verdict: &Verdict) {
        self.of += 1;
        self.by_misfit += usize::from(verdict.test == Some(Test::Misfit));
        self.misfits.extend(verdict.misfit);
        if let Some(class) = verdict.certain_class() {
            *self.named.entry(class.to_owned()).or_default() += 1;
            return;
        }
        if verdict.certain_category().is_some() {
            self.categories += 1;
            return;
        }
        *match (verdict.outcome, verdict.reason) {
            (Outcome::Healthy, _) => &mut self.healthy,
            (Outcome::Rejected, _) => &mut self.rejected,
            (_, Some(Reason::UnknownFault)) => &mut self.unknown_fault,
            (_, Some(Reason::NoRing)) => &mut self.no_ring,
            _ => &mut self.uncertain,
        } += 1;
    }

    fn median_misfit(&self) -> Option<f32> {
        let mut misfits = self.misfits.clone();
        misfits.sort_by(f32::total_cmp);
        misfits.get(misfits.len() / 2).copied()
    }

    pub fn called_healthy(&self) -> Rate {
        Rate { count: self.healthy, of: self.of }
    }

    /// A class or a category, with certainty.
    pub fn named(&self) -> Rate {
        Rate { count: self.named.values().sum::<usize>() + self.categories, of: self.of }
    }
}

pub struct Row {
    pub mode: Mode,
    pub family: Family,
    pub said: Tally,
}

impl Row {
    fn is_gross(&self) -> bool {
        matches!(self.family, Family::Disturbed(_, x) if x >= 1600.0)
    }

    /// What goes beyond chance against the goals: at most 2 % called healthy, of gross ones .5 %;
    /// at most 2 % named.
    fn missed(&self) -> Vec<String> {
        let most_healthy = if self.is_gross() { 0.005 } else { 0.02 };
        let at = format!("{}, {:?}", self.family, self.mode);
        let healthy = self.said.called_healthy();
        let mut missed =
            Vec::from_iter(healthy.beyond(most_healthy, &format!("{at}: called healthy")));
        missed.extend(self.said.named().beyond(0.02, &format!("{at}: named")));
        missed
    }
}

pub fn missed(rows: &[Row]) -> Vec<String> {
    rows.iter().flat_map(Row::missed).collect()
}

/// One recording: a window of healthy signals, then every family in turn.
pub fn measure(program: &Program, plant: &Plant, plan: &Plan) -> Result<Vec<Row>, Refusal> {
    let lab = Lab::new(program);
    lab.train(&Library::THESIS, plant, plan.seed)?;
    if let Some(mutant) = plan.mutant {
        lab.spoil(mutant);
    }

    let window = Library { healthy: 20 * Rows::USUAL.channels, per_class: 0, ..Library::THESIS };
    let mut signals = Signals::of(&window, plant, plan.seed + 1);
    let mut families = vec![None; signals.samples.len()];
    for (stream, family) in Family::all(&plan.levels).into_iter().enumerate() {
        let mut rng = random(plan.seed + 2, stream as u64);
        for y in (0..plan.signals).map_while(|_| family.signal(plant, &mut rng)) {
            signals.samples.push(y);
            families.push(Some(family));
        }
    }
    lab.write("foreign", Rows::USUAL, plant, signals.samples);

    let mut rows = Vec::new();
    for &mode in &plan.modes {
        // the first window alone: what comes after it is not healthy
        let judged = lab.judge_known("foreign", mode, "--set identify.every=0", &families)?;
        for of_family in judged.chunk_by(|(_, one), (_, next)| one == next) {
            let Some(family) = *of_family[0].1 else { continue };
            let mut said = Tally::default();
            of_family.iter().for_each(|(verdict, _)| said.add(verdict));
            rows.push(Row { mode, family, said });
        }
    }
    Ok(rows)
}

pub fn show(rows: &[Row], mode: Mode) -> Shown {
    let title = format!("Signals of no class, {mode:?}, % of each family (certain: at .8 or more)");
    let head = "family | signals | healthy | class | category | uncertain | unknown_fault | no_ring | \
                rejected | by misfit | median misfit | named";
    Shown::of(title, head, rows.iter().filter(|row| row.mode == mode), |row| {
        let said = &row.said;
        let share = |count: usize| percent(count as f64 / said.of as f64);
        let names: Vec<String> =
            said.named.iter().map(|(class, n)| format!("{class} {}", share(*n))).collect();
        vec![
            row.family.to_string(),
            said.of.to_string(),
            share(said.healthy),
            share(said.named.values().sum()),
            share(said.categories),
            share(said.uncertain),
            share(said.unknown_fault),
            share(said.no_ring),
            share(said.rejected),
            share(said.by_misfit),
            said.median_misfit().map_or("-".into(), |misfit| format!("{misfit:.2}")),
            names.join(" "),
        ]
    })
}
