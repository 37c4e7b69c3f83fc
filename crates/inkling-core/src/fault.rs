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

/// Category of a fault class; a user's own class is its own category.
pub fn category(class: &str) -> &str {
    match class {
        "EC" => "empty_channel",
        "BN" | "PBN" => "blocked_nozzle",
        "SDN" | "IDN" | "DDN" => "dried_nozzle",
        "AB1" | "AB2" | "AB3" => "air_bubble",
        own => own,
    }
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

/// The class as a technician calls it.
pub fn in_words(class: &str) -> &str {
    match class {
        "EC" => "empty ink channel",
        "AB1" => "air bubble in the nozzle",
        "AB2" => "small air bubble in the chamber",
        "AB3" => "large air bubble in the chamber",
        "BN" => "blocked nozzle",
        "PBN" => "partly blocked nozzle",
        "SDN" => "slightly dried nozzle",
        "IDN" => "intermediately dried nozzle",
        "DDN" => "deeply dried nozzle",
        own => own,
    }
}

/// What a class's severity measures; severities of classes with the same quantity can be compared.
pub fn quantity(class: &str) -> &str {
    match class {
        "EC" => "missing share of density",
        "AB1" => "share of the nozzle's length taken by air",
        "AB2" | "AB3" => "added compliance over the chamber's",
        "BN" | "PBN" => "blocked share of the nozzle's cross-section",
        "SDN" | "IDN" | "DDN" => "viscosity factor in the nozzle",
        own => own,
    }
}
