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
    ) -> Round<Self::Model, Self::Form>;

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
    /// If not, all it can do is to keep others from entering.
    pub may_enter: bool,
}

pub struct Round<Model, Form> {
    pub contenders: Vec<Contender<Model, Form>>,
    /// The smallest `penalised` of anything that competes.
    pub least: f64,
}

impl<Model, Form> Round<Model, Form> {
    /// Index of the next cause: the likeliest that has a name, if it is within `tie` of `least`; else the
    /// likeliest without a name.
    fn winner(&self) -> Option<usize> {
        let likeliest = |named: bool| {
            let all = self.contenders.iter().enumerate();
            all.filter(|(_, r)| r.may_enter && r.candidate.has_name() == named)
                .min_by(|(_, p), (_, q)| p.penalised.total_cmp(&q.penalised))
        };
        let named = likeliest(true).filter(|(_, r)| r.penalised - self.least < TIE);
        named.or_else(|| likeliest(false)).map(|(place, _)| place)
    }

    /// Writes into the step's rows which candidate won, and that it explains more, or what others explain.
    fn tell(&self, winner: usize, rows: &mut [Evidence], ln_samples: f64) {
        let chosen = self.contenders[winner].candidate.id;
        for row in rows {
            let by_id = |c: &&Contender<Model, Form>| c.candidate.id == row.id;
            let refitted = self.contenders.iter().find(by_id);
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

    fn won(mut self, winner: usize, ln_samples: f64) -> (Model, Chosen<Form>) {
        let Contender { candidate, model, penalised, .. } = self.contenders.remove(winner);
        let is_close = |r: &&Contender<Model, Form>| r.penalised - penalised < TIE;
        let close = self.contenders.iter().filter(is_close);
        let (tied_with, tied_unnamed) = close.map(|r| r.candidate.id).partition(|id| id.has_name());
        let delta_bic = candidate.delta_bic(ln_samples);
        (model, Chosen { candidate, delta_bic, tied_with, tied_unnamed })
    }
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

        let round = system.round(&now, &tried, &causes);
        let Some(winner) = round.winner() else {
            // a named candidate that had passed, where none survived its refit, is significant but no cause
            if round.contenders.iter().all(|r| !r.candidate.has_name()) {
                let lost = tried.into_iter().find(|t| t.has_name() && t.accepted());
                let objection = Some(Objection::LeadsNowhere);
                unnamed.extend(lost.map(|lost| Candidate { objection, ..lost }));
            }
            break;
        };

        round.tell(winner, &mut evidence[rows..], ln_samples);
        let (model, cause) = round.won(winner, ln_samples);
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

    /// The winner of a round, and what is tied with it. `contenders`: identifier, penalised -2 ln likelihood, and
    /// whether it may enter.
    fn won(contenders: &[(CauseId, f64, bool)], least: f64) -> Option<(CauseId, Vec<CauseId>)> {
        let rival = |&(id, penalised, may_enter): &(CauseId, f64, bool)| Contender {
            candidate: Candidate::plain(id, -penalised, ()),
            model: (),
            penalised,
            may_enter,
        };
        let round = Round { contenders: contenders.iter().map(rival).collect(), least };
        let winner = round.winner()?;
        let ((), Chosen { candidate, tied_with, tied_unnamed, .. }) = round.won(winner, 1.0);
        Some((candidate.id, [tied_with, tied_unnamed].concat()))
    }

    #[test]
    fn who_passes_and_is_not_chosen_is_told_by_what() {
        let all = [(Tone, 300.0), (Offset, 40.0), (Lowpass, 60.0), (Droop, 3.0)];
        let all = all.map(|(id, statistic)| Candidate::plain(id, statistic, ()));
        let contender = |c: &Candidate| Contender {
            candidate: c.clone(),
            model: (),
            penalised: -c.statistic,
            may_enter: true,
        };
        let round = Round { contenders: all[..2].iter().map(contender).collect(), least: -300.0 };
        let mut rows = all.map(|candidate| candidate.evidence(0, 1.0));
        round.tell(0, &mut rows, 1.0);
        let told = rows.each_ref().map(Evidence::why_not_in_words);
        assert_eq!(told, ["", "tone explains more", "explained by tone", "not significant"]);
        let passes = Candidate::plain(Offset, 40.0, ()).evidence(1, 1.0).why_not_in_words();
        assert_eq!(passes, "passes, but no further cause is looked for");
    }

    #[test]
    fn a_name_enters_unless_something_without_one_is_clearly_likelier() {
        let near = [(Offset, -50.0, true), (EvenSpring, -52.0, true), (Droop, -47.0, true)];
        assert_eq!(won(&near, -52.0), Some((Offset, vec![Droop, EvenSpring])));
        let far = [(Offset, -50.0, true), (EvenSpring, -60.0, true)];
        assert_eq!(won(&far, -60.0), Some((EvenSpring, vec![])));
        // no winner: something without a name is likelier but may not enter, or is a bump that is no rival
        // here
        assert_eq!(won(&[(Offset, -50.0, true), (EvenSpring, -60.0, false)], -60.0), None);
        assert_eq!(won(&[(Offset, -50.0, true)], -60.0), None);
        assert_eq!(won(&[], f64::INFINITY), None);
    }
}
