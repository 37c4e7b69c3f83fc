//! The drying-and-prefire experiment, simulated. In: the physics scenario, a seed. Out: figures of
//! thesis Tables 4-2, 4-5, 4-7. The thesis's own signals are not published.

use super::chapter::{self, COMPARED, Compared, judge, settings, thesis_detect};
use super::data::Signals;
use super::practice::{Thresholds, key_numbers};
use super::{Figures, ThesisError};
use crate::fault::HEALTHY;
use crate::isolate::{IsolateMethod, IsolateSignal};
use crate::simulate::drying;
use crate::simulate::scenario::Physics;

/// Training and test experiment of one seed.
pub fn signals(physics: &Physics, seed: u64) -> (Signals, Signals) {
    let of = |repeat| {
        let mut signals = Signals {
            dt_s: physics.acquisition.sample_period_s(),
            samples: physics.acquisition.samples,
            ..Signals::default()
        };
        for (state, counts) in drying::experiment(physics, seed, repeat) {
            signals.y.push(counts.iter().map(|&v| f64::from(v)).collect());
            signals.state.push(state.into());
        }
        signals
    };
    (of(0), of(1))
}

pub fn figures(physics: &Physics, seed: u64, out: &mut Figures) -> Result<(), ThesisError> {
    let (learn, test) = signals(physics, seed);
    // mu = 2, thesis §4-2
    let detect = thesis_detect(2.0);
    for size in [147, 74, 15] {
        // the healthy ones are kept whole: identification averages 16 at least
        let faulty = (size * learn.faulty()).div_ceil(learn.len());
        let set = learn.training(faulty);
        let remember = settings(IsolateMethod::Neighbours, IsolateSignal::Residual);
        let design = chapter::train(&set, &detect, &remember)?;
        for (at, Compared { name, method, signal }) in COMPARED.into_iter().enumerate() {
            let isolated = judge(&design, &settings(method, signal), &test)?;
            let first = size == 147 && at == 0;
            out.isolation(&format!("drying: {name}, {size}"), &isolated, first);
            if first {
                out.detection("drying", &isolated.ungated);
            }
        }
    }
    let thresholds = Thresholds::learn(&learn, &key_numbers(&learn));
    let (mut detected, mut isolated) = (0, 0);
    for (k, state) in key_numbers(&test).iter().zip(&test.state) {
        if state != HEALTHY {
            let flagged = thresholds.is_faulty(k);
            detected += usize::from(flagged);
            // detection and isolation are one step there: what looks healthy is not named
            let named = thresholds.name(k, &["IDN", "DDN"]) == Some(state);
            isolated += usize::from(flagged && named);
        }
    }
    let faulty = test.faulty() as f64;
    out.put("drying: practice/detection", detected as f64 / faulty);
    out.put("drying: practice/isolation", isolated as f64 / faulty);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::Scenario;
    use crate::simulate::scenario::Kind;

    #[test]
    fn training_and_test_have_the_texts_numbers_and_share_no_signal() {
        let scenario = Scenario::from_toml(crate::thesis::PHYSICS).unwrap();
        let Kind::Physics(physics) = &scenario.kind else { panic!("a physics scenario") };
        let (learn, test) = signals(physics, 1);
        for set in [&learn, &test] {
            let of = |state: &str| set.state.iter().filter(|s| *s == state).count();
            assert_eq!([of(HEALTHY), of("IDN"), of("DDN"), set.len()], [48, 39, 60, 147]);
        }
        assert!(learn.y.iter().all(|y| !test.y.contains(y)));
        for (size, faulty) in [(147, 99), (74, 50), (15, 11)] {
            assert_eq!((size * learn.faulty()).div_ceil(learn.len()), faulty);
        }
    }
}
