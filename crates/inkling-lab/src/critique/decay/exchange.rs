//! Causes that entered a decay's model early, looked at again beside all that entered later.
//!
//! In: a model and its causes. Out: the same, or what explains as much in their place. Forward selection alone would keep a
//! rival without a name that explained a little more as long as its neighbours were missing.

use super::children::{Added, children};
use super::fit::{Fit, Noise};
use super::motion::Form;
use super::objections::objection;
use super::terms::Term;
use crate::critique::candidate::Chosen;
use crate::critique::tuned::{HALF, LEFT_TO_SHAPES, TIE};

/// What two models must differ by to be told apart: where they leave noise, odds; where what they leave follows from the
/// samples before, it is their own error, and a share of that.
pub fn margin(now: &Fit, noise: &Noise) -> f64 {
    let coloured = noise.predictable() > HALF;
    if coloured { TIE.max(LEFT_TO_SHAPES * now.cost) } else { TIE }
}

/// Of Bayes, in units of -2 ln likelihood: what is free counts.
fn criterion(fit: &Fit) -> f64 {
    fit.cost + fit.p.len() as f64 * fit.decays.ln_samples()
}

/// What has no name gives way to what has one, where that explains as much beside the other causes.
pub fn exchange<'a>(now: &mut Fit<'a>, causes: &mut Vec<Chosen<Added<'a>>>) {
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

/// A spring's form that explains more beside all else, and by how much more than the other.
pub fn better_form(now: &mut Fit, causes: &mut [Chosen<Added>], noise: &Noise) -> f64 {
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
