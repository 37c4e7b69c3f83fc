//! A critique in words: a sentence for each cause, remarks, and the extended equation, as plain text.

use super::catalogue::{CauseId, experiment};
use super::finding::{Cause, Gain};
use crate::plot::digits;

/// One sentence, without capital letter and full stop. `words`: the catalogue's description.
pub fn cause_sentence(cause: &Cause, words: &str) -> String {
    let number = digits::measured(cause.value, cause.ci95, &cause.unit);
    format!("{words}: {} = {number}{}", cause.parameter, relative_to(cause.id))
}

/// Of a relative change: between which two.
fn relative_to(id: CauseId) -> &'static str {
    match id {
        CauseId::CubicStiffness => " at the largest amplitude, relative to a small one",
        CauseId::QuadraticDrag | CauseId::DryFriction => {
            " at the largest amplitude, relative to the smallest"
        }
        CauseId::Ageing | CauseId::ClockDrift => " over the recording, relative",
        CauseId::PositionGradient => " from the first channel to the last, relative",
        _ => "",
    }
}

pub fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |c| c.to_uppercase().chain(letters).collect())
}

/// Which experiment would tell two causes apart, and which rivals cannot be told from a cause.
pub fn ties(causes: &[Cause]) -> Vec<String> {
    let pairs = causes.iter().flat_map(|c| c.tied_with.iter().map(|tied| (c.id, *tied)));
    let line =
        |(id, tied)| format!("{id} and {tied} cannot be told apart here: {}", experiment(id, tied));
    let rivals =
        causes.iter().flat_map(|c| c.tied_unnamed.iter().map(|rival| (c.id, rival.row().words)));
    let unnamed = rivals.map(|(id, words)| format!("{id} cannot be told from {words}"));
    pairs.map(line).chain(unnamed).collect()
}

/// Remarks on causes that do not surely make the model predict held-out signals better.
pub fn not_worth(causes: &[Cause], gain: &Gain) -> Vec<String> {
    let line = |cause: &Cause| {
        let worth = gain.worth(cause.id).filter(|worth| !worth.is_sure())?;
        let [low, high] = worth.ci95.map(digits::short);
        Some(format!(
            "{} is there and not worth modelling: ln likelihood per held-out signal {} with it (95 %: {low} to {high})",
            cause.id,
            digits::short(worth.gain)
        ))
    };
    causes.iter().filter_map(line).collect()
}

pub fn equation(causes: &[Cause]) -> String {
    let terms: String = causes.iter().map(|c| format!(" {}", c.id.row().equation)).collect();
    format!("y = s C e^{{A t}} x_a + e{terms}")
}
