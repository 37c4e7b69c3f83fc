//! Scores critiques against what a simulation hid in the recordings that were criticised.
//!
//! In: for each recording a `CritiqueAnswer` (from its `critique.json`) and a `Truth` (from its
//! `truth.json`), from `inkling score --truth` and the tests of hidden effects. Out: a `Blind`,
//! which counts how often an effect was detected, rightly named, tied, withheld, missed or wrongly
//! named, by kind of truth, by effect and by strength.
//!
//! Words: a critique names *causes*; a simulation hides *effects*. A *tie* is a group of causes
//! that the critique could not tell apart. The strength of an effect is in detection limits (DL):
//! at 1 DL a test that knows the effect just finds it.
//!
//! The rules (`outcome`): a name is right if it is the id of a hidden effect. A tie is honest if
//! every name in it is one that, as the truth's `ties` say, nobody could tell from that effect.
//! Where the truth can only be tied (a covariate that follows another one), naming one of the
//! causes alone is wrong.

use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// The answer that a critique gives in its `critique.json`. `verdict`: `none` (nothing found),
/// `named`, `tie`, or `unknown` (something that no cause in the catalogue explains); `causes`: what
/// it names.
#[derive(Clone, Debug, Default, Deserialize)]
pub struct CritiqueAnswer {
    pub verdict: String,
    #[serde(default)]
    pub causes: Vec<NamedCause>,
}

/// A cause that a critique names: its id in the catalogue, the size of its effect with a 95 %
/// interval (in the unit of the effect's parameter), and the ids of causes that could not be told
/// from it.
#[derive(Clone, Debug, Default, Deserialize)]
pub struct NamedCause {
    pub id: String,
    pub value: Option<f64>,
    pub ci95: Option<[Option<f64>; 2]>,
    #[serde(default)]
    pub tied_with: Vec<String>,
}

/// The effects that a simulation hid in a recording, as its `truth.json` states them.
/// `circumstances` are words for what is unusual but no effect, such as `heavy_tails`.
#[derive(Clone, Debug, Default, Deserialize)]
pub struct Truth {
    pub effects: Vec<TrueEffect>,
    #[serde(default)]
    pub circumstances: Vec<serde_json::Value>,
}

/// One hidden effect: its id, whether the catalogue of causes has it, its size `value` in `unit`,
/// and its strength in detection limits.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct TrueEffect {
    pub id: String,
    pub in_catalogue: bool,
    /// What `value` is the size of; not needed where the truth is scored.
    #[serde(default)]
    pub parameter: String,
    #[serde(default)]
    pub unit: String,
    pub value: f64,
    pub strength_dl: f64,
    /// Names that an honest critic may leave this effect tied with, its own among them; empty: the
    /// effect can be told from all others.
    #[serde(default)]
    pub ties: Vec<String>,
}

impl CritiqueAnswer {
    /// Refuses an answer that contradicts itself: inkling writes no such answer, and its score would mean
    /// nothing.
    pub fn check(&self) -> Result<(), String> {
        match (self.verdict.as_str(), self.causes.len()) {
            ("none", 0) | ("unknown", _) => {}
            ("named" | "tie", n) if n > 0 => {}
            ("none", n) => return Err(format!("its verdict is `none`, and it has {n} causes")),
            ("named" | "tie", _) => {
                return Err(format!("its verdict is `{}`, and it has no causes", self.verdict));
            }
            (other, _) => {
                let short: String = other.chars().take(60).collect();
                return Err(format!(
                    "its verdict is {short:?}: it must be none, named, tie or unknown"
                ));
            }
        }
        for (i, cause) in self.causes.iter().enumerate() {
            if cause.id.is_empty() {
                return Err(format!("causes[{i}] has no id"));
            }
            if let Some([Some(low), Some(high)]) = cause.ci95
                && low > high
            {
                return Err(format!("causes[{i}].ci95 = [{low:?}, {high:?}]: the lower one first"));
            }
        }
        Ok(())
    }
}

impl Truth {
    /// Refuses effects without an id, and strengths that no effect can have.
    pub fn check(&self) -> Result<(), String> {
        for (i, effect) in self.effects.iter().enumerate() {
            if effect.id.is_empty() {
                return Err(format!("effects[{i}] has no id"));
            }
            if !(0.0..=1e9).contains(&effect.strength_dl) {
                let strength = effect.strength_dl;
                return Err(format!("effects[{i}].strength_dl = {strength:?}: give 0 to 1e9"));
            }
        }
        Ok(())
    }

    /// Whether the recording has this circumstance.
    fn has(&self, circumstance: &str) -> bool {
        self.circumstances.iter().any(|c| c.as_str() == Some(circumstance))
    }
}

/// The outcome for one recording. If several rules apply, `Wrong` comes first, then `Partly`,
/// `WideTie`, `HonestTie`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Every effect is named, and nothing else; if nothing is hidden, the verdict is `none`; if the effect is
    /// outside the catalogue, it is `unknown`.
    Right,
    /// A tie that is honest by the truth.
    HonestTie,
    /// A tie that holds the truth, and others that could have been told apart from it.
    WideTie,
    /// Some effects are named, but not all.
    Partly,
    /// The verdict is `unknown` though the effects have names, or though there is nothing but unusual noise.
    Withheld,
    /// The verdict is `none` though there is an effect.
    Missed,
    /// A name is not the truth's; or something was found where nothing is hidden; or one cause
    /// alone was named where the truth can only be tied.
    Wrong,
}

impl Outcome {
    pub fn word(self) -> &'static str {
        match self {
            Outcome::Right => "right",
            Outcome::HonestTie => "honest tie",
            Outcome::WideTie => "wide tie",
            Outcome::Partly => "one of two",
            Outcome::Withheld => "withheld",
            Outcome::Missed => "missed",
            Outcome::Wrong => "wrong",
        }
    }
}

/// All names of a cause: its own and those tied with it.
fn names(cause: &NamedCause) -> BTreeSet<&str> {
    cause.tied_with.iter().chain([&cause.id]).map(String::as_str).collect()
}

/// Compares a critique's answer with what was hidden in its recording. Causes beside the verdict
/// `unknown` are only the nearest ones, and claim nothing.
pub fn outcome(answer: &CritiqueAnswer, truth: &Truth) -> Outcome {
    let claims = matches!(answer.verdict.as_str(), "named" | "tie");

    // Nothing is hidden: only the verdict `none` is right.
    if truth.effects.is_empty() {
        return match answer.verdict.as_str() {
            "none" => Outcome::Right,
            // the verdict points at the noise, which is unusual; a name would be false
            "unknown" if truth.has("heavy_tails") => Outcome::Withheld,
            _ => Outcome::Wrong,
        };
    }

    // Something is hidden, and nothing is named.
    if !claims {
        let outside = truth.effects.iter().all(|e| !e.in_catalogue);
        return match (answer.verdict.as_str(), outside) {
            ("unknown", true) => Outcome::Right,
            ("unknown", false) => Outcome::Withheld,
            _ => Outcome::Missed,
        };
    }

    // Something is named. Each group of causes is one claim: a cause with those tied with it.
    let follows = truth.has("temperature_follows_time");
    let (mut found, mut tied, mut wide) = (0, false, false);
    let mut wrong = false;
    // a verdict `tie` is about one discrepancy, so all its names are one group, however they are
    // written down
    let mut groups: Vec<BTreeSet<&str>> = match answer.verdict.as_str() {
        "tie" => vec![answer.causes.iter().flat_map(names).collect()],
        _ => answer.causes.iter().map(names).collect(),
    };

    // Each group must hold the id of an effect that no other group is counted for. A group of one name is a
    // plain name; a larger group is an honest or a wide tie. Small groups choose first: a name that stands
    // alone leaves the other effects to those that are tied.
    groups.sort_by_key(BTreeSet::len);
    let mut hit = BTreeSet::new();
    for group in &groups {
        let free = |e: &&TrueEffect| group.contains(e.id.as_str()) && !hit.contains(e.id.as_str());
        let Some(effect) = truth.effects.iter().find(free) else {
            wrong = true;
            continue;
        };
        hit.insert(effect.id.as_str());
        found += 1;
        let must_tie = follows && !effect.ties.is_empty();
        let honest = group.iter().all(|name| effect.ties.iter().any(|t| t == name));
        match group.len() {
            1 => wrong |= must_tie,
            _ if honest => tied = true,
            _ => wide = true,
        }
    }

    // The worst that was found decides.
    match () {
        () if wrong => Outcome::Wrong,
        () if found < truth.effects.len() => Outcome::Partly,
        () if wide => Outcome::WideTie,
        () if tied => Outcome::HonestTie,
        () => Outcome::Right,
    }
}

/// Whether the 95 % interval of the cause that is named as `effect` holds the effect's true value;
/// `None` if that cause has no interval.
fn covered(answer: &CritiqueAnswer, effect: &TrueEffect) -> Option<bool> {
    let cause = answer.causes.iter().find(|c| c.id == effect.id)?;
    let [Some(low), Some(high)] = cause.ci95? else { return None };
    Some(low <= effect.value && effect.value <= high)
}

/// Counts of outcomes over some recordings.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Row {
    pub recordings: u32,
    /// Number of recordings whose verdict is not `none`.
    pub detected: u32,
    pub outcomes: BTreeMap<Outcome, u32>,
    /// Number of effects in recordings with the verdict `named` and the outcome right (or an honest
    /// tie) whose cause has an interval; and number of those intervals that hold the true value.
    pub intervals: u32,
    pub covered: u32,
}

impl Row {
    /// Number of recordings with this outcome.
    pub fn count(&self, outcome: Outcome) -> u32 {
        self.outcomes.get(&outcome).copied().unwrap_or(0)
    }

    /// Share of the recordings that have one of these outcomes; NaN without recordings.
    pub fn share(&self, outcomes: &[Outcome]) -> f64 {
        let n: u32 = outcomes.iter().map(|o| self.count(*o)).sum();
        f64::from(n) / f64::from(self.recordings)
    }

    /// Adds the counts of other recordings.
    fn merge(&mut self, other: &Row) {
        self.recordings += other.recordings;
        self.detected += other.detected;
        self.intervals += other.intervals;
        self.covered += other.covered;
        for (outcome, n) in &other.outcomes {
            *self.outcomes.entry(*outcome).or_default() += n;
        }
    }
}

/// What was hidden in a recording: nothing, one effect of the catalogue, two effects or more, or
/// one effect that the catalogue lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    Nothing,
    One,
    Two,
    Outside,
}

/// Outcomes of critiques against truths.
#[derive(Clone, Debug, Default)]
pub struct Blind {
    /// Counts by kind, effects (`a + b` for two) and strength in detection limits, rounded; of two
    /// effects the weaker one's strength, and 0 where nothing is hidden.
    rows: BTreeMap<(Kind, String, u32), Row>,
}

impl Blind {
    /// Counts how the answer for one recording compares with its truth, and returns the outcome.
    pub fn add(&mut self, answer: &CritiqueAnswer, truth: &Truth) -> Outcome {
        let kind = match truth.effects.as_slice() {
            [] => Kind::Nothing,
            [one] if one.in_catalogue => Kind::One,
            [_] => Kind::Outside,
            _ => Kind::Two,
        };
        let ids: Vec<&str> = truth.effects.iter().map(|e| e.id.as_str()).collect();
        let strength = truth.effects.iter().map(|e| e.strength_dl).fold(f64::INFINITY, f64::min);
        let strength = if strength.is_finite() { strength.round() as u32 } else { 0 };
        let outcome = outcome(answer, truth);
        let row = self.rows.entry((kind, ids.join(" + "), strength)).or_default();
        row.recordings += 1;
        row.detected += u32::from(answer.verdict != "none");
        *row.outcomes.entry(outcome).or_default() += 1;
        if answer.verdict == "named" && matches!(outcome, Outcome::Right | Outcome::HonestTie) {
            for inside in truth.effects.iter().filter_map(|effect| covered(answer, effect)) {
                row.intervals += 1;
                row.covered += u32::from(inside);
            }
        }
        outcome
    }

    /// The counts of all recordings of a kind whose rounded strength lies in `strengths`.
    pub fn row(&self, kind: Kind, strengths: std::ops::RangeInclusive<u32>) -> Row {
        let mut sum = Row::default();
        let of = self.rows.iter().filter(|((k, _, s), _)| *k == kind && strengths.contains(s));
        of.for_each(|(_, row)| sum.merge(row));
        sum
    }

    /// The counts of a kind by effect, of all strengths of at least `least_dl`.
    pub fn by_effect(&self, kind: Kind, least_dl: u32) -> BTreeMap<String, Row> {
        let mut rows: BTreeMap<String, Row> = BTreeMap::new();
        for ((k, id, strength), row) in &self.rows {
            if *k == kind && *strength >= least_dl {
                rows.entry(id.clone()).or_default().merge(row);
            }
        }
        rows
    }

    /// The rows for which the project has goals, each with its name.
    pub fn goals(&self) -> Vec<(&'static str, Row)> {
        let all = 0..=u32::MAX;
        vec![
            ("nothing hidden", self.row(Kind::Nothing, all.clone())),
            ("one effect, 1 DL", self.row(Kind::One, 1..=1)),
            ("one effect, >= 2 DL", self.row(Kind::One, 2..=u32::MAX)),
            ("one effect, >= 4 DL", self.row(Kind::One, 4..=u32::MAX)),
            ("outside the catalogue, >= 4 DL", self.row(Kind::Outside, 4..=u32::MAX)),
            ("outside the catalogue, all", self.row(Kind::Outside, all.clone())),
            ("two effects, both >= 4 DL", self.row(Kind::Two, 4..=u32::MAX)),
            ("two effects, all", self.row(Kind::Two, all)),
        ]
    }

    /// The goals as a Markdown table, then two tables by effect: of single effects in the catalogue
    /// and of those outside, from 2 DL on.
    pub fn markdown(&self) -> String {
        use Outcome::{HonestTie, Missed, Partly, Right, WideTie, Withheld, Wrong};
        let columns = [Right, HonestTie, WideTie, Partly, Withheld, Missed, Wrong];
        let line = |name: &str, row: &Row| {
            let counts: String = columns.iter().map(|c| format!(" {} |", row.count(*c))).collect();
            let covered = format!("{}/{}", row.covered, row.intervals);
            format!("| {name} | {} | {} |{counts} {covered} |\n", row.recordings, row.detected)
        };
        let heads: String = columns.iter().map(|c| format!(" {} |", c.word())).collect();
        let head = |what: &str| {
            let rule = "---|".repeat(columns.len() + 4);
            format!(
                "| {what} | recordings | detected |{heads} interval holds the truth |\n|{rule}\n"
            )
        };
        let mut text = head("hidden");
        for (name, row) in self.goals().iter().filter(|(_, row)| row.recordings > 0) {
            text += &line(name, row);
        }
        for (kind, what) in
            [(Kind::One, "one effect, >= 2 DL"), (Kind::Outside, "outside, >= 2 DL")]
        {
            let rows = self.by_effect(kind, 2);
            if !rows.is_empty() {
                text += &format!("\n{}", head(what));
                rows.iter().for_each(|(id, row)| text += &line(id, row));
            }
        }
        text
    }

    /// The goals' rows and all rows as JSON.
    pub fn json(&self) -> serde_json::Value {
        let rows: Vec<serde_json::Value> = self
            .rows
            .iter()
            .map(|((kind, effects, strength_dl), row)| {
                serde_json::json!({
                    "hidden": kind, "effects": effects, "strength_dl": strength_dl, "score": row
                })
            })
            .collect();
        let goals: serde_json::Map<String, serde_json::Value> = self
            .goals()
            .into_iter()
            .filter(|(_, row)| row.recordings > 0)
            .map(|(name, row)| (name.to_owned(), serde_json::json!(row)))
            .collect();
        serde_json::json!({ "goals": goals, "rows": rows })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(verdict: &str, causes: &[&[&str]]) -> CritiqueAnswer {
        let causes = causes.iter().map(|names| NamedCause {
            id: names[0].to_owned(),
            value: Some(1.0),
            ci95: Some([Some(0.5), Some(1.5)]),
            tied_with: names[1..].iter().map(|n| (*n).to_owned()).collect(),
        });
        CritiqueAnswer { verdict: verdict.to_owned(), causes: causes.collect() }
    }

    fn truth(ids: &[&str], ties: &[&str], circumstances: &[&str]) -> Truth {
        let effects = ids.iter().map(|id| TrueEffect {
            id: (*id).to_owned(),
            in_catalogue: !id.starts_with("outside"),
            value: 1.2,
            strength_dl: 4.0,
            ties: ties.iter().map(|t| (*t).to_owned()).collect(),
            ..TrueEffect::default()
        });
        let circumstances = circumstances.iter().map(|c| serde_json::json!(c)).collect();
        Truth { effects: effects.collect(), circumstances }
    }

    #[test]
    fn what_contradicts_itself_is_refused() {
        for good in [answer("none", &[]), answer("unknown", &[]), answer("unknown", &[&["tone"]])] {
            good.check().unwrap();
        }
        answer("tie", &[&["offset", "droop"]]).check().unwrap();
        for (bad, word) in [
            (answer("none", &[&["tone"]]), "none"),
            (answer("named", &[]), "no causes"),
            (answer("tie", &[]), "no causes"),
            (answer("Named", &[&["tone"]]), "none, named, tie or unknown"),
            (answer("", &[]), "none, named, tie or unknown"),
            (answer("named", &[&[""]]), "no id"),
        ] {
            let message = bad.check().unwrap_err();
            assert!(message.contains(word), "{message}");
        }
        let mut swapped = answer("named", &[&["tone"]]);
        swapped.causes[0].ci95 = Some([Some(1.5), Some(0.5)]);
        assert!(swapped.check().unwrap_err().contains("causes[0].ci95"));
        swapped.causes[0].ci95 = Some([None, Some(0.5)]);
        swapped.check().unwrap();
        truth(&["tone"], &[], &[]).check().unwrap();
        assert!(truth(&[""], &[], &[]).check().is_err());
    }

    #[test]
    fn every_outcome_has_its_rule() {
        use Outcome::*;
        let nothing = || truth(&[], &[], &[]);
        let heavy = || truth(&[], &[], &["heavy_tails"]);
        let one = |id: &str| truth(&[id], &[], &[]);
        let droop = || truth(&["droop"], &["offset", "droop"], &[]);
        let both = || truth(&["tone", "ageing"], &[], &[]);
        let aged = || truth(&["ageing"], &["ageing", "temperature"], &["temperature_follows_time"]);
        for (answer, truth, expected) in [
            (answer("none", &[]), nothing(), Right),
            (answer("unknown", &[]), nothing(), Wrong),
            (answer("unknown", &[]), heavy(), Withheld),
            (answer("named", &[&["tone"]]), heavy(), Wrong),
            (answer("tie", &[&["ageing", "temperature"]]), nothing(), Wrong),
            (answer("named", &[&["tone"]]), one("tone"), Right),
            (answer("named", &[&["tone"], &["offset"]]), one("tone"), Wrong),
            (answer("none", &[]), one("tone"), Missed),
            (answer("unknown", &[&["tone"]]), one("tone"), Withheld),
            (answer("tie", &[&["offset", "droop"]]), droop(), HonestTie),
            (answer("tie", &[&["offset"], &["droop"]]), droop(), HonestTie),
            (answer("tie", &[&["offset", "tone"]]), one("tone"), WideTie),
            (answer("named", &[&["offset"]]), droop(), Wrong),
            (answer("unknown", &[&["tone"]]), one("outside_x"), Right),
            (answer("named", &[&["tone"]]), one("outside_x"), Wrong),
            (answer("named", &[&["tone"]]), both(), Partly),
            (answer("named", &[&["ageing"], &["tone"]]), both(), Right),
            (answer("named", &[&["ageing"]]), aged(), Wrong),
            (answer("tie", &[&["ageing", "temperature"]]), aged(), HonestTie),
        ] {
            assert_eq!(outcome(&answer, &truth), expected, "{answer:?} {truth:?}");
        }
    }

    #[test]
    fn counts_add_up_and_intervals_are_counted_once() {
        let mut blind = Blind::default();
        blind.add(&answer("named", &[&["tone"]]), &truth(&["tone"], &[], &[]));
        blind.add(&answer("none", &[]), &truth(&["tone"], &[], &[]));
        blind.add(&answer("none", &[]), &truth(&[], &[], &[]));
        let row = blind.row(Kind::One, 4..=4);
        assert_eq!((row.recordings, row.detected, row.intervals, row.covered), (2, 1, 1, 1));
        assert!((row.share(&[Outcome::Missed]) - 0.5).abs() < 1e-12);
        assert!(blind.markdown().contains("| tone | 2 | 1 | 1 | 0 | 0 | 0 | 0 | 1 | 0 | 1/1 |"));
        assert_eq!(blind.json()["goals"]["nothing hidden"]["recordings"], 1);
    }
}
