//! A critique in words: its verdict with the sentence that the page begins with, a sentence for each cause, remarks,
//! and the extended equation, as plain text.
//!
//! In: the causes that were found, and what is left unexplained ([`Unexplained`]). The [`Verdict`] is `None` without
//! causes and significant misfit; `Unknown` if significant misfit is left and there is no cause, or a larger share is
//! left than allowed; `Tie` if every cause is tied with another; else `Named`.

use super::catalogue::{CauseId, experiment};
use super::finding::{Cause, Detection, Gain, Verdict};
use crate::plot::digits;

#[derive(Clone, Debug, Default)]
pub struct Unexplained {
    /// What is significant in the misfit that is left, in words; the verdict's sentence tells the first.
    pub significant: Vec<String>,
    /// What asks for no cause, but must be said; the sentence of `None` does.
    pub noted: Vec<String>,
    /// The misfit that is left, as a share of all misfit; and the largest share with which causes keep their
    /// names.
    pub share: f64,
    pub share_allowed: f64,
}

impl Unexplained {
    pub fn remarks(&self) -> Vec<String> {
        self.significant.iter().map(|what| format!("still unexplained: {what}")).collect()
    }
}

impl Verdict {
    /// Where too much is left beside causes, `explains` of every cause is set to the share of the misfit that
    /// all of them together explain.
    pub fn of(causes: &mut [Cause], left: &Unexplained) -> Verdict {
        let unexplained = !left.significant.is_empty();
        match &causes[..] {
            [] if unexplained => Verdict::Unknown,
            [] => Verdict::None,
            _ if unexplained && left.share > left.share_allowed => {
                let explained = Some((1.0 - left.share).max(0.0));
                causes.iter_mut().for_each(|cause| cause.explains = explained);
                Verdict::Unknown
            }
            all if all.iter().all(Cause::is_tied) => Verdict::Tie,
            _ => Verdict::Named,
        }
    }

    /// What the report begins with. `detection` is told with verdict `Named`.
    pub fn sentence(self, causes: &[Cause], left: &Unexplained, detection: Detection) -> String {
        match self {
            Verdict::None if left.noted.is_empty() => {
                "The model explains these signals: nothing in them asks for more.".into()
            }
            Verdict::None => {
                format!("The model explains these signals, but {}.", left.noted.join("; and "))
            }
            Verdict::Unknown => {
                let what = left.significant.first().map_or("a misfit", String::as_str);
                let nearest = causes.first().map(|cause| {
                    let share = 100.0 * cause.explains.unwrap_or(0.0);
                    format!("; nearest is {}, which explains {share:.0} % of it", cause.id)
                });
                format!(
                    "The model misses something that the catalogue does not hold ({what}){}.",
                    nearest.unwrap_or_default()
                )
            }
            Verdict::Tie => {
                let c = &causes[0];
                let split =
                    c.tied_with.first().map(|tied| format!(": {}", experiment(c.id, *tied)));
                format!(
                    "{}; {} explains the signals as well{}.",
                    capital(&c.sentence),
                    c.tied_words(),
                    split.unwrap_or_default()
                )
            }
            Verdict::Named => {
                let each = causes.iter().map(|cause| match cause.is_tied() {
                    true => format!("{}, or {}", capital(&cause.sentence), cause.tied_words()),
                    false => capital(&cause.sentence),
                });
                let rest = (!left.significant.is_empty()).then(|| {
                    let share = 100.0 * left.share;
                    format!(" Of what the plain model misses, {share:.1} % is still unexplained.")
                });
                let each = each.collect::<Vec<String>>().join(". ");
                format!("{each}.{}{}", rest.unwrap_or_default(), detection.words())
            }
        }
    }
}

impl Detection {
    /// A sentence, with a space before it; empty if detection was not measured.
    fn words(self) -> &'static str {
        match self {
            Detection::Better => {
                " Planted faults are found better with the extension than without it, both learned from these signals."
            }
            Detection::Worse => {
                " Planted faults are found worse with the extension than without it, both learned from these signals."
            }
            Detection::Same => {
                " Planted faults are found as well with the extension as without it, as far as can be told."
            }
            Detection::NotMeasured => "",
        }
    }
}

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

#[cfg(test)]
mod tests {
    use super::super::candidate::Candidate;
    use super::super::catalogue::CauseId::{self, *};
    use super::*;

    fn cause(id: CauseId, tied_with: &[CauseId]) -> Cause {
        let plain = Candidate::by_chance(id, 50.0, 1.0, 0.1).cause(95.0);
        Cause { tied_with: tied_with.to_vec(), ..plain }
    }

    fn judged(mut causes: Vec<Cause>, left: &Unexplained) -> (Verdict, Vec<Cause>) {
        let verdict = Verdict::of(&mut causes, left);
        (verdict, causes)
    }

    #[test]
    fn a_verdict_is_named_only_where_little_is_left() {
        let nothing = Unexplained { share_allowed: 0.05, ..Default::default() };
        let much = Unexplained { significant: vec!["x".into()], share: 0.3, ..nothing.clone() };
        let little = Unexplained { share: 0.01, ..much.clone() };
        let one = || vec![cause(Tone, &[])];
        assert_eq!(judged(vec![], &nothing).0, Verdict::None);
        let noted = Unexplained { noted: vec!["x".into()], ..nothing.clone() };
        let said = Verdict::None.sentence(&[], &noted, Detection::NotMeasured);
        assert_eq!(said, "The model explains these signals, but x.");
        assert_eq!(judged(vec![], &much).0, Verdict::Unknown);
        assert_eq!(judged(one(), &little).0, Verdict::Named);
        let (verdict, causes) = judged(one(), &much);
        assert_eq!((verdict, causes[0].explains), (Verdict::Unknown, Some(0.7)));
        let tied = || cause(Offset, &[Droop]);
        assert_eq!(judged(vec![tied()], &nothing).0, Verdict::Tie);
        assert_eq!(judged(vec![tied(), cause(Ageing, &[])], &nothing).0, Verdict::Named);
        assert_eq!(judged(vec![tied(), cause(Ageing, &[ClockDrift])], &nothing).0, Verdict::Tie);
    }
}
