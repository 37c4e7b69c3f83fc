//! Tests of the streaming kernel (`kernel.rs`, whose private parts they see): an energy has the
//! same bits whatever the instruction set, the layout and the neighbours; whatever is settled lies
//! below the threshold by the f64 reference, too; and what f32 cannot hold gets no kernel. Tests
//! with `property_` in their names draw random filters and signals from fixed seeds.

use super::*;
use crate::burst::{Burst, FORMS, Format, Layout};
use crate::detect::poles;
use crate::processor::with_each_set;
use crate::verdict::unusable_signal;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const DT_S: f64 = 0.78125e-6;
const RAILS: [f64; 2] = [-32768.0, 32767.0];

/// A burst of one signal.
fn alone(signal: &[f32]) -> Burst {
    Burst::of(&[signal.to_vec()], DT_S, Format::S16Le, Layout::ChannelMajor)
}

/// A random filter of degree `order` (1 or more): one pair of poles on the unit circle if there is
/// room, the others real and inside of it, and any numerator.
fn random_generator(rng: &mut ChaCha8Rng, order: usize) -> ResidualGenerator {
    let mut a = vec![1.0];
    let times = |p: &[f64], q: &[f64]| -> Vec<f64> {
        let mut product = vec![0.0; p.len() + q.len() - 1];
        for (i, x) in p.iter().enumerate() {
            for (j, y) in q.iter().enumerate() {
                product[i + j] += x * y;
            }
        }
        product
    };
    if order >= 2 {
        let omega: f64 = rng.random_range(0.05..3.0);
        a = times(&a, &[1.0, -2.0 * omega.cos(), 1.0]);
    }
    while a.len() <= order {
        a = times(&a, &[1.0, -rng.random_range(-0.95..0.95)]);
    }
    let b = (0..=order).map(|_| rng.random_range(-3.0..3.0)).collect();
    ResidualGenerator::new(b, a, DT_S).unwrap()
}

/// The expected signal plus a deviation of random size: uniform noise (half of the time), a
/// constant, one outlying sample, or an alternating sign. Counts, rounded and within the rails.
fn random_signal(rng: &mut ChaCha8Rng, expected: &[f64]) -> Vec<f32> {
    let kind = rng.random_range(0..6);
    let size = 10f64.powf(rng.random_range(-1.0..3.5));
    let at = rng.random_range(0..expected.len());
    let y = expected.iter().enumerate().map(|(k, e)| {
        e + match kind {
            0..3 => size * rng.random_range(-1.0..1.0),
            3 => size,                                // constant
            4 => f64::from(u8::from(k == at)) * size, // one sample
            _ => size * [1.0, -1.0][k % 2],
        }
    });
    y.map(|y| y.round().clamp(-32767.0, 32766.0) as f32).collect()
}

/// The residual energy in f64, which the kernel must agree with.
fn reference(g: &ResidualGenerator, expected: &[f64], signal: &[f32]) -> f64 {
    let d: Vec<f64> = signal.iter().zip(expected).map(|(&y, e)| f64::from(y) - e).collect();
    g.energy(&d)
}

/// The kernel's statistics of rows that are put into one tile.
fn judge(filter: &LaneFilter, of: &[(&Burst, usize)], threshold: f64) -> LaneStatistics {
    let mut tile = Tile::default();
    for &(burst, row) in of {
        tile.push(burst, row..row + 1, 1.0, 0.0);
    }
    filter.judge(&mut tile, threshold, RAILS)
}

/// An expected signal: a damped cosine of `n` samples.
fn expectation(n: usize) -> Vec<f64> {
    (0..n).map(|k| 400.0 * (-0.02 * k as f64).exp() * (0.317 * k as f64).cos()).collect()
}

#[test]
fn property_energies_have_equal_bits_whatever_the_instructions_layout_format_and_neighbours() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for order in 1..=MOST_ORDER {
        for n in [1, 5, 8, 16, 31, 128, 131] {
            let g = random_generator(&mut rng, order);
            let expected = expectation(n);
            let filter = LaneFilter::new(&g, &expected, None).unwrap();
            let lanes = rng.random_range(1..=LANES);
            let signals: Vec<Vec<f32>> =
                (0..lanes).map(|_| random_signal(&mut rng, &expected)).collect();
            // each signal by itself, then all in one tile in every format and with every
            // instruction set
            let threshold = 2.0 * reference(&g, &expected, &signals[0]);
            let alone: Vec<(u64, bool)> = signals
                .iter()
                .map(|s| {
                    let j = judge(&filter, &[(&alone(s), 0)], threshold);
                    (j.statistic[0].to_bits(), j.settled[0])
                })
                .collect();
            with_each_set(|| {
                for &(format, layout) in FORMS {
                    let b = Burst::of(&signals, DT_S, format, layout);
                    let rows: Vec<(&Burst, usize)> = (0..lanes).map(|row| (&b, row)).collect();
                    let j = judge(&filter, &rows, threshold);
                    for (lane, alone) in alone.iter().enumerate() {
                        let here = (j.statistic[lane].to_bits(), j.settled[lane]);
                        assert_eq!(here, *alone, "order {order} n {n} lane {lane}");
                    }
                }
            });
        }
    }
}

/// Tests that the bound holds, and that no lane is settled whose reference lies above the
/// threshold: thresholds are put right at, and hardly beside, each signal's own energy. At four
/// times the energy most signals must be settled, otherwise the bound would be useless.
#[test]
fn property_what_is_settled_is_at_or_below_the_threshold_in_f64() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let (mut clear, mut settled_clear) = (0, 0);
    for round in 0..400 {
        let order = 1 + round % MOST_ORDER;
        let n = [3, 64, 100, 128, 512][round % 5];
        let g = random_generator(&mut rng, order);
        let expected = expectation(n);
        let filter = LaneFilter::new(&g, &expected, None).unwrap();
        for _ in 0..8 {
            let signal = random_signal(&mut rng, &expected);
            let e = reference(&g, &expected, &signal);
            let b = alone(&signal);
            for factor in [1.0 - 1e-3, 1.0 - 1e-6, 1.0 - 1e-12, 1.0, 1.0 + 1e-9, 1.0 + 1e-4, 4.0] {
                let j = judge(&filter, &[(&b, 0)], e * factor);
                assert!(!j.settled[0] || factor >= 1.0, "settled above the threshold");
                if factor == 4.0 {
                    clear += 1;
                    settled_clear += usize::from(j.settled[0]);
                    let d2: f64 = signal
                        .iter()
                        .zip(&expected)
                        .map(|(&y, e)| (f64::from(y) - e).powi(2))
                        .sum();
                    let (r32, r) = ((j.statistic[0] / DT_S).sqrt(), (e / DT_S).sqrt());
                    let error = filter.expectation.error_at(1.0, 0.0);
                    let bound = filter.bound(Deviation { norm: d2.sqrt(), error }, r32);
                    assert!((r32 - r).abs() <= bound, "order {order} n {n}: {r32} {r} {bound}");
                }
            }
        }
    }
    assert!(settled_clear * 2 > clear, "{settled_clear} of {clear}: the bound says nothing");
}

#[test]
fn hand_bad_and_extreme_signals_are_never_settled_or_settled_rightly() {
    let n = 128;
    let expected = expectation(n);
    let omega = poles::resonance_of_oscillations(6.47, n, DT_S);
    let alpha = poles::resonance(omega, &[2.0e5, 2.0e5], DT_S).unwrap();
    let g = ResidualGenerator::new(vec![1.0, -3.75, 5.36, -3.46, 0.85], alpha, DT_S).unwrap();
    let filter = LaneFilter::new(&g, &expected, None).unwrap();
    let healthy: Vec<f32> = expected.iter().map(|e| e.round() as f32).collect();
    let with = |at: usize, values: &[f32]| {
        let mut signal = healthy.clone();
        signal[at..at + values.len()].copy_from_slice(values);
        signal
    };
    let signals = vec![
        healthy.clone(),
        with(3, &[f32::NAN]),
        with(127, &[f32::INFINITY]),
        with(0, &[f32::NEG_INFINITY]),
        with(5, &[32767.0, 32767.0]),
        with(5, &[-32768.0, -40000.0]),
        with(9, &[f32::MAX, -f32::MAX]),
        vec![0.0; n],
        vec![f32::MIN_POSITIVE / 2.0; n],
        vec![1e30; n],
        expected.iter().map(|&e| e as f32).collect(),
    ];
    let b = Burst::of(&signals, DT_S, Format::F32Le, Layout::ChannelMajor);
    let rows: Vec<(&Burst, usize)> = (0..signals.len()).map(|row| (&b, row)).collect();
    for threshold in [1e-30, 1e-3, 0.2, 1e3, 1e40] {
        let mut first = None;
        with_each_set(|| {
            let j = judge(&filter, &rows, threshold);
            for (lane, signal) in signals.iter().enumerate() {
                let counts: Vec<f64> = signal.iter().map(|&y| f64::from(y)).collect();
                let usable = unusable_signal(&counts, RAILS).is_none();
                let below = reference(&g, &expected, signal) <= threshold;
                assert!(!j.settled[lane] || (usable && below), "lane {lane} at {threshold}");
            }
            assert_eq!(*first.get_or_insert(j.settled), j.settled);
        });
    }
    // With rails within the range of the expected signal any sample may be saturated. So nothing is
    // settled, and the reference looks at every signal.
    let mut tile = Tile::default();
    tile.push(&b, 0..1, 1.0, 0.0);
    assert!(!filter.judge(&mut tile, 1e3, [-300.0, 300.0]).settled[0]);
}

#[test]
fn drive_and_temperature_of_one_burst_do_not_touch_another() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let n = 64;
    let expected = expectation(n);
    let response: Vec<f64> = (0..n).map(|k| 0.7 * (0.2 * k as f64).sin()).collect();
    let g = random_generator(&mut rng, 4);
    let filter = LaneFilter::new(&g, &expected, Some(&response)).unwrap();
    let conditions: Vec<(f64, f64)> = (0..LANES)
        .map(|i| if i < 5 { (1.0, 0.0) } else { (rng.random_range(0.5..1.5), i as f64 - 16.0) })
        .collect();
    let signals: Vec<Vec<f32>> = (0..LANES).map(|_| random_signal(&mut rng, &expected)).collect();
    let bursts: Vec<Burst> = signals.iter().map(|s| alone(s)).collect();
    with_each_set(|| {
        let run = |lanes: &[usize]| {
            let mut tile = Tile::default();
            for &i in lanes {
                tile.push(&bursts[i], 0..1, conditions[i].0, conditions[i].1);
            }
            filter.judge(&mut tile, 1.0, RAILS)
        };
        let together = run(&(0..LANES).collect::<Vec<_>>());
        for (i, &(drive, warmer)) in conditions.iter().enumerate() {
            let alone = run(&[i]);
            assert_eq!(alone.statistic[0].to_bits(), together.statistic[i].to_bits());
            let d: Vec<f64> = (0..n)
                .map(|k| f64::from(signals[i][k]) - drive * (expected[k] + warmer * response[k]))
                .collect();
            let e = g.energy(&d);
            assert!((together.statistic[i] - e).abs() <= 1e-3 * e, "{} {e}", together.statistic[i]);
        }
    });
}

#[test]
fn what_f32_cannot_hold_has_no_kernel() {
    let g = |b: Vec<f64>, a: Vec<f64>| ResidualGenerator::new(b, a, DT_S).unwrap();
    let y = [1.0, 2.0];
    let degree = |n: usize| {
        let mut p = vec![0.0; n + 1];
        p[0] = 1.0;
        g(p.clone(), p)
    };
    assert!(LaneFilter::new(&degree(MOST_ORDER), &y, None).is_some());
    assert!(LaneFilter::new(&degree(MOST_ORDER + 1), &y, None).is_none());
    assert!(LaneFilter::new(&degree(0), &y, None).is_none());
    assert!(LaneFilter::new(&degree(2), &[], None).is_none());
    assert!(LaneFilter::new(&degree(2), &y, Some(&[1.0])).is_none());
    assert!(LaneFilter::new(&g(vec![1e30, 0.0], vec![1.0, 0.5]), &y, None).is_none());
    assert!(LaneFilter::new(&g(vec![1.0, 1e-30], vec![1.0, 0.5]), &y, None).is_none());
    assert!(LaneFilter::new(&degree(2), &[1e30, 0.0], None).is_none());
}
