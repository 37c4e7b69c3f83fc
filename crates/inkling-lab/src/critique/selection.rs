//! Which causes the data ask for: forward selection, full refits of what competes, backward elimination.
//!
//! In: signals and a fitted baseline. Out: the causes, with what was tried on the way. A cause enters
//! when its surprise passes the family-wise threshold; the winner among those that compete is the one
//! whose refitted model is most likely; what cannot be told apart from it is tied with it.

use super::candidates::{Kind, Locally, Objection, Scored};
use super::catalogue::CauseId;
use super::chance::{DETECTION_LIMIT, HINT, THRESHOLD, statistic_of, surprise};
use super::finding::{EXPLAINS_MORE, Evidence};
use super::leftovers::Weighed;
use super::model::Model;
use super::refit::{Refit, Setting, Spaces, apply, follow, refit, rescored};
use super::tuned::TIE;

/// Causes that are looked for at most.
const MOST_CAUSES: usize = 4;
/// Candidates with a name, and without one, that are refitted in a step, at most.
const MOST_NAMED: usize = 5;
const MOST_UNNAMED: usize = 3;

#[derive(Clone, Debug)]
pub struct Chosen {
    pub scored: Scored,
    pub delta_bic: f64,
    pub tied_with: Vec<CauseId>,
    /// Rivals without a name that explain as much.
    pub tied_unnamed: Vec<CauseId>,
    /// Likelihood-ratio statistic against the final model without it.
    pub statistic: f64,
}

impl Chosen {
    pub fn weighed(&self) -> Weighed {
        let (id, tied_with) = (self.scored.applied.id, self.tied_with.clone());
        Weighed { id, tied_with, statistic: self.statistic, growth: 1.0 }
    }
}

pub struct Selected {
    pub model: Model,
    pub causes: Vec<Chosen>,
    pub spaces: Spaces,
    pub evidence: Vec<Evidence>,
    /// Candidates that passed but cannot be the cause, of the last step.
    pub unnamed: Vec<Scored>,
}

impl Selected {
    pub fn weighed(&self) -> Vec<Weighed> {
        self.causes.iter().map(Chosen::weighed).collect()
    }
}

/// `found`: in codes and noise, which leave something to the mean, too.
pub fn select(
    baseline: Model,
    setting: Setting,
    found: Vec<Weighed>,
    stages: &mut dyn FnMut(&str),
) -> Selected {
    let data = setting.data;
    let mut now = refit(baseline, Vec::new(), setting, 3, true);
    let mut chosen: Vec<Chosen> = Vec::new();
    let mut evidence = Vec::new();
    let ln_samples = (data.len() as f64 * data.samples as f64).ln();
    let mut unnamed = Vec::new();
    for step in 0..=MOST_CAUSES as u32 {
        stages("testing the catalogue");
        let (mut scored, anything) = tested(&now, setting);
        let rows = evidence.len();
        let named = scored.iter().filter(|s| s.applied.id.has_name());
        evidence.extend(named.map(|s| row(s, step, ln_samples)));
        // what is tied with a cause in the model stands for the same
        let tied = |id| chosen.iter().any(|c| c.tied_with.contains(&id));
        scored.retain(|s| !tied(s.applied.id));
        let named = || scored.iter().filter(|s| s.applied.id.has_name());
        unnamed = named().filter(|s| s.surprise > THRESHOLD && !s.able()).cloned().collect();
        let able: Vec<&Scored> = scored.iter().filter(|s| s.able()).collect();
        let Some(best) = named().find(|s| s.able() && s.surprise > THRESHOLD) else { break };
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
        let Won { refitted, cause } = round.won(ln_samples);
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
    let mut all: Vec<Weighed> = chosen.iter().map(Chosen::weighed).collect();
    all.extend(found);
    // what brought a cause in was told about a model without it: beside all others it must say as much still
    let stands = |(cause, own): (&Chosen, &Weighed)| {
        cause.scored.surprise > THRESHOLD && own.is_beyond(&all)
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
    let bench = setting.bench(&now.model, &now.spaces, &nuisances);
    let mut scored = bench.score_all();
    scored.retain(|s| now.causes.iter().all(|c| c.id != s.applied.id));
    scored.sort_by(|p, q| q.surprise.total_cmp(&p.surprise));
    (scored, bench.local_scan())
}

fn row(s: &Scored, step: u32, ln_samples: f64) -> Evidence {
    Evidence {
        step,
        id: s.applied.id,
        statistic: s.statistic,
        threshold: threshold_statistic(s),
        p: (-s.surprise).exp(),
        delta_bic: s.statistic - s.degrees as f64 * ln_samples,
        strength_dl: (s.statistic / DETECTION_LIMIT).sqrt(),
        value: s.value,
        sd: s.sd,
        tested: true,
        accepted: false,
        why_not: s.why_not(),
    }
}

/// One cause in the model, refitted with it.
struct Rival<'a> {
    refitted: Refit,
    scored: &'a Scored,
    deviance: f64,
}

impl Rival<'_> {
    fn id(&self) -> CauseId {
        self.scored.applied.id
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

/// The next cause, in the model.
struct Won {
    refitted: Refit,
    cause: Chosen,
}

impl<'a> Round<'a> {
    /// `None`: all refits lead nowhere.
    fn of(now: &Refit, able: &[&'a Scored], best: &Scored, setting: Setting) -> Option<Round<'a>> {
        let kind = &best.applied.kind;
        let mut rivals: Vec<Rival<'a>> = Vec::new();
        let competing = |named: bool, most: usize| {
            let those = able.iter().copied().filter(move |s| s.applied.id.has_name() == named);
            those.filter(|s| competes(s, best)).take(most)
        };
        for scored in competing(true, MOST_NAMED).chain(competing(false, MOST_UNNAMED)) {
            let mut model = now.model.clone();
            let mut causes = now.causes.clone();
            follow(&mut model, &now.spaces, &[], std::slice::from_ref(&scored.applied), 1.0);
            apply(&mut model, &scored.applied, &scored.applied.coefficients, setting);
            causes.push(scored.applied.clone());
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

    fn won(mut self, ln_samples: f64) -> Won {
        let (tied_with, tied_unnamed) = self.tied();
        let Rival { refitted, scored, deviance } = self.rivals.swap_remove(self.likeliest);
        let statistic = (self.before - deviance).max(0.0);
        let cause = Chosen {
            delta_bic: statistic - scored.degrees as f64 * ln_samples,
            statistic,
            scored: scored.clone(),
            tied_with,
            tied_unnamed,
        };
        Won { refitted, cause }
    }
}

/// Whether a candidate is refitted beside the most surprising one.
fn competes(s: &Scored, best: &Scored) -> bool {
    let of_shapes = |s: &Scored| matches!(s.applied.kind, Kind::Shapes);
    of_shapes(s) == of_shapes(best) && s.surprise > HINT
}

/// The model without the causes that are not kept.
fn without(
    now: Refit,
    chosen: &mut Vec<Chosen>,
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
fn measure(chosen: &mut [Chosen], last: &Refit, setting: Setting) {
    for (index, cause) in chosen.iter_mut().enumerate() {
        if let Some(scored) = rescored(index, &last.model, &last.causes, &last.spaces, setting) {
            cause.statistic = scored.statistic;
            cause.scored = scored;
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
    s.degrees as f64 + s.applied.id.row().free
}

/// The value of the statistic at which the surprise reaches the threshold.
fn threshold_statistic(s: &Scored) -> f64 {
    statistic_of(THRESHOLD, |x| surprise(x, s.degrees, s.tried, f64::INFINITY))
}

#[cfg(test)]
mod tests {
    use super::super::candidates::Applied;
    use super::*;

    #[test]
    fn the_threshold_of_a_statistic_is_where_its_surprise_reaches_it() {
        for degrees in [1, 2, 4] {
            let one = Scored {
                applied: Applied::rigid(CauseId::Tone, vec![], vec![], Kind::Shapes),
                statistic: 0.0,
                degrees,
                tried: 20.0,
                surprise: 0.0,
                value: 1.0,
                sd: 0.1,
                objection: None,
            };
            let at = threshold_statistic(&one);
            let surprise = surprise(at, degrees, 20.0, f64::INFINITY);
            assert!((surprise - THRESHOLD).abs() < 1e-3, "{degrees}: {surprise}");
        }
    }
}
