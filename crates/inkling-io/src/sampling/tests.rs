use super::*;
use crate::fixtures::assert_refused;

const T: TimeColumn = TimeColumn { name: "t", unit_s: 1e-6 };

fn decay(times: Vec<f64>, y: impl Fn(f64) -> f64) -> Decay {
    let outputs = vec![times.iter().map(|t| y(*t)).collect()];
    Decay { line: 2, times, outputs, ..Decay::default() }
}

#[test]
fn times_rounded_to_milliseconds_are_regular_and_their_period_is_found() {
    let times = (1..400).map(|k| (f64::from(k) / 30.0 * 1e3).round() / 1e3).collect();
    let sampled = sample(vec![decay(times, f64::sin)], T, false).unwrap();
    assert!((sampled.period * 30.0 - 1.0).abs() < 1e-5, "{}", sampled.period);
    assert!(sampled.most_off_grid < 0.02);
    assert_eq!(sampled.interpolated, 0);
}

#[test]
fn irregular_sampling_is_refused_and_says_how_much_and_where() {
    let mut times: Vec<f64> = (0..100).map(f64::from).collect();
    times[40] += 0.4;
    let sampled = sample(vec![decay(times, f64::sin)], T, false);
    assert_refused(sampled, &["irregular", "1 of 100", "40.4 (its row 41", "--resample"]);
}

#[test]
fn rows_that_are_not_there_are_counted_and_told() {
    let times = |gone: &[i32]| -> Vec<f64> {
        (0..2000).filter(|k| !gone.contains(k)).map(|k| f64::from(k) / 100.0).collect()
    };
    let refused = |decays, texts: &[&str]| assert_refused(sample(decays, T, false), texts);
    for (gone, texts) in [
        (&[499, 500, 501][..], &["3 samples missing after t = 4.98 of times every 0.01;"][..]),
        (&[7], &["1 sample missing after t = 0.06 "]),
        (&[7, 100, 200, 300, 301], &["5 samples missing", "at 1 more place"]),
    ] {
        refused(vec![decay(times(gone), f64::sin)], texts);
    }
    // a dropout is no end of an acquisition, whether times are exact or have few digits
    let dropout: Vec<i32> = (60..100).chain(128..2000).collect();
    for (scale, says) in [(1.0, "40 samples missing after t = 0.59 "), (1.0 / 0.3, "t = 1.967 ")] {
        let coarse = |t: &f64| (t * scale * 1e3).round() / 1e3;
        let times: Vec<f64> = times(&dropout).iter().map(coarse).collect();
        let both = ["--burst", "--resample draws a curve"];
        refused(vec![decay(times.clone(), f64::sin)], &[&[says], &both[..]].concat());
        assert_refused(
            as_listed(vec![decay(times, f64::sin)]),
            &[says, "as --period-s takes them"],
        );
    }
    // beside a whole decay it is the one with a gap that is to blame
    let whole = Decay { name: "whole".into(), ..decay(times(&[]), f64::sin) };
    let cut = Decay { name: "cut".into(), ..decay(times(&[999]), f64::sin) };
    refused(vec![whole, cut], &["burst \"cut\"", "1 sample missing"]);
    // written with few digits
    let coarse = times(&[1000]).iter().map(|t| (t / 0.3 * 1e3).round() / 1e3).collect();
    refused(vec![decay(coarse, f64::sin)], &["1 sample missing", "every 0.033333"]);
}

#[test]
fn advice_about_rounded_times_gaps_between_acquisitions_and_rows_of_one_time_leads_to_right_data() {
    let grid = |k: i32| f64::from(k) * 0.78125;
    let every = |n: i32, of: &dyn Fn(i32) -> f64| (0..n).map(of).collect::<Vec<f64>>();
    let by_rows = "--period-s 0.00000078125 (about) takes rows as samples";
    for (times, says) in [
        (every(129, &|k| (grid(k) / 0.5).round() * 0.5), by_rows),
        (every(128, &|k| 1e6 + grid(k) + f64::from(k / 40) * 1e5), "each needs a table"),
        (every(384, &|k| grid(k + 2 * (k / 128))), "4 samples missing"),
        (every(384, &|k| grid(k + 2 * (k / 128))), "each needs a table"),
        (every(384, &|k| grid(k / 3)), "stands in 3 rows: if they are of several channels"),
        (every(400, &|k| grid(k / 10 * 10)), by_rows),
        (every(100, &|k| grid(k / 10 * 10)), by_rows),
        (every(256, &|k| grid((k + 20) / 32 * 32)), by_rows),
        (every(60, &|k| grid(k / 30 * 30)), by_rows),
        (every(50, &|k| grid((k + 20) / 40 * 40)), "--period-s takes rows as samples"),
    ] {
        let refusal = sample(vec![decay(times, f64::sin)], T, false).unwrap_err();
        assert!(refusal.contains(says) && !refusal.contains("--resample"), "{says}: {refusal}");
    }
    let elapsed = TimeColumn { name: "x", ..T };
    let coarse = every(100, &|k| (grid(k) / 2.0).floor());
    assert_refused(sample(vec![decay(coarse, f64::sin)], elapsed, false), &["--time \"x\""]);
    // resampled, the period is not the commonest step
    let times = every(129, &|k| (grid(k) / 0.5).round() * 0.5);
    let sampled = sample(vec![decay(times, f64::sin)], T, true).unwrap();
    assert!((sampled.period / 0.78125 - 1.0).abs() < 1e-3, "{}", sampled.period);
}

#[test]
fn rows_that_are_samples_are_cut_where_acquisitions_begin() {
    let times = (0..60).map(|k| f64::from(k / 20) * 1e6 + f64::from(k % 20 / 2)).collect();
    let listed = as_listed(vec![decay(times, f64::sin)]).unwrap();
    assert_eq!((listed.segments, listed.decays[2].times[0]), (3, 2e6));
}

#[test]
fn two_rows_that_were_swapped_are_to_be_sorted_and_are_no_two_acquisitions() {
    for at in [2, 64, 126] {
        let mut times: Vec<f64> = (0..128).map(f64::from).collect();
        times.swap(at, at + 1);
        for resample in [false, true] {
            let sampled = sample(vec![decay(times.clone(), f64::sin)], T, resample);
            let says = format!("rows {} and {} are out of order", at + 1, at + 2);
            assert_refused(sampled, &[&says, "sort the rows by it"]);
        }
    }
}

#[test]
fn time_that_goes_back_or_stands_still_is_refused_with_its_row() {
    let other = TimeColumn { name: "CH1", ..T };
    for (again, time, says) in [
        (2.0, T, "at its row 5: 2 after 3; sort the rows"),
        (2.0, other, "row 5: 2 after 3; where no column is of times, --period-s"),
        (3.0, T, "rows 4 and 5 have one time in \"t\", 3: remove one"),
    ] {
        let times = vec![0.0, 1.0, 2.0, 3.0, again, 5.0];
        for resample in [false, true] {
            let sampled = sample(vec![decay(times.clone(), f64::sin)], time, resample);
            assert_refused(sampled, &[says, "--burst"]);
        }
    }
}

#[test]
fn a_spline_through_a_straight_line_is_the_line_and_misses_nothing_missing() {
    let mut decay = decay(vec![0.0, 0.7, 2.0, 3.1, 4.0, 5.2, 6.0], |t| 3.0 - 2.0 * t);
    decay.outputs[0][2] = f64::NAN;
    let sampled = sample(vec![decay.clone()], T, true).unwrap();
    assert_eq!(sampled.missing, 1);
    for (k, y) in sampled.decays[0].outputs[0].iter().enumerate() {
        assert!((y - (3.0 - 2.0 * sampled.period * k as f64)).abs() < 1e-9);
    }
}

#[test]
fn decays_of_different_period_are_refused_and_resampled_to_one() {
    let at = |period: f64| (0..50).map(|k| f64::from(k) * period).collect::<Vec<f64>>();
    let decays = || [1.0, 1.0, 1.5].map(|period| decay(at(period), f64::cos)).to_vec();
    assert_refused(sample(decays(), T, false), &["1.5", "--resample"]);
    let sampled = sample(decays(), T, true).unwrap();
    let lengths: Vec<usize> = sampled.decays.iter().map(|d| d.outputs[0].len()).collect();
    assert_eq!(lengths, [50, 50, 74]);
}

#[test]
fn too_few_and_too_many_samples_are_refused() {
    for n in [1, 3, MOST_SAMPLES + 1] {
        let times = (0..n).map(|k| k as f64).collect();
        let sampled = sample(vec![decay(times, f64::sin)], T, false);
        assert_refused(sampled, &[&format!("{n} samples")]);
    }
    // one far time would make a grid of 1e12 samples
    let times = vec![0.0, 1.0, 2.0, 3.0, 4.0, 1e12];
    assert!(sample(vec![decay(times, f64::sin)], T, true).is_err());
}
