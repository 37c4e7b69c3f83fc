//! Which terms a long decay asks for: forward selection and backward elimination by full refits.
//!
//! In: decays. Out: [`Selected`]. Every candidate starts at its parent's optimum (and once more from
//! the first swings on), so that it never ends worse; it is judged in the metric of the noise that the
//! best of the candidates leaves; a coefficient of the unphysical sign, and a line that is an alias of
//! something else, cannot be the cause.

use super::children::{baseline, children};
use super::decays::Decays;
use super::exchange::{better_form, exchange, margin};
use super::fit::{self, Fit, Noise, sizes};
use super::objections::objection;
use super::terms::{Line, Term};
use super::unnamed::unnamed;
use crate::critique::candidate::{Candidate, Chosen, Objection};
use crate::critique::chance::{DETECTION_LIMIT, THRESHOLD, surprise};
use crate::critique::finding::{EXPLAINS_MORE, Evidence};
use crate::critique::tuned::{FEW, HALF, LEFT_BY_ALL, LEFT_TO_SHAPES, TIE};
use nalgebra::DMatrix;

/// Terms that are looked for at most.
const MOST_TERMS: usize = 12;

/// A term beside what a model has already.
#[derive(Clone, Debug)]
pub struct Added {
    pub term: Term,
    pub fit: Fit,
    /// Share of the parent's misfit (squares) that it takes away.
    pub share: f64,
}

/// Its statistic is in the noise of the best candidate.
pub type Tried = Candidate<Added>;

impl Tried {
    /// Without its fit.
    fn as_term(&self) -> Candidate<Term> {
        let Candidate { id, statistic, degrees, tried, surprise, value, sd, objection, .. } = *self;
        let form = self.form.term;
        Candidate { id, statistic, degrees, tried, surprise, value, sd, objection, form }
    }
}

pub struct Selected {
    pub baseline: Fit,
    pub fit: Fit,
    /// Of the final model.
    pub noise: Noise,
    pub covariance: DMatrix<f64>,
    pub causes: Vec<Chosen<Term>>,
    pub evidence: Vec<Evidence>,
    /// What passes but cannot be the cause, of the last step.
    pub unnamed: Vec<Tried>,
    /// Whether one form of the spring explains more than the other.
    pub form_is_known: bool,
}

impl Selected {
    /// The strongest that has no name.
    pub fn strongest_rival(&self) -> Option<&Candidate<Term>> {
        let rivals = self.causes.iter().map(|c| &c.candidate).filter(|c| !c.has_name());
        rivals.max_by(|p, q| p.statistic.total_cmp(&q.statistic))
    }

    /// The causes that have a name, and explain more than any that has none; by their places.
    pub fn named(&self) -> impl Iterator<Item = (usize, &Chosen<Term>)> {
        let rival = self.strongest_rival().map_or(0.0, |rival| rival.statistic);
        let is_named = move |c: &Candidate<Term>| c.has_name() && c.statistic > rival;
        self.causes.iter().enumerate().filter(move |(_, c)| is_named(&c.candidate))
    }
}

fn deviance(misfit: &[f64], decays: &Decays) -> f64 {
    let count = (decays.samples * decays.bursts) as f64;
    sizes(misfit, decays).iter().map(|s| 2.0 * count * s.ln()).sum()
}

/// All candidates about a model, judged in the noise that is left by what explains most.
pub fn try_all(decays: &Decays, parent: &Fit) -> Vec<Tried> {
    let ln_samples = (decays.y.len() as f64).ln();
    let candidates = candidates(decays, parent);
    let best = candidates
        .iter()
        .filter(|c| c.able())
        .max_by(|p, q| p.delta_bic(ln_samples).total_cmp(&q.delta_bic(ln_samples)))
        .map(|c| c.form.fit.clone())
        .unwrap_or_else(|| parent.clone());
    let noise = Noise::of(&best.misfit(decays), decays, best.p.len());
    let parent = fit::descend(decays, parent, &noise);
    let mut all: Vec<Tried> =
        candidates.into_iter().map(|c| judged(decays, c, &parent, &noise)).collect();
    // a line that rings down is no tone
    if all.iter().any(|t| t.form.term == Term::Line(Line::Mode) && t.able()) {
        all.retain(|t| t.form.term != Term::Line(Line::Tone));
    }
    all
}

/// In white noise. Forms of one cause compete here: the better stays.
fn candidates(decays: &Decays, parent: &Fit) -> Vec<Tried> {
    let misfit = parent.misfit(decays);
    let plain = Noise::white(&sizes(&misfit, decays));
    let lines = [Term::Line(Line::Mode), Term::Line(Line::Tone)];
    let all = Term::NAMED.into_iter().chain(lines).chain(unnamed().map(Term::Unnamed));
    let samples = decays.y.len() as f64;
    let before = deviance(&misfit, decays);
    let mut kept: Vec<Tried> = Vec::new();
    for term in all.filter(|term| term.may_join(&parent.terms)) {
        for fit in children(decays, parent, term, &plain, &misfit) {
            let left = fit.misfit(decays);
            let after = deviance(&left, decays);
            let degrees = fit.p.len() - parent.p.len();
            let share = 1.0 - ((after - before) / samples).exp();
            let covariance = fit.covariance(decays, &Noise::white(&sizes(&left, decays)));
            let objection = objection(decays, &fit, parent.terms.len(), &covariance);
            let one = Candidate {
                degrees,
                tried: term.places(decays),
                objection,
                id: term.id(),
                statistic: before - after,
                surprise: 0.0,
                value: f64::NAN,
                sd: f64::NAN,
                form: Added { term, fit, share },
            };
            // what can be the cause goes before what cannot
            let rank = |c: &Tried| (!c.able(), -c.delta_bic(samples.ln()));
            // forms of one cause are one
            match kept.iter_mut().find(|c| c.id == term.id()) {
                Some(known) if rank(&one) < rank(known) => *known = one,
                Some(_) => {}
                None => kept.push(one),
            }
        }
    }
    kept
}

/// A candidate fitted in the noise, and whether it can be the cause.
fn judged(decays: &Decays, mut t: Tried, parent: &Fit, noise: &Noise) -> Tried {
    let Added { term, fit, share } = &mut t.form;
    *fit = fit::descend(decays, fit, noise);
    if !term.is_line() {
        // nor worse than the parent in this metric
        let from_parent = fit::descend(decays, &parent.with(decays, *term), noise);
        if from_parent.cost < fit.cost {
            *fit = from_parent;
        }
    }
    t.statistic = (parent.cost - fit.cost).max(0.0);
    let free = decays.y.len() as f64 - fit.p.len() as f64;
    t.surprise = surprise(t.statistic, t.degrees, t.tried, free);
    let covariance = fit.covariance(decays, noise);
    let little = match term.is_line() {
        true => *share < FEW,
        false => noise.predictable() > HALF && t.statistic < LEFT_TO_SHAPES * parent.cost,
    };
    t.objection = objection(decays, fit, parent.terms.len(), &covariance)
        .or(little.then_some(Objection::Little));
    t
}

pub fn select(decays: &Decays, stages: &mut dyn FnMut(&str)) -> Selected {
    stages("fitting one damped oscillation");
    let baseline = baseline(decays);
    let ln_samples = (decays.y.len() as f64).ln();
    let mut now = baseline.clone();
    let mut causes: Vec<Chosen<Term>> = Vec::new();
    let (mut evidence, mut unnamed) = (Vec::new(), Vec::new());
    for step in 0..=MOST_TERMS as u32 {
        stages("trying what may be added");
        let mut tried = try_all(decays, &now);
        tried.sort_by(|p, q| q.statistic.total_cmp(&p.statistic));
        let rows = evidence.len();
        let named = tried.iter().filter(|t| t.has_name());
        evidence.extend(named.map(|t| t.evidence(step, ln_samples)));
        unnamed = tried.iter().filter(|t| t.is_significant() && !t.able()).cloned().collect();
        // names are of one number or two, rivals too: each is paid for as Bayes' criterion does
        let penalised = |t: &Tried| t.delta_bic(ln_samples);
        // what strong causes leave to what has no name, and less than one detection limit, is nothing
        let left = LEFT_BY_ALL * causes.iter().map(|c| c.candidate.statistic).fold(0.0, f64::max);
        let least = |t: &Tried| if t.has_name() { 0.0 } else { left.max(DETECTION_LIMIT) };
        let able = |t: &&Tried| t.accepted() && t.statistic >= least(t);
        let mut rivals: Vec<&Tried> = tried.iter().filter(able).collect();
        rivals.sort_by(|p, q| penalised(q).total_cmp(&penalised(p)));
        let Some(likeliest) = rivals.first().filter(|_| (step as usize) < MOST_TERMS) else {
            break;
        };
        // of what cannot be told apart, what has a name enters, tied with what has none
        let close = |t: &&&Tried| penalised(likeliest) - penalised(t) < TIE;
        let named = rivals.iter().filter(close).find(|t| t.has_name());
        let best = named.unwrap_or(likeliest);
        let others = tried.iter().filter(|t| t.form.term != best.form.term && t.accepted());
        let tied = others.filter(|t| penalised(best) - penalised(t) < TIE).map(|t| t.id);
        let (tied_with, tied_unnamed) = tied.partition(|id| id.has_name());
        for e in &mut evidence[rows..] {
            if best.id == e.id {
                e.accepted = true;
                e.why_not = String::new();
            } else if rivals.iter().any(|r| r.id == e.id) {
                e.why_not = EXPLAINS_MORE.into();
            }
        }
        let newcomer = best.form.term;
        causes.push(Chosen {
            delta_bic: best.delta_bic(ln_samples),
            candidate: best.as_term(),
            tied_with,
            tied_unnamed,
        });
        let lines = |fit: &Fit| fit.terms.iter().filter(|term| term.is_line()).count();
        let lines_before = lines(&now);
        now = best.form.fit.clone();
        let there = causes.len();
        eliminate(decays, &mut now, &mut causes);
        exchange(decays, &mut now, &mut causes);
        if causes.len() < there && !causes.iter().any(|c| c.candidate.form == newcomer) {
            break; // it would come and go for ever
        }
        if newcomer.is_line() && lines(&now) <= lines_before {
            break;
        }
    }
    stages("measuring the causes");
    let noise = Noise::of(&now.misfit(decays), decays, now.p.len());
    let mut fit = fit::descend(decays, &now, &noise);
    let more = better_form(decays, &mut fit, &mut causes, &noise);
    let form_is_known = more > margin(&fit, &noise);
    let covariance = fit.covariance(decays, &noise);
    Selected { baseline, fit, noise, covariance, causes, evidence, unnamed, form_is_known }
}

/// What the newcomer makes superfluous, or gives the wrong sign, goes again.
fn eliminate(decays: &Decays, now: &mut Fit, causes: &mut Vec<Chosen<Term>>) {
    loop {
        let noise = Noise::of(&now.misfit(decays), decays, now.p.len());
        *now = fit::descend(decays, now, &noise);
        let covariance = now.covariance(decays, &noise);
        let mut weakest: Option<(usize, Fit, f64)> = None;
        for (i, Chosen { candidate, .. }) in causes.iter_mut().enumerate() {
            let parent = fit::descend(decays, &now.without(decays, |k| k == i), &noise);
            candidate.statistic = (parent.cost - now.cost).max(0.0);
            let free = decays.y.len() as f64 - now.p.len() as f64;
            let mut surprise =
                surprise(candidate.statistic, candidate.degrees, candidate.tried, free);
            if objection(decays, now, i, &covariance).is_some() {
                surprise = 0.0;
            }
            if surprise <= THRESHOLD && weakest.as_ref().is_none_or(|w| surprise < w.2) {
                weakest = Some((i, parent, surprise));
            }
        }
        // the newest was judged just now: it goes only where it has become unphysical itself
        let Some((i, parent, _)) = weakest.filter(|_| causes.len() > 1) else { return };
        causes.remove(i);
        *now = parent;
    }
}
