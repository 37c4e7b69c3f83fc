//! Fits of decays from where another fit stands: the plain oscillation, and each candidate beside what a model has already.

use super::fit::{self, Fit, Noise, sizes};
use super::objections::lowest_line;
use super::plant::{Decays, Line, OMEGA, SIGMA, Structure};
use super::spectrum;
use super::terms::Term;
use super::unnamed::{moves_phase, second_numbers};
use std::f64::consts::TAU;

/// Peaks of the misfit's spectrum at which a line is tried.
const PEAKS: usize = 3;

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
