//! Chapter 5 of the thesis, conclusion by conclusion: held, not held, cannot tell.
//!
//! In: figures over rounds. Out: a verdict on each, from 95 % intervals of differences that are paired by
//! round.

use super::measure::{Size, figure};
use super::outcome::{Confusion, DataSet, Difference, Measured};
use serde::Serialize;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    Held,
    NotHeld,
    CannotTell,
}

impl Verdict {
    pub fn in_words(self) -> &'static str {
        match self {
            Verdict::Held => "held",
            Verdict::NotHeld => "not held",
            Verdict::CannotTell => "cannot tell",
        }
    }

    /// The verdict on a claim that consists of several: one that did not hold refutes it.
    fn of_all(each: impl Iterator<Item = Verdict>) -> Verdict {
        each.fold(Verdict::Held, |all, one| match (all, one) {
            (Verdict::NotHeld, _) | (_, Verdict::NotHeld) => Verdict::NotHeld,
            (Verdict::CannotTell, _) | (_, Verdict::CannotTell) => Verdict::CannotTell,
            _ => Verdict::Held,
        })
    }
}

/// Who makes a claim, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// The thesis concludes so.
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

/// Shares that differ by less are alike: the thesis calls a difference of .002 to .004 negligible, and
/// reports .01 as one.
const ALIKE: f64 = 0.005;

impl Difference {
    /// Verdict on the claim that the difference is positive.
    fn is_positive(self) -> Verdict {
        match self {
            Difference { low, .. } if low > 0.0 => Verdict::Held,
            Difference { high, .. } if high < ALIKE => Verdict::NotHeld,
            _ => Verdict::CannotTell,
        }
    }

    /// Verdict on the claim that the difference is negligible.
    fn is_negligible(self) -> Verdict {
        match self {
            Difference { low, high, .. } if low > -2.0 * ALIKE && high < 2.0 * ALIKE => {
                Verdict::Held
            }
            Difference { low, high, .. } if low > ALIKE || high < -ALIKE => Verdict::NotHeld,
            _ => Verdict::CannotTell,
        }
    }
}

/// Names of two figures that a claim compares; the first is the one that it says is larger.
type Pair = (String, String);

fn pair(a: impl Into<String>, b: impl Into<String>) -> Pair {
    (a.into(), b.into())
}

/// All conclusions that one data set can decide.
pub fn conclusions(of: &Measured) -> Vec<Conclusion> {
    let [lr_r, lr_y, nn_r, nn_y] = ["LR on r", "LR on y", "1-NN on r", "1-NN on y"];
    let accuracy = |method, size| figure(method, size, "accuracy");
    let certain = |method, size| figure(method, size, "certain");
    let large = [Size::All, Size::Half];
    let faulty = of.mean("tested/faulty");
    let all_signals = faulty + of.mean("tested/healthy");
    let larger = |claim, pairs: Vec<Pair>, signals| {
        judged(of, claim, pairs, signals, Difference::is_positive)
    };
    let alike =
        |claim, pairs: Vec<Pair>| judged(of, claim, pairs, faulty, Difference::is_negligible);
    let question = |asked: Conclusion| Conclusion { kind: Kind::Question, ..asked };
    let of_sizes = |sizes: &[Size], f: &dyn Fn(Size) -> Vec<Pair>| -> Vec<Pair> {
        sizes.iter().flat_map(|&size| f(size)).collect()
    };

    // claims that every data set can decide
    let mut all = vec![
        larger(
            "The FD filter detects faults better than the current practice.",
            vec![match of.set {
                // of its experiment, the text counts the faults that were detected
                DataSet::Drying => pair("I, 1.12 f0/detected", "practice/detected"),
                _ => pair("I, 1.12 f0/right", "practice/right"),
            }],
            all_signals,
        ),
        larger(
            "The FI filter isolates better than the practice extended to every class, as §4-3 asks for.",
            vec![pair(accuracy(lr_r, Size::All), "practice/all classes")],
            faulty,
        ),
        larger(
            "Linear regression with a bound on its certainty is more often right than any other method, whichever signal and \
             training size (of the signals that it names).",
            of_sizes(&Size::EACH, &|size| {
                let others = [lr_r, lr_y, nn_r, nn_y].map(|method| accuracy(method, size));
                let mut pairs = Vec::new();
                for bounded in [certain(lr_r, size), certain(lr_y, size)] {
                    pairs.extend(others.iter().map(|other| pair(bounded.clone(), other.clone())));
                }
                pairs
            }),
            faulty,
        ),
        alike(
            "With that bound r or y makes a negligible difference where training signals are many.",
            of_sizes(&large, &|size| vec![pair(certain(lr_r, size), certain(lr_y, size))]),
        ),
        larger(
            "With that bound r is better than y where training signals are few.",
            vec![pair(certain(lr_r, Size::Tenth), certain(lr_y, Size::Tenth))],
            faulty,
        ),
        larger(
            "The nearest neighbour is better than linear regression where training signals are enough.",
            of_sizes(&large, &|size| {
                vec![
                    pair(accuracy(nn_r, size), accuracy(lr_r, size)),
                    pair(accuracy(nn_y, size), accuracy(lr_y, size)),
                ]
            }),
            faulty,
        ),
        larger(
            "On r and with few training signals linear regression is slightly better than the nearest neighbour.",
            vec![pair(accuracy(lr_r, Size::Tenth), accuracy(nn_r, Size::Tenth))],
            faulty,
        ),
        larger(
            "r is better than y in all cases.",
            of_sizes(&Size::EACH, &|size| {
                vec![
                    pair(accuracy(lr_r, size), accuracy(lr_y, size)),
                    pair(accuracy(nn_r, size), accuracy(nn_y, size)),
                ]
            }),
            faulty,
        ),
        larger(
            "A tenth of the training signals costs regression on y and the nearest neighbour some points.",
            [lr_y, nn_r, nn_y]
                .map(|method| pair(accuracy(method, Size::All), accuracy(method, Size::Tenth)))
                .into(),
            faulty,
        ),
        question(larger(
            "Model matching, on the principle of the FD filter, isolates better than residual matching.",
            vec![pair("model matching/of all", accuracy(lr_r, Size::All))],
            faulty,
        )),
        question(larger(
            "A more systematic choice of the denominator detects better than method I at the resonance.",
            vec![pair("searched/right", "I/right")],
            all_signals,
        )),
    ];
    // known is 0, and this figure NaN, where the data have none of the classes that the practice knows
    if of.mean("practice/of the four").is_finite() {
        let claim = "The FI filter isolates better than the current practice, which knows four of the thesis's nine classes.";
        let pair = pair(accuracy(lr_r, Size::All), "practice/four classes");
        all.insert(1, larger(claim, vec![pair], faulty));
    }
    if of.set == DataSet::Drying {
        all.push(larger(
            "On the drying experiment the FI filter isolates better than the practice, which takes dried nozzles for \
             healthy ones.",
            vec![pair(accuracy(lr_r, Size::All), "practice/in one step")],
            faulty,
        ));
        all.push(at_least(
            of,
            "On the drying experiment every method is right in .98 or more, at any training size.",
            0.98,
        ));
    }
    if of.rounds.contains_key("LR on r certain/HMA, SDN and IDN as one") {
        all.push(larger(
            "To count slightly and intermediately dried nozzles as one class makes isolation more often right.",
            vec![pair("LR on r certain/HMA, SDN and IDN as one", certain(lr_r, Size::All))],
            faulty,
        ));
    }
    if of.set == DataSet::ThesisForm {
        all.push(Conclusion {
            data: of.set,
            kind: Kind::Question,
            claim: "Uniform distributions represent how the signals of real channels scatter.",
            verdict: Verdict::CannotTell,
            because: "the data are simulated with such distributions; `inkling thesis RECORDING... --labels FILE` runs this \
                      chapter on measured ones"
                .into(),
        });
    }
    all.push(by_default(of, accuracy(lr_r, Size::All), faulty));
    all
}

/// A claim that the thesis does not make, since it has no second method: the product's default against its
/// own.
fn by_default(of: &Measured, own: String, faulty: f64) -> Conclusion {
    let default = figure("default", Size::All, "accuracy");
    let mut said = judged(
        of,
        "inkling's default names faults better than residual matching does.",
        vec![pair(default, own)],
        faulty,
        Difference::is_positive,
    );
    let [ours, theirs] = ["default", "LR on r"].map(|name| {
        let category = of.mean(&figure(name, Size::All, "category"));
        let worst = of.confusions.get(name).and_then(worst_class).unwrap_or_default();
        format!("category right {}{worst}", share(category))
    });
    said.kind = Kind::Ours;
    said.because += &format!("; default: {ours}; residual matching: {theirs}");
    said
}

/// The class that is named rightly least often, in words.
fn worst_class(confusion: &Confusion) -> Option<String> {
    let rows = confusion.counts.iter().enumerate();
    let rows = rows.map(|(i, row)| (i, row[i], row.iter().sum::<f64>())).filter(|row| row.2 > 0.0);
    let (i, right, all) = rows.min_by(|a, b| (a.1 / a.2).total_cmp(&(b.1 / b.2)))?;
    Some(format!(", least often {}: {right:.0} of {all:.0}", confusion.classes[i]))
}

/// Judges a claim by the differences of its pairs. `verdict`: what one difference says.
fn judged(
    of: &Measured,
    claim: &'static str,
    pairs: Vec<Pair>,
    signals: f64,
    verdict: fn(Difference) -> Verdict,
) -> Conclusion {
    let mut each = Vec::new();
    for (a, b) in &pairs {
        // a figure of certain signals counts only those in which phi reaches its bound
        let counted = |key: &str| {
            let coverage = key.strip_suffix("certain").map(|of| of.to_owned() + "coverage");
            signals * coverage.map_or(1.0, |key| of.mean(&key))
        };
        let Some(difference) = of.difference(a, b, counted(a).min(counted(b))) else {
            each.push((Verdict::CannotTell, format!("{a} against {b}: not measured")));
            continue;
        };
        let Difference { low, high, .. } = difference;
        let (ours, other) = (share(of.mean(a)), share(of.mean(b)));
        let interval = format!("[{}, {}]", signed(low), signed(high));
        let [a, b] = [a, b].map(|key| in_words(key));
        each.push((verdict(difference), format!("{a} {ours}, {b} {other}, difference {interval}")));
    }
    let all = Verdict::of_all(each.iter().map(|(verdict, _)| *verdict));
    // tell the comparisons that decide; of many alike the first three are enough
    let mut deciding: Vec<&String> =
        each.iter().filter(|(verdict, _)| *verdict == all).map(|(_, because)| because).collect();
    let (number, of_all) = (deciding.len(), each.len());
    deciding.truncate(3);
    let mut because = deciding.into_iter().cloned().collect::<Vec<_>>().join("; ");
    if of_all > 3 {
        because += &format!(" ({number} of {of_all} comparisons say so)");
    }
    Conclusion { data: of.set, kind: Kind::Conclusion, claim, verdict: all, because }
}

/// Judges the claim that every method's accuracy is at least `bound`.
fn at_least(of: &Measured, claim: &'static str, bound: f64) -> Conclusion {
    let mut least = (f64::INFINITY, String::new());
    let mut verdicts = Vec::new();
    for method in super::measure::COMPARED {
        for size in Size::EACH {
            let key = figure(method.name, size, "accuracy");
            let Some(spread) = of.spread(&key) else {
                verdicts.push(Verdict::CannotTell);
                continue;
            };
            let rounds = of.values(&key).len() as f64;
            // the half-width of the interval: from round to round, but at least that of sampling
            let sampling = spread.mean * (1.0 - spread.mean) / (of.mean("tested/faulty") * rounds);
            let half = 2.0 * (spread.sd / rounds.sqrt()).max(sampling.sqrt());
            verdicts.push(match spread.mean {
                mean if mean + half < bound => Verdict::NotHeld,
                mean if mean - half >= bound => Verdict::Held,
                _ => Verdict::CannotTell,
            });
            if spread.mean < least.0 {
                least = (spread.mean, key);
            }
        }
    }
    let because = format!("the least is {} ({})", share(least.0), in_words(&least.1));
    let verdict = Verdict::of_all(verdicts.into_iter());
    Conclusion { data: of.set, kind: Kind::Conclusion, claim, verdict, because }
}

/// A figure's name in words for the reader.
fn in_words(key: &str) -> String {
    let (method, figure) = key.split_once('/').unwrap_or((key, ""));
    let method = if method == "I, 1.12 f0" { "the FD filter" } else { method };
    match figure {
        "accuracy" | "right" => method.into(),
        "certain" => format!("{method}, phi >= .8:"),
        figure => format!("{method}, {figure}:"),
    }
}

/// A share with three decimals.
fn share(v: f64) -> String {
    format!("{v:.3}")
}

fn signed(v: f64) -> String {
    format!("{v:+.3}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::thesis::outcome::Figures;

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
        let verdict = |rounds: &[[f64; 2]]| {
            judged(&measured(rounds), "", vec![pair("a", "b")], 1e6, Difference::is_positive)
                .verdict
        };
        assert_eq!(verdict(&[[0.9, 0.8], [0.91, 0.8], [0.9, 0.81]]), Verdict::Held);
        assert_eq!(verdict(&[[0.8, 0.9], [0.81, 0.9], [0.8, 0.91]]), Verdict::NotHeld);
        // as good as is not better than
        assert_eq!(verdict(&[[0.9, 0.9], [0.9, 0.901], [0.901, 0.9]]), Verdict::NotHeld);
        assert_eq!(verdict(&[[0.9, 0.8], [0.7, 0.8], [0.85, 0.8]]), Verdict::CannotTell);
        // with one round, the interval is the sampling error of its signals
        let one = |a, b| {
            let pairs = vec![pair("a", "b")];
            judged(&measured(&[[a, b]]), "", pairs, 100.0, Difference::is_positive).verdict
        };
        assert_eq!(one(0.9, 0.85), Verdict::CannotTell);
        assert_eq!(one(0.99, 0.5), Verdict::Held);
        let unknown = vec![pair("a", "b"), pair("a", "c")];
        let open = judged(&measured(&[[0.9, 0.5]]), "", unknown, 1e4, Difference::is_positive);
        assert_eq!(open.verdict, Verdict::CannotTell);
        assert!(open.because.contains("not measured"));
    }

    #[test]
    fn alike_is_a_claim_of_its_own() {
        let verdict = |rounds: &[[f64; 2]]| {
            judged(&measured(rounds), "", vec![pair("a", "b")], 1e6, Difference::is_negligible)
                .verdict
        };
        assert_eq!(verdict(&[[0.9, 0.9], [0.9, 0.901], [0.901, 0.9]]), Verdict::Held);
        assert_eq!(verdict(&[[0.9, 0.8], [0.91, 0.8], [0.9, 0.81]]), Verdict::NotHeld);
        assert_eq!(verdict(&[[0.9, 0.8], [0.7, 0.8]]), Verdict::CannotTell);
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
