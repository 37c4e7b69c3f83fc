//! Judges the claims of chapter 5 of the thesis, one by one: held, not held, or cannot tell.
//!
//! In: the figures of one data set over its rounds (`Measured`), and the claims of `claims.toml`,
//! which explains its keys. Out: a `Conclusion` for each claim that these data can decide, with the
//! figures that decided.
//!
//! A claim names pairs of figures and says that the first of each pair is larger (or, if `alike`,
//! that the two hardly differ). Each pair gets a verdict from the 95 % interval of its difference,
//! paired by round (`Measured::difference`). The claim's verdict is the worst of its pairs'
//! verdicts. A claim with `least` is judged by `at_least`; one with `undecided` is never decided.

use super::methods::{COMPARED, Size, figure};
use super::outcome::{Confusion, DataSet, Difference, Measured};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::LazyLock;

/// A verdict on a claim. The order is from the best to the worst, which `of_all` relies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    Held,
    CannotTell,
    NotHeld,
}

impl Verdict {
    pub fn in_words(self) -> &'static str {
        match self {
            Verdict::Held => "held",
            Verdict::NotHeld => "not held",
            Verdict::CannotTell => "cannot tell",
        }
    }

    /// The verdict where the figures confirm a claim, refute it, or do neither.
    fn of(confirmed: bool, refuted: bool) -> Verdict {
        match (confirmed, refuted) {
            (true, _) => Verdict::Held,
            (false, true) => Verdict::NotHeld,
            (false, false) => Verdict::CannotTell,
        }
    }

    /// The verdict on a claim of several parts: the worst of theirs. A claim without parts held.
    fn of_all(each: impl Iterator<Item = Verdict>) -> Verdict {
        each.max().unwrap_or(Verdict::Held)
    }
}

/// Who makes a claim, and how.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// The thesis concludes so.
    #[default]
    Conclusion,
    /// The thesis asks it, as future work.
    Question,
    /// The thesis does not say so; this project does.
    Ours,
}

/// A claim, and its verdict on one data set.
#[derive(Clone, Debug, Serialize)]
pub struct Conclusion {
    pub data: DataSet,
    pub kind: Kind,
    pub claim: &'static str,
    pub verdict: Verdict,
    /// The figures that decide, in words.
    pub because: String,
}

/// Two shares that differ by less than this are alike. The value is a judgement: the thesis calls
/// differences of .002 to .004 negligible, and reports one of .01 as a difference.
const ALIKE: f64 = 0.005;

impl Difference {
    /// Verdict on the claim that the difference is positive: held if the whole interval is above 0,
    /// not held if the whole interval is below `ALIKE` (being as good is not being better).
    fn is_positive(self) -> Verdict {
        Verdict::of(self.low > 0.0, self.high < ALIKE)
    }

    /// Verdict on the claim that the difference is negligible: held if the whole interval is within
    /// 2 `ALIKE` of 0, not held if it lies on one side of 0 and farther than `ALIKE`.
    fn is_negligible(self) -> Verdict {
        let Difference { low, high } = self;
        let is_small = low > -2.0 * ALIKE && high < 2.0 * ALIKE;
        Verdict::of(is_small, low > ALIKE || high < -ALIKE)
    }
}

/// Names of two figures that a claim compares; the first is the one that the claim says is larger.
type Pair = [String; 2];

/// A claim as it stands in `claims.toml`, whose head explains each key.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Claim {
    /// The claim in words, for the page.
    words: String,
    #[serde(default)]
    kind: Kind,
    /// The first figure of each pair is the larger one; with `alike`, the two hardly differ.
    #[serde(default)]
    pairs: Vec<Pair>,
    #[serde(default)]
    alike: bool,
    /// The training sizes that each `*` in the names of figures stands for.
    #[serde(default)]
    sizes: Vec<String>,
    /// Whether the figures are shares of all test signals, and not only of the faulty ones.
    #[serde(default)]
    all_signals: bool,
    /// Instead of pairs: the claim is that every method is right in this share or more.
    least: Option<f64>,
    /// Instead of pairs: why no data can tell.
    undecided: Option<String>,
    /// The data sets that can decide the claim; empty: all.
    #[serde(default)]
    sets: Vec<DataSet>,
    /// A figure without which the claim is not judged at all.
    needs: Option<String>,
}

/// The claims of `claims.toml`: under one key a list in the order of the page.
static CLAIMS: LazyLock<BTreeMap<String, Vec<Claim>>> = LazyLock::new(|| {
    toml::from_str(include_str!("claims.toml")).expect("a test has read the same text")
});

/// All conclusions that one data set can decide.
pub fn conclusions(of: &Measured) -> Vec<Conclusion> {
    let claims = CLAIMS.values().flatten().filter(|claim| claim.is_decided_by(of));
    claims.map(|claim| claim.judged(of)).collect()
}

impl Claim {
    /// Whether the claim is about this data set, and the figure that it needs was measured there.
    fn is_decided_by(&self, of: &Measured) -> bool {
        (self.sets.is_empty() || self.sets.contains(&of.set))
            && self.needs.as_ref().is_none_or(|key| of.mean(key).is_finite())
    }

    /// The verdict on the claim.
    fn judged(&'static self, of: &Measured) -> Conclusion {
        let (verdict, mut because) = match (&self.undecided, self.least) {
            (Some(why), _) => (Verdict::CannotTell, why.clone()),
            (None, Some(bound)) => at_least(of, bound),
            (None, None) => {
                let faulty = of.mean("tested/faulty");
                let healthy = if self.all_signals { of.mean("tested/healthy") } else { 0.0 };
                let says =
                    if self.alike { Difference::is_negligible } else { Difference::is_positive };
                compared(of, &self.pairs_by_size(), faulty + healthy, says)
            }
        };
        if self.kind == Kind::Ours {
            because += &both_named(of);
        }
        Conclusion { data: of.set, kind: self.kind, claim: &self.words, verdict, because }
    }

    /// The pairs with each of the claim's training sizes, if it names any, for `*`.
    fn pairs_by_size(&self) -> Vec<Pair> {
        let of_size = |size: &String| {
            let pair = |pair: &Pair| pair.each_ref().map(|key| key.replace('*', size));
            self.pairs.iter().map(pair).collect::<Vec<Pair>>()
        };
        match self.sizes.is_empty() {
            true => self.pairs.clone(),
            false => self.sizes.iter().flat_map(of_size).collect(),
        }
    }
}

/// The end of every claim of this project: how often the product's default and the thesis's own
/// method name the category rightly, and the class that each of them names rightly least often.
fn both_named(of: &Measured) -> String {
    let [ours, theirs] = ["default", "LR on r"].map(|name| {
        let category = of.mean(&figure(name, Size::ALL, "category"));
        let worst = of.confusions.get(name).and_then(worst_class).unwrap_or_default();
        format!("category right {category:.3}{worst}")
    });
    format!("; default: {ours}; residual matching: {theirs}")
}

/// The class of which the smallest share is named rightly, in words; `None` if nothing was counted.
fn worst_class(confusion: &Confusion) -> Option<String> {
    let rows = confusion.counts.iter().enumerate();
    let rows = rows.map(|(i, row)| (i, row[i], row.iter().sum::<f64>())).filter(|row| row.2 > 0.0);
    let (i, right, all) = rows.min_by(|a, b| (a.1 / a.2).total_cmp(&(b.1 / b.2)))?;
    Some(format!(", least often {}: {right:.0} of {all:.0}", confusion.classes[i]))
}

/// The verdict on all pairs with the figures that decide. `signals`: the number of test signals of one round
/// that the figures are shares of; `says`: the verdict of one difference.
fn compared(
    of: &Measured,
    pairs: &[Pair],
    signals: f64,
    says: fn(Difference) -> Verdict,
) -> (Verdict, String) {
    let of_pair = |[a, b]: &Pair| {
        // a figure of certain signals counts only those in which phi reaches its bound
        let counted = |key: &str| {
            let coverage = key.strip_suffix("certain").map(|of| of.to_owned() + "coverage");
            signals * coverage.map_or(1.0, |key| of.mean(&key))
        };
        let Some(difference) = of.difference(a, b, counted(a).min(counted(b))) else {
            return (Verdict::CannotTell, format!("{a} against {b}: not measured"));
        };
        let Difference { low, high } = difference;
        let (ours, other) = (of.mean(a), of.mean(b));
        let [a, b] = [a, b].map(|key| in_words(key));
        let because = format!("{a} {ours:.3}, {b} {other:.3}, difference [{low:+.3}, {high:+.3}]");
        (says(difference), because)
    };
    let each: Vec<(Verdict, String)> = pairs.iter().map(of_pair).collect();
    let all = Verdict::of_all(each.iter().map(|(verdict, _)| *verdict));

    // Tell the first three of the comparisons whose verdict is that of the whole claim.
    let deciding = each.iter().filter(|(verdict, _)| *verdict == all);
    let deciding: Vec<&str> = deciding.map(|(_, because)| because.as_str()).collect();
    let mut because = deciding[..deciding.len().min(3)].join("; ");
    if each.len() > 3 {
        because += &format!(" ({} of {} comparisons say so)", deciding.len(), each.len());
    }
    (all, because)
}

/// Judges the claim that the accuracy of each method, at every training size, is at least `bound`.
fn at_least(of: &Measured, bound: f64) -> (Verdict, String) {
    let mut least = (f64::INFINITY, String::new());
    let mut verdicts = Vec::new();
    for method in COMPARED {
        for size in Size::EACH {
            let key = figure(method.name, size, "accuracy");
            let Some(spread) = of.spread(&key) else {
                verdicts.push(Verdict::CannotTell);
                continue;
            };
            let rounds = of.values(&key).len() as f64;
            // Two standard errors: from the scatter over rounds, but at least from the sampling of all signals.
            let sampling = spread.mean * (1.0 - spread.mean) / (of.mean("tested/faulty") * rounds);
            let half = 2.0 * (spread.sd / rounds.sqrt()).max(sampling.sqrt());
            verdicts.push(Verdict::of(spread.mean - half >= bound, spread.mean + half < bound));
            if spread.mean < least.0 {
                least = (spread.mean, key);
            }
        }
    }
    let because = format!("the least is {:.3} ({})", least.0, in_words(&least.1));
    (Verdict::of_all(verdicts.into_iter()), because)
}

/// A figure's name in words.
fn in_words(key: &str) -> String {
    let (method, figure) = key.split_once('/').unwrap_or((key, ""));
    let method = if method == "I, 1.12 f0" { "the FD filter" } else { method };
    match figure {
        "accuracy" | "right" => method.into(),
        "certain" => format!("{method}, phi >= .8:"),
        figure => format!("{method}, {figure}:"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::thesis::outcome::Figures;

    fn pair(a: &str, b: &str) -> Pair {
        [a, b].map(str::to_owned)
    }

    fn measured(rounds: &[[f64; 2]]) -> Measured {
        let of = |[a, b]: &[f64; 2]| {
            let mut figures = Figures::default();
            figures.put("a", *a);
            figures.put("b", *b);
            figures
        };
        Measured::of(DataSet::Recordings, &rounds.iter().map(of).collect::<Vec<_>>())
    }

    #[test]
    fn a_claim_holds_fails_or_stays_open_by_its_interval() {
        use Verdict::{CannotTell, Held, NotHeld};
        let verdict = |rounds: &[[f64; 2]], signals, says: fn(Difference) -> Verdict| {
            compared(&measured(rounds), &[pair("a", "b")], signals, says).0
        };
        // as good as is not better than, and alike is a claim of its own
        for (rounds, better, alike) in [
            ([[0.9, 0.8], [0.91, 0.8], [0.9, 0.81]], Held, NotHeld),
            ([[0.8, 0.9], [0.81, 0.9], [0.8, 0.91]], NotHeld, NotHeld),
            ([[0.9, 0.9], [0.9, 0.901], [0.901, 0.9]], NotHeld, Held),
            ([[0.9, 0.8], [0.7, 0.8], [0.85, 0.8]], CannotTell, CannotTell),
        ] {
            assert_eq!(verdict(&rounds, 1e6, Difference::is_positive), better, "{rounds:?}");
            assert_eq!(verdict(&rounds, 1e6, Difference::is_negligible), alike, "{rounds:?}");
        }
        // with one round, the interval is the sampling error of its signals
        for (round, better) in [([0.9, 0.85], CannotTell), ([0.99, 0.5], Held)] {
            assert_eq!(verdict(&[round], 100.0, Difference::is_positive), better, "{round:?}");
        }
        let unknown = [pair("a", "b"), pair("a", "c")];
        let (open, because) =
            compared(&measured(&[[0.9, 0.5]]), &unknown, 1e4, Difference::is_positive);
        assert_eq!(open, CannotTell);
        assert!(because.contains("not measured"));
    }

    #[test]
    fn one_part_that_fails_refutes_the_whole() {
        use Verdict::{CannotTell, Held, NotHeld};
        for (each, all) in [
            (vec![Held, Held], Held),
            (vec![Held, CannotTell], CannotTell),
            (vec![CannotTell, NotHeld, Held], NotHeld),
        ] {
            assert_eq!(Verdict::of_all(each.into_iter()), all);
        }
    }
}
