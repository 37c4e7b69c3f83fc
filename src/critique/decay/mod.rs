//! The critique of few, long decays of one oscillator.
//!
//! In: decays of one system, a few bursts of one or more outputs. Out: the same findings as for a
//! printhead. The trajectory itself is fitted (`fit`, `motion`): a damped oscillation for all
//! outputs, then whatever the decays ask for (`selection`). There is no drive scan, but a long decay
//! goes through all amplitudes. It must never name what it could not refit.

mod fit;
mod gain;
mod motion;
mod plant;
mod selection;
mod spectrum;
#[cfg(test)]
mod tests;
mod unnamed;
mod words;

use super::catalogue::{CATALOGUE, InDecays};
use super::chance::{DETECTION_LIMIT, THRESHOLD, surprise};
use super::digits;
use super::extended::NotExtended;
use super::finding::{Cause, Critique, NotTestable, Signals, VERSION, Verdict};
use super::observations::Observations;
use super::outcome::{CritiqueError, Outcome};
use super::tuned::HALF;
use super::words::{capital, ties};
use plant::Decays;
use selection::{Chosen, Selected, sizes};

/// Bursts that are taken for decays of one system; more are an ensemble.
pub const MOST_BURSTS: usize = 32;
/// Longer decays are judged by their first samples.
pub const MOST_SAMPLES: usize = 32_768;
/// Samples in all: more would not be fitted in reasonable time.
const MOST_IN_ALL: usize = 8 * MOST_SAMPLES;
/// Whether these signals are decays for this room.
pub fn can(data: &Observations) -> bool {
    data.bursts <= MOST_BURSTS
        && data.printheads.len() == 1
        && data.len() * data.samples <= MOST_IN_ALL
}

/// What is left of the misfit.
struct Left {
    /// Of what the baseline missed.
    share: f64,
    /// Of what is left, what the samples before predict.
    predictable: f64,
    p: f64,
    words: Option<String>,
}

fn left(decays: &Decays, selected: &Selected) -> Left {
    let misfit = selected.fit.misfit(decays);
    let (before, after) =
        (sizes(&selected.baseline.misfit(decays), decays), sizes(&misfit, decays));
    let (mut missed, mut rest, mut predictable) = (0.0, 0.0, 0.0_f64);
    for (o, colour) in selected.noise.colours.iter().enumerate() {
        let floor = (colour.sds[colour.order()] / after[o]).powi(2).min(1.0);
        missed += ((before[o] / after[o]).powi(2) - floor).max(0.0);
        rest += 1.0 - floor;
        predictable = predictable.max(1.0 - floor);
    }
    let p = gain::whiteness(&misfit, decays, |_| true);
    let words = (p < 1e-4).then(|| {
        let n = decays.samples;
        let power = misfit.chunks(n).enumerate().fold(Vec::new(), |mut sum: Vec<f64>, (i, r)| {
            let power = spectrum::power(r);
            sum.resize(power.len(), 0.0);
            let weight = after[i % decays.outputs].powi(-2);
            sum.iter_mut().zip(power).for_each(|(s, p)| *s += weight * p);
            sum
        });
        let hz = spectrum::peaks(&power, 0.0, 1e9, 1).first().copied().unwrap_or(0.0)
            / (std::f64::consts::TAU * decays.dt_s);
        format!(
            "the misfit that is left is not white ({}; {:.0} % of it follows from the samples before; its \
             spectrum peaks at {} Hz)",
            digits::p_is(p),
            100.0 * predictable,
            digits::short(hz)
        )
    });
    Left { share: rest / missed.max(1e-12), predictable, p, words }
}

/// What is left, and what would take part of it and is not named.
fn unexplained(selected: &Selected, left: &Left) -> Vec<String> {
    let still = left.words.iter().map(|words| format!("still unexplained: {words}"));
    let unnamed = selected.unnamed.iter().map(|t| {
        format!(
            "{} would take {:.0} % of what is left, but {}: it is not named",
            t.term.words(),
            100.0 * t.share.max(0.0),
            t.why_not()
        )
    });
    still.chain(unnamed).collect()
}

pub fn critique(
    data: &Observations,
    stages: &mut dyn FnMut(&str),
) -> Result<Outcome, CritiqueError> {
    let decays = Decays::of(data).ok_or(CritiqueError::NoRing)?;
    let selected = selection::select(&decays, stages);
    let sum = |y: &[f64]| y.iter().map(|v| v * v).sum::<f64>();
    // an offset may be the larger part: what must be explained is the movement
    let explained = 1.0 - sum(&selected.fit.misfit(&decays)) / sum(&decays.y);
    if explained.is_nan() || !rings(&decays, &selected, explained) {
        return Err(CritiqueError::NoRing);
    }
    stages("measuring the gain");
    let (mut causes, mut remarks) = words::causes(&decays, &selected);
    let (misfit, gain) = gain::measure(&decays, &selected);
    let left = left(&decays, &selected);
    let verdict = verdict(&mut causes, &selected, &left);
    remarks.extend(unexplained(&selected, &left));
    remarks.extend(ties(&causes));
    if decays.incomplete > 0 {
        remarks.push(format!(
            "{} bursts were left out: not all outputs are in them",
            decays.incomplete
        ));
    }
    let critique = Critique {
        version: VERSION,
        verdict,
        sentence: sentence(verdict, &causes, &selected, &left),
        equation: words::equation(&decays, &selected.fit),
        causes,
        not_testable: not_testable(),
        misfit,
        gain,
        extended_model: None,
        remarks,
        signals: Signals {
            found: data.found,
            used: decays.bursts * decays.outputs,
            outliers: 0,
            channels: decays.outputs,
            rejected: 0,
        },
        figures: gain::draw(&decays, &selected),
        evidence: selected.evidence,
    };
    Ok(Outcome {
        critique,
        outlier: vec![false; data.len()],
        extended: Err(NotExtended::NoInkChannel),
    })
}

/// Whether there is a ring: more than chance finds in as much noise. Of many partials none is much.
fn rings(decays: &Decays, selected: &Selected, explained: f64) -> bool {
    let samples = decays.y.len() as f64;
    let statistic = -samples * (1.0 - explained).max(1e-12).ln();
    let places = decays.samples as f64 / 2.0;
    surprise(statistic, selected.fit.p.len(), places, f64::INFINITY) > THRESHOLD
}

fn verdict(causes: &mut Vec<Cause>, selected: &Selected, left: &Left) -> Verdict {
    let unexplained = left.p < 1e-4;
    let found = &selected.causes;
    if causes.is_empty() {
        if !found.is_empty() {
            return Verdict::Unknown; // it has no name
        }
        if !unexplained || left.predictable < HALF {
            return Verdict::None;
        }
        if let Some(near) = nearest(selected) {
            causes.push(near);
        }
        return Verdict::Unknown;
    }
    if unexplained && left.share > HALF && left.predictable > HALF {
        causes.iter_mut().for_each(|c| c.explains = Some((1.0 - left.share).max(0.0)));
        return Verdict::Unknown;
    }
    match &causes[..] {
        [one] if one.is_tied() => Verdict::Tie,
        _ => Verdict::Named,
    }
}

/// The candidate that takes most of the misfit away, though it is not the cause.
fn nearest(selected: &Selected) -> Option<Cause> {
    let named = selected.unnamed.iter().filter(|t| t.term.id().has_name());
    let t = named.max_by(|p, q| p.share.total_cmp(&q.share))?;
    let id = t.term.id();
    let strength_dl = (t.statistic / DETECTION_LIMIT).sqrt();
    Some(Cause {
        explains: Some(t.share.clamp(0.0, 1.0)),
        sentence: format!("nearest is {id}, but {}", t.why_not()),
        ..Cause::new(id, f64::NAN, f64::NAN, strength_dl, t.statistic)
    })
}

/// Rows of the catalogue that a single oscillator's decay does not bear on.
fn not_testable() -> Vec<NotTestable> {
    let needs = CATALOGUE.iter().filter_map(|e| match e.in_decays {
        InDecays::Fitted(_) => None,
        InDecays::Needs(needs) => Some(NotTestable { id: e.id, needs: needs.into() }),
    });
    needs.collect()
}

fn sentence(verdict: Verdict, causes: &[Cause], selected: &Selected, left: &Left) -> String {
    let strongest = |p: &&Chosen, q: &&Chosen| p.statistic.total_cmp(&q.statistic);
    let like = selected.causes.iter().filter(|c| !c.term.id().has_name()).max_by(strongest);
    let like = like.map(|c| format!("something like {}", c.term.words()));
    let what = like.as_deref().or(left.words.as_deref()).unwrap_or("a misfit");
    match verdict {
        Verdict::None => {
            "One damped oscillation explains these decays: nothing in them asks for more.".into()
        }
        Verdict::Unknown => match causes.first() {
            Some(c) => format!(
                "The model misses something that the catalogue does not hold: {what}; nearest is {}, which \
                 explains {:.0} % of it.",
                c.id,
                100.0 * c.explains.unwrap_or(0.0)
            ),
            None => format!("The model misses something that the catalogue does not hold: {what}."),
        },
        Verdict::Tie | Verdict::Named => {
            let each: Vec<String> = causes
                .iter()
                .map(|c| match c.is_tied() {
                    true => format!("{}, or {}", capital(&c.sentence), c.tied_words()),
                    false => capital(&c.sentence),
                })
                .collect();
            let rest = match &left.words {
                Some(_) => format!(
                    " Of what the linear model misses, {:.1} % is still unexplained.",
                    100.0 * left.share
                ),
                None => String::new(),
            };
            format!("{}.{rest}", each.join(". "))
        }
    }
}
