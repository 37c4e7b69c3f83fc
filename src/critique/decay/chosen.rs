//! The causes of a decay's model, in the order of its terms.

use super::terms::Term;
use crate::critique::catalogue::CauseId;

#[derive(Clone, Debug)]
pub struct Chosen {
    pub term: Term,
    pub statistic: f64,
    pub degrees: usize,
    pub tied_with: Vec<CauseId>,
    /// Rivals without a name that explain as much.
    pub tied_unnamed: Vec<CauseId>,
}

impl Chosen {
    /// Whether it has a name, and explains more than any rival without one that is in the model, too.
    pub fn is_named(&self, all: &[Chosen]) -> bool {
        let unnamed = all.iter().filter(|c| !c.term.id().has_name());
        self.term.id().has_name()
            && unnamed.map(|c| c.statistic).fold(0.0, f64::max) < self.statistic
    }
}
