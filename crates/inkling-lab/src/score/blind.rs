//! Scores critiques against what a simulation hid in the recordings that were criticised: names against truth.
//!
//! In: a `CritiqueAnswer` (from a `critique.json`) and the [`Truth`] of its recording, from `inkling score
//! --truth` and the tests of hidden effects. Out: an [`Outcome`]. A critique names *causes*; a simulation hides
//! *effects*. A *tie* is a group of causes that the critique could not tell apart.

use super::truth::{Circumstance, TrueEffect, Truth};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The model explains the data.
    None,
    /// Every cause is named; of several, one may be tied.
    Named,
    /// One discrepancy, and several causes that explain it equally well.
    Tie,
    /// The misfit is significant and nothing in the catalogue explains it.
    Unknown,
}

impl Verdict {
    pub fn as_str(self) -> &'static str {
        match self {
            Verdict::None => "none",
            Verdict::Named => "named",
            Verdict::Tie => "tie",
            Verdict::Unknown => "unknown",
        }
    }
}

#[derive(Clone, Debug, Deserialize)]
pub struct CritiqueAnswer {
    pub verdict: Verdict,
    #[serde(default)]
    pub causes: Vec<NamedCause>,
}

#[derive(Clone, Debug, Deserialize)]
pub struct NamedCause {
    pub id: String,
    #[serde(default)]
    pub tied_with: Vec<String>,
}

/// The outcome for one recording. The later one is the worse.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Every effect is named, and nothing else; if nothing is hidden, the verdict is `none`; if the effect is
    /// outside the catalogue, it is `unknown`.
    Right,
    /// Right, but for a tie of names that, as the truth says, nobody could tell apart.
    Tied,
    /// The verdict is `unknown` though the effects have names, or though there is nothing but unusual noise;
    /// or a tie holds the truth, and a name that could have been told apart from it.
    Unknown,
    /// The verdict is `none` though there is an effect, or of several effects not all are named.
    Missed,
    /// A name is not the truth's; or something was found where nothing is hidden; or one
    /// cause alone was named where the truth can only be tied.
    Wrong,
}

impl Outcome {
    pub fn word(self) -> &'static str {
        match self {
            Outcome::Right => "right",
            Outcome::Tied => "tied",
            Outcome::Unknown => "unknown",
            Outcome::Missed => "missed",
            Outcome::Wrong => "wrong",
        }
    }
}

impl CritiqueAnswer {
    /// Refuses an answer that contradicts itself, since its score would mean nothing.
    pub fn check(&self) -> Result<(), String> {
        let (verdict, n) = (self.verdict.as_str(), self.causes.len());
        match (self.verdict, n) {
            (Verdict::None, 1..) | (Verdict::Named | Verdict::Tie, 0) => {
                Err(format!("its verdict is `{verdict}`, and it has {n} causes"))
            }
            _ => Ok(()),
        }
    }

    /// The groups of names that the answer claims, each a cause with those tied with it. Causes beside the
    /// verdict `unknown` are only the nearest ones, and claim nothing.
    fn claims(&self) -> Vec<BTreeSet<&str>> {
        let names = self.causes.iter().map(|cause| {
            cause.tied_with.iter().chain([&cause.id]).map(String::as_str).collect::<BTreeSet<_>>()
        });
        match self.verdict {
            Verdict::None | Verdict::Unknown => Vec::new(),
            Verdict::Named => names.collect(),
            // it is about one discrepancy, so all its names are one group
            Verdict::Tie => vec![names.flatten().collect()],
        }
    }
}

pub fn outcome(answer: &CritiqueAnswer, truth: &Truth) -> Outcome {
    let is = |circumstance| truth.circumstances.contains(&circumstance);
    let mut claims = answer.claims();
    if claims.is_empty() {
        let outside = truth.effects.iter().all(|e| !e.in_catalogue);
        return match (answer.verdict, truth.effects.is_empty()) {
            (Verdict::Unknown, true) if is(Circumstance::HeavyTails) => Outcome::Unknown,
            (Verdict::Unknown, true) => Outcome::Wrong,
            (_, true) => Outcome::Right,
            (Verdict::Unknown, false) if outside => Outcome::Right,
            (Verdict::Unknown, false) => Outcome::Unknown,
            (_, false) => Outcome::Missed,
        };
    }
    // Each group must hold an effect that no other group is counted for. Small groups choose first: a name that
    // stands alone leaves the other effects to those that are tied.
    claims.sort_by_key(BTreeSet::len);
    let mut open: Vec<&TrueEffect> = truth.effects.iter().collect();
    let mut said = Outcome::Right;
    for claim in &claims {
        let Some(k) = open.iter().position(|e| claim.contains(e.id.as_str())) else {
            return Outcome::Wrong;
        };
        let effect = open.remove(k);
        said = said.max(match claim.len() {
            // nobody could have told it from its twin
            1 if is(Circumstance::TemperatureFollowsTime) && !effect.ties.is_empty() => {
                Outcome::Wrong
            }
            1 => Outcome::Right,
            _ if claim.iter().all(|name| effect.ties.iter().any(|tie| tie == name)) => {
                Outcome::Tied
            }
            _ => Outcome::Unknown,
        });
    }
    if open.is_empty() { said } else { said.max(Outcome::Missed) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(verdict: Verdict, causes: &[&[&str]]) -> CritiqueAnswer {
        let causes = causes.iter().map(|names| NamedCause {
            id: names[0].to_owned(),
            tied_with: names[1..].iter().map(|n| (*n).to_owned()).collect(),
        });
        CritiqueAnswer { verdict, causes: causes.collect() }
    }

    fn truth(ids: &[&str], ties: &[&str], circumstances: &[Circumstance]) -> Truth {
        let effects = ids.iter().map(|id| TrueEffect {
            id: (*id).to_owned(),
            in_catalogue: !id.starts_with("outside"),
            value: 1.2,
            strength_dl: 4.0,
            ties: ties.iter().map(|t| (*t).to_owned()).collect(),
            ..TrueEffect::default()
        });
        let circumstances = circumstances.to_vec();
        Truth { effects: effects.collect(), circumstances, ..Truth::default() }
    }

    #[test]
    fn what_contradicts_itself_is_refused() {
        answer(Verdict::Unknown, &[&["tone"]]).check().unwrap();
        for (bad, word) in [
            (answer(Verdict::None, &[&["tone"]]), "none"),
            (answer(Verdict::Named, &[]), "0 causes"),
            (answer(Verdict::Tie, &[]), "0 causes"),
        ] {
            let message = bad.check().unwrap_err();
            assert!(message.contains(word), "{message}");
        }
        let unknown = serde_json::from_str::<CritiqueAnswer>(r#"{"verdict":"Named"}"#).unwrap_err();
        assert!(unknown.to_string().contains("`named`"), "{unknown}");
    }

    #[test]
    fn every_outcome_has_its_rule() {
        use Outcome::*;
        let nothing = || truth(&[], &[], &[]);
        let heavy = || truth(&[], &[], &[Circumstance::HeavyTails]);
        let one = |id: &str| truth(&[id], &[], &[]);
        let droop = || truth(&["droop"], &["offset", "droop"], &[]);
        let both = || truth(&["tone", "ageing"], &[], &[]);
        let aged = || {
            truth(&["ageing"], &["ageing", "temperature"], &[Circumstance::TemperatureFollowsTime])
        };
        for (answer, truth, expected) in [
            (answer(Verdict::None, &[]), nothing(), Right),
            (answer(Verdict::Unknown, &[]), nothing(), Wrong),
            (answer(Verdict::Unknown, &[]), heavy(), Unknown),
            (answer(Verdict::Named, &[&["tone"]]), heavy(), Wrong),
            (answer(Verdict::Tie, &[&["ageing", "temperature"]]), nothing(), Wrong),
            (answer(Verdict::Named, &[&["tone"]]), one("tone"), Right),
            (answer(Verdict::Named, &[&["tone"], &["offset"]]), one("tone"), Wrong),
            (answer(Verdict::None, &[]), one("tone"), Missed),
            (answer(Verdict::Unknown, &[&["tone"]]), one("tone"), Unknown),
            (answer(Verdict::Tie, &[&["offset", "droop"]]), droop(), Tied),
            (answer(Verdict::Tie, &[&["offset"], &["droop"]]), droop(), Tied),
            (answer(Verdict::Tie, &[&["offset", "tone"]]), one("tone"), Unknown),
            (answer(Verdict::Named, &[&["offset"]]), droop(), Wrong),
            (answer(Verdict::Unknown, &[&["tone"]]), one("outside_x"), Right),
            (answer(Verdict::Named, &[&["tone"]]), one("outside_x"), Wrong),
            (answer(Verdict::Named, &[&["tone"]]), both(), Missed),
            (answer(Verdict::Named, &[&["ageing"], &["tone"]]), both(), Right),
            (answer(Verdict::Named, &[&["ageing"]]), aged(), Wrong),
            (answer(Verdict::Tie, &[&["ageing", "temperature"]]), aged(), Tied),
        ] {
            assert_eq!(outcome(&answer, &truth), expected, "{answer:?} {truth:?}");
        }
    }
}
