//! Selects the terms that a long decay asks for: forward selection and backward elimination by full refits.
//!
//! In: decays. Out: [`Selected`]. The search itself is that of all plants (`search.rs`); this file says:
//!
//! 1. `tried`: each term that may join is fitted beside the parent, which is the model so far (`candidates`),
//!    and compared in the metric of the noise that the best candidate leaves (`judged`). A coefficient of the
//!    unphysical sign, or a line that is an alias of something else, is an objection (`objections`).
//! 2. `round`: candidates that passed compete by BIC.
//! 3. `settled`: terms that are now superfluous go (`eliminate`), and a rival without a name gives way to a
//!    named term that explains as much beside all others (`exchange`).
//!
//! Causes and the fit's terms stand in the same order, so one index serves both.

use super::children::{Added, baseline, children};
use super::decays::Decays;
use super::fit::{Fit, Noise};
use super::motion::Form;
use super::objections::objection;
use super::terms::{Line, Term};
use super::unnamed::unnamed;
use crate::critique::candidate::{Candidate, Chosen};
use crate::critique::chance::{DETECTION_LIMIT, THRESHOLD, surprise};
use crate::critique::finding::Evidence;
use crate::critique::objection::Objection;
use crate::critique::search::{Contender, ExplainedModel, Round, System, search};
use crate::critique::tuned::{LEFT_BY_ALL, LEFT_TO_SHAPES, MOSTLY, TIE};
use crate::critique::work::{self, Stage, Work};
use inkling_core::numbers::LITTLE;
use inkling_core::side_by_side::{cores, side_by_side};
use nalgebra::DMatrix;
use std::ops::ControlFlow;

pub type Tried<'a> = Candidate<Added<'a>>;

pub struct Selected<'a> {
    pub baseline: Fit<'a>,
    /// The final model; the noise that it leaves, and the covariance of its numbers.
    pub fit: Fit<'a>,
    pub noise: Noise,
    pub covariance: DMatrix<f64>,
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

    /// The causes that keep their name, with their indices: those that explain more than any rival in the
    /// model, and beside other causes more than one detection limit.
    pub fn named(&self) -> impl Iterator<Item = (usize, &Chosen<Added<'a>>)> {
        let rival = self.strongest_rival().map_or(0.0, |rival| rival.statistic);
        let least = if self.causes.len() > 1 { rival.max(DETECTION_LIMIT) } else { rival };
        let is_named = move |c: &Tried| c.has_name() && c.statistic > least;
        self.causes.iter().enumerate().filter(move |(_, c)| is_named(&c.candidate))
    }
}

/// -2 ln likelihood in white noise whose variance was estimated, up to a constant: n ln(size²),
/// summed over outputs.
fn deviance(fit: &Fit) -> f64 {
    let count = (fit.decays.samples * fit.decays.bursts) as f64;
    fit.sizes().iter().map(|s| 2.0 * count * s.ln()).sum()
}

/// Fits all candidates beside the parent's terms, in white noise. Of forms of one cause, and places of a
/// line, the best stays.
fn candidates<'a>(parent: &Fit<'a>) -> Vec<Tried<'a>> {
    let decays = parent.decays;
    let plain = Noise::white(&parent.sizes());
    let all = Term::NAMED
        .into_iter()
        .chain(Line::ALL.map(Term::Line))
        .chain(unnamed().map(Term::Unnamed));
    let before = deviance(parent);
    let mut kept: Vec<Tried> = Vec::new();
    let terms: Vec<Term> = all.filter(|term| term.may_join(&parent.terms)).collect();
    let fits = side_by_side(cores(), terms.clone(), |term| children(parent, term, &plain));
    for (term, fits) in terms.into_iter().zip(fits) {
        for fit in fits {
            let after = deviance(&fit);
            // share of the parent's squares that the term takes away (outputs by their geometric mean)
            let share = 1.0 - ((after - before) / decays.y.len() as f64).exp();
            let covariance = fit.covariance(&Noise::white(&fit.sizes()));
            let one = Candidate {
                degrees: fit.p.len() - parent.p.len(),
                tried: term.places(decays),
                objection: objection(&fit, parent.terms.len(), &covariance),
                ..Candidate::plain(term.id(), before - after, Added { term, fit, share })
            };
            let rank = |c: &Tried| (!c.able(), -c.delta_bic(decays.ln_samples()));
            match kept.iter_mut().find(|c| c.id == term.id()) {
                Some(known) if rank(&one) < rank(known) => *known = one,
                Some(_) => {}
                None => kept.push(one),
            }
        }
    }
    kept
}

/// Refits a candidate in the given noise, and decides whether it can be the cause. Its statistic becomes the
/// fall of the cost, which is -2 ln likelihood in that noise. `parent`: fitted in the same noise.
fn judged<'a>(mut t: Tried<'a>, parent: &Fit<'a>, noise: &Noise) -> Tried<'a> {
    let Added { term, fit, share } = &mut t.form;
    *fit = fit.descend(noise);
    if !term.is_line() {
        let from_parent = parent.with(*term).descend(noise);
        if from_parent.cost < fit.cost {
            *fit = from_parent;
        }
    }
    t.statistic = (parent.cost - fit.cost).max(0.0);
    t.surprise = surprise(t.statistic, t.degrees, t.tried, fit.degrees_of_freedom());

    // where more than half of the misfit can be predicted from itself, any term takes some of it: a little (a
    // tenth of the squares for a line, 3 % of the cost else) is not enough
    let coloured = noise.predictable() > MOSTLY;
    let little = coloured
        && match term.is_line() {
            true => *share < LITTLE,
            false => t.statistic < LEFT_TO_SHAPES * parent.cost,
        };
    t.objection = objection(fit, parent.terms.len(), &fit.covariance(noise))
        .or(little.then_some(Objection::TooWeak));
    t
}

impl<'a> System for &'a Decays {
    type Model = Fit<'a>;
    type Form = Added<'a>;
    const MOST_CAUSES: u32 = 12;
    const TIED_MAY_ENTER: bool = true;
    const TRYING: Stage = work::TERMS;

    fn work(&self) -> &Work {
        &self.work
    }

    /// All candidates, judged in the noise that the one with the largest gain in BIC would leave (of those
    /// without an objection); the largest statistic first.
    fn tried(&self, parent: &Fit<'a>) -> Vec<Tried<'a>> {
        let candidates = candidates(parent);
        let worth = |c: &Tried| c.delta_bic(self.ln_samples());
        let able = candidates.iter().filter(|c| c.able());
        let best = able.max_by(|p, q| worth(p).total_cmp(&worth(q)));
        let noise = best.map_or(parent, |best| &best.form.fit).noise();
        let parent = parent.descend(&noise);
        let mut all = side_by_side(cores(), candidates, |c| judged(c, &parent, &noise));
        all.sort_by(|p, q| q.statistic.total_cmp(&p.statistic));
        all
    }

    /// All candidates that passed compete by BIC. A rival that is no more than what strong causes leave, or
    /// less than one detection limit, may not enter.
    fn round(
        &self,
        _: &Fit<'a>,
        tried: &[Tried<'a>],
        chosen: &[Chosen<Added<'a>>],
    ) -> Round<Fit<'a>, Added<'a>> {
        let strongest = chosen.iter().map(|c| c.candidate.statistic).fold(0.0, f64::max);
        let least = (LEFT_BY_ALL * strongest).max(DETECTION_LIMIT);
        let contender = |t: &Tried<'a>| Contender {
            candidate: t.clone(),
            model: t.form.fit.clone(),
            penalised: -t.delta_bic(self.ln_samples()),
            may_enter: t.has_name() || t.statistic >= least,
        };
        let contenders: Vec<_> = tried.iter().filter(|t| t.accepted()).map(contender).collect();
        let may_enter = contenders.iter().filter(|r| r.may_enter).map(|r| r.penalised);
        Round { least: may_enter.fold(f64::INFINITY, f64::min), contenders }
    }

    /// The search breaks where the newcomer itself is gone again: it would come back for ever.
    fn settled(
        &self,
        mut now: Fit<'a>,
        causes: &mut Vec<Chosen<Added<'a>>>,
    ) -> ControlFlow<Fit<'a>, Fit<'a>> {
        let newcomer = causes.last().map(|c| c.candidate.form.term);
        let (there, lines) = (causes.len(), now.lines().count());
        eliminate(&mut now, causes);
        exchange(&mut now, causes);
        let is_there = causes.iter().any(|c| Some(c.candidate.form.term) == newcomer);
        let gone = causes.len() < there && !is_there
            || newcomer.is_some_and(Term::is_line) && now.lines().count() < lines;
        if gone { ControlFlow::Break(now) } else { ControlFlow::Continue(now) }
    }
}

pub fn select(decays: &Decays) -> Selected<'_> {
    decays.work.begins(work::OSCILLATION);
    let baseline = baseline(decays);
    let ExplainedModel { fitted, mut causes, evidence, unnamed } =
        search(&decays, baseline.clone(), decays.ln_samples());
    decays.work.begins(work::MEASURING);
    let noise = fitted.noise();
    let mut fit = fitted.descend(&noise);
    let more = better_form(&mut fit, &mut causes, &noise);
    let form_is_known = more > margin(&fit, &noise);
    let covariance = fit.covariance(&noise);
    Selected { baseline, fit, noise, covariance, causes, evidence, unnamed, form_is_known }
}

/// Takes out causes that the newcomer makes superfluous, or gives the wrong sign, the weakest first, and
/// measures all others: how much the cost rises if the cause is left out and all else fitted again.
fn eliminate<'a>(now: &mut Fit<'a>, causes: &mut Vec<Chosen<Added<'a>>>) {
    loop {
        let noise = now.noise();
        *now = now.descend(&noise);
        let covariance = now.covariance(&noise);
        let mut weakest: Option<(usize, Fit, f64)> = None;
        for (i, Chosen { candidate, .. }) in causes.iter_mut().enumerate() {
            let parent = now.without(|k| k == i).descend(&noise);
            candidate.statistic = (parent.cost - now.cost).max(0.0);
            let Candidate { statistic, degrees, tried, .. } = *candidate;
            let surprise = match objection(now, i, &covariance) {
                Some(_) => 0.0,
                None => surprise(statistic, degrees, tried, now.degrees_of_freedom()),
            };
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
    fit.cost + fit.p.len() as f64 * fit.decays.ln_samples()
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
        let possible =
            |fit: &Fit| objection(fit, left.terms.len(), &fit.covariance(&noise)).is_none();
        let named = Term::NAMED.into_iter().filter(|term| term.may_join(&left.terms));
        let best = named
            .flat_map(|term| children(&left, term, &noise))
            .filter(possible)
            .min_by(|p, q| criterion(p).total_cmp(&criterion(q)));
        let Some(fit) = best else { continue };
        if criterion(&fit) < criterion(now) + margin(now, &noise) {
            let mut cause = causes.remove(index);
            let term = fit.terms[left.terms.len()];
            cause.candidate.id = term.id();
            cause.candidate.degrees = fit.p.len() - left.p.len();
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
    let other = match now.terms[index] {
        Term::Stiffness(Form::Cubic) => Term::Stiffness(Form::Sine),
        _ => Term::Stiffness(Form::Cubic),
    };
    let mut fit = now.clone();
    fit.terms[index] = other;
    let fit = fit.descend(noise);
    let more = now.cost - fit.cost;
    if more > 0.0 && objection(&fit, index, &fit.covariance(noise)).is_none() {
        (causes[index].candidate.form.term, *now) = (other, fit);
    }
    more.abs()
}
