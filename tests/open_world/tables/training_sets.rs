//! A threshold is learned from one training set: how often is the rate that it realises above the
//! rate that is stated?

use super::{STATED, Shown};
use crate::open_world::chance::Rate;
use crate::open_world::lab::{Lab, Library, Mode, Program, Refusal, Signals};
use crate::open_world::plant::Plant;
use crate::open_world::recording::Rows;
use crate::open_world::scatter::Scatter;

pub struct Plan {
    pub seed: u64,
    pub sets: usize,
    /// Healthy signals that every set is judged on.
    pub fresh: usize,
    pub scatter: Scatter,
}

pub struct Realised {
    pub scatter: Scatter,
    pub rates: Vec<Rate>,
}

impl Realised {
    pub fn exceeding(&self) -> Rate {
        let count = self.rates.iter().filter(|rate| rate.share() > STATED).count();
        Rate { count, of: self.rates.len() }
    }
}

pub fn measure(program: &Program, plan: &Plan) -> Result<Realised, Refusal> {
    let lab = Lab::new(program);
    let plant = Plant::thesis_form();
    let library = Library { scatter: plan.scatter, per_class: 0, ..Library::THESIS };
    let fresh = Signals::of(&Library { healthy: plan.fresh, ..library }, &plant, plan.seed);
    lab.write("fresh", Rows::USUAL, &plant, fresh.samples);
    let rates = (1..=plan.sets as u64).map(|set| {
        lab.train(&library, &plant, plan.seed + set)?;
        let judged = lab.judge_known("fresh", Mode::Design, "", &fresh.states)?;
        let count = judged.iter().filter(|(verdict, _)| verdict.is_flagged()).count();
        Ok(Rate { count, of: judged.len() })
    });
    Ok(Realised { scatter: plan.scatter, rates: rates.collect::<Result<_, Refusal>>()? })
}

/// Against the goal: at most a tenth of the sets.
pub fn missed(realised: &[Realised]) -> Vec<String> {
    let what = |one: &Realised| format!("{}: above the stated rate", one.scatter);
    realised.iter().filter_map(|one| one.exceeding().beyond(0.1, &what(one))).collect()
}

pub fn show(realised: &[Realised]) -> Shown {
    let title = format!(
        "Training sets of 2475 healthy signals: realised rate of false alarms, stated {STATED}"
    );
    let head = "scatter | sets | mean | median | largest | share above the stated rate";
    Shown::of(title, head, realised, |one| {
        let mut shares: Vec<f64> = one.rates.iter().map(|rate| rate.share()).collect();
        shares.sort_by(f64::total_cmp);
        let mean = shares.iter().sum::<f64>() / shares.len() as f64;
        vec![
            one.scatter.to_string(),
            shares.len().to_string(),
            format!("{mean:.1e}"),
            format!("{:.1e}", shares[shares.len() / 2]),
            format!("{:.1e}", shares[shares.len() - 1]),
            one.exceeding().to_string(),
        ]
    })
}
