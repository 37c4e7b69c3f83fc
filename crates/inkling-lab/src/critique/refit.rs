//! Fits a model and its causes together by full likelihood, after a linear test has proposed a cause.
//!
//! In: a model, and causes with their sizes and shapes. Out: [`Refit`]: model and causes where -2 ln
//! likelihood is at rest, and the spaces of linear extensions about them.
//!
//! One round: (1) linearise about the present causes (`Model::settle`; with `scatter` also EM); (2) sum the
//! space; (3) take a joint Gauss-Newton step of the causes' sizes, where a cause with a shape is searched
//! anew near its old shape instead; (4) move the mean by what the old causes, which are taken out, and the
//! new ones, which are put in, ask for. A round that raises -2 ln likelihood is dropped, and
//! was the last.

use super::candidates::{Applied, Asked, ScoreTests, Scored, Setting};
use super::catalogue::{Acts, CauseId};
use super::matrices::means_of_groups;
use super::model::{Additions, Model};
use super::nuisance::{Both, Nuisance};
use super::space::{Direction, Space};
use inkling_core::model::free_decay::{ALL, Theta};

/// Largest number of rounds: of a rival, whose scatter is held, and of the model itself.
const ROUNDS_OF_RIVAL: usize = 5;
const MOST_ROUNDS: usize = 8;
/// The refit has settled when -2 ln likelihood changes by less than this, or by less than a share of itself.
const SETTLED: f64 = 1.0;
const RESTS: f64 = 2e-5;

/// Adds a cause to a model; with a sign of -1, takes it out.
pub fn apply(model: &mut Model, applied: &Applied, sign: f64, setting: Setting) {
    let each = || applied.directions.iter().zip(&applied.coefficients);
    each().for_each(|(direction, by)| direction.add_to(&mut model.added, sign * by));
    if let Some(which) = applied.id.follows() {
        let mut own = Additions::none(setting.data.samples);
        each().for_each(|(direction, by)| direction.add_to(&mut own, sign * by));
        give_up(model, which, own.beta[which], setting);
    }
}

/// Subtracts from the own parameters of channels and signals what a covariate adds to them from now on, so
/// that theta of every signal stays the same, and no phase is lost that a descent would not find again. `by`:
/// change of theta per unit of covariate `which`.
fn give_up(model: &mut Model, which: usize, mut by: Theta, Setting { data, .. }: Setting) {
    by[ALL - 1] = 0.0;
    let rows = data.rows.iter().zip(&data.beside.z);
    let means = means_of_groups(data.units, rows.map(|(row, z)| (row.unit, [z[which]].into())));
    let mean = |unit: usize| means[unit][0];
    model.units.iter_mut().enumerate().for_each(|(unit, own)| *own -= by * mean(unit));
    for ((own, row), z) in model.each.iter_mut().zip(&data.rows).zip(&data.beside.z) {
        *own -= by * (z[which] - mean(row.unit));
    }
}

pub struct Refit {
    pub model: Model,
    /// The causes in `model`, in the order in which they entered.
    pub causes: Vec<Applied>,
    pub spaces: Both<Space>,
}

impl Both<Space> {
    pub fn about(model: &Model, setting: Setting) -> Both<Space> {
        let [shapes, covariates] = Space::of(model, setting.data);
        Both { shapes, covariates }
    }

    /// What is allowed for beside these causes.
    pub fn nuisances(&self, causes: &[Applied]) -> Both<Nuisance<'_>> {
        let directions = causes.iter().flat_map(|c| c.directions.iter().cloned());
        let directions: Vec<Direction> = directions.collect();
        Both {
            shapes: Nuisance::new(&self.shapes, &directions),
            covariates: Nuisance::new(&self.covariates, &directions),
        }
    }
}

impl Refit {
    /// Whether nothing speaks against the cause that entered last, if it is a shape, after its refit.
    pub fn last_is_able(&self, setting: Setting) -> bool {
        self.causes.last().filter(|cause| cause.id.is_shape()).is_none_or(|_| {
            self.rescored(self.causes.len() - 1, setting).is_none_or(|scored| scored.able())
        })
    }

    /// Tests a cause again, all others in the nuisance, and its shape searched near the present one.
    pub fn rescored(&self, index: usize, setting: Setting) -> Option<Scored> {
        let own = &self.causes[index];
        let mut others = self.causes.clone();
        others.remove(index);
        // the spaces are those of the model with this cause
        let mut nuisances = self.spaces.nuisances(&others);
        take_out(&mut nuisances.shapes, own, 1.0);
        take_out(&mut nuisances.covariates, own, 1.0);
        let mut model = self.model.clone();
        if matches!(own.id.row().acts, Acts::PreviousRing) {
            model.added.tail_gain = 0.0;
        }
        ScoreTests::new(&model, setting, &nuisances)
            .score_one(Asked { id: own.id, near: Some(own) })
    }

    /// -2 ln likelihood, up to a constant, that one more linear step of the mean and the causes would reach,
    /// in the space that `of` is tested in.
    pub fn deviance(&self, of: CauseId) -> f64 {
        self.spaces.of(of).deviance - self.spaces.nuisances(&self.causes).of(of).gain()
    }
}

/// Changes the score as if a cause were not in the model; with a sign of -1, as if it were.
fn take_out(nuisance: &mut Nuisance, cause: &Applied, sign: f64) {
    let each = cause.directions.iter().zip(&cause.coefficients);
    each.for_each(|(direction, c)| nuisance.move_score(direction, sign * c));
}

/// Shifts the mean and all channels, to first order, to where they are most probable once the causes change
/// from `old` to `new`.
pub fn follow(model: &mut Model, spaces: &Both<Space>, old: &[Applied], new: &[Applied]) {
    let mut nuisance = Nuisance::new(&spaces.shapes, &[]);
    old.iter().for_each(|cause| take_out(&mut nuisance, cause, 1.0));
    new.iter().for_each(|cause| take_out(&mut nuisance, cause, -1.0));
    let step = nuisance.step();
    model.shift(&std::array::from_fn(|j| step[j]));
}

/// `causes`: those that are in the model already (`apply`). `rounds`: fewest rounds. `scatter`: whether noise
/// and scatter are estimated anew; of rivals, which are compared at the same ones, they are not.
pub fn refit(
    model: Model,
    causes: Vec<Applied>,
    setting: Setting,
    rounds: usize,
    scatter: bool,
) -> Refit {
    let settled_at = |mut model: Model, causes: Vec<Applied>| {
        match scatter {
            true => model.fit(setting.data, 1),
            false => model.settle(setting.data),
        }
        let spaces = Both::about(&model, setting);
        Refit { model, causes, spaces }
    };
    let mut best = settled_at(model, causes);
    let most = if scatter { MOST_ROUNDS } else { ROUNDS_OF_RIVAL };
    for round in 2..=most {
        let (model, causes) = stepped(&best, setting);
        let next = settled_at(model, causes);
        let gain = best.spaces.shapes.deviance - next.spaces.shapes.deviance;
        let rests = SETTLED.max(RESTS * best.spaces.shapes.deviance);
        if gain <= -SETTLED {
            break;
        }
        best = next;
        if round >= rounds && gain.abs() < rests {
            break;
        }
    }
    best
}

/// Takes a Gauss-Newton step of the causes and of the mean; not linearised anew yet.
fn stepped(now: &Refit, setting: Setting) -> (Model, Vec<Applied>) {
    let Refit { model, causes, spaces } = now;
    let steps = spaces.nuisances(causes).covariates.step();
    let mut next = causes.clone();
    // the causes' steps come after those of the mean's parameters
    let mut at = ALL;
    for (index, cause) in next.iter_mut().enumerate() {
        let q = cause.coefficients.len();
        let step = &steps.as_slice()[at..at + q];
        at += q;
        // a shape may depend on its size, so it is searched anew
        match cause.id.is_shape().then(|| now.rescored(index, setting)).flatten() {
            Some(anew) => *cause = anew.form,
            None => cause.coefficients.iter_mut().zip(step).for_each(|(c, s)| *c += s),
        }
    }
    let mut model = model.clone();
    follow(&mut model, spaces, causes, &next);
    for (old, new) in causes.iter().zip(&next) {
        apply(&mut model, old, -1.0, setting);
        apply(&mut model, new, 1.0, setting);
    }
    (model, next)
}

#[cfg(test)]
mod tests {
    use super::super::catalogue::CauseId;
    use super::super::generator::{Run, draw};
    use super::*;

    /// Strong misfits bend the baseline, too; wherever it goes, signals must not become less likely.
    #[test]
    fn a_refit_never_ends_with_signals_less_likely_than_at_its_start() {
        let effects = [
            (None, 0.0),
            (Some(CauseId::CubicStiffness), 0.1),
            (Some(CauseId::QuadraticDrag), 0.5),
        ];
        for (effect, size) in effects {
            let data = draw(&Run { channels: 12, bursts: 8, effect, size, ..Run::default() }, 32);
            let model = Model::fitted(&data, 2).unwrap();
            let setting = Setting { data: &data, avoid: &[] };
            for scatter in [false, true] {
                let mut start = model.clone();
                match scatter {
                    true => start.fit(&data, 1),
                    false => start.settle(&data),
                }
                let first = Both::about(&start, setting).shapes.deviance;
                let last = refit(model.clone(), Vec::new(), setting, 3, scatter);
                assert!(last.model.mean.iter().all(|v| v.is_finite()));
                let last = last.spaces.shapes.deviance;
                assert!(
                    last < first + MOST_ROUNDS as f64 * SETTLED,
                    "{effect:?}: {first} -> {last}"
                );
            }
        }
    }
}
