//! Causes that entered a decay's model early, looked at again beside all that entered later.
//!
//! In: a model and its causes. Out: the same, or what explains as much in their place. Forward selection alone would keep a
//! rival without a name that explained a little more as long as its neighbours were missing.

use super::children::children;
use super::decays::Decays;
use super::fit::{self, Fit, Noise};
use super::motion::Form;
use super::objections::objection;
use super::terms::Term;
use crate::critique::candidate::{Candidate, Chosen};
use crate::critique::tuned::{HALF, LEFT_TO_SHAPES, TIE};

/// What two models must differ by to be told apart: where they leave noise, odds; where what they leave follows from the
/// samples before, it is their own error, and a share of that.
pub fn margin(now: &Fit, noise: &Noise) -> f64 {
    let coloured = noise.predictable() > HALF;
    if coloured { TIE.max(LEFT_TO_SHAPES * now.cost) } else { TIE }
}

/// Of Bayes, in units of -2 ln likelihood: what is free counts.
fn criterion(decays: &Decays, fit: &Fit) -> f64 {
    fit.cost + fit.p.len() as f64 * (decays.y.len() as f64).ln()
}

/// What has no name gives way to what has one, where that explains as much beside the other causes.
pub fn exchange(decays: &Decays, now: &mut Fit, causes: &mut Vec<Chosen<Term>>) {
    let noise = Noise::of(&now.misfit(decays), decays, now.p.len());
    for rival in causes.iter().map(|cause| cause.candidate.form).collect::<Vec<Term>>() {
        let Term::Unnamed(id) = rival else { continue };
        let Some(index) = now.terms.iter().position(|term| *term == rival) else { continue };
        let left = fit::descend(decays, &now.without(decays, |i| i == index), &noise);
        let misfit = left.misfit(decays);
        let fits = |term: Term| children(decays, &left, term, &noise, &misfit);
        let possible = |fit: &Fit| {
            objection(decays, fit, left.terms.len(), &fit.covariance(decays, &noise)).is_none()
        };
        let named = Term::NAMED.into_iter().filter(|term| term.may_join(&left.terms));
        let best = named
            .flat_map(fits)
            .filter(possible)
            .min_by(|p, q| criterion(decays, p).total_cmp(&criterion(decays, q)));
        let Some(fit) = best else { continue };
        if criterion(decays, &fit) < criterion(decays, now) + margin(now, &noise) {
            let mut cause = causes.remove(index);
            let term = fit.terms[left.terms.len()];
            cause.candidate = Candidate {
                id: term.id(),
                degrees: fit.p.len() - left.p.len(),
                statistic: (left.cost - fit.cost).max(0.0),
                form: term,
                ..cause.candidate
            };
            cause.tied_unnamed.push(id);
            causes.push(cause);
            *now = fit;
        }
    }
}

/// A spring's form that explains more beside all else, and by how much more than the other.
pub fn better_form(
    decays: &Decays,
    now: &mut Fit,
    causes: &mut [Chosen<Term>],
    noise: &Noise,
) -> f64 {
    let is_spring = |term: &Term| matches!(term, Term::Stiffness(_));
    let Some(index) = now.terms.iter().position(is_spring) else { return 0.0 };
    let other = match now.terms[index] {
        Term::Stiffness(Form::Cubic) => Term::Stiffness(Form::Sine),
        _ => Term::Stiffness(Form::Cubic),
    };
    let mut start = now.clone();
    start.terms[index] = other;
    let fit = fit::descend(decays, &start, noise);
    let more = now.cost - fit.cost;
    if more > 0.0 && objection(decays, &fit, index, &fit.covariance(decays, noise)).is_none() {
        (causes[index].candidate.form, *now) = (other, fit);
    }
    more.abs()
}
