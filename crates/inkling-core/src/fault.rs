//! Names of fault classes, and what follows from a name: the category, the words, what a severity
//! measures (thesis §2-2; `schemas/verdicts.md` has the same names). And [`Naming`], the rule by
//! which weights per class name a class or a category.
//!
//! A *class* is a fault by its name; a *category* is a group of classes that need the same thing to
//! be done. A user's own classes may have any name; where nothing is declared of one, its name is
//! also its category, its words and its quantity.

use std::collections::BTreeMap;

/// The thesis's fault classes, in the order of its tables.
pub const CLASSES: [&str; 9] = ["EC", "AB1", "AB2", "AB3", "BN", "PBN", "SDN", "IDN", "DDN"];

/// The label of a signal without a fault.
pub const HEALTHY: &str = "healthy";

/// The label of a signal that is neither trained on nor scored.
pub const IGNORE: &str = "ignore";

/// Names under which signals that were not collected for training are counted.
pub const NOT_COLLECTED: [&str; 4] =
    ["unlabelled", "rejected", "other_sampling", "beyond_the_limit_of_sets"];

pub fn is_reserved(name: &str) -> bool {
    [HEALTHY, IGNORE].into_iter().chain(NOT_COLLECTED).any(|taken| taken == name)
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Class {
    pub name: String,
    pub category: String,
    /// The laws that say what its faults do to a channel: declared ones, or its own name.
    pub of: Vec<String>,
    /// What severities count, in words that follow the number (`of the nozzle's mass`), if declared.
    pub unit: Option<String>,
}

impl Class {
    pub fn plain(name: &str) -> Class {
        let (category, of) = (category(name).into(), vec![name.into()]);
        Class { name: name.into(), category, of, unit: None }
    }
}

/// [category, the class as a technician calls it, what its severity measures].
const OF_THESIS: [(&str, [&str; 3]); 9] = [
    ("EC", ["empty_channel", "empty ink channel", "missing share of density"]),
    (
        "AB1",
        ["air_bubble", "air bubble in the nozzle", "share of the nozzle's length taken by air"],
    ),
    ("AB2", ["air_bubble", "small air bubble in the chamber", ADDED_COMPLIANCE]),
    ("AB3", ["air_bubble", "large air bubble in the chamber", ADDED_COMPLIANCE]),
    ("BN", ["blocked_nozzle", "blocked nozzle", BLOCKED_SHARE]),
    ("PBN", ["blocked_nozzle", "partly blocked nozzle", BLOCKED_SHARE]),
    ("SDN", ["dried_nozzle", "slightly dried nozzle", VISCOSITY]),
    ("IDN", ["dried_nozzle", "intermediately dried nozzle", VISCOSITY]),
    ("DDN", ["dried_nozzle", "deeply dried nozzle", VISCOSITY]),
];
const ADDED_COMPLIANCE: &str = "added compliance over the chamber's";
const BLOCKED_SHARE: &str = "blocked share of the nozzle's cross-section";
const VISCOSITY: &str = "viscosity factor in the nozzle";

fn of_thesis(class: &str) -> Option<&'static [&'static str; 3]> {
    OF_THESIS.iter().find(|(name, _)| *name == class).map(|(_, entry)| entry)
}

pub fn category(class: &str) -> &str {
    of_thesis(class).map_or(class, |[category, ..]| category)
}

pub fn in_words(class: &str) -> &str {
    of_thesis(class).map_or(class, |[_, in_words, _]| in_words)
}

/// What a class's severity measures, in words; comparable if two classes have the same.
pub fn quantity(class: &str) -> &str {
    of_thesis(class).map_or(class, |[.., quantity]| quantity)
}

/// The categories that `[isolate.physics]` declares for a user's own classes, by the class's name.
#[derive(Clone, Debug, Default)]
pub struct Categories(pub BTreeMap<String, String>);

impl Categories {
    /// Category of a class: the declared one, or else as [`category`] has it.
    pub fn of<'a>(&'a self, class: &'a str) -> &'a str {
        self.0.get(class).map_or(category(class), String::as_str)
    }

    /// Whether a category is that of a labelled state, or of one of several faults at once (`AB2+SDN`).
    pub fn is_of(&self, state: &str, category: &str) -> bool {
        self.of(state) == category || state.split('+').any(|one| self.of(one) == category)
    }
}

/// The categories of some classes, in their order, and for each class the index of its category.
pub fn categories(classes: &[Class]) -> (Vec<String>, Vec<u16>) {
    let mut names: Vec<String> = Vec::new();
    let index = |class: &Class| {
        let known = names.iter().position(|name| *name == class.category);
        known.unwrap_or_else(|| {
            names.push(class.category.clone());
            names.len() - 1
        }) as u16
    };
    let of_classes = classes.iter().map(index).collect();
    (names, of_classes)
}

/// The rule by which weights per class name a class, a category or neither, of a signal or an episode.
#[derive(Clone, Debug, PartialEq)]
pub struct Naming {
    pub categories: Vec<String>,
    /// The category of each class, as an index into `categories`.
    pub category_of: Vec<u16>,
    /// The weight, 0 to 1, from which on a class or a category is named.
    pub certainty: f64,
}

/// What the weights say. Classes and categories are indices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Named {
    pub best: usize,
    /// That class, if it is named.
    pub fault: Option<u16>,
    /// The category of the named class, or one that is certain although none of its classes is.
    pub category: Option<u16>,
    /// The weight of the named class, else of the named category, else of the best class.
    pub certainty: f64,
}

impl Naming {
    pub fn new(classes: &[Class], certainty: f64) -> Naming {
        let (categories, category_of) = categories(classes);
        Naming { categories, category_of, certainty }
    }

    /// Names the class of largest weight if that reaches the bound, else the category of largest total
    /// weight if that does. `of_any`: the probability that it is any class. `None`: no weights.
    pub fn name(&self, weights: &[f64], of_any: f64) -> Option<Named> {
        let (best, weight) = largest(weights)?;
        let weight = weight * of_any;
        if weight >= self.certainty {
            let (fault, category) = (Some(best as u16), Some(self.category_of[best]));
            return Some(Named { best, fault, category, certainty: weight });
        }

        let mut sums = vec![0.0; self.categories.len()];
        for (&category, weight) in self.category_of.iter().zip(weights) {
            sums[usize::from(category)] += weight * of_any;
        }
        let (category, certainty) = match largest(&sums).filter(|(_, sum)| *sum >= self.certainty) {
            Some((category, sum)) => (Some(category as u16), sum),
            None => (None, weight),
        };
        Some(Named { best, fault: None, category, certainty })
    }
}

/// The index of the largest value, and the value; of equal ones the first.
fn largest(values: &[f64]) -> Option<(usize, f64)> {
    values
        .iter()
        .copied()
        .enumerate()
        .reduce(|best, next| if next.1 > best.1 { next } else { best })
}
