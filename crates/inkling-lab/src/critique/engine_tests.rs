//! Tests of `engine.rs` on synthetic signals with correlated noise, which the engine makes white
//! before it looks for causes: clipped samples must not spoil this.

use super::super::generator::{Run, criticised, draw};
use super::super::observations::Sampler;
use super::CauseId::CorrelatedNoise;
use super::*;

/// 16 channels in 12 bursts, as whole counts, with AR(1) noise of rho = .35. `converted` changes
/// each sample before it is rounded; its arguments are the number of the signal, the time in signal
/// lengths, and the value in counts.
fn coloured(seed: u64, mut converted: impl FnMut(usize, f64, f64) -> f64) -> Observations {
    let effect = Some(CorrelatedNoise);
    let run = Run { channels: 16, bursts: 12, effect, size: 0.35, ..Run::default() };
    let drawn = draw(&run, seed);
    let mut sampler = Sampler::new(drawn.dt_s, usize::MAX);
    for (i, row) in drawn.rows.iter().enumerate() {
        let time = |k: usize| k as f64 / drawn.samples as f64;
        let each = drawn.signal(i).iter().enumerate();
        let y: Vec<f64> = each.map(|(k, y)| converted(i, time(k), (*y).into()).round()).collect();
        sampler.offer("p", row.beside, &y);
    }
    sampler.finish()
}

/// The causes that are named, sorted; `None`: too much is left to name any.
fn named(data: &Observations) -> Option<Vec<&'static str>> {
    let of = criticised(data);
    let mut names: Vec<&str> = of.causes.iter().map(|cause| cause.id.name()).collect();
    names.sort_unstable();
    (of.verdict == Verdict::Named).then_some(names)
}

/// A ring fits noise, too: it explains as much of it as its parameters are of the samples.
#[test]
fn noise_alone_is_refused() {
    let mut turn = 1u64;
    let noise = coloured(1, |_, _, _| {
        turn = turn.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (0..4).map(|k| (turn >> (8 * k + 24) & 255) as f64 - 127.5).sum()
    });
    let refused = critique(&noise, Rings::InkChannel, false);
    assert!(matches!(refused, Err(CritiqueError::NoRing)));
    let mut turn = 0.0;
    let weak = coloured(1, |_, _, y| {
        turn += 1.0;
        y + 30.0 * f64::sin(turn * turn)
    });
    assert!(critique(&weak, Rings::InkChannel, false).is_ok());
}

/// Both causes must be named, and nothing else: a clipped sample, if it were whitened, would look
/// like a pulse.
#[test]
fn clipped_samples_are_left_out_where_noise_is_made_white() {
    for seed in [1, 2, 3] {
        for rail in [60.0, 90.0] {
            let clipped = coloured(seed, |_, _, y| y.min(rail));
            assert_eq!(named(&clipped), Some(vec!["clipping", "correlated_noise"]));
        }
    }
}
