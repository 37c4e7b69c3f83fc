//! Fault classes and the categories they form (thesis §2-2, contract "Out: verdicts").

use std::collections::BTreeMap;

/// The thesis's fault classes, in the order of its tables.
pub const CLASSES: [&str; 9] = ["EC", "AB1", "AB2", "AB3", "BN", "PBN", "SDN", "IDN", "DDN"];

/// The label of a signal without a fault.
pub const HEALTHY: &str = "healthy";

/// The label of a signal that is neither trained on nor scored.
pub const IGNORE: &str = "ignore";

/// A fault class, by the name that labels and verdicts give it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Class {
    pub name: String,
    pub category: String,
    /// The laws of faults that the class stands for (`isolate.classes`): its own name where none were
    /// declared.
    pub of: Vec<String>,
    /// What the class's severities count, in words that follow the number; `None`: no user declared that.
    pub unit: Option<String>,
}

impl Class {
    /// One of the thesis's classes, or a user's own class of which nothing else is known.
    pub fn plain(name: &str) -> Class {
        let (category, of) = (category(name).into(), vec![name.into()]);
        Class { name: name.into(), category, of, unit: None }
    }
}

/// What is known of each of the thesis's classes: its category, the class as a technician calls it, and what its
/// severity measures.
const KNOWN: [(&str, [&str; 3]); 9] = [
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

/// One of the things that are known of a class; of a user's own class its name.
fn known(class: &str, what: usize) -> &str {
    KNOWN.iter().find(|(name, _)| *name == class).map_or(class, |(_, known)| known[what])
}

/// Category of a fault class; a user's own class is its own category.
pub fn category(class: &str) -> &str {
    known(class, 0)
}

/// The class as a technician calls it.
pub fn in_words(class: &str) -> &str {
    known(class, 1)
}

/// What a class's severity measures; severities of classes with the same quantity can be compared.
pub fn quantity(class: &str) -> &str {
    known(class, 2)
}

/// Categories of a user's own classes by class, where they were declared (`[isolate.physics]`).
#[derive(Clone, Debug, Default)]
pub struct Categories(pub BTreeMap<String, String>);

impl Categories {
    /// Category of a class: the declared one, or else as [`category`] has it.
    pub fn of<'a>(&'a self, class: &'a str) -> &'a str {
        self.0.get(class).map_or(category(class), String::as_str)
    }

    /// Whether a labelled state is of a category. If it is several faults at once, such as `AB2+SDN`, the
    /// category of each is right.
    pub fn is_of(&self, state: &str, category: &str) -> bool {
        self.of(state) == category || state.split('+').any(|one| self.of(one) == category)
    }
}
