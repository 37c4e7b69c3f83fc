use super::*;
use crate::model::normal::draws;

/// Draws looks at a channel: |offset + noise|² over the threshold. The vector has three
/// components, of which the first has the offset, and all have noise of standard deviation .75.
/// At the threshold of 15.85 looks with offsets of 0, 1 and 2 are flagged at rates of 3e-6,
/// 1.5e-4 and 9e-3; channels with offsets spread evenly from 0 to 2 at about 1e-3.
fn source(seed: u64) -> impl FnMut(f32) -> f32 {
    let mut normal = draws(seed);
    move |offset| {
        let off = [offset, 0.0, 0.0].map(|at| at + 0.75 * normal() as f32);
        off.map(|x| x * x).iter().sum::<f32>() / 15.85
    }
}

/// How often so many looks raise an episode.
fn raised(evidence: &mut Evidence, looks: usize, mut look: impl FnMut() -> f32) -> usize {
    (0..looks).filter(|_| evidence.look(look(), 16.0) == Step::Raised).count()
}

#[test]
fn healthy_channels_high_or_low_raise_less_often_than_the_bound_says() {
    // bound of 20 in a million looks, 1.6 million looks
    let bound = (1e6f32 / 20.0).ln();
    let mut look = source(1);
    let mut raised = 0;
    for channel in 0..4000 {
        let offset = 2.0 * channel as f32 / 4000.0;
        let mut evidence = Evidence::default();
        for _ in 0..400 {
            raised += u32::from(evidence.look(look(offset), bound) == Step::Raised);
        }
    }
    assert!(raised <= 32, "{raised} raised");
}

#[test]
fn the_shift_follows_what_is_seen_of_a_fault_and_not_what_is_seen_of_its_end() {
    let after = |z: f32| {
        let mut evidence = Evidence { shift: 6.0, raised: true, ..Evidence::default() };
        for _ in 0..200 {
            evidence.look_at_shift(z);
        }
        evidence.shift
    };
    for z in [3.5, 4.5, 5.5] {
        assert!((after(z) - z).abs() < 1e-3, "{}, not {z}", after(z));
    }
    assert_eq!(after(2.0), 6.0);
    assert_eq!(after(1e3), tuned::LARGEST_SHIFT);
}

#[test]
fn fault_is_raised_within_a_few_looks_and_ended_soon_after_it_is_gone() {
    let bound = 16.0;
    let mut look = source(2);
    for _ in 0..200 {
        let mut evidence = Evidence::default();
        for _ in 0..60 {
            evidence.look(look(1.0), bound);
        }
        let raised = (1..30).find(|_| evidence.look(look(8.0), bound) == Step::Raised);
        assert!(raised.is_some_and(|n| (2..=6).contains(&n)), "{raised:?}");
        for _ in 0..50 {
            let step = evidence.look(look(8.0), bound);
            assert!(matches!(step, Step::Faulty { .. }), "{step:?}");
        }
        let ended = (1..30).find(|_| evidence.look(look(1.0), bound) == Step::Ended);
        assert!(ended.is_some_and(|n| n <= 8), "{ended:?}");
    }
    // as is a channel that is faulty from the start
    let mut evidence = Evidence::default();
    let raised = (1..30).find(|_| evidence.look(look(8.0), bound) == Step::Raised);
    assert!(raised.is_some_and(|n| n <= 8), "{raised:?}");
}

/// A look by a channel's own baseline: chi-squared with three degrees of freedom over the value
/// that it exceeds at a rate of 7e-4.
fn own_look(look: &mut impl FnMut(f32) -> f32) -> f32 {
    look(0.0) * 15.85 / 0.75f32.powi(2) / 17.06
}

#[test]
fn own_statistic_has_the_level_and_spread_that_are_expected_of_it() {
    let mut look = source(6);
    let x: Vec<f64> = (0..100_000).map(|_| f64::from(own_look(&mut look)).powf(0.25)).collect();
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    let sd = (x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / x.len() as f64).sqrt();
    assert!((mean - f64::from(OWN.level)).abs() < 0.003, "{mean}");
    assert!((sd - f64::from(OWN.variance).sqrt()).abs() < 0.003, "{sd}");
}

#[test]
fn own_baseline_that_begins_is_no_fault() {
    let mut look = source(5);
    let raises = |_: &u32| {
        let mut evidence = Evidence::default();
        // twenty looks against all channels' spread, which is wider than the channel's own;
        // from then on against the latter
        let by_all = raised(&mut evidence, 20, || 0.3 * own_look(&mut look));
        evidence.judge_by_own(true);
        by_all + raised(&mut evidence, 200, || own_look(&mut look)) > 0
    };
    // 400,000 looks, of which .1 per million are expected to raise an episode
    assert_eq!((0..2000).filter(raises).count(), 0);
}

/// Healthy looks whose distribution is another than assumed, flagged at the stated rate or
/// never.
#[test]
fn healthy_looks_of_any_shape_raise_nothing() {
    // A log-normal whose threshold is 3.19 standard deviations out (7e-4); and a tenth of the
    // threshold or, one time in twenty, nine tenths of it.
    let shapes: [fn(f32) -> f32; 2] =
        [|z| (1.6 * (z - 3.19)).exp(), |z| if z > 1.645 { 0.9 } else { 0.1 }];
    let mut normal = draws(9);
    for shape in shapes {
        for _ in 0..1000 {
            assert_eq!(raised(&mut Evidence::default(), 400, || shape(normal() as f32)), 0);
        }
    }
}

#[test]
fn one_odd_look_however_large_raises_nothing() {
    let mut evidence = Evidence::default();
    let mut look = source(4);
    for i in 0..2000 {
        let ratio = if i % 50 == 49 { f32::MAX } else { look(1.0) };
        assert!(!matches!(evidence.look(ratio, 16.0), Step::Raised | Step::Ended));
    }
}

/// The statistic over threshold of a look that lies `z` standard deviations above what is
/// learned.
fn look_at(learned: &Learned, z: f32) -> f32 {
    (learned.level + z * learned.deviation(0.0).1).powi(4)
}

#[test]
fn level_and_spread_are_running_means_and_a_look_is_measured_by_what_it_may_be() {
    let of = Evidence::default().learned;
    let (z, sd) = of.deviation(look_at(&of, 2.0));
    assert!((z - 2.0).abs() < 1e-4, "{z}");
    // the variance of a look to come: its own, and that of the level, which is a mean of so
    // many looks
    let predicted = of.variance + of.variance / of.level_looks;
    assert!((sd * sd / predicted - 1.0).abs() < 1e-4);
    let after = |z: f32| {
        let ratio = look_at(&of, z);
        of.after(ratio, of.deviation(ratio).0, sd)
    };
    let (one, two) = (after(1.0), after(2.0));
    // A look as far off as expected leaves the variance as it is; one farther off raises it.
    assert!((one.variance / of.variance - 1.0).abs() < 1e-4);
    let mean = (of.variance_looks * of.variance + 4.0 * of.variance) / (of.variance_looks + 1.0);
    assert!((two.variance / mean - 1.0).abs() < 1e-4);
    let mean = (of.level_looks * of.level + of.level + 2.0 * sd) / (of.level_looks + 1.0);
    assert!((two.level - mean).abs() < 1e-4);
    assert_eq!(two.level_looks, of.level_looks + 1.0);
    assert_eq!(two.variance_looks, of.variance_looks + 1.0);
}

#[test]
fn a_look_lies_as_far_off_by_another_threshold_as_by_this_one() {
    for lower in [0.25, 1.8] {
        let mut evidence = Evidence::default();
        let before = [0.1, 0.5, 0.9].map(|ratio| evidence.learned.deviation(ratio).0);
        evidence.change_model(lower);
        let after = [0.1, 0.5, 0.9].map(|ratio| evidence.learned.deviation(ratio * lower).0);
        assert!(before.iter().zip(after).all(|(b, a)| (b - a).abs() < 1e-3), "{before:?}");
    }
}

#[test]
fn a_look_at_its_threshold_is_not_flagged() {
    let of = Evidence::default().learned;
    let evidence = |ratio: f32| {
        let (z, sd) = of.deviation(ratio);
        of.after(ratio, z, sd).faulty
    };
    assert_eq!(evidence(1.0), 0.0);
    assert!(evidence(1.001) > 2.0);
}

#[test]
fn own_baseline_brings_its_own_level_and_takes_it_with_it_and_evidence_stays() {
    let mut evidence = Evidence::default();
    assert!(evidence.is_quiet());
    assert_eq!(evidence.look(1.1, 16.0), Step::Suspect { begins: true });
    assert!(!evidence.is_quiet());
    let suspicion = evidence.learned.faulty;
    evidence.judge_by_own(true);
    assert!(evidence.learned.deviation(OWN.level.powi(4)).0.abs() < 1e-4);
    assert_eq!(evidence.learned.faulty, suspicion);
    evidence.judge_by_own(false);
    assert!(evidence.learned.deviation(FIRST.level.powi(4)).0.abs() < 1e-4);
    assert_eq!(evidence.learned.faulty, suspicion);
}

#[test]
fn what_a_fault_has_grown_to_is_what_its_end_is_told_by() {
    let looks_to_the_end = |grown: f32| {
        let mut evidence = Evidence::default();
        let look = |z: f32| look_at(&evidence.learned, z);
        let (beyond, grown, healthy) = (look(2.9), look(grown), look(0.0));
        let raised = (0..40).find(|_| evidence.look(beyond, 16.0) == Step::Raised);
        assert!(raised.is_some());
        (0..60).for_each(|_| {
            evidence.look(grown, 16.0);
        });
        (1..60).find(|_| evidence.look(healthy, 16.0) == Step::Ended).expect("it ends")
    };
    let (small, large) = (looks_to_the_end(2.9), looks_to_the_end(40.0));
    assert!(large == 3 && small > large, "{small}, {large}");
}

#[test]
fn an_onset_is_the_first_evidence_or_what_chance_does_not_explain() {
    let alone = 1.01 * tuned::SUSPICION;
    assert!(begins(0.0, 0.1) && begins(tuned::SUSPICION / 2.0, alone));
    assert!(!begins(tuned::SUSPICION / 2.0, 0.99 * tuned::SUSPICION));
    assert!(!begins(tuned::SUSPICION, alone));
    // a look that is not flagged is no onset, however far it lies above the channel's level
    assert!(!begins(tuned::SUSPICION / 2.0, evidence_of(0.9, 20.0)));
}
