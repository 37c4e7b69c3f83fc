//! A critique in words: a sentence of each cause, one of all, and the extended equation.
//!
//! In: causes and verdict. Out: text.

use super::catalogue::experiment;
use super::digits;
use super::finding::{Cause, Detection, Gain, Verdict};

/// One sentence of a cause: what, how large.
pub fn cause_sentence(cause: &Cause) -> String {
    let number = digits::measured(cause.value, cause.ci95, &cause.unit);
    format!("{}: {} = {number}", cause.id.row().words, cause.parameter)
}

pub fn sentence(
    verdict: Verdict,
    causes: &[Cause],
    unexplained: &[String],
    detection: Detection,
) -> String {
    match verdict {
        Verdict::None => "The model explains these signals: nothing in them asks for more.".into(),
        Verdict::Unknown => {
            let what = unexplained.first().map_or("a misfit", String::as_str);
            match causes.first() {
                Some(c) => format!(
                    "The model misses something that the catalogue does not hold ({what}); nearest \
                     is {}, which explains {:.0} % of it.",
                    c.id,
                    100.0 * c.explains.unwrap_or(0.0)
                ),
                None => {
                    format!("The model misses something that the catalogue does not hold ({what}).")
                }
            }
        }
        Verdict::Tie => {
            let c = &causes[0];
            let split = c.tied_with.first().map(|tied| format!(": {}", experiment(c.id, *tied)));
            format!(
                "{}; {} explains the signals as well{}.",
                capital(&c.sentence),
                c.tied_words(),
                split.unwrap_or_default()
            )
        }
        Verdict::Named => {
            let each: Vec<String> = causes.iter().map(|c| capital(&c.sentence)).collect();
            let detection = match detection {
                Detection::Better => {
                    " Planted faults are found better with the extension than without it, both \
                     learned from these signals."
                }
                Detection::Worse => {
                    " Planted faults are found worse with the extension than without it, both \
                     learned from these signals."
                }
                Detection::Same => {
                    " Planted faults are found as well with the extension as without it, as far as \
                     can be told."
                }
                Detection::NotMeasured => "",
            };
            format!("{}.{detection}", each.join(". "))
        }
    }
}

pub fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |c| c.to_uppercase().chain(letters).collect())
}

/// The experiments that would split ties.
pub fn ties(causes: &[Cause]) -> Vec<String> {
    let pairs = causes.iter().flat_map(|c| c.tied_with.iter().map(|tied| (c.id, *tied)));
    let line =
        |(id, tied)| format!("{id} and {tied} cannot be told apart here: {}", experiment(id, tied));
    let rivals =
        causes.iter().flat_map(|c| c.tied_unnamed.iter().map(|rival| (c.id, rival.row().words)));
    let unnamed = rivals.map(|(id, words)| format!("{id} cannot be told from {words}"));
    pairs.map(line).chain(unnamed).collect()
}

/// Causes that are there, and that models are not better for.
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
    let mut text = String::from("y = s C e^{A t} x_a + e");
    for cause in causes {
        text.push(' ');
        text.push_str(cause.id.row().equation);
    }
    text
}
