//! The causes of a decay's model, and the model without some of them.

use super::fit::Fit;
use super::plant::Decays;
use super::terms::Term;
use crate::critique::catalogue::CauseId;

#[derive(Clone, Debug)]
pub struct Chosen {
    pub term: Term,
    /// Which line it is.
    pub line: usize,
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

/// A model without what some of its causes added, where it stood: nothing is fitted anew.
pub fn without(decays: &Decays, fit: &Fit, causes: &[Chosen], goes: impl Fn(Term) -> bool) -> Fit {
    let gone: Vec<&Chosen> = causes.iter().filter(|c| goes(c.term)).collect();
    let lines = gone.iter().filter(|c| matches!(c.term, Term::Line(_))).map(|c| c.line);
    let mut left = without_lines(decays, fit, &lines.collect::<Vec<usize>>());
    for chosen in gone {
        let mut structure = left.structure.clone();
        match chosen.term {
            Term::Offset => structure.offset = false,
            Term::Stiffness(_) => structure.stiffness = None,
            Term::Drag => structure.drag = false,
            Term::Friction => structure.friction = false,
            Term::Unnamed(what) => structure.unnamed.retain(|w| *w != what),
            Term::Line(_) => {}
        }
        left.p = structure.carried(&left.structure, &left.p, decays);
        left.structure = structure;
    }
    left
}

fn without_lines(decays: &Decays, fit: &Fit, gone: &[usize]) -> Fit {
    let layout = fit.structure.layout(decays.bursts, decays.outputs);
    let first = layout.lines.first().copied().unwrap_or(layout.count);
    let mut left = fit.clone();
    left.p.truncate(first);
    left.structure.lines.clear();
    for (i, at) in layout.lines.iter().enumerate().filter(|(i, _)| !gone.contains(i)) {
        let end = layout.lines.get(i + 1).copied().unwrap_or(layout.count);
        left.p.extend_from_slice(&fit.p[*at..end]);
        left.structure.lines.push(fit.structure.lines[i]);
    }
    left
}
