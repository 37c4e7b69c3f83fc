//! Whether the selected model is enough: tests of what it leaves, most of them made without the
//! catalogue.
//!
//! In, from `engine.rs`: the selected model with its causes, and what was found in codes and noise.
//! Out: [`Adequacy`]: what is still significant, in words, what share of the misfit that is, and
//! how large a share is allowed; `verdict.rs` makes `unknown` of a larger one. The share is
//! L / (L + E), where L is the largest statistic of what is still significant, and E the sum of the
//! statistics of all that was found. Allowed is .07 for one cause, .07² for two, and so on
//! (heuristic: tuned, `tuned.rs`).
//!
//! Every test must be so surprising that all tests of its kind together pass by chance once in 1000
//! (`without_a_name`). Where statistics of tests do not compare, twice the surprise stands for the
//! statistic.

use super::candidates::{Applied, ScoreTests, Scored, Setting};
use super::catalogue::{CATALOGUE, CauseId, RIVALS};
use super::chance::without_a_name;
use super::covariates::{DRIVE, NAMES, TEMPERATURE, TIME};
use super::found::{Aside, accepted};
use super::objection::Objection;
use super::selection::Selected;
use super::space::Direction;
use super::tuned::left_by_all;
use super::verdict::Unexplained;

/// What may follow a covariate, in words, in the order of `ParameterTest::parameter`.
const PARAMETERS: [&str; 5] = ["damping", "frequency", "amplitude", "phase", "slow decay"];

/// What the model leaves, and the candidates that it tells of as "something like ...", so that no
/// other remark has to.
pub struct Adequacy {
    pub unexplained: Unexplained,
    pub told: Vec<CauseId>,
}

/// Tests what is left: odd signals, missing codes, rivals and free shapes of the mean, parameters
/// that follow covariates, and the candidates that passed but were not named. `setting`: the
/// signals that the causes were selected for, and the random tone's frequency.
pub fn check(selected: &Selected, aside: &Aside, setting: Setting) -> Adequacy {
    let mut applied: Vec<Applied> =
        selected.causes.iter().map(|c| c.candidate.form.clone()).collect();
    let samples = setting.data.samples;
    // all causes are in the nuisance; and a random tone's mean over few bursts is allowed for like
    // a cause
    applied.extend(setting.avoid.iter().map(|omega| chance_mean(*omega, samples)));
    let nuisances = selected.fitted.spaces.nuisances(&applied);
    let tests = ScoreTests::new(&selected.fitted.model, setting, &nuisances);
    // Noise that grows with the signal makes what is largest look surer than it is, since the tests
    // assume noise of one variance: divide surprises by the growth of the variance.
    let growth = accepted(&aside.noise, CauseId::HeteroscedasticNoise).map_or(1.0, |h| 1.0 + h);

    // odd signals, and codes that are missing otherwise than a coarse step would have it
    let mut look = Look::default();
    if aside.odd_signals > without_a_name(CATALOGUE.len() as f64) {
        let what =
            "a few signals ring like the others and have a misfit of a shape: a pulse, a step";
        look.tell(what.into(), 2.0 * aside.odd_signals);
    }
    for found in aside.all() {
        if found.objection == Some(Objection::NoLattice) {
            let what = "codes are missing that no coarse step would leave out";
            look.tell(what.into(), found.statistic);
        }
    }

    // the mean misfit: a free shape (a bump or a step), or a rival if one is more surprising than
    // that
    let local = tests.own_shape(CauseId::OwnShape, None).map_or(0.0, |s| s.surprise / growth);
    let like = tests.likest_rival().filter(|s| {
        let surprise = s.surprise / growth;
        surprise > local.max(without_a_name(RIVALS.len() as f64))
    });
    match like {
        Some(s) => {
            // Beside a cause, a rival is so flexible that it takes what the cause's own model leaves. So the
            // free shape tells how much is left; the allowed share was tuned with it.
            let statistic = if applied.is_empty() { s.statistic } else { 2.0 * local };
            look.tell(format!("something like {}", s.id.row().words), statistic);
        }
        None if local > without_a_name(1.0) => {
            look.tell("the mean misfit has a shape of its own".into(), 2.0 * local);
        }
        None => {}
    }

    // parameters that follow a covariate which no cause owns
    let owned = owned_covariates(selected);
    let looks = tests.covariate_scan();
    let asked = without_a_name(looks.len() as f64);
    for found in looks {
        if !owned.contains(&found.covariate) && found.surprise > asked {
            let (parameter, covariate) = (PARAMETERS[found.parameter], NAMES[found.covariate]);
            look.tell(format!("{parameter} follows {covariate}"), 2.0 * found.surprise);
        }
    }

    // candidates of the selection's last step that passed but could not be named, unless they
    // resemble a cause that was named
    let mut told = Vec::new();
    for s in &selected.unnamed {
        let s = judged_again(s, &tests);
        if s.surprise / growth > without_a_name(CATALOGUE.len() as f64)
            && !is_relative(&s, selected)
        {
            let what = format!("something like {} ({})", s.id, s.why_not());
            look.tell(what, s.statistic);
            told.push(s.id);
        }
    }

    // the share of all misfit; codes count as explained, too, since the model of clipped or coarse
    // codes is not exact either, and bends the mean
    let by_others = aside.accepted().map(|f| f.statistic);
    let explained: f64 =
        selected.causes.iter().map(|c| c.candidate.statistic).chain(by_others).sum();
    let unexplained = Unexplained {
        significant: look.significant,
        share: look.statistic / (look.statistic + explained).max(1e-300),
        share_allowed: share_allowed(selected, aside),
    };
    Adequacy { unexplained, told }
}

/// What is significant, in words, and the largest statistic among it.
#[derive(Default)]
struct Look {
    significant: Vec<String>,
    statistic: f64,
}

impl Look {
    fn tell(&mut self, what: String, statistic: f64) {
        self.significant.push(what);
        self.statistic = self.statistic.max(statistic);
    }
}

/// Indices of the covariates that need no further test, because a cause that acts through them
/// explains whatever they do.
fn owned_covariates(selected: &Selected) -> Vec<usize> {
    let named = || selected.causes.iter().map(|c| c.candidate.id);
    let mut owned: Vec<usize> = named().filter_map(CauseId::follows).collect();
    // tied causes own each other's covariates
    let tied = selected.causes.iter().flat_map(|c| &c.tied_with);
    let of_tied = tied.filter_map(|id| id.follows());
    owned.extend(of_tied.filter(|which| matches!(*which, TIME | TEMPERATURE)));
    // and what acts through the amplitude owns the drive
    if named().any(CauseId::by_amplitude) {
        owned.push(DRIVE);
    }
    owned
}

/// A candidate that was passed over, tested again beside what a random tone leaves in the mean; the
/// smaller surprise counts. Without a random tone the candidate stays as it is.
fn judged_again(s: &Scored, tests: &ScoreTests) -> Scored {
    match tests.avoid.is_empty() {
        true => s.clone(),
        false => match tests.score_one(s.id, None) {
            Some(now) if now.surprise < s.surprise => Scored { objection: s.objection, ..now },
            _ => s.clone(),
        },
    }
}

/// Whether a candidate is what the model of a named cause leaves: a cause of the same class; or, if
/// the named cause acts through the amplitude and so bends the ring itself, another such cause or a
/// line at the ring's own frequency.
fn is_relative(s: &Scored, selected: &Selected) -> bool {
    let other = s.id;
    selected.causes.iter().map(|c| c.candidate.id).any(|named| {
        named.same_class(other)
            || named.by_amplitude()
                && (other.by_amplitude() || s.objection == Some(Objection::OwnLine))
    })
}

/// Largest share of the misfit that may be left. One cause may leave a share s of what it explains;
/// a second cause must explain that but for s of it, so two may leave s², and so on. Without this,
/// nearly any curve could be made of several causes. Causes in codes, noise and trigger count as
/// well.
fn share_allowed(selected: &Selected, aside: &Aside) -> f64 {
    let causes = selected.causes.len() + aside.accepted().count();
    left_by_all().powi(causes.max(1) as i32)
}

/// The mean of a random tone over all bursts, as a cause of size 0, so that it stands in the
/// nuisance. Over few bursts that mean does not vanish; whether it scales with the drive is not
/// known, so both are allowed for. `omega`: rad per signal length.
fn chance_mean(omega: f64, samples: usize) -> Applied {
    let wave = |k: usize| (1.0, omega * k as f64 / samples as f64);
    let directions = [0, 1].map(|power| Direction::waves(power, samples, wave)).concat();
    Applied { shape: omega, ..Applied::rigid(CauseId::RandomTone, directions, vec![0.0; 4]) }
}
