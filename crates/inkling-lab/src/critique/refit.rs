//! Fits a model and its causes together.
//!
//! In: a model, causes with their sizes. Out: [`Refit`]: both where -2 ln likelihood is at rest, and the
//! spaces of linear extensions about them ([`Spaces`], [`Nuisances`]).

use super::candidates::{Applied, ScoreTests, Scored, Setting};
use super::catalogue::{Acts, CauseId};
use super::covariates::{DRIVE, square_of};
use super::matrices::means_of_groups;
use super::model::{Additions, Model};
use super::nuisance::{Both, Nuisance};
use super::space::{Direction, Space};
use inkling_core::model::free_decay::{ALL, Theta};
use std::collections::BTreeSet;

/// Largest number of rounds of a refit (of a rival, with the scatter held; of the model itself), and the
/// change of -2 ln likelihood below which it has settled, absolute and relative.
const ROUNDS_OF_RIVAL: usize = 5;
const MOST_ROUNDS: usize = 8;
const SETTLED: f64 = 1.0;
const RESTS: f64 = 2e-5;
/// Share of a step below which the refit gives up.
const LEAST_STRIDE: f64 = 0.2;

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

/// Takes off the channels' and signals' own parameters what a covariate takes over, so that they ring where
/// they rang. A descent from elsewhere would not find a signal again that has drifted by a radian.
fn give_up(model: &mut Model, which: usize, mut by: Theta, Setting { data, .. }: Setting) {
    by[ALL - 1] = 0.0;
    // the covariate's mean over a channel's signals is taken off the channel, the rest off each signal
    let rows = data.rows.iter().zip(&data.beside.z);
    let means = means_of_groups(data.units, rows.map(|(row, z)| (row.unit, [z[which]].into())));
    let mean = |unit: usize| means[unit][0];
    model.units.iter_mut().enumerate().for_each(|(unit, own)| *own -= by * mean(unit));
    for ((own, row), z) in model.each.iter_mut().zip(&data.rows).zip(&data.beside.z) {
        *own -= by * (z[which] - mean(row.unit));
    }
}

/// A model with its causes after a refit.
pub struct Refit {
    pub model: Model,
    pub causes: Vec<Applied>,
    /// The spaces of linear extensions about the model.
    pub spaces: Both<Space>,
}

impl Both<Space> {
    /// The spaces about a model, with its channels treated in either way.
    pub fn about(model: &Model, setting: Setting) -> Both<Space> {
        let [shapes, covariates] = Space::of(model, setting.data);
        Both { shapes, covariates }
    }

    /// The nuisances of a model with these causes: the causes, and what their imperfect models leave.
    pub fn nuisances(&self, causes: &[Applied]) -> Both<Nuisance<'_>> {
        self.nuisances_beside(causes, causes)
    }

    /// The nuisances with some causes, and with what the models of all of them leave.
    fn nuisances_beside(&self, causes: &[Applied], all: &[Applied]) -> Both<Nuisance<'_>> {
        let mut directions: Vec<Direction> =
            causes.iter().flat_map(|c| c.directions.iter().cloned()).collect();
        directions.extend(squares(all, self.covariates.samples));
        let shapes = Nuisance::new(&self.shapes, &directions);
        directions.extend(amplitude(all, self.covariates.samples));
        Both { shapes, covariates: Nuisance::new(&self.covariates, &directions) }
    }
}

impl Refit {
    /// Whether nothing speaks against the cause that came last where the refit ended; causes other than
    /// shapes always pass.
    pub fn last_is_able(&self, setting: Setting) -> bool {
        self.causes.last().filter(|cause| cause.id.is_shape()).is_none_or(|_| {
            self.rescored(self.causes.len() - 1, setting).is_none_or(|scored| scored.able())
        })
    }

    /// Tests one cause again about the model that holds it, with all others in the nuisance. Its shape and
    /// strength are searched anew in the model as it is now.
    pub fn rescored(&self, index: usize, setting: Setting) -> Option<Scored> {
        let own = &self.causes[index];
        let mut others = self.causes.clone();
        others.remove(index);
        // the score as if this cause were not in the model
        let mut nuisances = self.spaces.nuisances_beside(&others, &self.causes);
        for (direction, c) in own.directions.iter().zip(&own.coefficients) {
            nuisances.shapes.move_score(direction, *c);
            nuisances.covariates.move_score(direction, *c);
        }
        let mut model = self.model.clone();
        if matches!(own.id.row().acts, Acts::PreviousRing) {
            model.added.tail_gain = 0.0;
        }
        ScoreTests::new(&model, setting, &nuisances).score_one(own.id, Some(own))
    }

    /// -2 ln likelihood after the best linear step, in the space in which a cause is compared with others.
    pub fn deviance(&self, of: CauseId) -> f64 {
        self.spaces.of(of).deviance - self.spaces.nuisances(&self.causes).of(of).gain()
    }
}

/// The square of time or temperature on every parameter, where a cause follows it: no cause is quite linear
/// in its covariate. These directions come after the causes' own.
fn squares(causes: &[Applied], samples: usize) -> Vec<Direction> {
    let followed: BTreeSet<usize> =
        causes.iter().filter_map(|cause| square_of(cause.id.follows()?)).collect();
    let each = |which| (0..ALL).map(move |j| Direction::parameter(samples, which, j));
    followed.into_iter().flat_map(each).collect()
}

/// The drive on every parameter, where a cause acts through the amplitude: it moves every parameter with the
/// drive, and not quite as its model says. What follows another covariate must do so beside this.
fn amplitude(causes: &[Applied], samples: usize) -> Vec<Direction> {
    match causes.iter().any(|c| c.id.by_amplitude()) {
        true => (0..ALL).map(|j| Direction::parameter(samples, DRIVE, j)).collect(),
        false => Vec::new(),
    }
}

/// Shifts all channels as they must when the causes change from `old` to `new`, and by a share (`stride`) of
/// what the data ask for anyway.
pub fn follow(
    model: &mut Model,
    spaces: &Both<Space>,
    old: &[Applied],
    new: &[Applied],
    stride: f64,
) {
    let mut nuisance = Nuisance::new(&spaces.shapes, &[]);
    let own = nuisance.mean_shift();
    for (causes, sign) in [(old, 1.0), (new, -1.0)] {
        for cause in causes {
            for (direction, c) in cause.directions.iter().zip(&cause.coefficients) {
                nuisance.move_score(direction, sign * c);
            }
        }
    }
    let all = nuisance.mean_shift();
    model.shift(&std::array::from_fn(|j| all[j] - (1.0 - stride) * own[j]));
}

/// Refits: Gauss-Newton over the causes' sizes and shapes, and EM over the scatter, in turn, until -2 ln
/// likelihood rests. A step that makes the signals less likely is taken back and halved.
///
/// `rounds`: fewest rounds. `scatter`: whether noise and scatter are estimated anew; rivals are compared at
/// the same scatter.
pub fn refit(
    model: Model,
    causes: Vec<Applied>,
    setting: Setting,
    rounds: usize,
    scatter: bool,
) -> Refit {
    // the model linearised anew about these causes, with its spaces
    let settled_at = |mut model: Model, causes: Vec<Applied>| {
        match scatter {
            true => model.fit(setting.data, 1),
            false => model.settle(setting.data),
        }
        let spaces = Both::about(&model, setting);
        Refit { model, causes, spaces }
    };
    let mut best = settled_at(model, causes);
    let mut stride = 1.0_f64;
    let most = if scatter { MOST_ROUNDS } else { ROUNDS_OF_RIVAL };
    for round in 2..=most {
        let (model, causes) = stepped(&best, setting, stride);
        let next = settled_at(model, causes);
        let gain = best.spaces.shapes.deviance - next.spaces.shapes.deviance;
        let rests = SETTLED.max(RESTS * best.spaces.shapes.deviance);
        if gain > -SETTLED {
            stride = (2.0 * stride).min(1.0);
            best = next;
        } else {
            stride *= 0.5;
        }
        if round >= rounds && gain.abs() < rests || stride < LEAST_STRIDE {
            break;
        }
    }
    best
}

/// A cause on its way from an old size and shape to new ones: what it adds to a signal lies between what both
/// add.
fn part_way(old: &Applied, new: Applied, stride: f64) -> Applied {
    let between = |old: f64, new: f64| old + stride * (new - old);
    let mut way = new.clone();
    (way.shape, way.damping) = (between(old.shape, new.shape), between(old.damping, new.damping));
    for (i, direction) in way.directions.iter_mut().enumerate() {
        let (from, to) = (old.coefficients[i], new.coefficients[i]);
        let coefficient = between(from, to);
        if stride == 1.0 || coefficient * to <= 0.0 {
            continue; // all the way; or through zero, where nothing is halfway
        }
        // the direction times the new coefficient is the mixture of what both add
        way.coefficients[i] = coefficient;
        for (block, before) in direction.0.iter_mut().zip(&old.directions[i].0) {
            for (new, old) in block.1.iter_mut().zip(&before.1) {
                *new = between(from * old, to * *new) / coefficient;
            }
        }
    }
    way
}

/// Takes a share (`stride`) of a Gauss-Newton step of the causes and of the mean.
fn stepped(now: &Refit, setting: Setting, stride: f64) -> (Model, Vec<Applied>) {
    let Refit { model, causes, spaces } = now;
    let (steps, _) = spaces.nuisances(causes).covariates.causes();
    let mut next = causes.clone();
    let mut at = 0;
    for (index, cause) in next.iter_mut().enumerate() {
        let q = cause.coefficients.len();
        let step = &steps.as_slice()[at..at + q];
        at += q;
        // a shape is searched anew, since it may depend on its size; what follows a covariate is linear
        match cause.id.is_shape().then(|| now.rescored(index, setting)).flatten() {
            Some(anew) => *cause = part_way(cause, anew.form, stride),
            None => cause.coefficients.iter_mut().zip(step).for_each(|(c, s)| *c += stride * s),
        }
    }
    let mut model = model.clone();
    follow(&mut model, spaces, causes, &next, stride);
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
            let mut model = Model::start(&data, true).unwrap();
            model.fit(&data, 2);
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
