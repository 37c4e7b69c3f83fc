//! Which terms a long decay asks for: forward selection and backward elimination by full refits.
//!
//! In: decays. Out: [`Selected`]. Every candidate starts at its parent's optimum (and once more from
//! the first swings on), so that it never ends worse; it is judged in the metric of the noise that the
//! best of the candidates leaves; a coefficient of the unphysical sign, and a line that is an alias of
//! something else, cannot be the cause.

use super::children::{baseline, children};
use super::chosen::Chosen;
use super::decays::Decays;
use super::exchange::{better_form, exchange, margin};
use super::fit::{self, Fit, Noise, sizes};
use super::objections::{Objection, objection};
use super::terms::{Line, Term};
use super::unnamed::unnamed;
use crate::critique::chance::{DETECTION_LIMIT, THRESHOLD, statistic_of, surprise};
use crate::critique::finding::{EXPLAINS_MORE, Evidence, NOT_SIGNIFICANT};
use crate::critique::tuned::{FEW, HALF, LEFT_BY_ALL, LEFT_TO_SHAPES, TIE};
use nalgebra::DMatrix;

/// Terms that are looked for at most.
const MOST_TERMS: usize = 12;

/// A candidate, fitted.
#[derive(Clone, Debug)]
pub struct Tried {
    pub term: Term,
    pub fit: Fit,
    /// In the noise of the best candidate.
    pub statistic: f64,
    pub degrees: usize,
    pub surprise: f64,
    /// Share of the parent's misfit (squares) that it takes away.
    pub share: f64,
    /// Why it cannot be the cause although it fits.
    pub objection: Option<Objection>,
}

impl Tried {
    /// Why it is not accepted, in words.
    pub fn why_not(&self) -> String {
        self.objection.map_or_else(|| NOT_SIGNIFICANT.into(), |why| why.to_string())
    }
}

pub struct Selected {
    pub baseline: Fit,
    pub fit: Fit,
    /// Of the final model.
    pub noise: Noise,
    pub covariance: DMatrix<f64>,
    pub causes: Vec<Chosen>,
    pub evidence: Vec<Evidence>,
    /// What passes but cannot be the cause, of the last step.
    pub unnamed: Vec<Tried>,
    /// Whether one form of the spring explains more than the other.
    pub form_is_known: bool,
}

fn deviance(misfit: &[f64], decays: &Decays) -> f64 {
    let count = (decays.samples * decays.bursts) as f64;
    sizes(misfit, decays).iter().map(|s| 2.0 * count * s.ln()).sum()
}

/// All candidates about a model, judged in the noise that is left by what explains most.
pub fn try_all(decays: &Decays, parent: &Fit) -> Vec<Tried> {
    let candidates = candidates(decays, parent);
    let best = candidates
        .iter()
        .filter(|c| c.tried.objection.is_none())
        .min_by(|p, q| p.criterion.total_cmp(&q.criterion))
        .map(|c| c.tried.fit.clone())
        .unwrap_or_else(|| parent.clone());
    let noise = Noise::of(&best.misfit(decays), decays, best.p.len());
    let parent = fit::descend(decays, parent, &noise);
    let mut all: Vec<Tried> =
        candidates.into_iter().map(|c| judged(decays, c.tried, &parent, &noise)).collect();
    // a line that rings down is no tone
    if all.iter().any(|t| t.term == Term::Line(Line::Mode) && t.objection.is_none()) {
        all.retain(|t| t.term != Term::Line(Line::Tone));
    }
    all
}

/// A candidate in white noise.
struct Candidate {
    tried: Tried,
    /// Of Bayes: what is free counts.
    criterion: f64,
}

/// Forms of one cause compete here: the better stays.
fn candidates(decays: &Decays, parent: &Fit) -> Vec<Candidate> {
    let misfit = parent.misfit(decays);
    let plain = Noise::white(&sizes(&misfit, decays));
    let lines = [Term::Line(Line::Mode), Term::Line(Line::Tone)];
    let all = Term::NAMED.into_iter().chain(lines).chain(unnamed().map(Term::Unnamed));
    let samples = decays.y.len() as f64;
    let before = deviance(&misfit, decays);
    let mut kept: Vec<Candidate> = Vec::new();
    for term in all.filter(|term| term.may_join(&parent.terms)) {
        for fit in children(decays, parent, term, &plain, &misfit) {
            let left = fit.misfit(decays);
            let after = deviance(&left, decays);
            let degrees = fit.p.len() - parent.p.len();
            let share = 1.0 - ((after - before) / samples).exp();
            let criterion = after + degrees as f64 * samples.ln();
            let covariance = fit.covariance(decays, &Noise::white(&sizes(&left, decays)));
            let objection = objection(decays, &fit, parent.terms.len(), &covariance);
            let tried =
                Tried { term, fit, statistic: 0.0, degrees, surprise: 0.0, share, objection };
            let one = Candidate { tried, criterion };
            // what can be the cause goes before what cannot
            let rank = |c: &Candidate| (c.tried.objection.is_some(), c.criterion);
            // forms of one cause are one
            match kept.iter_mut().find(|c| c.tried.term.id() == term.id()) {
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
    t.fit = fit::descend(decays, &t.fit, noise);
    if !t.term.is_line() {
        // nor worse than the parent in this metric
        let from_parent = fit::descend(decays, &parent.with(decays, t.term), noise);
        if from_parent.cost < t.fit.cost {
            t.fit = from_parent;
        }
    }
    t.statistic = (parent.cost - t.fit.cost).max(0.0);
    let free = decays.y.len() as f64 - t.fit.p.len() as f64;
    t.surprise = surprise(t.statistic, t.degrees, t.term.places(decays), free);
    let covariance = t.fit.covariance(decays, noise);
    t.objection = objection(decays, &t.fit, parent.terms.len(), &covariance);
    let little = match t.term {
        Term::Line(_) => t.share < FEW,
        _ => noise.predictable() > HALF && t.statistic < LEFT_TO_SHAPES * parent.cost,
    };
    if t.objection.is_none() && little {
        t.objection = Some(Objection::Little);
    }
    t
}

fn row(t: &Tried, step: u32, samples: f64) -> Evidence {
    let lines = if t.term.is_line() { samples / 2.0 } else { 1.0 };
    let surprise = |x: f64| surprise(x, t.degrees, lines, f64::INFINITY);
    Evidence {
        step,
        id: t.term.id(),
        statistic: t.statistic,
        threshold: statistic_of(THRESHOLD, surprise),
        p: (-t.surprise).exp(),
        delta_bic: t.statistic - t.degrees as f64 * samples.ln(),
        strength_dl: (t.statistic / DETECTION_LIMIT).sqrt(),
        value: f64::NAN,
        sd: f64::NAN,
        tested: true,
        accepted: false,
        why_not: t.why_not(),
    }
}

pub fn select(decays: &Decays, stages: &mut dyn FnMut(&str)) -> Selected {
    stages("fitting one damped oscillation");
    let baseline = baseline(decays);
    let samples = decays.y.len() as f64;
    let mut now = baseline.clone();
    let mut causes: Vec<Chosen> = Vec::new();
    let (mut evidence, mut unnamed) = (Vec::new(), Vec::new());
    for step in 0..=MOST_TERMS as u32 {
        stages("trying what may be added");
        let mut tried = try_all(decays, &now);
        tried.sort_by(|p, q| q.statistic.total_cmp(&p.statistic));
        let rows = evidence.len();
        let named = tried.iter().filter(|t| t.term.id().has_name());
        evidence.extend(named.map(|t| row(t, step, samples)));
        unnamed = tried
            .iter()
            .filter(|t| t.surprise > THRESHOLD && t.objection.is_some())
            .cloned()
            .collect();
        // names are of one number or two, rivals too: each is paid for as Bayes' criterion does
        let penalised = |t: &Tried| t.statistic - t.degrees as f64 * samples.ln();
        // what strong causes leave to what has no name, and less than one detection limit, is nothing
        let left = LEFT_BY_ALL * causes.iter().map(|c| c.statistic).fold(0.0, f64::max);
        let least = |t: &Tried| match t.term {
            Term::Unnamed(_) => left.max(DETECTION_LIMIT),
            _ => 0.0,
        };
        let passes = |t: &&Tried| t.objection.is_none() && t.surprise > THRESHOLD;
        let able = |t: &&Tried| passes(t) && t.statistic >= least(t);
        let mut rivals: Vec<&Tried> = tried.iter().filter(able).collect();
        rivals.sort_by(|p, q| penalised(q).total_cmp(&penalised(p)));
        let Some(likeliest) = rivals.first().filter(|_| (step as usize) < MOST_TERMS) else {
            break;
        };
        // of what cannot be told apart, what has a name enters, tied with what has none
        let close = |t: &&&Tried| penalised(likeliest) - penalised(t) < TIE;
        let named = rivals.iter().filter(close).find(|t| t.term.id().has_name());
        let best = named.unwrap_or(likeliest);
        let others = tried.iter().filter(|t| t.term != best.term && passes(t));
        let tied = others.filter(|t| penalised(best) - penalised(t) < TIE).map(|t| t.term.id());
        let (tied_with, tied_unnamed) = tied.partition(|id| id.has_name());
        for e in &mut evidence[rows..] {
            if best.term.id() == e.id {
                e.accepted = true;
                e.why_not = String::new();
            } else if rivals.iter().any(|r| r.term.id() == e.id) {
                e.why_not = EXPLAINS_MORE.into();
            }
        }
        causes.push(Chosen {
            term: best.term,
            statistic: best.statistic,
            degrees: best.degrees,
            tied_with,
            tied_unnamed,
        });
        let newcomer = best.term;
        let lines = |fit: &Fit| fit.terms.iter().filter(|term| term.is_line()).count();
        let lines_before = lines(&now);
        now = best.fit.clone();
        let there = causes.len();
        eliminate(decays, &mut now, &mut causes);
        exchange(decays, &mut now, &mut causes);
        if causes.len() < there && !causes.iter().any(|c| c.term == newcomer) {
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
fn eliminate(decays: &Decays, now: &mut Fit, causes: &mut Vec<Chosen>) {
    loop {
        let noise = Noise::of(&now.misfit(decays), decays, now.p.len());
        *now = fit::descend(decays, now, &noise);
        let covariance = now.covariance(decays, &noise);
        let mut weakest: Option<(usize, Fit, f64)> = None;
        for (i, chosen) in causes.iter_mut().enumerate() {
            let parent = fit::descend(decays, &now.without(decays, |k| k == i), &noise);
            chosen.statistic = (parent.cost - now.cost).max(0.0);
            let free = decays.y.len() as f64 - now.p.len() as f64;
            let mut surprise =
                surprise(chosen.statistic, chosen.degrees, chosen.term.places(decays), free);
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
