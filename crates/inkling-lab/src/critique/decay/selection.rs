//! Selects the terms that a long decay asks for: forward selection and backward elimination by full refits.
//!
//! In: decays. Out: [`Selected`]. The search itself is that of all plants (`search.rs`); this file says:
//!
//! 1. `candidates`: each term that may join is fitted beside the parent, which is the model so far, in white
//!    noise: coloured noise hides a mode, which the samples before predict as well. What it explains must yet
//!    be more than chance in the colour of what the best of them leaves. A coefficient of the unphysical
//!    sign is an objection (`children`).
//! 2. `round`: candidates that passed compete by BIC, so whether a line is a mode, a tone, a harmonic or a
//!    side band is one comparison.
//! 3. `settled`: terms that are now superfluous go (`eliminate`), a rival without a name gives way to a named term
//!    that explains as much beside all others (`exchange`), and what the sensor shows at rest is compared anew (`rest`).
//!
//! Causes and the fit's terms stand in the same order.

use super::children::{Added, baseline, child, objection};
use super::decays::Decays;
use super::motion::Form;
use super::noise::Noise;
use super::plant::{AtRest, Fit};
use super::rest;
use super::terms::{Line, Term, unnamed};
use crate::critique::candidate::{Candidate, Chosen, Objection};
use crate::critique::catalogue::CauseId;
use crate::critique::chance::{DETECTION_LIMIT, THRESHOLD, surprise};
use crate::critique::finding::Evidence;
use crate::critique::search::{Contender, ExplainedModel, System, search};
use crate::critique::tuned::{LEFT_BY_ALL, LEFT_TO_SHAPES, MOSTLY, TIE};
use crate::critique::work::{self, Stage, Work};
use inkling_core::numbers::LITTLE;
use inkling_core::side_by_side::{cores, side_by_side};
use nalgebra::DMatrix;
use std::ops::ControlFlow;

/// Causes that bend the ring itself.
const BENT: [CauseId; 3] = [CauseId::CubicStiffness, CauseId::QuadraticDrag, CauseId::DryFriction];

pub type Tried<'a> = Candidate<Added<'a>>;

pub struct Selected<'a> {
    pub baseline: Fit<'a>,
    /// The final model; the noise that it leaves, and the covariance of its numbers.
    pub fit: Fit<'a>,
    pub noise: Noise,
    pub covariance: DMatrix<f64>,
    /// The final model without what has no name, fitted anew: what can be told of it as numbers. None: all of it can.
    pub told: Option<(Fit<'a>, DMatrix<f64>)>,
    /// That all decays share.
    pub offset: Candidate,
    /// One for each term of `fit`, rivals among them.
    pub causes: Vec<Chosen<Added<'a>>>,
    pub evidence: Vec<Evidence>,
    /// Candidates of the last step that pass but cannot be the cause.
    pub unnamed: Vec<Tried<'a>>,
    /// Whether one form of the spring explains clearly more than the other.
    pub form_is_known: bool,
}

impl<'a> Selected<'a> {
    pub fn strongest_rival(&self) -> Option<&Tried<'a>> {
        let rivals = self.causes.iter().map(|c| &c.candidate).filter(|c| !c.has_name());
        rivals.max_by(|p, q| p.statistic.total_cmp(&q.statistic))
    }

    /// What its numbers are told of, with their covariance.
    pub fn told(&self) -> (&Fit<'a>, &DMatrix<f64>) {
        self.told.as_ref().map_or((&self.fit, &self.covariance), |(fit, of)| (fit, of))
    }

    /// Whether a cause, or the offset, keeps its name: if it explains more than any rival in the model, and beside
    /// other causes more than one detection limit.
    pub fn is_named<Form>(&self, cause: &Candidate<Form>) -> bool {
        let rival = self.strongest_rival().map_or(0.0, |rival| rival.statistic);
        let least = if self.causes.is_empty() { rival } else { rival.max(DETECTION_LIMIT) };
        cause.has_name() && cause.accepted() && cause.statistic > least
    }

    /// What keeps its name; of several lines each.
    pub fn named(&self) -> Vec<CauseId> {
        let causes = self.causes.iter().map(|c| &c.candidate).filter(|c| self.is_named(c));
        let offset = self.is_named(&self.offset).then_some(CauseId::Offset);
        causes.map(|c| c.id).chain(offset).collect()
    }
}

/// -2 ln likelihood in white noise whose variance was estimated, up to a constant: n ln(size²),
/// summed over outputs.
fn deviance(fit: &Fit) -> f64 {
    let count = (fit.decays.samples * fit.decays.bursts) as f64;
    fit.sizes().iter().map(|s| 2.0 * count * s.ln()).sum()
}

/// By how much the misfit's squares fall from the parent to the fit, as a noise sees them.
pub fn fall(parent: &Fit, fit: &Fit, noise: &Noise) -> f64 {
    let seen = |of: &Fit| noise.seen(&of.misfit(), of.decays.samples);
    (seen(parent) - seen(fit)).max(0.0)
}

/// By how much BIC falls from the parent to the fit, in white noise.
pub fn gain_in_bic(parent: &Fit, fit: &Fit) -> f64 {
    let more = fit.parameters() as f64 - parent.parameters() as f64;
    deviance(parent) - deviance(fit) - more * fit.decays.ln_samples()
}

/// Fits terms beside the parent's, in white noise, and tests them in the noise that the best of them leaves:
/// their statistic is the fall of the misfit's squares as that noise sees them. Of forms of one cause the
/// best stays. What bends the ring shifts its mean, so each is fitted beside a drift and without.
fn candidates<'a>(parent: &Fit<'a>, terms: Vec<Term>) -> Vec<Tried<'a>> {
    let white = Noise::white(&parent.sizes());
    let without = parent.drift().map(|_| parent.resting(AtRest::Offset).descend(&white));
    let likeliest = |term| {
        let parents = std::iter::once(parent).chain(&without);
        let fits = parents.filter_map(|parent| child(parent, term, &white));
        fits.max_by(|p, q| gain_in_bic(parent, p).total_cmp(&gain_in_bic(parent, q)))
    };
    let fits = side_by_side(cores(), terms.clone(), likeliest);
    let mut kept: Vec<Tried> = Vec::new();
    for (term, fit) in terms.into_iter().zip(fits) {
        let Some(fit) = fit else { continue };
        // share of the parent's squares that the term takes away (outputs by their geometric mean)
        let more = deviance(&fit) - deviance(parent);
        let share = 1.0 - (more / parent.decays.y.len() as f64).exp();
        let covariance = fit.covariance(&Noise::white(&fit.sizes()));
        let bic = gain_in_bic(parent, &fit);
        let one = Candidate {
            degrees: fit.parameters().saturating_sub(parent.parameters()).max(1),
            tried: term.places(parent.decays),
            objection: objection(&fit, parent.terms.len(), &covariance),
            ..Candidate::plain(term.id(), -more, Added { term, fit, share, bic })
        };
        let rank = |c: &Tried| (!c.able(), -c.form.bic);
        match kept.iter_mut().find(|c| c.id == term.id()) {
            Some(known) if rank(&one) < rank(known) => *known = one,
            Some(_) => {}
            None => kept.push(one),
        }
    }

    let able = kept.iter().filter(|c| c.able());
    let best = able.max_by(|p, q| p.form.bic.total_cmp(&q.form.bic));
    let noise = best.map_or(parent, |best| &best.form.fit).noise();
    kept.iter_mut().for_each(|candidate| judge(candidate, parent, &noise));
    kept.sort_by(|p, q| q.statistic.total_cmp(&p.statistic));
    kept
}

/// Where more than half of the misfit can be predicted from itself, any term takes some of it: a little (a
/// tenth of the squares for a line, 3 % of the cost else) is not enough.
fn judge(candidate: &mut Tried, parent: &Fit, noise: &Noise) {
    let Added { term, fit, share, .. } = &candidate.form;
    let before = noise.seen(&parent.misfit(), parent.decays.samples);
    candidate.statistic = fall(parent, fit, noise);
    let Candidate { statistic, degrees, tried, .. } = *candidate;
    candidate.surprise = surprise(statistic, degrees, tried, fit.degrees_of_freedom());
    let little = noise.predictable() > MOSTLY
        && match term.is_line() {
            true => *share < LITTLE,
            false => statistic < LEFT_TO_SHAPES * before,
        };
    candidate.objection = candidate.objection.or(little.then_some(Objection::TooWeak));
}

impl<'a> System for &'a Decays {
    type Model = Fit<'a>;
    type Form = Added<'a>;
    const MOST_CAUSES: u32 = 14;
    const TIED_MAY_ENTER: bool = true;
    const RIVALS_MAY_ENTER: bool = true;
    const TRYING: Stage = work::TERMS;

    fn work(&self) -> &Work {
        &self.work
    }

    /// All candidates, the largest statistic first. What has several modes is first asked for further ones
    /// alone: nothing else explains so much of it, and each is found in a moment.
    fn tried(&self, parent: &Fit<'a>) -> Vec<Tried<'a>> {
        let may_join = |terms: Vec<Term>| -> Vec<Term> {
            terms.into_iter().filter(|term| term.may_join(&parent.terms)).collect()
        };
        let lines = || Line::all().map(Term::Line).collect::<Vec<Term>>();
        let is_mode = |term: &&Term| **term == Term::Line(Line::Mode);
        if parent.terms.iter().filter(is_mode).count() >= 2 {
            let tried = candidates(parent, may_join(lines()));
            if tried.iter().any(|c| c.accepted() && c.form.bic > 0.0) {
                return tried;
            }
        }
        let all = Term::NAMED.into_iter().chain(lines()).chain(unnamed().map(Term::Unnamed));
        candidates(parent, may_join(all.collect()))
    }

    /// All candidates that passed compete by BIC, but a line that something without a name makes as well: the
    /// ring itself needs no further cause. (Side bands, which hold any line, are no such thing.) A rival that is
    /// no more than what strong causes leave, or less than one detection limit, is weak.
    fn round(
        &self,
        _: &Fit<'a>,
        tried: &[Tried<'a>],
        chosen: &[Chosen<Added<'a>>],
    ) -> Vec<Contender<Fit<'a>, Added<'a>>> {
        let strongest = chosen.iter().map(|c| c.candidate.statistic).fold(0.0, f64::max);
        let least = (LEFT_BY_ALL * strongest).max(DETECTION_LIMIT);
        let contender = |t: &Tried<'a>| Contender {
            candidate: t.clone(),
            model: t.form.fit.clone(),
            // a pair of lines counts by what each of them gains
            penalised: -t.form.bic / if t.id == CauseId::GainSways { 2.0 } else { 1.0 },
            is_weak: !t.has_name() && t.statistic < least,
        };
        let passed = tried.iter().filter(|t| t.accepted() && t.form.bic > 0.0);
        let mut contenders: Vec<_> = passed.map(contender).collect();
        let made = contenders.iter().filter(|r| !r.candidate.has_name());
        let made = made.filter(|r| r.candidate.id != CauseId::GainSways);
        let made = made.map(|r| r.penalised).fold(f64::INFINITY, f64::min);
        // what a bent ring's model leaves of it may look like a line
        let bends = |c: &Chosen<Added<'a>>| BENT.contains(&c.candidate.id);
        let least_line = if chosen.iter().any(bends) { LEFT_BY_ALL * strongest } else { 0.0 };
        contenders.retain(|r| {
            let is_line = r.candidate.has_name() && r.candidate.form.term.is_line();
            let is_own = made >= r.penalised + TIE && r.candidate.statistic >= least_line;
            !is_line || is_own
        });
        contenders
    }

    /// The search breaks where the newcomer itself is gone again: it would come back for ever.
    fn settled(
        &self,
        mut now: Fit<'a>,
        causes: &mut Vec<Chosen<Added<'a>>>,
    ) -> ControlFlow<Fit<'a>, Fit<'a>> {
        let newcomer = causes.last().map(|c| c.candidate.form.term);
        let (there, lines) = (causes.len(), now.lines());
        let alone = newcomer == Some(Term::Line(Line::Mode)) && lines == causes.len();
        if !alone {
            eliminate(&mut now, causes);
            exchange(&mut now, causes);
        }
        now = rest::compared(now);
        let is_there = causes.iter().any(|c| Some(c.candidate.form.term) == newcomer);
        let gone = causes.len() < there && !is_there
            || newcomer.is_some_and(Term::is_line) && now.lines() < lines;
        if gone { ControlFlow::Break(now) } else { ControlFlow::Continue(now) }
    }
}

pub fn select(decays: &Decays) -> Selected<'_> {
    decays.work.begins(work::OSCILLATION);
    let baseline = baseline(decays);
    let ExplainedModel { mut fitted, mut causes, evidence, unnamed } =
        search(&decays, rest::compared(baseline.clone()), decays.ln_samples());
    decays.work.begins(work::MEASURING);
    eliminate(&mut fitted, &mut causes);
    let noise = fitted.noise();
    // the autoregression of what is left of many modes holds most of every mode
    let mut fit = if fitted.lines() > 0 { fitted } else { fitted.descend(&noise) };
    let more = better_form(&mut fit, &mut causes, &noise);
    let form_is_known = more > margin(&fit, &noise);
    let covariance = fit.covariance(&noise);
    let is_untold = |term: &Term| !term.id().has_name();
    let told = fit.terms.iter().any(is_untold).then(|| {
        let told = fit.without(|i| is_untold(&fit.terms[i]));
        let told = told.descend(&Noise::white(&fit.sizes()));
        let covariance = told.covariance(&told.noise());
        (told, covariance)
    });
    let offset = rest::offset(&fit, &noise);
    Selected {
        baseline,
        fit,
        noise,
        covariance,
        told,
        offset,
        causes,
        evidence,
        unnamed,
        form_is_known,
    }
}

/// Takes out causes that the newcomer makes superfluous, or gives the wrong sign, the weakest first, and
/// measures all others: how much of the misfit comes back if the cause is left out and all else fitted again.
fn eliminate<'a>(now: &mut Fit<'a>, causes: &mut Vec<Chosen<Added<'a>>>) {
    loop {
        let noise = now.noise();
        let white = Noise::white(&now.sizes());
        *now = now.descend(&white);
        let covariance = now.covariance(&noise);
        let without = |i: usize| now.without(|k| k == i).descend(&white);
        let parents = side_by_side(cores(), (0..causes.len()).collect(), without);
        let mut weakest: Option<(usize, Fit, f64)> = None;
        for (i, (Chosen { candidate, .. }, parent)) in causes.iter_mut().zip(parents).enumerate() {
            if !parent.cost.is_finite() {
                continue; // without this cause the motion is lost
            }
            candidate.statistic = fall(&parent, now, &noise);
            let Candidate { statistic, degrees, tried, .. } = *candidate;
            let surprise = match objection(now, i, &covariance) {
                Some(_) => 0.0,
                None if gain_in_bic(&parent, now) < 0.0 => 0.0,
                None => surprise(statistic, degrees, tried, now.degrees_of_freedom()),
            };
            candidate.surprise = surprise;
            if surprise <= THRESHOLD && weakest.as_ref().is_none_or(|w| surprise < w.2) {
                weakest = Some((i, parent, surprise));
            }
        }
        // a cause alone in the model was judged when it entered: it stays
        let Some((i, parent, _)) = weakest.filter(|_| causes.len() > 1) else { return };
        causes.remove(i);
        *now = parent;
    }
}

/// Difference in -2 ln likelihood that tells two models apart. Where more than half of what they leave
/// follows from the samples before, it is their own error, and the difference must also be 3 % of the cost.
fn margin(now: &Fit, noise: &Noise) -> f64 {
    let coloured = noise.predictable() > MOSTLY;
    if coloured { TIE.max(LEFT_TO_SHAPES * now.cost) } else { TIE }
}

fn criterion(fit: &Fit) -> f64 {
    fit.cost + fit.parameters() as f64 * fit.decays.ln_samples()
}

/// Gives the place of a rival to a named candidate that explains as much (to within `margin`) beside all
/// causes that entered later, and is then tied with the rival. Forward selection alone would keep a rival
/// that explained a little more as long as its neighbours were missing.
fn exchange<'a>(now: &mut Fit<'a>, causes: &mut Vec<Chosen<Added<'a>>>) {
    let noise = now.noise();
    for rival in causes.iter().map(|cause| cause.candidate.form.term).collect::<Vec<Term>>() {
        let Term::Unnamed(id) = rival else { continue };
        let Some(index) = now.terms.iter().position(|term| *term == rival) else { continue };

        let left = now.without(|i| i == index).descend(&noise);
        if !left.cost.is_finite() {
            continue;
        }
        let possible =
            |fit: &Fit| objection(fit, left.terms.len(), &fit.covariance(&noise)).is_none();
        let named = Term::NAMED.into_iter().filter(|term| term.may_join(&left.terms));
        let best = named
            .filter_map(|term| child(&left, term, &noise))
            .filter(possible)
            .min_by(|p, q| criterion(p).total_cmp(&criterion(q)));
        let Some(fit) = best else { continue };
        if criterion(&fit) < criterion(now) + margin(now, &noise) {
            let mut cause = causes.remove(index);
            let term = fit.terms[left.terms.len()];
            cause.candidate.id = term.id();
            cause.candidate.degrees = fit.parameters() - left.parameters();
            cause.candidate.statistic = (left.cost - fit.cost).max(0.0);
            cause.candidate.form.term = term;
            cause.tied_unnamed.push(id);
            causes.push(cause);
            *now = fit;
        }
    }
}

/// Takes the form of the spring (cubic or sine) that explains more beside all else, if nothing speaks against
/// it; returns by how much more than the other, in -2 ln likelihood.
fn better_form(now: &mut Fit, causes: &mut [Chosen<Added>], noise: &Noise) -> f64 {
    let is_spring = |term: &Term| matches!(term, Term::Stiffness(_));
    let Some(index) = now.terms.iter().position(is_spring) else { return 0.0 };
    let forms = [Form::Cubic, Form::Sine].map(Term::Stiffness);
    let other = forms[usize::from(now.terms[index] == forms[0])];
    let mut fit = now.clone();
    fit.terms[index] = other;
    let fit = fit.descend(noise);
    let more = now.cost - fit.cost;
    if more > 0.0 && objection(&fit, index, &fit.covariance(noise)).is_none() {
        (causes[index].candidate.form.term, *now) = (other, fit);
    }
    more.abs()
}
