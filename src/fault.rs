//! Fault classes and the categories they form (thesis §2-2, contract "Out: verdicts").

/// The thesis's fault classes, in the order of its tables.
pub const CLASSES: [&str; 9] = ["EC", "AB1", "AB2", "AB3", "BN", "PBN", "SDN", "IDN", "DDN"];

/// The label of a signal without a fault.
pub const HEALTHY: &str = "healthy";

/// The label of a signal that is neither trained on nor scored.
pub const IGNORE: &str = "ignore";

/// A class by the name that labels and verdicts give it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Class {
    pub name: String,
    /// The thesis's classes that it stands for (`isolate.classes`): its own name where none were
    /// declared.
    pub of: Vec<String>,
}

impl Class {
    /// One of the thesis's classes, or one of a user's own of which nothing else is known.
    pub fn plain(name: &str) -> Class {
        Class { name: name.into(), of: vec![name.into()] }
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

/// What a technician calls the class.
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

/// What a class's severity measures: classes of one quantity can be compared.
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
