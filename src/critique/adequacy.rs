//! Whether the model that was found is enough: what is left, tested without the catalogue.
//!
//! In: the selected model. Out: [`Left`]: what is still significant, in words, and how much of the
//! misfit it is.

use super::candidates::{Applied, MARGIN, OWN_LINE, Scored};
use super::catalogue::{by_amplitude, same_class};
use super::covariates::{Covariates, DRIVE, NAMES, TEMPERATURE, TIME};
use super::engine::Found;
use super::finding::Cause;
use super::observations::Observations;
use super::refit::Setting;
use super::selection::{Selected, THRESHOLD};
use super::space::Direction;

/// Parameters in words.
const PARAMETERS: [&str; 5] = ["damping", "frequency", "amplitude", "phase", "slow decay"];
/// Of what the named causes explain, this share may be left: no model of a cause is exact. What the catalogue does
/// not hold leaves .13 at least (hidden effects of 4 detection limits and more, tuning recordings).
const SHARE_ALLOWED: f64 = 0.07;
/// What several causes may leave that would together explain nearly anything.
const SHARE_OF_SEVERAL: f64 = 0.005;
/// So many causes explain anything.
const MANY: usize = 3;

#[derive(Clone, Debug, Default)]
pub struct Left {
    pub significant: Vec<String>,
    /// Rows of the catalogue that are told of among them.
    pub told: Vec<&'static str>,
    /// Of all misfit (explained and not), the share that is not explained.
    pub share: f64,
    pub share_allowed: f64,
    pub nearest: Vec<Cause>,
}

pub fn check(
    selected: &Selected,
    data: &Observations,
    beside: &Covariates,
    (of_codes, of_noise): (&[Found], &[Found]),
    avoid: &[f64],
) -> Left {
    let mut applied: Vec<Applied> =
        selected.causes.iter().map(|c| c.scored.applied.clone()).collect();
    applied.extend(avoid.iter().map(|omega| chance_mean(*omega, data.samples)));
    let nuisances = selected.spaces.nuisances(&applied);
    let setting = Setting { data, beside, avoid };
    let bench = setting.bench(&selected.model, &selected.spaces, &nuisances);
    let mut left = Left { share_allowed: SHARE_ALLOWED, ..Left::default() };
    // the model of clipped or coarse codes is not exact either, and it bends the mean
    let found = || of_codes.iter().chain(of_noise).filter(|f| f.evidence.accepted);
    let by_others = found().map(|f| f.evidence.statistic);
    let explained: f64 = selected.causes.iter().map(|c| c.statistic).chain(by_others).sum();
    // noise that grows with the signal makes what is largest look surer than it is
    let growth = found().find(|f| f.evidence.id == "heteroscedastic_noise");
    let growth = growth.map_or(1.0, |f| 1.0 + f.evidence.value);
    let mut unexplained = 0.0_f64;
    for found in of_codes.iter().chain(of_noise) {
        if let Some(what) = found.unlike {
            left.significant.push(what.into());
            unexplained = unexplained.max(found.evidence.statistic);
        }
    }
    let (local, tried) = bench.local_scan();
    let local = local / growth - tried.max(1.0).ln();
    if local > MARGIN + THRESHOLD - 3.0 {
        left.significant.push("the mean misfit has a shape of its own".into());
        unexplained = unexplained.max(2.0 * local);
    }
    // causes that act through a covariate own whatever that covariate does
    let mut owned: Vec<usize> =
        selected.causes.iter().filter_map(|c| which(&c.scored.applied)).collect();
    // tied ones own each other's
    let tied = || selected.causes.iter().flat_map(|c| c.tied_with.iter());
    if tied().any(|id| matches!(id.as_str(), "ageing" | "clock_drift")) {
        owned.push(TIME);
    }
    if tied().any(|id| id == "temperature") {
        owned.push(TEMPERATURE);
    }
    // and what acts through the amplitude owns the drive
    if selected.causes.iter().any(|c| by_amplitude(c.scored.applied.id)) {
        owned.push(DRIVE);
    }
    for (which, parameter, surprise) in bench.covariate_scan() {
        if owned.contains(&which) {
            continue;
        }
        if surprise > THRESHOLD + MARGIN {
            left.significant.push(format!("{} follows {}", PARAMETERS[parameter], NAMES[which]));
            unexplained = unexplained.max(2.0 * surprise);
        }
    }
    // beside what a random tone leaves in the mean, they are judged again
    let again = |s: &Scored| match avoid.is_empty() {
        true => s.clone(),
        false => match bench.score_one(s.applied.id, None) {
            Some(now) if now.surprise < s.surprise => {
                Scored { disqualified: s.disqualified.clone(), ..now }
            }
            _ => s.clone(),
        },
    };
    let by_amplitude_too = selected.causes.iter().any(|c| by_amplitude(c.scored.applied.id));
    for s in &selected.unnamed.iter().map(again).collect::<Vec<Scored>>() {
        // a relative of what was named, with the wrong sign, is what that one's model leaves
        let relative = selected.causes.iter().any(|c| {
            let (named, other) = (c.scored.applied.id, s.applied.id);
            same_class(named, other) || by_amplitude(named) && by_amplitude(other)
        });
        // and so is a line at the ring's own frequency, of what bends the ring itself
        let relative = relative || by_amplitude_too && s.disqualified == OWN_LINE;
        if s.surprise / growth > THRESHOLD + MARGIN && !relative {
            left.significant.push(format!("something like {} ({})", s.applied.id, s.disqualified));
            left.told.push(s.applied.id);
            unexplained = unexplained.max(s.statistic);
        }
    }
    // several shapes in the mean that leave another one are as good as any curve: they name nothing
    let shapes = selected.causes.iter().filter(|c| which(&c.scored.applied).is_none()).count();
    // so are many causes
    let causes = selected.causes.len() + found().count();
    if shapes >= 2 || causes >= MANY {
        left.share_allowed = 0.0;
    } else if causes == 2 {
        left.share_allowed = SHARE_OF_SEVERAL;
    }
    left.share = unexplained / (unexplained + explained).max(1e-300);
    left
}

/// A random tone's mean over few bursts is not nothing: it is allowed for, steady and by the drive.
fn chance_mean(omega: f64, samples: usize) -> Applied {
    let wave = |power: usize, phase: f64| {
        let y = (0..samples).map(|k| (omega * k as f64 / samples as f64 + phase).cos());
        Direction::shape(power, y.collect())
    };
    let quarter = std::f64::consts::FRAC_PI_2;
    Applied {
        id: "random_tone",
        shape: omega,
        damping: 0.0,
        coefficients: vec![0.0; 4],
        directions: vec![wave(0, 0.0), wave(0, quarter), wave(1, 0.0), wave(1, quarter)],
        kind: super::candidates::Kind::Shapes,
    }
}

fn which(applied: &Applied) -> Option<usize> {
    match applied.kind {
        super::candidates::Kind::Covariate { which, .. } => Some(which),
        super::candidates::Kind::Tail => Some(super::covariates::IDLE),
        super::candidates::Kind::Shapes => None,
    }
}
