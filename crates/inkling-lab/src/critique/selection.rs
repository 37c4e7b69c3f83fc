//! Selects the causes that the signals of ink channels ask for, by the forward selection of `search.rs`.
//!
//! In: signals (a `Setting`) and a fitted baseline. Out: [`Selected`], the refitted model with its causes, and
//! what was tried on the way.
//!
//! The linear tests of all candidates (`candidates`) nominate; the most surprising accepted name is the
//! benchmark, and at most five names and three rivals of its kind (shape, or covariate) are refitted beside it
//! at fixed noise and scatter; the refitted -2 ln likelihood plus prices decides; the winner enters, everything
//! is refitted with scatter. At the end causes leave that are no longer significant, or no more than what stronger
//! findings leave (`leftovers.rs`).

use super::candidate::Chosen;
use super::candidates::{Applied, ScoreTests, Scored, Setting};
use super::chance::HINT;
use super::leftovers::Finding;
use super::model::Model;
use super::refit::{Refit, apply, follow, refit};
use super::search::{Contender, ExplainedModel, System, search};
use super::work::{self, Stage, Work};
use std::ops::ControlFlow;

/// Largest numbers of candidates that are refitted in a step: of those with a name, and of those without.
const MOST_NAMED: usize = 5;
const MOST_UNNAMED: usize = 3;

pub type Selected = ExplainedModel<Refit, Applied>;

impl Selected {
    pub fn findings(&self) -> Vec<Finding> {
        findings(&self.causes)
    }
}

fn findings(chosen: &[Chosen<Applied>]) -> Vec<Finding> {
    chosen.iter().map(|c| Finding::of(&c.candidate, &c.tied_with)).collect()
}

/// `baseline`: the model without causes, fitted to the signals of `setting`. `found`: what was found in codes
/// and noise, which may also leave something that looks like a cause of the mean.
pub fn select(baseline: Model, setting: Setting, found: Vec<Finding>) -> Selected {
    let baseline = refit(baseline, Vec::new(), setting, 3, true);
    let ExplainedModel { fitted: now, mut causes, evidence, unnamed } =
        search(&setting, baseline, setting.data.ln_samples());

    setting.data.work.begins(work::MEASURING);
    let mut last = refit(now.model, now.causes, setting, 3, true);
    measure(&mut causes, &last, setting);
    let mut all = findings(&causes);
    all.extend(found);

    // A cause entered because of a test about a model that lacked those that entered later. It stays only if
    // it is still significant, and more than what the others and codes and noise may leave.
    let stands = |(cause, own): (&Chosen<Applied>, &Finding)| {
        cause.candidate.is_significant() && own.is_beyond(&all)
    };
    let kept: Vec<bool> = causes.iter().zip(&all).map(stands).collect();
    if kept.iter().any(|k| !k) {
        last = without(last, &kept, setting);
        let mut keep = kept.into_iter();
        causes.retain(|_| keep.next().unwrap_or(true));
        measure(&mut causes, &last, setting);
    }
    ExplainedModel { fitted: last, causes, evidence, unnamed }
}

impl System for Setting<'_> {
    type Model = Refit;
    type Form = Applied;
    const MOST_CAUSES: u32 = 4;
    const TIED_MAY_ENTER: bool = false;
    const RIVALS_MAY_ENTER: bool = false;
    const TRYING: Stage = work::CATALOGUE;

    fn work(&self) -> &Work {
        &self.data.work
    }

    /// The most surprising first, without the causes that are in the model.
    fn tried(&self, now: &Refit) -> Vec<Scored> {
        let nuisances = now.spaces.nuisances(&now.causes);
        let mut scored = ScoreTests::new(&now.model, *self, &nuisances).score_all();
        scored.retain(|s| now.causes.iter().all(|c| c.id != s.id));
        scored.sort_by(|p, q| q.surprise.total_cmp(&p.surprise));
        scored
    }

    /// Those that explain something after the refit, the likeliest first.
    fn round(
        &self,
        now: &Refit,
        tried: &[Scored],
        _: &[Chosen<Applied>],
    ) -> Vec<Contender<Refit, Applied>> {
        let best = tried.iter().find(|s| s.has_name() && s.accepted());
        let Some(best) = best else { return Vec::new() };
        let before = now.deviance(best.id);
        let competing = |named: bool, most: usize| {
            let those = tried.iter().filter(move |s| s.has_name() == named);
            those.filter(|s| competes(s, best)).take(most)
        };
        let all = competing(true, MOST_NAMED).chain(competing(false, MOST_UNNAMED));
        let refitted = |scored: &Scored| {
            let contender = with(now, &scored.form, *self);
            let deviance = contender.deviance(best.id);
            // A candidate that has an objection once it is refitted is dropped. The price is that of Akaike, 2 for
            // each free parameter, plus 2 ln of the number of independent shapes among which it was the best.
            (contender.last_is_able(*self) && deviance < before).then(|| Contender {
                model: contender,
                penalised: deviance + 2.0 * (free_parameters(scored) + scored.tried.ln()),
                is_weak: false,
                candidate: Scored { statistic: before - deviance, ..scored.clone() },
            })
        };
        let mut contenders: Vec<_> = all.filter_map(refitted).collect();
        contenders.sort_by(|p, q| p.penalised.total_cmp(&q.penalised));
        contenders
    }

    fn settled(&self, now: Refit, _: &mut Vec<Chosen<Applied>>) -> ControlFlow<Refit, Refit> {
        ControlFlow::Continue(refit(now.model, now.causes, *self, 2, true))
    }
}

/// Refitted with scatter and noise held, after the mean is shifted by what the cause takes away (`follow`).
fn with(now: &Refit, cause: &Applied, setting: Setting) -> Refit {
    let mut model = now.model.clone();
    let mut causes = now.causes.clone();
    follow(&mut model, &now.spaces, &[], std::slice::from_ref(cause));
    apply(&mut model, cause, 1.0, setting);
    causes.push(cause.clone());
    refit(model, causes, setting, 3, false)
}

/// Whether a candidate is refitted beside the most surprising one.
fn competes(s: &Scored, best: &Scored) -> bool {
    s.able() && s.id.is_shape() == best.id.is_shape() && s.surprise > HINT
}

/// Takes the causes that are not `kept` out, and refits the model with its scatter.
fn without(now: Refit, kept: &[bool], setting: Setting) -> Refit {
    let Refit { mut model, causes, .. } = now;
    let each = causes.into_iter().zip(kept);
    let (stay, go): (Vec<_>, Vec<_>) = each.partition(|(_, kept)| **kept);
    go.iter().for_each(|(cause, _)| apply(&mut model, cause, -1.0, setting));
    refit(model, stay.into_iter().map(|(cause, _)| cause).collect(), setting, 3, true)
}

/// Replaces each candidate by its final test beside all others, if it can be tested again.
fn measure(chosen: &mut [Chosen<Applied>], last: &Refit, setting: Setting) {
    for (index, cause) in chosen.iter_mut().enumerate() {
        if let Some(scored) = last.rescored(index, setting) {
            cause.candidate = scored;
        }
    }
}

/// A candidate's coefficients, and the parameters of its shape (rate, frequency, damping).
fn free_parameters(s: &Scored) -> f64 {
    s.form.directions.len() as f64 + s.id.row().free
}
