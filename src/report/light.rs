//! The traffic light beside a channel, a printhead or a recording. Each colour has a word, for
//! those who do not see it.
//!
//! In: a fault (`Light::of`), or a light that `heads` and `tables` choose by the state of the data.
//! Out: a dot as SVG, for the page, and the light's word.

use super::fault::Fault;

/// From this urgency on a fault has a red light. Somewhat arbitrary.
const AT_ONCE: f64 = 0.5;

/// A light; worse ones are greater, so that the worst of several is their maximum.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Light {
    Green,
    /// Not judged.
    Grey,
    Amber,
    Red,
}

impl Light {
    /// The light of a fault: green if its channel is not to be cleaned, else by its urgency.
    pub fn of(fault: &Fault) -> Light {
        match fault.is_open() {
            false => Light::Green,
            true if fault.urgency >= AT_ONCE => Light::Red,
            true => Light::Amber,
        }
    }

    /// The word that stands for the colour.
    pub fn word(self) -> &'static str {
        self.word_and_colour().0
    }

    fn word_and_colour(self) -> (&'static str, &'static str) {
        match self {
            Light::Green => ("healthy", "#009e73"),
            Light::Grey => ("not judged", "#999"),
            Light::Amber => ("soon", "#e69f00"),
            Light::Red => ("now", "#c00"),
        }
    }

    /// A coloured dot as SVG, with its word as title and label.
    pub fn dot(self) -> String {
        let (word, colour) = self.word_and_colour();
        format!(
            "<svg class=\"dot\" width=\"14\" height=\"14\" viewBox=\"0 0 14 14\" role=\"img\" aria-label=\"{word}\">\
             <title>{word}</title><circle cx=\"7\" cy=\"7\" r=\"6\" fill=\"{colour}\"/></svg>"
        )
    }
}
