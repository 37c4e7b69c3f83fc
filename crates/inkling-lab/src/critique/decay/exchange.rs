//! Causes that entered a decay's model early, looked at again beside all that entered later.
//!
//! In: a model and its causes. Out: the same, or what explains as much in their place. Forward selection alone would keep a
//! rival without a name that explained a little more as long as its neighbours were missing.

use super::children::children;
use super::chosen::{Chosen, without};
use super::fit::{self, Fit, Noise};
use super::motion::Form;
use super::objections::objection;
use super::plant::Decays;
use super::terms::Term;
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
pub fn exchange(decays: &Decays, now: &mut Fit, causes: &mut [Chosen]) {
    let noise = Noise::of(&now.misfit(decays), decays, now.p.len());
    for cause in causes {
        let Term::Unnamed(rival) = cause.term else { continue };
        let left = without(decays, now, std::slice::from_ref(cause), |_| true);
        let left = fit::descend(decays, &left.structure, &left.p, &noise, decays.samples);
        let misfit = left.misfit(decays);
        let fits = |term: Term| {
            let all = children(decays, &left, term, &noise, &misfit);
            all.into_iter().map(move |fit| (term, fit))
        };
        let possible = |(term, fit): &(Term, Fit)| {
            objection(decays, fit, *term, &fit.covariance(decays, &noise)).is_none()
        };
        let named = Term::NAMED.into_iter().filter(|term| !term.is_in(&left.structure));
        let best = named
            .flat_map(fits)
            .filter(possible)
            .min_by(|(_, p), (_, q)| criterion(decays, p).total_cmp(&criterion(decays, q)));
        let Some((term, fit)) = best else { continue };
        if criterion(decays, &fit) < criterion(decays, now) + margin(now, &noise) {
            (cause.term, cause.degrees) = (term, fit.p.len() - left.p.len());
            cause.statistic = (left.cost - fit.cost).max(0.0);
            cause.tied_unnamed.push(rival);
            *now = fit;
        }
    }
}

/// A spring's form that explains more beside all else, and by how much more than the other.
pub fn better_form(decays: &Decays, now: &mut Fit, causes: &mut [Chosen], noise: &Noise) -> f64 {
    let spring = causes.iter_mut().find(|of| matches!(of.term, Term::Stiffness(_)));
    let Some((spring, form)) = spring.zip(now.structure.stiffness) else { return 0.0 };
    let other = match form {
        Form::Cubic => Form::Sine,
        Form::Sine => Form::Cubic,
    };
    let mut structure = now.structure.clone();
    structure.stiffness = Some(other);
    let fit = fit::descend(decays, &structure, &now.p, noise, decays.samples);
    let more = now.cost - fit.cost;
    if more > 0.0
        && objection(decays, &fit, Term::Stiffness(other), &fit.covariance(decays, noise)).is_none()
    {
        (spring.term, *now) = (Term::Stiffness(other), fit);
    }
    more.abs()
}
