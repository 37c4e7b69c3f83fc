//! The scenarios of `sample_logs`, for the unit tests of this room.

use super::scenario::{Kind, Physics, Scenario};
use std::sync::Arc;

pub const SAMPLE: &str = include_str!("../../../../sample_logs/scenarios/sample.toml");
pub const PHYSICS: &str = include_str!("../../../../sample_logs/scenarios/physics.toml");
pub const THESIS: &str = include_str!("../../../../sample_logs/scenarios/thesis.toml");
pub const HIDDEN: &str = include_str!("../../../../sample_logs/scenarios/hidden.toml");
pub const HIDDEN_PLAIN: &str = include_str!("../../../../sample_logs/scenarios/hidden_plain.toml");

/// A scenario's text with other settings; each `from` must occur in it.
pub fn replaced(text: &str, replacements: &[(&str, &str)]) -> String {
    replacements.iter().fold(text.to_owned(), |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    })
}

pub fn scenario(text: &str) -> Scenario {
    Scenario::from_toml(text).unwrap()
}

pub fn physics(text: &str) -> Arc<Physics> {
    let Kind::Physics(physics) = scenario(text).kind else { panic!("a physics scenario") };
    physics
}
