//! Chapter 4 again: the thesis's tables and figures beside ours, over any seeds.
//!
//! In: seeds. Out: a directory with `tables.md`, `tables.json` and figures. Works in memory on the
//! thesis-form data set and on a simulated drying experiment; the methods are the product's own
//! ([`crate::design`]).

pub mod chapter;
pub mod data;
pub mod defaults;
pub mod experiment;
mod figures;
mod outcome;
pub mod practice;
mod report;
mod tables;

use crate::side_by_side::side_by_side;
use crate::simulate::Scenario;
use crate::simulate::scenario::Kind;
use std::collections::BTreeMap;
use std::path::Path;

pub use outcome::{Chapter, Confusion, Figures, Spread, ThesisError};

const THESIS_FORM: &str = include_str!("../../sample_logs/scenarios/thesis.toml");
const PHYSICS: &str = include_str!("../../sample_logs/scenarios/physics.toml");

/// Runs every seed, several at a time. `done` hears of each that ends.
pub fn run(
    seeds: &[u64],
    threads: usize,
    done: impl Fn(u64) + Sync,
) -> Result<Chapter, ThesisError> {
    let (classes, physics) = scenarios()?;
    let Kind::Physics(dried) = &physics.kind else {
        return Err(ThesisError::Scenario("the experiment needs a physics scenario".into()));
    };
    let each = side_by_side(threads, seeds.to_vec(), |seed| {
        let mut figures = chapter::figures(&classes, seed)?;
        experiment::figures(dried, seed, &mut figures)?;
        done(seed);
        Ok(figures)
    });
    let each = each.into_iter().collect::<Result<Vec<_>, ThesisError>>()?;
    Ok(Chapter::of(seeds, &each))
}

/// Writes tables and, of the first seed, figures into `dir`.
pub fn write(chapter: &Chapter, dir: &Path) -> Result<(), ThesisError> {
    let failed =
        |path: &Path, source| ThesisError::Write { path: path.display().to_string(), source };
    std::fs::create_dir_all(dir).map_err(|e| failed(dir, e))?;
    let tables = [
        ("tables.md", report::markdown(chapter)),
        ("tables.json", serde_json::to_string_pretty(chapter).unwrap_or_default()),
    ];
    for (name, text) in tables {
        let path = dir.join(name);
        std::fs::write(&path, text + "\n").map_err(|e| failed(&path, e))?;
    }
    let (classes, physics) = scenarios()?;
    figures::write(&classes, &physics, chapter.seeds.first().copied().unwrap_or(1), dir)
}

fn scenarios() -> Result<(Scenario, Scenario), ThesisError> {
    let read = |text| Scenario::from_toml(text).map_err(|e| ThesisError::Scenario(e.to_string()));
    Ok((read(THESIS_FORM)?, read(PHYSICS)?))
}

impl Confusion {
    /// HMA of thesis §4-3, trace over sum: plain accuracy. NaN where nothing was counted.
    pub fn hma(&self) -> f64 {
        let right: f64 = (0..self.classes.len()).map(|i| self.counts[i][i]).sum();
        right / self.counts.iter().flatten().sum::<f64>()
    }

    /// Without one class, as truth and as answer.
    pub fn without(&self, class: &str) -> Confusion {
        let kept: Vec<usize> =
            (0..self.classes.len()).filter(|&i| self.classes[i] != class).collect();
        Confusion {
            classes: kept.iter().map(|&i| self.classes[i].clone()).collect(),
            counts: kept
                .iter()
                .map(|&i| kept.iter().map(|&j| self.counts[i][j]).collect())
                .collect(),
        }
    }

    /// `class` counted as `into`.
    pub fn merged(&self, into: &str, class: &str) -> Confusion {
        let place = |name: &str| self.classes.iter().position(|c| c == name);
        let (Some(to), Some(from)) = (place(into), place(class)) else { return self.clone() };
        let mut sum = self.clone();
        for row in &mut sum.counts {
            row[to] += row[from];
        }
        let moved = sum.counts[from].clone();
        sum.counts[to].iter_mut().zip(moved).for_each(|(s, n)| *s += n);
        sum.without(class)
    }
}

impl Chapter {
    fn of(seeds: &[u64], each: &[Figures]) -> Chapter {
        let mut values: BTreeMap<String, Vec<f64>> = BTreeMap::new();
        let mut confusions: BTreeMap<String, Confusion> = BTreeMap::new();
        for figures in each {
            for (key, v) in &figures.values {
                values.entry(key.clone()).or_default().push(*v);
            }
            for (key, c) in &figures.confusions {
                let sum = confusions.entry(key.clone()).or_insert_with(|| Confusion {
                    classes: c.classes.clone(),
                    counts: vec![vec![0.0; c.classes.len()]; c.classes.len()],
                });
                for (row, add) in sum.counts.iter_mut().zip(&c.counts) {
                    row.iter_mut().zip(add).for_each(|(s, n)| *s += n / each.len() as f64);
                }
            }
        }
        let values = values.into_iter().map(|(key, v)| (key, Spread::of(&v))).collect();
        Chapter { seeds: seeds.to_vec(), values, confusions }
    }
}

impl Spread {
    fn of(v: &[f64]) -> Spread {
        let n = v.len() as f64;
        let mean = v.iter().sum::<f64>() / n;
        let square: f64 = v.iter().map(|x| (x - mean).powi(2)).sum();
        Spread {
            mean,
            sd: (square / (n - 1.0).max(1.0)).sqrt(),
            least: v.iter().copied().fold(f64::INFINITY, f64::min),
            most: v.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        }
    }
}
