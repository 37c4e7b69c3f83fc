//! Makes the evidence of a selection readable, once the selection is over.
//!
//! In: the rows [`Evidence`] as tests and selection left them. Out, in place: findings in codes, noise and
//! trigger get the threshold that was in fact asked of their statistic. And reasons name what was chosen
//! instead: "another cause explains more" becomes "tone explains more", and "not significant" of a row beyond
//! its threshold becomes "explained by tone", if a tone entered in the same step.

use super::chance::{THRESHOLD, statistic_of, surprise};
use super::finding::Evidence;
use super::objection::WhyNot;

/// Tidies the rows. The first `by_chance` of them (codes, noise and trigger) were judged by their probability
/// by chance alone: their threshold is the statistic at which it would just have sufficed.
pub fn tidy(rows: &mut [Evidence], by_chance: usize) {
    let count = rows.len().min(by_chance);
    for row in &mut rows[..count] {
        row.threshold = if row.tested() { by_its_chance(row.statistic, row.p) } else { f64::NAN };
    }

    for k in 0..rows.len() {
        // codes and noise explain nothing of the mean: only a selected cause can be the reason
        let mut chosen = rows[count..].iter().filter(|r| k >= count && r.step == rows[k].step);
        let chosen = chosen.find(|r| r.accepted()).map(|r| r.id);
        let row = &mut rows[k];
        let beyond = row.statistic > row.threshold;
        row.why_not = row.why_not.map(|why| match (why, chosen) {
            (WhyNot::AnotherExplainsMore, Some(id)) => WhyNot::ExplainsMore(id),
            (WhyNot::NotSignificant, Some(id)) if beyond => WhyNot::ExplainedBy(id),
            (WhyNot::NotSignificant, None) if beyond => WhyNot::NotLookedFor,
            (why, _) => why,
        });
    }
}

/// The statistic that would just have been significant, if corrections reduced its plain surprise, -ln of its
/// chi-squared probability, as much as they did here.
fn by_its_chance(statistic: f64, p: f64) -> f64 {
    let plain = |statistic: f64| surprise(statistic, 1, 1.0, f64::INFINITY);
    if !statistic.is_finite() || p.is_nan() || p <= 0.0 {
        return f64::NAN;
    }
    let asked = THRESHOLD + (plain(statistic) + p.ln()).max(0.0);
    statistic_of(asked, plain)
}

#[cfg(test)]
mod tests {
    use super::super::candidate::Candidate;
    use super::super::catalogue::CauseId::{self, *};
    use super::*;

    fn row(step: u32, id: CauseId, statistic: f64, accepted: bool) -> Evidence {
        let why_not = (!accepted).then_some(WhyNot::NotSignificant);
        let plain = Candidate::plain(id, statistic, ()).evidence(step, 0.0);
        Evidence { threshold: 14.0, why_not, ..plain }
    }

    #[test]
    fn who_passes_and_is_not_chosen_is_told_by_what() {
        let mut rows = vec![
            row(0, Temperature, 16.0, true), // of the noise: it explains nothing of the others
            row(0, Tone, 300.0, true),
            row(0, Offset, 40.0, false),
            row(0, Droop, 3.0, false),
            row(1, Offset, 15.0, false),
        ];
        rows[2].why_not = Some(WhyNot::AnotherExplainsMore);
        rows.insert(3, row(0, Lowpass, 60.0, false));
        tidy(&mut rows, 1);
        let why: Vec<String> = rows.iter().map(Evidence::why_not_in_words).collect();
        let more = "passes, but no further cause is looked for";
        let told = ["", "", "tone explains more", "explained by tone", "not significant", more];
        assert_eq!(why, told);
    }

    #[test]
    fn a_statistic_beyond_its_threshold_is_one_whose_chance_was_small_enough() {
        for statistic in [1.0, 10.0, 13.0, 20.0, 40.0, 90.0] {
            for penalty in [0.0, 2.0, 20.0] {
                let surprise = surprise(statistic, 1, 1.0, f64::INFINITY) - penalty;
                if surprise > 0.0 {
                    let threshold = by_its_chance(statistic, (-surprise).exp());
                    assert_eq!(
                        statistic > threshold,
                        surprise > THRESHOLD,
                        "{statistic} {penalty}"
                    );
                }
            }
        }
        assert!(by_its_chance(f64::NAN, 0.5).is_nan() && by_its_chance(1e4, 0.0).is_nan());
    }
}
