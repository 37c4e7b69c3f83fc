//! Which causes the data ask for: forward selection, full refits of what competes, backward elimination.
//!
//! In: signals and a fitted baseline. Out: the causes, with what was tried on the way. A cause enters
//! when its surprise passes the family-wise threshold; the winner among those that compete is the one
//! whose refitted model is most likely; what cannot be told apart from it is tied with it.

use super::candidate::{Chosen, Objection};
use super::candidates::{Applied, Kind, Locally, ScoreTests, Scored, Setting};
use super::catalogue::CauseId;
use super::chance::{HINT, surprise};
use super::finding::{EXPLAINS_MORE, Evidence};
use super::leftovers::Weighed;
use super::model::Model;
use super::refit::{Refit, Spaces, apply, follow, refit};
use super::tuned::TIE;

/// Causes that are looked for at most.
const MOST_CAUSES: usize = 4;
/// Candidates with a name, and without one, that are refitted in a step, at most.
const MOST_NAMED: usize = 5;
const MOST_UNNAMED: usize = 3;

pub struct Selected {
    pub model: Model,
    pub causes: Vec<Chosen<Applied>>,
    pub spaces: Spaces,
    pub evidence: Vec<Evidence>,
    /// Candidates that passed but cannot be the cause, of the last step.
    pub unnamed: Vec<Scored>,
}

impl Selected {
    pub fn weighed(&self) -> Vec<Weighed> {
        weighed(&self.causes)
    }
}

fn weighed(chosen: &[Chosen<Applied>]) -> Vec<Weighed> {
    chosen.iter().map(|c| Weighed::of(&c.candidate, &c.tied_with)).collect()
}

/// `found`: in codes and noise, which leave something to the mean, too.
pub fn select(
    baseline: Model,
    setting: Setting,
    found: Vec<Weighed>,
    stages: &mut dyn FnMut(&str),
) -> Selected {
    let mut now = refit(baseline, Vec::new(), setting, 3, true);
    let mut chosen: Vec<Chosen<Applied>> = Vec::new();
    let mut evidence = Vec::new();
    let ln_samples = setting.data.ln_samples();
    let mut unnamed = Vec::new();
    for step in 0..=MOST_CAUSES as u32 {
        stages("testing the catalogue");
        let (mut scored, anything) = tested(&now, setting);
        let rows = evidence.len();
        let named = scored.iter().filter(|s| s.has_name());
        evidence.extend(named.map(|s| s.evidence(step, ln_samples)));
        // what is tied with a cause in the model stands for the same
        let tied = |id| chosen.iter().any(|c| c.tied_with.contains(&id));
        scored.retain(|s| !tied(s.id));
        let named = || scored.iter().filter(|s| s.has_name());
        unnamed = named().filter(|s| s.is_significant() && !s.able()).cloned().collect();
        let able: Vec<&Scored> = scored.iter().filter(|s| s.able()).collect();
        let Some(best) = named().find(|s| s.able() && s.is_significant()) else { break };
        if step as usize == MOST_CAUSES {
            break;
        }
        stages("refitting what competes");
        let Some(round) = Round::of(&now, &able, best, setting) else {
            let why = Some(Objection::LeadsNowhere);
            unnamed.push(Scored { objection: why, ..best.clone() });
            break;
        };
        // what something without a name explains better has no name here: it is left for `adequacy` to tell
        if round.is_without_a_name() || round.of_shapes && anything.gain() > round.gain() + TIE {
            break;
        }
        round.tell(&mut evidence[rows..], ln_samples);
        let (refitted, cause) = round.won(ln_samples);
        chosen.push(cause);
        now = refit(refitted.model, refitted.causes, setting, 2, true);
        // what the newcomer makes superfluous goes again
        let kept = necessary(&now);
        if kept.iter().any(|k| !k) {
            now = without(now, &mut chosen, &kept, setting, 2);
        }
    }
    stages("measuring the causes");
    let mut last = refit(now.model, now.causes, setting, 3, true);
    measure(&mut chosen, &last, setting);
    let mut all = weighed(&chosen);
    all.extend(found);
    // what brought a cause in was told about a model without it: beside all others it must say as much still
    let stands = |(cause, own): (&Chosen<Applied>, &Weighed)| {
        cause.candidate.is_significant() && own.is_beyond(&all)
    };
    let kept: Vec<bool> = chosen.iter().zip(&all).map(stands).collect();
    if kept.iter().any(|k| !k) {
        last = without(last, &mut chosen, &kept, setting, 3);
        measure(&mut chosen, &last, setting);
    }
    Selected { model: last.model, causes: chosen, spaces: last.spaces, evidence, unnamed }
}

/// The catalogue about a model, without what is in it; what is most surprising first. And what has no name.
fn tested(now: &Refit, setting: Setting) -> (Vec<Scored>, Locally) {
    let nuisances = now.spaces.nuisances(&now.causes);
    let tests = ScoreTests::new(&now.model, setting, &nuisances);
    let mut scored = tests.score_all();
    scored.retain(|s| now.causes.iter().all(|c| c.id != s.id));
    scored.sort_by(|p, q| q.surprise.total_cmp(&p.surprise));
    (scored, tests.local_scan())
}

/// One cause in the model, refitted with it.
struct Rival<'a> {
    refitted: Refit,
    scored: &'a Scored,
    deviance: f64,
}

impl Rival<'_> {
    fn id(&self) -> CauseId {
        self.scored.id
    }

    /// -2 ln likelihood and what is paid for what is free.
    fn penalised(&self) -> f64 {
        self.deviance + 2.0 * (parameters(self.scored) + self.scored.tried.ln())
    }
}

/// What competes to be the next cause, the likeliest first.
struct Round<'a> {
    /// -2 ln likelihood without any of them.
    before: f64,
    of_shapes: bool,
    rivals: Vec<Rival<'a>>,
    /// Place of the likeliest that has a name.
    likeliest: usize,
}

impl<'a> Round<'a> {
    /// `None`: all refits lead nowhere.
    fn of(now: &Refit, able: &[&'a Scored], best: &Scored, setting: Setting) -> Option<Round<'a>> {
        let kind = &best.form.kind;
        let mut rivals: Vec<Rival<'a>> = Vec::new();
        let competing = |named: bool, most: usize| {
            let those = able.iter().copied().filter(move |s| s.has_name() == named);
            those.filter(|s| competes(s, best)).take(most)
        };
        for scored in competing(true, MOST_NAMED).chain(competing(false, MOST_UNNAMED)) {
            let mut model = now.model.clone();
            let mut causes = now.causes.clone();
            follow(&mut model, &now.spaces, &[], std::slice::from_ref(&scored.form), 1.0);
            apply(&mut model, &scored.form, &scored.form.coefficients, setting);
            causes.push(scored.form.clone());
            let refitted = refit(model, causes, setting, 3, false);
            if refitted.last_is_able(setting) {
                rivals.push(Rival { deviance: refitted.deviance(kind), refitted, scored });
            }
        }
        // what explains less once it is refitted leads nowhere: it is no cause, and the misfit stays
        let before = now.deviance(kind);
        rivals.retain(|r| r.deviance < before);
        rivals.sort_by(|p, q| p.penalised().total_cmp(&q.penalised()));
        let of_shapes = matches!(kind, Kind::Shapes);
        let likeliest = rivals.iter().position(|r| r.id().has_name())?;
        Some(Round { before, of_shapes, rivals, likeliest })
    }

    /// What the likeliest that has a name gains in -2 ln likelihood, its parameters paid for.
    fn gain(&self) -> f64 {
        self.before - self.rivals[self.likeliest].penalised()
    }

    /// Whether a rival without a name is likelier than all that have one.
    fn is_without_a_name(&self) -> bool {
        self.before - self.rivals[0].penalised() > self.gain() + TIE
    }

    /// What cannot be told from the likeliest that has a name: what has one, and what has none.
    fn tied(&self) -> (Vec<CauseId>, Vec<CauseId>) {
        let best = &self.rivals[self.likeliest];
        let others = self.rivals.iter().filter(|r| r.id() != best.id());
        let close = others.filter(|r| r.penalised() - best.penalised() < TIE);
        close.map(Rival::id).partition(|id| id.has_name())
    }

    /// What became of each, in the evidence of this step.
    fn tell(&self, rows: &mut [Evidence], ln_samples: f64) {
        for (place, r) in self.rivals.iter().enumerate() {
            if let Some(row) = rows.iter_mut().find(|e| e.id == r.id()) {
                row.delta_bic = self.before - r.deviance - r.scored.degrees as f64 * ln_samples;
                row.accepted = place == self.likeliest;
                row.why_not = if row.accepted { String::new() } else { EXPLAINS_MORE.into() };
            }
        }
    }

    /// The next cause, and the model with it.
    fn won(mut self, ln_samples: f64) -> (Refit, Chosen<Applied>) {
        let (tied_with, tied_unnamed) = self.tied();
        let Rival { refitted, scored, deviance } = self.rivals.swap_remove(self.likeliest);
        let statistic = (self.before - deviance).max(0.0);
        let candidate = Scored { statistic, ..scored.clone() };
        let delta_bic = candidate.delta_bic(ln_samples);
        let cause = Chosen { candidate, delta_bic, tied_with, tied_unnamed };
        (refitted, cause)
    }
}

/// Whether a candidate is refitted beside the most surprising one.
fn competes(s: &Scored, best: &Scored) -> bool {
    let of_shapes = |s: &Scored| matches!(s.form.kind, Kind::Shapes);
    of_shapes(s) == of_shapes(best) && s.surprise > HINT
}

/// The model without the causes that are not kept.
fn without(
    now: Refit,
    chosen: &mut Vec<Chosen<Applied>>,
    kept: &[bool],
    setting: Setting,
    rounds: usize,
) -> Refit {
    let Refit { mut model, mut causes, .. } = now;
    for (cause, _) in causes.iter().zip(kept).filter(|(_, k)| !**k) {
        let minus: Vec<f64> = cause.coefficients.iter().map(|c| -c).collect();
        apply(&mut model, cause, &minus, setting);
    }
    let mut keep = kept.iter();
    chosen.retain(|_| *keep.next().unwrap_or(&true));
    let mut keep = kept.iter();
    causes.retain(|_| *keep.next().unwrap_or(&true));
    refit(model, causes, setting, rounds, true)
}

/// Final sizes, each beside all others.
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
            let (steps, covariance) = match cause.kind {
                Kind::Shapes => nuisances.shapes.causes(),
                _ => nuisances.covariates.causes(),
            };
            let q = cause.coefficients.len();
            // of what follows a covariate, its own effect must stay, not the state's
            let own = if matches!(cause.kind, Kind::Covariate { .. }) { 1 } else { q };
            let total: Vec<f64> = cause
                .coefficients
                .iter()
                .zip(steps.rows(at, own).iter())
                .map(|(c, s)| c + s)
                .collect();
            let block = covariance.view((at, at), (own, own)).into_owned();
            at += q;
            let x = nalgebra::DVector::from_vec(total);
            let statistic = block.try_inverse().map_or(0.0, |inverse| x.dot(&(inverse * &x)));
            surprise(statistic, own, 1.0, f64::INFINITY) > HINT
        })
        .collect()
}

/// What a cause has free: its coefficients, and its rate, frequency and damping.
fn parameters(s: &Scored) -> f64 {
    s.degrees as f64 + s.id.row().free
}
