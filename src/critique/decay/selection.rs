//! Which terms a long decay asks for: forward selection and backward elimination by full refits.
//!
//! In: decays. Out: [`Selected`]. Every candidate starts at its parent's optimum (and once more from
//! the first swings on), so that it never ends worse; it is judged in the metric of the noise that the
//! best of the candidates leaves; a coefficient of the unphysical sign, and a line that is an alias of
//! something else, cannot be the cause.

use super::fit::{self, Fit, Noise, sizes};
use super::motion::Form;
use super::objections::{Objection, line_objection, lowest_line, objection};
use super::plant::{Decays, Line, OMEGA, SIGMA, Structure};
use super::spectrum;
use super::terms::Term;
use super::unnamed::{moves_phase, second_numbers, unnamed};
use crate::critique::catalogue::CauseId;
use crate::critique::chance::{DETECTION_LIMIT, THRESHOLD, statistic_of, surprise};
use crate::critique::finding::{EXPLAINS_MORE, Evidence, NOT_SIGNIFICANT};
use crate::critique::tuned::{FEW, HALF, LEFT_BY_ALL, LEFT_TO_SHAPES, TIE};
use nalgebra::DMatrix;
use std::f64::consts::TAU;

/// Terms that are looked for at most.
const MOST_TERMS: usize = 12;
/// Peaks of the misfit's spectrum at which a line is tried.
const PEAKS: usize = 3;

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

#[derive(Clone, Debug)]
pub struct Chosen {
    pub term: Term,
    /// Which line it is.
    pub line: usize,
    pub statistic: f64,
    pub degrees: usize,
    pub tied_with: Vec<CauseId>,
    /// Rivals without a name that explain as much.
    pub tied_unnamed: Vec<CauseId>,
}

impl Chosen {
    /// Whether it has a name, and explains more than any rival without one that is in the model, too.
    pub fn is_named(&self, all: &[Chosen]) -> bool {
        let unnamed = all.iter().filter(|c| !c.term.id().has_name());
        self.term.id().has_name()
            && unnamed.map(|c| c.statistic).fold(0.0, f64::max) < self.statistic
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
}

/// Samples that three swings take.
fn first_swings(omega: f64) -> usize {
    (3.0 * TAU / omega.max(1e-6)).ceil().min(1e7) as usize
}

/// Power of the misfits of all bursts and outputs, each output in its own size.
fn misfit_power(misfit: &[f64], decays: &Decays) -> Vec<f64> {
    let sizes = sizes(misfit, decays);
    let mut sum: Vec<f64> = Vec::new();
    for (i, series) in misfit.chunks(decays.samples).enumerate() {
        let mean = series.iter().sum::<f64>() / series.len() as f64;
        let scaled: Vec<f64> =
            series.iter().map(|r| (r - mean) / sizes[i % decays.outputs]).collect();
        let power = spectrum::power(&scaled);
        if sum.is_empty() {
            sum = power;
        } else {
            sum.iter_mut().zip(power).for_each(|(s, p)| *s += p);
        }
    }
    sum
}

/// The damped oscillation that explains most. It is looked for beside an offset, so that it does not
/// slow down to stand in for one.
pub fn baseline(decays: &Decays) -> Fit {
    let plain = Structure::default();
    let beside = Structure { offset: true, ..Structure::default() };
    let layout = beside.layout(decays.bursts, decays.outputs);
    let white = Noise::white(&vec![1.0; decays.outputs]);
    let resolution = TAU / decays.samples as f64;
    let power = misfit_power(&decays.y, decays);
    let mut found: Option<Fit> = None;
    for omega in spectrum::peaks(&power, lowest_line(decays), 2.0 * resolution, 2) {
        for turns in [0.5, 4.0] {
            let mut p = vec![0.0; layout.count];
            p[OMEGA] = omega;
            p[SIGMA] = turns / decays.samples as f64;
            let ways = [
                fit::follow(decays, &beside, &p, &white, first_swings(omega)),
                fit::descend(decays, &beside, &p, &white, decays.samples),
            ];
            for fit in ways {
                if found.as_ref().is_none_or(|f| fit.cost < f.cost) {
                    found = Some(fit);
                }
            }
        }
    }
    let p = match found {
        Some(fit) => plain.carried(&beside, &fit.p, decays),
        None => {
            let mut p = vec![0.0; plain.layout(decays.bursts, decays.outputs).count];
            p[OMEGA] = lowest_line(decays);
            p
        }
    };
    fit::descend(decays, &plain, &p, &white, decays.samples)
}

/// Starts of a candidate: its parent's optimum first.
fn starts(decays: &Decays, parent: &Fit, term: Term, misfit: &[f64]) -> Vec<Vec<f64>> {
    let structure = term.put(&parent.structure);
    let warm = structure.carried(&parent.structure, &parent.p, decays);
    let layout = structure.layout(decays.bursts, decays.outputs);
    let line = match term {
        Term::Line(line) => line,
        Term::Unnamed(what) => {
            let seconds = second_numbers(what, decays.samples);
            let at = layout.unnamed[layout.unnamed.len() - 1].1 + 1;
            let from = |second: f64| {
                let mut p = warm.clone();
                p[at] = second;
                p
            };
            let all: Vec<Vec<f64>> = seconds.into_iter().map(from).collect();
            return if all.is_empty() { vec![warm] } else { all };
        }
        _ => return vec![warm],
    };
    let at = layout.lines[layout.lines.len() - 1];
    let resolution = TAU / decays.samples as f64;
    let power = misfit_power(misfit, decays);
    // what is in the model already leaves side lines: look elsewhere, too
    let known = layout.lines[..layout.lines.len() - 1].iter().map(|l| parent.p[l + 1]);
    let known: Vec<f64> = known.chain([parent.p[OMEGA]]).collect();
    let all_tops = spectrum::peaks(&power, lowest_line(decays), 2.0 * resolution, 40);
    let mut tops: Vec<f64> = all_tops.iter().copied().take(1).collect();
    let elsewhere = |w: &f64| known.iter().all(|k| (k - w).abs() > 0.05 * k + 2.0 * resolution);
    tops.extend(all_tops.into_iter().skip(1).filter(elsewhere).take(PEAKS - 1));
    let sigmas: &[f64] = match line {
        Line::Mode => &[1.0],
        Line::Tone => &[0.0],
    };
    let rate = parent.p[SIGMA].abs().max(1.0 / decays.samples as f64);
    let mut all = Vec::new();
    for omega in tops {
        for sigma in sigmas {
            let mut p = warm.clone();
            (p[at], p[at + 1]) = (sigma * rate, omega);
            all.push(p);
        }
    }
    all
}

/// Fits of a candidate, each from its parent's optimum on: of a line one per place and damping, of any other the best:
/// of several second numbers the likeliest is followed, and what moves the phase once more from the first swings on.
pub fn children(
    decays: &Decays,
    parent: &Fit,
    term: Term,
    noise: &Noise,
    misfit: &[f64],
) -> Vec<Fit> {
    let structure = term.put(&parent.structure);
    let starts = starts(decays, parent, term, misfit);
    let looks = || starts.iter().map(|start| fit::look(decays, &structure, start, noise));
    if matches!(term, Term::Line(_)) {
        return looks().collect();
    }
    let look = (starts.len() > 1)
        .then(looks)
        .and_then(|all| all.min_by(|p: &Fit, q: &Fit| p.cost.total_cmp(&q.cost)).map(|fit| fit.p));
    let start = look.as_ref().unwrap_or(&starts[0]);
    let best = fit::descend(decays, &structure, start, noise, decays.samples);
    let moves = match term {
        Term::Stiffness(_) | Term::Drag | Term::Friction => true,
        Term::Unnamed(what) => moves_phase(what),
        Term::Offset | Term::Line(_) => false,
    };
    if !moves {
        return vec![best];
    }
    let first = first_swings(parent.p[OMEGA]);
    let followed = fit::follow(decays, &structure, start, noise, first);
    vec![if followed.cost < best.cost { followed } else { best }]
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
    let parent = fit::descend(decays, &parent.structure, &parent.p, &noise, decays.samples);
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
    let named = [
        Term::Offset,
        Term::Stiffness(Form::Cubic),
        Term::Stiffness(Form::Sine),
        Term::Drag,
        Term::Friction,
        Term::Line(Line::Mode),
        Term::Line(Line::Tone),
    ];
    let all = named.into_iter().chain(unnamed().map(Term::Unnamed));
    let samples = decays.y.len() as f64;
    let before = deviance(&misfit, decays);
    let mut kept: Vec<Candidate> = Vec::new();
    for term in all.filter(|c| !c.is_in(&parent.structure)) {
        for fit in children(decays, parent, term, &plain, &misfit) {
            let left = fit.misfit(decays);
            let after = deviance(&left, decays);
            let degrees = fit.p.len() - parent.p.len();
            let share = 1.0 - ((after - before) / samples).exp();
            let criterion = after + degrees as f64 * samples.ln();
            let covariance = fit.covariance(decays, &Noise::white(&sizes(&left, decays)));
            let objection = objection(decays, &fit, term, &covariance);
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
    let from_own = fit::descend(decays, &t.fit.structure, &t.fit.p, noise, decays.samples);
    // nor worse than the parent in this metric
    let warm = t.fit.structure.carried(&parent.structure, &parent.p, decays);
    t.fit = match t.term {
        Term::Line(_) => from_own,
        _ => {
            let from_parent = fit::descend(decays, &t.fit.structure, &warm, noise, decays.samples);
            if from_parent.cost < from_own.cost { from_parent } else { from_own }
        }
    };
    t.statistic = (parent.cost - t.fit.cost).max(0.0);
    let free = decays.y.len() as f64 - t.fit.p.len() as f64;
    t.surprise = surprise(t.statistic, t.degrees, t.term.places(decays), free);
    let covariance = t.fit.covariance(decays, noise);
    t.objection = objection(decays, &t.fit, t.term, &covariance);
    let little = match t.term {
        Term::Line(_) => t.share < FEW,
        _ => noise.predictable() > HALF && t.statistic < LEFT_TO_SHAPES * parent.cost,
    };
    if t.objection.is_none() && little {
        t.objection = Some(Objection::Little);
    }
    t
}

/// Two modes of nearly the ring's own frequency, whatever their damping.
#[cfg(test)]
pub fn alias(decays: &Decays, parent: &Fit) -> Tried {
    let structure = Term::Line(Line::Mode).put(&parent.structure);
    let layout = structure.layout(decays.bursts, decays.outputs);
    let at = layout.lines[layout.lines.len() - 1];
    let noise = Noise::white(&sizes(&parent.misfit(decays), decays));
    let mut best: Option<Fit> = None;
    for (sigma, off) in [(-1.0, 1.5), (-1.0, -1.5), (-3.0, 0.5), (1.0, 1.5), (1.0, -1.5)] {
        let mut p = structure.carried(&parent.structure, &parent.p, decays);
        p[at] = sigma * parent.p[SIGMA].abs();
        p[at + 1] = parent.p[OMEGA] + off * TAU / decays.samples as f64;
        let fit = fit::descend(decays, &structure, &p, &noise, decays.samples);
        if best.as_ref().is_none_or(|b| fit.cost < b.cost) {
            best = Some(fit);
        }
    }
    let fit = best.unwrap();
    let covariance = fit.covariance(decays, &noise);
    let term = Term::Line(Line::Mode);
    let objection = objection(decays, &fit, term, &covariance);
    Tried { term, fit, statistic: 0.0, degrees: 0, surprise: 0.0, share: 0.0, objection }
}

fn row(t: &Tried, step: u32, samples: f64) -> Evidence {
    let lines = if matches!(t.term, Term::Line(_)) { samples / 2.0 } else { 1.0 };
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
            line: best.fit.structure.lines.len().max(1) - 1,
            statistic: best.statistic,
            degrees: best.degrees,
            tied_with,
            tied_unnamed,
        });
        let newcomer = best.term;
        let lines_before = now.structure.lines.len();
        now = best.fit.clone();
        let there = causes.len();
        eliminate(decays, &mut now, &mut causes);
        if causes.len() < there && !causes.iter().any(|c| c.term == newcomer) {
            break; // it would come and go for ever
        }
        let lines = now.structure.lines.len();
        if matches!(newcomer, Term::Line(_)) && lines <= lines_before {
            break;
        }
    }
    stages("measuring the causes");
    let noise = Noise::of(&now.misfit(decays), decays, now.p.len());
    let fit = fit::descend(decays, &now.structure, &now.p, &noise, decays.samples);
    let covariance = fit.covariance(decays, &noise);
    Selected { baseline, fit, noise, covariance, causes, evidence, unnamed }
}

/// A model without what some of its causes added, where it stood: nothing is fitted anew.
pub fn without(decays: &Decays, fit: &Fit, causes: &[Chosen], goes: impl Fn(Term) -> bool) -> Fit {
    let gone: Vec<&Chosen> = causes.iter().filter(|c| goes(c.term)).collect();
    let lines = gone.iter().filter(|c| matches!(c.term, Term::Line(_))).map(|c| c.line);
    let mut left = without_lines(decays, fit, &lines.collect::<Vec<usize>>());
    for chosen in gone {
        let mut structure = left.structure.clone();
        match chosen.term {
            Term::Offset => structure.offset = false,
            Term::Stiffness(_) => structure.stiffness = None,
            Term::Drag => structure.drag = false,
            Term::Friction => structure.friction = false,
            Term::Unnamed(what) => structure.unnamed.retain(|w| *w != what),
            Term::Line(_) => {}
        }
        left.p = structure.carried(&left.structure, &left.p, decays);
        left.structure = structure;
    }
    left
}

fn without_lines(decays: &Decays, fit: &Fit, gone: &[usize]) -> Fit {
    let layout = fit.structure.layout(decays.bursts, decays.outputs);
    let first = layout.lines.first().copied().unwrap_or(layout.count);
    let mut left = fit.clone();
    left.p.truncate(first);
    left.structure.lines.clear();
    for (i, at) in layout.lines.iter().enumerate().filter(|(i, _)| !gone.contains(i)) {
        let end = layout.lines.get(i + 1).copied().unwrap_or(layout.count);
        left.p.extend_from_slice(&fit.p[*at..end]);
        left.structure.lines.push(fit.structure.lines[i]);
    }
    left
}

/// What the newcomer makes superfluous, or gives the wrong sign, goes again.
fn eliminate(decays: &Decays, now: &mut Fit, causes: &mut Vec<Chosen>) {
    loop {
        let noise = Noise::of(&now.misfit(decays), decays, now.p.len());
        *now = fit::descend(decays, &now.structure, &now.p, &noise, decays.samples);
        let covariance = now.covariance(decays, &noise);
        let mut weakest: Option<(usize, Fit, f64)> = None;
        for (i, chosen) in causes.iter_mut().enumerate() {
            let left = without(decays, now, std::slice::from_ref(chosen), |_| true);
            let parent = fit::descend(decays, &left.structure, &left.p, &noise, decays.samples);
            chosen.statistic = (parent.cost - now.cost).max(0.0);
            let objection = match chosen.term {
                Term::Line(line) => line_objection(decays, now, line, chosen.line, &covariance),
                term => objection(decays, now, term, &covariance),
            };
            let free = decays.y.len() as f64 - now.p.len() as f64;
            let mut surprise =
                surprise(chosen.statistic, chosen.degrees, chosen.term.places(decays), free);
            if objection.is_some() {
                surprise = 0.0;
            }
            if surprise <= THRESHOLD && weakest.as_ref().is_none_or(|w| surprise < w.2) {
                weakest = Some((i, parent, surprise));
            }
        }
        // the newest was judged just now: it goes only where it has become unphysical itself
        let Some((i, parent, _)) = weakest.filter(|_| causes.len() > 1) else { return };
        let gone = causes.remove(i);
        if let Term::Line(_) = gone.term {
            for other in causes.iter_mut() {
                if matches!(other.term, Term::Line(_)) && other.line > gone.line {
                    other.line -= 1;
                }
            }
        }
        *now = parent;
    }
}
