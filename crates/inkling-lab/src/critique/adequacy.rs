//! Whether the selected model is enough: tests of what it leaves, most of them made without the catalogue.
//!
//! In: the selected model with its causes, and what was found in codes and noise. Out: [`Unexplained`], which
//! says in words what is still significant. Its share of the misfit is L / (L + E), where L is the largest
//! statistic of what is still significant, and E the sum of the statistics of all that was found.
//!
//! Every test must be so surprising that all tests of its kind together pass by chance once in 1000
//! (`without_a_name`). Where statistics of tests do not compare, twice the surprise stands for the statistic.

use super::candidate::Objection;
use super::candidates::{Applied, Asked, ParameterTest, ScoreTests, Setting};
use super::catalogue::{Acts, CATALOGUE, CauseId, RIVALS};
use super::chance::without_a_name;
use super::covariates::{DRIVE, NAMES, TEMPERATURE, TIME};
use super::leftovers::{Artefacts, accepted};
use super::selection::Selected;
use super::tuned::LEFT_BY_ALL;
use super::words::Unexplained;

/// In the order of `ParameterTest::parameter`.
const PARAMETERS: [&str; 5] = ["damping", "frequency", "amplitude", "phase", "slow decay"];

/// Tests what is left of the misfit. `setting`: as of the selection.
pub fn check(selected: &Selected, artefacts: &Artefacts, setting: Setting) -> Unexplained {
    // all causes are in the nuisance
    let applied: Vec<Applied> = selected.causes.iter().map(|c| c.candidate.form.clone()).collect();
    let nuisances = selected.fitted.spaces.nuisances(&applied);
    let tests = ScoreTests::new(&selected.fitted.model, setting, &nuisances);
    // Noise that grows with the signal makes what is largest look surer than it is, since the tests assume
    // noise of one variance: divide surprises by the growth of the variance.
    let growth = accepted(&artefacts.noise, CauseId::HeteroscedasticNoise).map_or(1.0, |h| 1.0 + h);

    let mut significant = of_artefacts(artefacts);
    significant.extend(of_the_mean(&tests, growth, applied.is_empty()));
    significant.extend(following_covariates(&tests, &owned_covariates(selected)));
    let asked = without_a_name(CATALOGUE.len() as f64);
    let unable = selected.unnamed.iter().filter(|s| s.surprise / growth > asked);
    significant.extend(
        unable.map(|s| (format!("something like {} ({})", s.id, s.why_not()), s.statistic)),
    );

    // codes count as explained, too: the model of clipped or coarse codes is not exact, and bends the mean
    let by_others = artefacts.accepted().map(|f| f.statistic);
    let explained: f64 =
        selected.causes.iter().map(|c| c.candidate.statistic).chain(by_others).sum();
    let largest = significant.iter().map(|(_, statistic)| *statistic).fold(0.0, f64::max);
    Unexplained {
        significant: significant.into_iter().map(|(what, _)| what).collect(),
        share: largest / (largest + explained).max(1e-300),
        share_allowed: share_allowed(selected, artefacts),
        noted: Vec::new(),
    }
}

/// What is significant in what is left, in words, and its statistic.
type Significant = (String, f64);

/// Odd signals, and codes that are missing otherwise than a coarse step would have it.
fn of_artefacts(artefacts: &Artefacts) -> Vec<Significant> {
    let mut significant = Vec::new();
    if artefacts.odd_signals > without_a_name(CATALOGUE.len() as f64) {
        let what =
            "a few signals ring like the others and have a misfit of a shape: a pulse, a step";
        significant.push((what.into(), 2.0 * artefacts.odd_signals));
    }
    for found in artefacts.all() {
        let what = match found.objection {
            Some(Objection::NoLattice) => "codes are missing that no coarse step would leave out",
            Some(Objection::NoAutoregression) => {
                "the noise is correlated, and no autoregression: it flickers, or jumps between levels"
            }
            _ => continue,
        };
        significant.push((what.into(), found.statistic));
    }
    significant
}

/// The mean misfit: a free shape (a bump or a step), or a rival if one is more surprising. `growth`: of the
/// noise's variance; `alone`: no cause is in the model.
fn of_the_mean(tests: &ScoreTests, growth: f64, alone: bool) -> Option<Significant> {
    let local =
        tests.own_shape(Asked::anew(CauseId::OwnShape)).map_or(0.0, |s| s.surprise / growth);
    let asked = local.max(without_a_name(RIVALS.len() as f64));
    if let Some(s) = tests.likest_rival().filter(|s| s.surprise / growth > asked) {
        // beside a cause, a rival takes what the cause's own model leaves; so the free shape tells how much is
        // left
        let statistic = if alone { s.statistic } else { 2.0 * local };
        return Some((format!("something like {}", s.id.row().words), statistic));
    }
    let has_shape = local > without_a_name(1.0);
    has_shape.then(|| ("the mean misfit has a shape of its own".into(), 2.0 * local))
}

fn following_covariates(tests: &ScoreTests, owned: &[(usize, usize)]) -> Vec<Significant> {
    let looks = tests.covariate_scan();
    let asked = without_a_name(looks.len() as f64);
    let is_owned = |l: &ParameterTest| {
        owned.iter().any(|&(covariate, from)| covariate == l.covariate && from <= l.parameter)
    };
    let beyond = looks.iter().filter(|l| !is_owned(l) && l.surprise > asked);
    let in_words = |l: &ParameterTest| {
        let (parameter, covariate) = (PARAMETERS[l.parameter], NAMES[l.covariate]);
        (format!("{parameter} follows {covariate}"), 2.0 * l.surprise)
    };
    beyond.map(in_words).collect()
}

/// Covariates through which a cause acts, each with the first of the parameters that it explains: a ring that
/// is added leaves damping and frequency alone, any other cause explains whatever the covariate does.
fn owned_covariates(selected: &Selected) -> Vec<(usize, usize)> {
    let named = || selected.causes.iter().map(|c| c.candidate.id);
    let from = |id: CauseId| if matches!(id.row().acts, Acts::Ring { .. }) { 2 } else { 0 };
    let mut owned: Vec<(usize, usize)> =
        named().filter_map(|id| Some((id.follows()?, from(id)))).collect();
    let tied = selected.causes.iter().flat_map(|c| &c.tied_with);
    let of_tied = tied.filter_map(|id| id.follows());
    owned.extend(
        of_tied.filter(|which| matches!(*which, TIME | TEMPERATURE)).map(|which| (which, 0)),
    );
    if named().any(CauseId::by_amplitude) {
        owned.push((DRIVE, 0));
    }
    owned
}

/// Largest share of the misfit that may be left. One cause may leave a share s (`left_by_all`) of what it
/// explains; a second cause must explain that but for s of it, so two may leave s², and so on. Without this,
/// nearly any curve could be made of several causes.
fn share_allowed(selected: &Selected, artefacts: &Artefacts) -> f64 {
    let causes = selected.causes.len() + artefacts.accepted().count();
    LEFT_BY_ALL.powi(causes.max(1) as i32)
}
