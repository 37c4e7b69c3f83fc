//! Where decays become free: how many samples come before the first one that a model of a decay should be fitted to.
//!
//! In: decays. Out: the onset, in samples ([`onset`]).
//!
//! Of two models, one oscillator that bends and rubs and a sum of modes, the one that foresees the later part better
//! is fitted from ever earlier samples k on. What came before is no decay, and is taken for noise as large as it is:
//! -2 ln likelihood is k ln(mean square of the first k) + (n - k) ln(mean square of the misfit from k on), summed over
//! outputs. The least of these is the onset, if the share of the movement that is misfit from there on is far smaller
//! than from the first sample on.

use super::children::{baseline, child};
use super::decays::Decays;
use super::motion::Form;
use super::noise::Noise;
use super::plant::Fit;
use super::selection::gain_in_bic;
use super::structure::foreseen;
use super::terms::{Line, Term};
use crate::critique::tuned::{DRIVEN, ONSET_WITHIN};
use inkling_core::numbers::LITTLE;

/// In so many steps it is looked for.
const STEPS: usize = 32;

#[derive(Clone, Copy)]
struct Tried {
    at: usize,
    deviance: f64,
    /// ln of the misfit's mean square over that of the movement of the same samples, the mean over outputs.
    ln_share: f64,
}

pub fn onset(decays: &Decays) -> usize {
    let last = decays.samples / ONSET_WITHIN;
    let late = decays.from(last);
    let (bends, rings) = (bent(&late), modes(&late));
    // a sum of many modes fits a pendulum, too, and better than one oscillator does: so it must be needed
    let is_bent = bends.left() < LITTLE || foreseen(&bends) < foreseen(&rings);
    let mut tried = backwards(decays, if is_bent { &bends } else { &rings }, last);
    // the whole record has its own chance, from its own start
    let whole = if is_bent { bent(decays) } else { modes(decays) };
    tried.extend(judged(decays, &whole, 0));
    let least = |of: &mut dyn Iterator<Item = &Tried>| {
        of.min_by(|p, q| p.deviance.total_cmp(&q.deviance)).copied()
    };
    let best = least(&mut tried.iter());
    let whole = least(&mut tried.iter().filter(|t| t.at == 0));
    match (best, whole) {
        (Some(best), Some(whole)) if (best.ln_share - whole.ln_share).exp() < DRIVEN => best.at,
        _ => 0,
    }
}

/// The model of the decays from `last` on, fitted from ever earlier samples on.
fn backwards(decays: &Decays, late: &Fit, last: usize) -> Vec<Tried> {
    let mut tried: Vec<Tried> = judged(decays, late, last).into_iter().collect();
    let mut p = late.p.clone();
    let mut at = last;
    while at > 0 {
        let next = at.saturating_sub((last / STEPS).max(1));
        let longer = decays.from(next);
        let mut fit = Fit { decays: &longer, p, upto: longer.samples, ..late.clone() };
        fit.turn_back(at - next);
        let one = Noise::white(&vec![1.0; decays.outputs]);
        let fit = fit.descend(&Noise::white(&fit.solved(&one).sizes()));
        let Some(of_fit) = judged(decays, &fit, next) else { break };
        tried.push(of_fit);
        (p, at) = (fit.p, next);
    }
    tried
}

/// `fit`: of the samples from `at` on. Its numbers cost as in BIC. `None`: its motion is lost.
fn judged(decays: &Decays, fit: &Fit, at: usize) -> Option<Tried> {
    if !fit.cost.is_finite() {
        return None;
    }
    let before = (at * decays.bursts) as f64;
    let centred = decays.centred(&decays.y);
    let moved = |o: usize| {
        let each = decays.of_output(&centred, o).flat_map(|y| &y[..at]);
        each.map(|v| v * v).sum::<f64>() / before
    };
    let of_start = |o: usize| if at == 0 { 0.0 } else { before * moved(o).max(1e-300).ln() };
    let start: f64 = (0..decays.outputs).map(of_start).sum();
    let after = ((decays.samples - at) * decays.bursts) as f64;
    let ln_squares: f64 = fit.sizes().iter().map(|s| 2.0 * s.ln()).sum();
    let price = fit.parameters() as f64 * decays.ln_samples();
    let deviance = start + after * ln_squares + price;
    // what decays leaves a smaller misfit later on, however badly it is fitted
    let ln_moved: f64 = fit.decays.movement().iter().map(|moved| 2.0 * moved.ln()).sum();
    Some(Tried { at, deviance, ln_share: (ln_squares - ln_moved) / decays.outputs as f64 })
}

fn grown<'a>(fit: &Fit<'a>, term: Term) -> Option<Fit<'a>> {
    child(fit, term, &Noise::white(&fit.sizes()))
}

/// One oscillator whose spring bends, and whose damping changes with the amplitude.
fn bent(decays: &Decays) -> Fit<'_> {
    let terms = [Term::Stiffness(Form::Sine), Term::Friction, Term::Drag];
    terms.into_iter().fold(baseline(decays), |fit, term| grown(&fit, term).unwrap_or(fit))
}

/// A sum of modes, as many as BIC asks for.
fn modes(decays: &Decays) -> Fit<'_> {
    let mode = Term::Line(Line::Mode);
    let mut modes = baseline(decays);
    while mode.may_join(&modes.terms) {
        match grown(&modes, mode).filter(|more| gain_in_bic(&modes, more) > 0.0) {
            Some(more) => modes = more,
            None => break,
        }
    }
    modes
}
