//! Selects the causes that the signals of ink channels ask for: full refits of the candidates that compete,
//! and backward elimination.
//!
//! In: signals and a fitted baseline. Out: the causes, with what was tried on the way. Among those that
//! compete, the one whose refitted model is most likely wins (`search`).

use super::candidate::Chosen;
use super::candidates::{Applied, ScoreTests, Scored, Setting};
use super::chance::{HINT, surprise};
use super::leftovers::Weighed;
use super::model::Model;
use super::refit::{Refit, apply, follow, refit};
use super::search::{ExplainedModel, Rival, Round, System, search};
use super::tuned::tie;
use nalgebra::DVector;
use std::ops::ControlFlow;

/// Largest number of candidates with a name, and without one, that are refitted in a step.
const MOST_NAMED: usize = 5;
const MOST_UNNAMED: usize = 3;

/// The model with the causes that were selected.
pub type Selected = ExplainedModel<Refit, Applied>;

impl Selected {
    /// The causes with their weights, for the comparison with what they may leave to others.
    pub fn weighed(&self) -> Vec<Weighed> {
        weighed(&self.causes)
    }
}

fn weighed(chosen: &[Chosen<Applied>]) -> Vec<Weighed> {
    chosen.iter().map(|c| Weighed::of(&c.candidate, &c.tied_with)).collect()
}

/// Selects the causes. `found`: what was found in codes and noise, which leave something to the mean, too.
pub fn select(
    baseline: Model,
    setting: Setting,
    found: Vec<Weighed>,
    stages: &mut dyn FnMut(&str),
) -> Selected {
    let baseline = refit(baseline, Vec::new(), setting, 3, true);
    let ExplainedModel { fitted: now, mut causes, evidence, unnamed } =
        search(&setting, baseline, setting.data.ln_samples(), stages);
    stages("measuring the causes");
    let mut last = refit(now.model, now.causes, setting, 3, true);
    measure(&mut causes, &last, setting);
    let mut all = weighed(&causes);
    all.extend(found);
    // A cause entered because of a test about a model that lacked later ones: it stays only if it is still
    // significant beside all others, and more than what these leave.
    let stands = |(cause, own): (&Chosen<Applied>, &Weighed)| {
        cause.candidate.is_significant() && own.is_beyond(&all)
    };
    let kept: Vec<bool> = causes.iter().zip(&all).map(stands).collect();
    if kept.iter().any(|k| !k) {
        last = without(last, &mut causes, &kept, setting, 3);
        measure(&mut causes, &last, setting);
    }
    ExplainedModel { fitted: last, causes, evidence, unnamed }
}

impl System for Setting<'_> {
    type Model = Refit;
    type Form = Applied;
    const MOST_CAUSES: u32 = 4;
    const TIED_MAY_ENTER: bool = false;
    const TRYING: &'static str = "testing the catalogue";

    /// Tests the catalogue, without the causes that are in the model; the most surprising first.
    fn tried(&self, now: &Refit) -> Vec<Scored> {
        let nuisances = now.spaces.nuisances(&now.causes);
        let mut scored = ScoreTests::new(&now.model, *self, &nuisances).score_all();
        scored.retain(|s| now.causes.iter().all(|c| c.id != s.id));
        scored.sort_by(|p, q| q.surprise.total_cmp(&p.surprise));
        scored
    }

    /// Refits the candidates that compete. One without a name never enters: what it explains better is left
    /// for `adequacy` to tell. Where it is clearly likelier than all names, it and the likeliest name are
    /// compared once more, each with what comes next beside it.
    fn round(
        &self,
        now: &Refit,
        tried: &[Scored],
        _: &[Chosen<Applied>],
        stages: &mut dyn FnMut(&str),
    ) -> Round<Refit, Applied> {
        let best = tried.iter().find(|s| s.has_name() && s.accepted());
        let Some(best) = best else { return Round { rivals: Vec::new(), least: f64::INFINITY } };
        stages("refitting what competes");
        let mut rivals = refitted(now, tried, best, *self);
        let place = |named: bool| rivals.iter().position(|r| r.candidate.has_name() == named);
        if let (Some(named), Some(unnamed)) = (place(true), place(false))
            && rivals[named].penalised > rivals[unnamed].penalised + tie()
        {
            // replace the difference of the two by that of the pairs; rivals other than the strongest are
            // dropped
            let behind =
                with_the_next(&rivals[unnamed], *self) - with_the_next(&rivals[named], *self);
            rivals[unnamed].penalised = rivals[named].penalised + behind;
            let strongest = rivals[unnamed].candidate.id;
            rivals.retain(|r| r.candidate.has_name() || r.candidate.id == strongest);
            rivals.sort_by(|p, q| p.penalised.total_cmp(&q.penalised));
        }
        let least = rivals.first().map_or(f64::INFINITY, |r| r.penalised);
        Round { rivals, least }
    }

    fn settled(&self, now: Refit, chosen: &mut Vec<Chosen<Applied>>) -> ControlFlow<Refit, Refit> {
        let now = refit(now.model, now.causes, *self, 2, true);
        let kept = necessary(&now);
        ControlFlow::Continue(match kept.iter().all(|k| *k) {
            true => now,
            false => without(now, chosen, &kept, *self, 2),
        })
    }
}

/// Refits the candidates that compete; the likeliest first. `best`: the most surprising one that has a name.
fn refitted(
    now: &Refit,
    tried: &[Scored],
    best: &Scored,
    setting: Setting,
) -> Vec<Rival<Refit, Applied>> {
    let before = now.deviance(best.id);
    let competing = |named: bool, most: usize| {
        let those = tried.iter().filter(move |s| s.has_name() == named);
        those.filter(|s| competes(s, best)).take(most)
    };
    let all = competing(true, MOST_NAMED).chain(competing(false, MOST_UNNAMED));
    let refitted = |scored: &Scored| {
        let rival = with(now, &scored.form, setting);
        let deviance = rival.deviance(best.id);
        // a candidate that explains less once it is refitted leads nowhere: it is no cause, and the misfit
        // stays
        (rival.last_is_able(setting) && deviance < before).then(|| Rival {
            model: rival,
            penalised: deviance + 2.0 * (parameters(scored) + scored.tried.ln()),
            may_enter: scored.has_name(),
            candidate: Scored { statistic: before - deviance, ..scored.clone() },
        })
    };
    let mut rivals: Vec<Rival<Refit, Applied>> = all.filter_map(refitted).collect();
    rivals.sort_by(|p, q| p.penalised.total_cmp(&q.penalised));
    rivals
}

/// Penalised -2 ln likelihood of a rival together with the named candidate that comes next beside it. Where
/// there are two causes, one that has no name may take a part of both and explain more than either alone.
fn with_the_next(rival: &Rival<Refit, Applied>, setting: Setting) -> f64 {
    let mut tried = setting.tried(&rival.model);
    tried.retain(Scored::has_name);
    let next = tried.iter().find(|s| s.accepted() && competes(s, &rival.candidate)).cloned();
    let paid = rival.penalised - rival.model.deviance(rival.candidate.id);
    let beside = next.map(|next| refitted(&rival.model, &tried, &next, setting));
    let least = beside.and_then(|all| Some(all.first()?.penalised + paid));
    least.map_or(rival.penalised, |both| both.min(rival.penalised))
}

/// The model with one more cause, refitted with scatter and noise held.
fn with(now: &Refit, cause: &Applied, setting: Setting) -> Refit {
    let mut model = now.model.clone();
    let mut causes = now.causes.clone();
    follow(&mut model, &now.spaces, &[], std::slice::from_ref(cause), 1.0);
    apply(&mut model, cause, 1.0, setting);
    causes.push(cause.clone());
    refit(model, causes, setting, 3, false)
}

/// Whether a candidate is refitted beside the most surprising one: it must be possible, of the same kind, and
/// surprising enough for a hint.
fn competes(s: &Scored, best: &Scored) -> bool {
    s.able() && s.id.is_shape() == best.id.is_shape() && s.surprise > HINT
}

/// The model without the causes that are not kept, refitted.
fn without(
    now: Refit,
    chosen: &mut Vec<Chosen<Applied>>,
    kept: &[bool],
    setting: Setting,
    rounds: usize,
) -> Refit {
    let Refit { mut model, mut causes, .. } = now;
    for (cause, _) in causes.iter().zip(kept).filter(|(_, k)| !**k) {
        apply(&mut model, cause, -1.0, setting);
    }
    let mut keep = kept.iter();
    chosen.retain(|_| *keep.next().unwrap_or(&true));
    let mut keep = kept.iter();
    causes.retain(|_| *keep.next().unwrap_or(&true));
    refit(model, causes, setting, rounds, true)
}

/// Measures the final size of each cause beside all others.
fn measure(chosen: &mut [Chosen<Applied>], last: &Refit, setting: Setting) {
    for (index, cause) in chosen.iter_mut().enumerate() {
        if let Some(scored) = last.rescored(index, setting) {
            cause.candidate = scored;
        }
    }
}

/// Which causes stay significant beside the others.
fn necessary(now: &Refit) -> Vec<bool> {
    let nuisances = now.spaces.nuisances(&now.causes);
    let mut at = 0;
    now.causes
        .iter()
        .map(|cause| {
            let (steps, covariance) = nuisances.of(cause.id).causes();
            let q = cause.coefficients.len();
            // for a cause that follows a covariate, the effect itself, which is its first coefficient, must
            // stay significant; the other coefficients are the acquisition state's
            let own = if cause.id.is_shape() { q } else { 1 };
            let x = DVector::from_column_slice(&cause.coefficients[..own]) + steps.rows(at, own);
            let block = covariance.view((at, at), (own, own)).into_owned();
            at += q;
            let statistic = block.try_inverse().map_or(0.0, |inverse| x.dot(&(inverse * &x)));
            surprise(statistic, own, 1.0, f64::INFINITY) > HINT
        })
        .collect()
}

/// Number of free parameters of a cause: its coefficients, and its rate, frequency and damping.
fn parameters(s: &Scored) -> f64 {
    s.degrees as f64 + s.id.row().free
}
