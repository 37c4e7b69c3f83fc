//! Scores critiques against what a simulation hid in the recordings that were criticised.
//!
//! In: for each recording a `CritiqueAnswer` (from its `critique.json`) and a `Truth` (from its
//! `truth.json`), from `inkling score --truth` and the tests of hidden effects. Out: a `Blind`, which counts
//! outcomes by kind of truth, by effect and by strength.
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

/// Its size has a 95 % interval and is in the unit of the effect's parameter.
#[derive(Clone, Debug, Deserialize)]
pub struct NamedCause {
    pub id: String,
    pub value: Option<f64>,
    pub ci95: Option<[Option<f64>; 2]>,
    #[serde(default)]
    pub tied_with: Vec<String>,
}

/// Circumstances that make a recording awkward without being an effect: a critique must not name them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Circumstance {
    /// The channels' frequencies scatter by this standard deviation, relative.
    FrequencyScatter(f64),
    /// Every signal's own frequency scatters by this standard deviation, relative.
    BurstScatter(f64),
    /// Some 6 % of the channels ring faultily all the time.
    FaultyChannels,
    /// The temperature rises linearly over the run, so that nobody can tell the two apart.
    TemperatureFollowsTime,
    /// The noise is Student's t with four degrees of freedom, of the same variance.
    HeavyTails,
}

/// What is true of a recording: the contents of the sealed `truth.json`. Only the effects must be there where
/// it is scored.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Truth {
    #[serde(default)]
    pub version: u32,
    /// A random number, so that the truth cannot be guessed from its digest, which lies beside the recording.
    #[serde(default)]
    pub salt: String,
    #[serde(default)]
    pub seed: u64,
    pub effects: Vec<TrueEffect>,
    #[serde(default)]
    pub circumstances: Vec<Circumstance>,
    /// Number of all signals, and of those of faulty channels.
    #[serde(default)]
    pub signals: usize,
    #[serde(default)]
    pub faulty_signals: usize,
}

/// Its size is `value` in `unit`; its strength is in detection limits.
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

/// Causes beside the verdict `unknown` are only the nearest ones, and claim nothing.
pub fn outcome(answer: &CritiqueAnswer, truth: &Truth) -> Outcome {
    let claims = matches!(answer.verdict, Verdict::Named | Verdict::Tie);

    let is = |circumstance| truth.circumstances.contains(&circumstance);

    // Nothing is hidden: only the verdict `none` is right.
    if truth.effects.is_empty() {
        return match answer.verdict {
            Verdict::None => Outcome::Right,
            // the verdict points at the noise, which is unusual; a name would be false
            Verdict::Unknown if is(Circumstance::HeavyTails) => Outcome::Withheld,
            _ => Outcome::Wrong,
        };
    }

    // Something is hidden, and nothing is named.
    if !claims {
        let outside = truth.effects.iter().all(|e| !e.in_catalogue);
        return match (answer.verdict, outside) {
            (Verdict::Unknown, true) => Outcome::Right,
            (Verdict::Unknown, false) => Outcome::Withheld,
            _ => Outcome::Missed,
        };
    }

    // Something is named. Each group of causes is one claim: a cause with those tied with it.
    let follows = is(Circumstance::TemperatureFollowsTime);
    let (mut found, mut tied, mut wide) = (0, false, false);
    let mut wrong = false;
    // a verdict `tie` is about one discrepancy, so all its names are one group
    let mut groups: Vec<BTreeSet<&str>> = match answer.verdict {
        Verdict::Tie => vec![answer.causes.iter().flat_map(names).collect()],
        _ => answer.causes.iter().map(names).collect(),
    };

    // Each group must hold the id of an effect that no other group is counted for. Small groups choose first:
    // a name that stands alone leaves the other effects to those that are tied.
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
    pub fn count(&self, outcome: Outcome) -> u32 {
        self.outcomes.get(&outcome).copied().unwrap_or(0)
    }

    /// Share of the recordings that have one of these outcomes; NaN without recordings.
    pub fn share(&self, outcomes: &[Outcome]) -> f64 {
        let n: u32 = outcomes.iter().map(|o| self.count(*o)).sum();
        f64::from(n) / f64::from(self.recordings)
    }

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

#[derive(Clone, Debug, Default)]
pub struct Blind {
    /// Counts by kind, effects (`a + b` for two) and strength in detection limits, rounded; of two
    /// effects the weaker one's strength, and 0 where nothing is hidden.
    rows: BTreeMap<(Kind, String, u32), Row>,
}

impl Blind {
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
        row.detected += u32::from(answer.verdict != Verdict::None);
        *row.outcomes.entry(outcome).or_default() += 1;
        let named = answer.verdict == Verdict::Named;
        if named && matches!(outcome, Outcome::Right | Outcome::HonestTie) {
            for inside in truth.effects.iter().filter_map(|effect| covered(answer, effect)) {
                row.intervals += 1;
                row.covered += u32::from(inside);
            }
        }
        outcome
    }

    pub fn row(&self, kind: Kind, strengths: std::ops::RangeInclusive<u32>) -> Row {
        let mut sum = Row::default();
        let of = self.rows.iter().filter(|((k, _, s), _)| *k == kind && strengths.contains(s));
        of.for_each(|(_, row)| sum.merge(row));
        sum
    }

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

    fn answer(verdict: Verdict, causes: &[&[&str]]) -> CritiqueAnswer {
        let causes = causes.iter().map(|names| NamedCause {
            id: names[0].to_owned(),
            value: Some(1.0),
            ci95: Some([Some(0.5), Some(1.5)]),
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
            (answer(Verdict::Unknown, &[]), heavy(), Withheld),
            (answer(Verdict::Named, &[&["tone"]]), heavy(), Wrong),
            (answer(Verdict::Tie, &[&["ageing", "temperature"]]), nothing(), Wrong),
            (answer(Verdict::Named, &[&["tone"]]), one("tone"), Right),
            (answer(Verdict::Named, &[&["tone"], &["offset"]]), one("tone"), Wrong),
            (answer(Verdict::None, &[]), one("tone"), Missed),
            (answer(Verdict::Unknown, &[&["tone"]]), one("tone"), Withheld),
            (answer(Verdict::Tie, &[&["offset", "droop"]]), droop(), HonestTie),
            (answer(Verdict::Tie, &[&["offset"], &["droop"]]), droop(), HonestTie),
            (answer(Verdict::Tie, &[&["offset", "tone"]]), one("tone"), WideTie),
            (answer(Verdict::Named, &[&["offset"]]), droop(), Wrong),
            (answer(Verdict::Unknown, &[&["tone"]]), one("outside_x"), Right),
            (answer(Verdict::Named, &[&["tone"]]), one("outside_x"), Wrong),
            (answer(Verdict::Named, &[&["tone"]]), both(), Partly),
            (answer(Verdict::Named, &[&["ageing"], &["tone"]]), both(), Right),
            (answer(Verdict::Named, &[&["ageing"]]), aged(), Wrong),
            (answer(Verdict::Tie, &[&["ageing", "temperature"]]), aged(), HonestTie),
        ] {
            assert_eq!(outcome(&answer, &truth), expected, "{answer:?} {truth:?}");
        }
    }

    #[test]
    fn counts_add_up_and_intervals_are_counted_once() {
        let mut blind = Blind::default();
        blind.add(&answer(Verdict::Named, &[&["tone"]]), &truth(&["tone"], &[], &[]));
        blind.add(&answer(Verdict::None, &[]), &truth(&["tone"], &[], &[]));
        blind.add(&answer(Verdict::None, &[]), &truth(&[], &[], &[]));
        let row = blind.row(Kind::One, 4..=4);
        assert_eq!((row.recordings, row.detected, row.intervals, row.covered), (2, 1, 1, 1));
        assert!((row.share(&[Outcome::Missed]) - 0.5).abs() < 1e-12);
        assert!(blind.markdown().contains("| tone | 2 | 1 | 1 | 0 | 0 | 0 | 0 | 1 | 0 | 1/1 |"));
        assert_eq!(blind.json()["goals"]["nothing hidden"]["recordings"], 1);
    }
}
