//! The search for causes, whatever rings: forward selection that tries all candidates, lets the significant
//! ones compete, puts the winner into the model, and tells which candidates are tied with it.
//!
//! In: a [`System`] and its model without causes. Out: [`ExplainedModel`].
//!
//! One step: (1) test all candidates about the present model; (2) the system refits those that compete, each
//! in a model of its own, and says how likely each is (`penalised`: -2 ln likelihood plus the price of its
//! parameters, lower is better); (3) the likeliest rival with a name wins, unless something without a name is
//! better by `tie` or more; then the latter enters, if the system allows it, or the search ends; (4) contenders
//! within `tie` of the winner are tied with it; (5) the system refits the model with the winner and drops
//! causes that have become superfluous.

use super::candidate::{Candidate, Chosen, Objection, WhyNot};
use super::finding::Evidence;
use super::tuned::TIE;
use super::work::{Stage, Work};
use std::ops::ControlFlow;

pub trait System {
    type Model;
    type Form: Clone;
    const MOST_CAUSES: u32;
    /// Whether a candidate that is tied with a cause in the model may enter beside it, or stands for the same
    /// effect.
    const TIED_MAY_ENTER: bool;
    /// Whether what has no name may enter. If not, all it can do is to end the search.
    const RIVALS_MAY_ENTER: bool;
    /// The step in which candidates are tried.
    const TRYING: Stage;

    fn work(&self) -> &Work;

    fn tried(&self, now: &Self::Model) -> Vec<Candidate<Self::Form>>;

    /// Refits those candidates that compete, each in a model of its own beside the `chosen` causes in `now`.
    fn round(
        &self,
        now: &Self::Model,
        tried: &[Candidate<Self::Form>],
        chosen: &[Chosen<Self::Form>],
    ) -> Vec<Contender<Self::Model, Self::Form>>;

    /// Refits the model after a cause has entered, and removes superfluous causes from it and from `chosen`.
    /// `Break` ends the search, where causes would come and go for ever.
    fn settled(
        &self,
        now: Self::Model,
        chosen: &mut Vec<Chosen<Self::Form>>,
    ) -> ControlFlow<Self::Model, Self::Model>;
}

pub struct Contender<Model, Form> {
    /// The candidate; its statistic compares this model with the one without it.
    pub candidate: Candidate<Form>,
    pub model: Model,
    /// -2 ln likelihood plus the price of the free parameters; lower is better.
    pub penalised: f64,
    /// A weak one competes with none, but may be tied with the winner.
    pub is_weak: bool,
}

/// Index of the winner: the likeliest that has a name, if nothing is better by `tie`; else the likeliest without a
/// name.
fn winner<Model, Form>(contenders: &[Contender<Model, Form>]) -> Option<usize> {
    let strong = || contenders.iter().enumerate().filter(|(_, r)| !r.is_weak);
    let least = strong().map(|(_, r)| r.penalised).fold(f64::INFINITY, f64::min);
    let likeliest = |named: bool| {
        let all = strong().filter(|(_, r)| r.candidate.has_name() == named);
        all.min_by(|(_, p), (_, q)| p.penalised.total_cmp(&q.penalised))
    };
    let named = likeliest(true).filter(|(_, r)| r.penalised - least < TIE);
    named.or_else(|| likeliest(false)).map(|(place, _)| place)
}

/// Writes into a step's rows which candidate won, and that it explains more, or what others explain.
fn tell<Model, Form>(
    contenders: &[Contender<Model, Form>],
    winner: usize,
    rows: &mut [Evidence],
    ln_samples: f64,
) {
    let chosen = contenders[winner].candidate.id;
    for row in rows {
        let refitted = contenders.iter().find(|c| c.candidate.id == row.id);
        row.why_not = match (refitted, row.why_not) {
            _ if row.id == chosen => None,
            (Some(_), _) if chosen.has_name() => Some(WhyNot::ExplainsMore(chosen)),
            (Some(_), _) => Some(WhyNot::AnotherExplainsMore),
            (None, Some(WhyNot::NotLookedFor)) if chosen.has_name() => {
                Some(WhyNot::ExplainedBy(chosen))
            }
            (None, why_not) => why_not,
        };
        if let Some(Contender { candidate, .. }) = refitted {
            row.delta_bic = candidate.delta_bic(ln_samples);
        }
    }
}

/// The model with the winner, and the winner with what is tied with it.
fn won<Model, Form>(
    mut contenders: Vec<Contender<Model, Form>>,
    winner: usize,
    ln_samples: f64,
) -> (Model, Chosen<Form>) {
    let Contender { candidate, model, penalised, .. } = contenders.remove(winner);
    let close = contenders.iter().filter(|r| r.penalised - penalised < TIE);
    let (tied_with, tied_unnamed) = close.map(|r| r.candidate.id).partition(|id| id.has_name());
    let delta_bic = candidate.delta_bic(ln_samples);
    (model, Chosen { candidate, delta_bic, tied_with, tied_unnamed })
}

pub struct ExplainedModel<Model, Form> {
    pub fitted: Model,
    /// In the order in which they entered.
    pub causes: Vec<Chosen<Form>>,
    /// One row for each named candidate in each step.
    pub evidence: Vec<Evidence>,
    /// Candidates of the last step that are significant but cannot be the cause.
    pub unnamed: Vec<Candidate<Form>>,
}

/// Adds causes one by one until none competes. `ln_samples`: the price of a parameter in BIC.
pub fn search<S: System>(
    system: &S,
    mut now: S::Model,
    ln_samples: f64,
) -> ExplainedModel<S::Model, S::Form> {
    let mut causes: Vec<Chosen<S::Form>> = Vec::new();
    let (mut evidence, mut unnamed) = (Vec::new(), Vec::new());
    for step in 0..=S::MOST_CAUSES {
        system.work().begins_step(S::TRYING, step, S::MOST_CAUSES);
        let mut tried = system.tried(&now);
        let rows = evidence.len();
        let named = tried.iter().filter(|t| t.has_name());
        evidence.extend(named.map(|t| t.evidence(step, ln_samples)));

        // what is tied with a cause has its row, but does not compete
        let tied = |id| causes.iter().any(|c| c.tied_with.contains(&id));
        tried.retain(|t| S::TIED_MAY_ENTER || !tied(t.id));
        unnamed = tried.iter().filter(|t| t.is_significant() && !t.able()).cloned().collect();
        if step == S::MOST_CAUSES {
            break; // the last step only tests what is left
        }

        let contenders = system.round(&now, &tried, &causes);
        let may_enter = |at: &usize| S::RIVALS_MAY_ENTER || contenders[*at].candidate.has_name();
        let Some(winner) = winner(&contenders).filter(may_enter) else {
            // a named candidate that had passed, where none survived its refit, is significant but no cause
            if contenders.iter().all(|r| !r.candidate.has_name()) {
                let lost = tried.into_iter().find(|t| t.has_name() && t.accepted());
                let objection = Some(Objection::LeadsNowhere);
                unnamed.extend(lost.map(|lost| Candidate { objection, ..lost }));
            }
            break;
        };

        tell(&contenders, winner, &mut evidence[rows..], ln_samples);
        let (model, cause) = won(contenders, winner, ln_samples);
        causes.push(cause);
        match system.settled(model, &mut causes) {
            ControlFlow::Continue(model) => now = model,
            ControlFlow::Break(model) => {
                now = model;
                break;
            }
        }
    }
    ExplainedModel { fitted: now, causes, evidence, unnamed }
}

#[cfg(test)]
mod tests {
    use super::super::catalogue::CauseId::{self, *};
    use super::*;

    fn contender(id: CauseId, penalised: f64) -> Contender<(), ()> {
        let candidate = Candidate::plain(id, -penalised, ());
        Contender { candidate, model: (), penalised, is_weak: penalised > -10.0 }
    }

    /// The winner, and what is tied with it. `all`: with penalised -2 ln likelihood.
    fn chosen(all: &[(CauseId, f64)]) -> Option<(CauseId, Vec<CauseId>)> {
        let all: Vec<_> = all.iter().map(|(id, penalised)| contender(*id, *penalised)).collect();
        let winner = winner(&all)?;
        let ((), Chosen { candidate, tied_with, tied_unnamed, .. }) = won(all, winner, 1.0);
        Some((candidate.id, [tied_with, tied_unnamed].concat()))
    }

    #[test]
    fn who_passes_and_is_not_chosen_is_told_by_what() {
        let all = [(Tone, 300.0), (Offset, 40.0), (Lowpass, 60.0), (Droop, 3.0)];
        let all = all.map(|(id, statistic)| contender(id, -statistic));
        let mut rows = all.each_ref().map(|of| of.candidate.evidence(0, 1.0));
        tell(&all[..2], 0, &mut rows, 1.0);
        let told = rows.each_ref().map(Evidence::why_not_in_words);
        assert_eq!(told, ["", "tone explains more", "explained by tone", "not significant"]);
        let passes = Candidate::plain(Offset, 40.0, ()).evidence(1, 1.0).why_not_in_words();
        assert_eq!(passes, "passes, but no further cause is looked for");
    }

    #[test]
    fn a_name_enters_unless_something_without_one_is_clearly_likelier() {
        let near = [(Offset, -50.0), (EvenSpring, -52.0), (Droop, -47.0)];
        assert_eq!(chosen(&near), Some((Offset, vec![Droop, EvenSpring])));
        let far = [(Offset, -50.0), (EvenSpring, -60.0)];
        assert_eq!(chosen(&far), Some((EvenSpring, vec![])));
        assert_eq!(chosen(&[(Offset, -9.0)]), None, "it is weak");
        assert_eq!(
            chosen(&[(Offset, -11.0), (EvenSpring, -9.0)]),
            Some((Offset, vec![EvenSpring]))
        );
        assert_eq!(chosen(&[]), None);
    }
}
