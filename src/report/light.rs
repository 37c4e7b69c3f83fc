//! The traffic light beside a channel, a printhead or a recording: told by its word, too. In: faults, coverage. Out: markup.

use super::fault::Fault;

/// From this urgency on a fault does not wait.
const AT_ONCE: f64 = 0.5;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Light {
    Green,
    /// Nobody judged it.
    Grey,
    Amber,
    Red,
}

impl Light {
    pub fn of(fault: &Fault) -> Light {
        match fault.is_open() {
            false => Light::Green,
            true if fault.urgency >= AT_ONCE => Light::Red,
            true => Light::Amber,
        }
    }

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

    /// A dot, and its word for those who do not see it.
    pub fn dot(self) -> String {
        let (word, colour) = self.word_and_colour();
        format!(
            "<svg class=\"dot\" width=\"14\" height=\"14\" viewBox=\"0 0 14 14\" role=\"img\" aria-label=\"{word}\">\
             <title>{word}</title><circle cx=\"7\" cy=\"7\" r=\"6\" fill=\"{colour}\"/></svg>"
        )
    }
}
