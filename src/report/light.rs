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
        match self {
            Light::Green => "healthy",
            Light::Grey => "not judged",
            Light::Amber => "soon",
            Light::Red => "now",
        }
    }

    fn colour(self) -> &'static str {
        match self {
            Light::Green => "#009e73",
            Light::Grey => "#999",
            Light::Amber => "#e69f00",
            Light::Red => "#c00",
        }
    }

    /// A dot, and its word for those who do not see it.
    pub fn dot(self) -> String {
        format!(
            "<svg class=\"dot\" width=\"14\" height=\"14\" viewBox=\"0 0 14 14\" role=\"img\" aria-label=\"{0}\">\
             <title>{0}</title><circle cx=\"7\" cy=\"7\" r=\"6\" fill=\"{1}\"/></svg>",
            self.word(),
            self.colour()
        )
    }
}
