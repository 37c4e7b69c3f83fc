//! Tests of `engine.rs` on synthetic signals with correlated noise, which the engine makes white
//! before it looks for causes: clipped samples must not spoil this.

use super::super::generator::{Run, criticised, draw};
use super::super::observations::Sampler;
use super::CauseId::CorrelatedNoise;
use super::*;

/// 16 channels in 12 bursts, as whole counts, with AR(1) noise of rho = .35. `converted` changes
/// each sample before it is rounded; its arguments are the number of the signal, the time in signal
/// lengths, and the value in counts.
fn coloured(seed: u64, converted: impl Fn(usize, f64, f64) -> f64) -> Observations {
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
