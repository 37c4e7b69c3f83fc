//! Which causes the data ask for: forward selection, full refits of what competes, backward elimination.
//!
//! In: signals and a fitted baseline. Out: the causes, with what was tried on the way. A cause enters
//! when its surprise passes the family-wise threshold; the winner among those that compete is the one
//! whose refitted model is most likely; what cannot be told apart from it is tied with it.

use super::candidates::{Kind, Scored};
use super::catalogue::{by_amplitude, same_class};
use super::covariates::{TEMPERATURE, TIME};
use super::finding::Evidence;
use super::model::Model;
use super::refit::{Refit, Setting, Spaces, apply, follow, refit, rescored};

/// -ln of the chance that one candidate passes on data of the model itself: 22 candidates stay well
/// below 1 % together.
pub const THRESHOLD: f64 = 8.3;
/// Rivals whose refitted -2 ln likelihood is within this of the best cannot be told from it.
const TIE: f64 = 6.0;
/// The same for causes whose effects are known to differ.
const CLOSE: f64 = 1.5;
/// A tone and a second mode whose likelihoods differ by less scale with the drive, and decay, as far as can be
/// told.
const LINES: f64 = 3.0;
/// Causes that are looked for at most.
const MOST_CAUSES: usize = 4;
/// Rivals that are refitted in a step, at most.
const MOST_RIVALS: usize = 5;
/// Noncentrality of one detection limit.
pub const DETECTION_LIMIT: f64 = 20.9;

#[derive(Clone, Debug)]
pub struct Chosen {
    pub scored: Scored,
    pub delta_bic: f64,
    pub tied_with: Vec<String>,
    /// Likelihood-ratio statistic against the final model without it.
    pub statistic: f64,
}

pub struct Selected {
    pub model: Model,
    pub causes: Vec<Chosen>,
    pub spaces: Spaces,
    pub evidence: Vec<Evidence>,
    /// Candidates that passed but cannot be the cause, of the last step.
    pub unnamed: Vec<Scored>,
}

/// `least`: the statistic that a cause must have beside what was found in codes and noise.
pub fn select(
    baseline: Model,
    setting: Setting,
    least: f64,
    stages: &mut dyn FnMut(&str),
) -> Selected {
    let data = setting.data;
    let mut now = refit(baseline, Vec::new(), setting, 3, true);
    let mut chosen: Vec<Chosen> = Vec::new();
    let mut evidence = Vec::new();
    let n_eff = (data.len() as f64 * data.samples as f64).ln();
    let mut unnamed = Vec::new();
    for step in 0..=MOST_CAUSES as u32 {
        stages("testing the catalogue");
        let nuisances = now.spaces.nuisances(&now.causes);
        let bench = setting.bench(&now.model, &now.spaces, &nuisances);
        let mut scored = bench.score_all();
        scored.retain(|s| now.causes.iter().all(|c| c.id != s.applied.id));
        scored.sort_by(|p, q| q.surprise.total_cmp(&p.surprise));
        let rows = evidence.len();
        for s in &scored {
            evidence.push(Evidence {
                step,
                id: s.applied.id.into(),
                statistic: s.statistic,
                threshold: threshold_statistic(s),
                p: (-s.surprise).exp(),
                delta_bic: s.statistic - s.degrees as f64 * n_eff,
                strength_dl: (s.statistic / DETECTION_LIMIT).sqrt(),
                value: s.value,
                sd: s.sd,
                tested: true,
                accepted: false,
                why_not: if s.disqualified.is_empty() {
                    "not significant".into()
                } else {
                    s.disqualified.clone()
                },
            });
        }
        unnamed = scored
            .iter()
            .filter(|s| s.surprise > THRESHOLD && !s.disqualified.is_empty())
            .cloned()
            .collect();
        let able: Vec<&Scored> = scored.iter().filter(|s| s.disqualified.is_empty()).collect();
        let Some(best) = able.first().filter(|s| s.surprise > THRESHOLD) else { break };
        if step as usize == MOST_CAUSES {
            break;
        }
        stages("refitting what competes");
        let mut rivals: Vec<(Refit, &Scored)> = Vec::new();
        let of_shapes = |s: &Scored| matches!(s.applied.kind, Kind::Shapes);
        let kind = best.applied.kind.clone();
        for s in able.iter().filter(|s| of_shapes(s) == of_shapes(best)).filter(|s| {
            s.surprise > 0.35 * best.surprise && s.surprise > 0.5 * THRESHOLD
                || same_class(s.applied.id, best.applied.id) && s.surprise > 0.3 * THRESHOLD
        }) {
            if rivals.len() >= MOST_RIVALS {
                break;
            }
            let mut model = now.model.clone();
            let mut causes = now.causes.clone();
            follow(&mut model, &now.spaces, &[], std::slice::from_ref(&s.applied), 1.0);
            apply(&mut model, &s.applied, &s.applied.coefficients);
            causes.push(s.applied.clone());
            rivals.push((refit(model, causes, setting, 3, false), s));
        }
        // what explains less once it is refitted leads nowhere: it is no cause, and the misfit stays
        let before = now.deviance(&kind);
        rivals.retain(|r| r.0.deviance(&kind) < before);
        if rivals.is_empty() {
            let why = "its refit leads nowhere".to_owned();
            unnamed.push(Scored { disqualified: why, ..(**best).clone() });
            break;
        }
        let penalised =
            |r: &(Refit, &Scored)| r.0.deviance(&kind) + 2.0 * (parameters(r.1) + r.1.tried.ln());
        rivals.sort_by(|p, q| penalised(p).total_cmp(&penalised(q)));
        let least = penalised(&rivals[0]);
        let tied: Vec<String> = rivals[1..]
            .iter()
            .filter(|r| {
                let near = penalised(r) - least;
                let honest = same_class(r.1.applied.id, rivals[0].1.applied.id)
                    || !matches!(kind, Kind::Shapes);
                let lines = is_line(r.1) && is_line(rivals[0].1);
                let apart = (r.0.deviance(&kind) - rivals[0].0.deviance(&kind)).abs();
                near < if honest { TIE } else { CLOSE } || lines && apart < LINES
            })
            .map(|r| r.1.applied.id.to_owned())
            .collect();
        for r in &rivals {
            if let Some(row) = evidence[rows..].iter_mut().find(|e| e.id == r.1.applied.id) {
                row.delta_bic =
                    now.deviance(&kind) - r.0.deviance(&kind) - r.1.degrees as f64 * n_eff;
                row.why_not = "another cause explains more".into();
            }
        }
        let (next, winner) = rivals.swap_remove(0);
        let statistic = (now.deviance(&kind) - next.deviance(&kind)).max(0.0);
        if let Some(row) = evidence[rows..].iter_mut().find(|e| e.id == winner.applied.id) {
            row.accepted = true;
            row.why_not = String::new();
        }
        chosen.push(Chosen {
            delta_bic: statistic - winner.degrees as f64 * n_eff,
            statistic,
            scored: winner.clone(),
            tied_with: tied,
        });
        now = refit(next.model, next.causes, setting, 2, true);
        // what the newcomer makes superfluous goes again
        let kept = necessary(&now);
        if kept.iter().any(|k| !k) {
            let mut model = now.model.clone();
            for (cause, _) in now.causes.iter().zip(&kept).filter(|(_, k)| !**k) {
                let minus: Vec<f64> = cause.coefficients.iter().map(|c| -c).collect();
                apply(&mut model, cause, &minus);
            }
            let mut keep = kept.iter();
            chosen.retain(|_| *keep.next().unwrap_or(&true));
            let mut keep = kept.iter();
            let mut causes = now.causes.clone();
            causes.retain(|_| *keep.next().unwrap_or(&true));
            now = refit(model, causes, setting, 2, true);
        }
    }
    stages("measuring the causes");
    let mut last = refit(now.model, now.causes, setting, 3, true);
    measure(&mut chosen, &last, setting);
    let kept = beyond_leftovers(&chosen, least);
    if kept.iter().any(|k| !k) {
        for (cause, _) in last.causes.iter().zip(&kept).filter(|(_, k)| !**k) {
            let minus: Vec<f64> = cause.coefficients.iter().map(|c| -c).collect();
            apply(&mut last.model, cause, &minus);
        }
        let mut keep = kept.iter();
        chosen.retain(|_| *keep.next().unwrap_or(&true));
        let mut keep = kept.iter();
        last.causes.retain(|_| *keep.next().unwrap_or(&true));
        last = refit(last.model, last.causes, setting, 3, true);
        measure(&mut chosen, &last, setting);
    }
    Selected { model: last.model, causes: chosen, spaces: last.spaces, evidence, unnamed }
}

/// No model of a cause is exact: what is found beside one that explains so much more is what that one
/// leaves, and no cause of its own. Of what follows the same covariate, or the amplitude, more so.
const LEFTOVER: f64 = 0.03;
const LEFTOVER_OF_RELATED: f64 = 0.15;

fn beyond_leftovers(chosen: &[Chosen], least: f64) -> Vec<bool> {
    let which = |c: &Chosen| match c.scored.applied.kind {
        Kind::Covariate { which, .. } => Some(which),
        Kind::Tail => Some(super::covariates::IDLE),
        Kind::Shapes => None,
    };
    // temperature and time cannot be told apart where what follows one is tied with what follows the other
    let collinear = |c: &Chosen| {
        let ids = c.tied_with.iter().map(String::as_str).chain([c.scored.applied.id]);
        let follows_time = ids.clone().any(|id| matches!(id, "ageing" | "clock_drift"));
        follows_time && ids.clone().any(|id| id == "temperature")
    };
    let by_time = |c: &Chosen| matches!(which(c), Some(TIME | TEMPERATURE));
    let with_amplitude = |c: &Chosen| by_amplitude(c.scored.applied.id);
    let largest = chosen.iter().fold(0.0, |m: f64, c| m.max(c.statistic));
    chosen
        .iter()
        .map(|cause| {
            // beside another, below one detection limit: chance, or what that one leaves
            cause.statistic >= DETECTION_LIMIT.min(largest).max(least)
                && chosen.iter().all(|other| {
                    let of_shapes = which(cause).is_none() == which(other).is_none();
                    let related = which(cause).is_some() && which(cause) == which(other)
                        || by_time(cause) && by_time(other) && collinear(other)
                        || with_amplitude(cause) && with_amplitude(other);
                    let share = match (related, of_shapes) {
                        (true, _) => LEFTOVER_OF_RELATED,
                        (false, true) => LEFTOVER,
                        // what a shape leaves in the mean follows no covariate, nor the reverse
                        (false, false) => 0.0,
                    };
                    cause.statistic >= share * other.statistic
                })
        })
        .collect()
}

/// Final sizes, each beside all others.
fn measure(chosen: &mut [Chosen], last: &Refit, setting: Setting) {
    for (index, cause) in chosen.iter_mut().enumerate() {
        if let Some(scored) = rescored(index, &last.model, &last.causes, &last.spaces, setting) {
            cause.statistic = scored.statistic;
            cause.scored = scored;
        }
    }
}

/// Which causes stay significant beside the others.
fn necessary(now: &Refit) -> Vec<bool> {
    let nuisances = now.spaces.nuisances(&now.causes);
    let mut at = 0;
    now.causes
        .iter()
        .map(|cause| {
            let (steps, covariance) = match cause.kind {
                Kind::Shapes => nuisances.shapes.causes(),
                _ => nuisances.covariates.causes(),
            };
            let q = cause.coefficients.len();
            // of what follows a covariate, its own effect must stay, not the state's
            let own = if matches!(cause.kind, Kind::Covariate { .. }) { 1 } else { q };
            let total: Vec<f64> = cause
                .coefficients
                .iter()
                .zip(steps.rows(at, own).iter())
                .map(|(c, s)| c + s)
                .collect();
            let block = covariance.view((at, at), (own, own)).into_owned();
            at += q;
            let x = nalgebra::DVector::from_vec(total);
            let statistic = block.try_inverse().map_or(0.0, |inverse| x.dot(&(inverse * &x)));
            super::candidates::surprise(statistic, own, 1.0, f64::INFINITY) > 0.5 * THRESHOLD
        })
        .collect()
}

fn is_line(s: &Scored) -> bool {
    matches!(s.applied.id, "tone" | "second_mode")
}

/// What a cause has free: its coefficients, and its rate, frequency and damping.
fn parameters(s: &Scored) -> f64 {
    let shape = match s.applied.id {
        "second_mode" => 3.0,
        "tone" | "lowpass" | "meniscus" => 1.0,
        _ => 0.0,
    };
    s.degrees as f64 + shape
}

/// The value of the statistic at which the surprise reaches the threshold.
fn threshold_statistic(s: &Scored) -> f64 {
    let (mut low, mut high) = (0.0, 400.0);
    for _ in 0..40 {
        let mid = 0.5 * (low + high);
        if super::candidates::surprise(mid, s.degrees, s.tried, f64::INFINITY) > THRESHOLD {
            high = mid;
        } else {
            low = mid;
        }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::super::candidates::Applied;
    use super::*;

    fn chosen(id: &'static str, kind: Kind, statistic: f64) -> Chosen {
        let applied = Applied {
            id,
            shape: 0.0,
            damping: 0.0,
            coefficients: vec![1.0],
            directions: vec![],
            kind,
        };
        let scored = Scored {
            applied,
            statistic,
            degrees: 1,
            tried: 1.0,
            surprise: statistic / 2.0,
            value: 1.0,
            sd: 0.1,
            disqualified: String::new(),
        };
        Chosen { scored, delta_bic: statistic, tied_with: vec![], statistic }
    }

    #[test]
    fn what_a_strong_cause_leaves_is_no_cause_of_its_own() {
        let shape = |id, statistic| chosen(id, Kind::Shapes, statistic);
        let follows =
            |id, which, statistic| chosen(id, Kind::Covariate { which, v: vec![] }, statistic);
        // 2 % of another shape's statistic; of what follows no shape, the same is one
        assert_eq!(
            beyond_leftovers(&[shape("tone", 5000.0), shape("offset", 100.0)], 0.0),
            [true, false]
        );
        assert_eq!(
            beyond_leftovers(&[shape("tone", 5000.0), follows("temperature", 2, 100.0)], 0.0),
            [true, true]
        );
        // of two that follow the same covariate, more is asked
        assert_eq!(
            beyond_leftovers(&[follows("ageing", 1, 1000.0), follows("clock_drift", 1, 80.0)], 0.0),
            [true, false]
        );
        // alone, a weak one stays; beside another it does not
        assert_eq!(beyond_leftovers(&[shape("tone", 18.0)], 0.0), [true]);
        let two = [shape("tone", 60.0), shape("offset", 18.0)];
        assert_eq!(beyond_leftovers(&two, 0.0), [true, false]);
        // beside noise that explains much, more is asked of all
        assert_eq!(beyond_leftovers(&two, 50.0), [true, false]);
        assert_eq!(beyond_leftovers(&[shape("tone", 18.0)], 50.0), [false]);
    }

    #[test]
    fn the_threshold_of_a_statistic_is_where_its_surprise_reaches_it() {
        for degrees in [1, 2, 4] {
            let mut one = chosen("tone", Kind::Shapes, 0.0).scored;
            (one.degrees, one.tried) = (degrees, 20.0);
            let at = threshold_statistic(&one);
            let surprise = super::super::candidates::surprise(at, degrees, 20.0, f64::INFINITY);
            assert!((surprise - THRESHOLD).abs() < 1e-3, "{degrees}: {surprise}");
        }
    }
}
