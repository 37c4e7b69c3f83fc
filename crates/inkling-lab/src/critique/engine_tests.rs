//! What is done with signals whose noise is made white.

use super::super::generator::{Run, draw};
use super::super::observations::Sampler;
use super::CauseId::CorrelatedNoise;
use super::*;

/// Whole counts with correlated noise, after `converted` was applied to each sample.
fn coloured(seed: u64, converted: impl Fn(f64) -> f64) -> Observations {
    let effect = Some(CorrelatedNoise);
    let run = Run { channels: 16, bursts: 12, effect, size: 0.35, ..Run::default() };
    let drawn = draw(&run, seed);
    let mut sampler = Sampler::new(drawn.dt_s, usize::MAX);
    for (i, row) in drawn.rows.iter().enumerate() {
        let each = drawn.signal(i).iter();
        let y: Vec<f64> = each.map(|y| converted((*y).into()).round()).collect();
        sampler.offer("p", row.beside, &y);
    }
    sampler.finish()
}

/// The causes that are named, sorted; `None`: too much is left to name any.
fn named(data: &Observations) -> Option<Vec<&'static str>> {
    let of = critique(data, Rings::InkChannel, false, &mut |_| {}).unwrap().critique;
    let mut names: Vec<&str> = of.causes.iter().map(|cause| cause.id.name()).collect();
    names.sort_unstable();
    (of.verdict == Verdict::Named).then_some(names)
}

#[test]
fn clipped_samples_are_left_out_where_noise_is_made_white() {
    for seed in [1, 2, 3] {
        for rail in [60.0, 90.0] {
            let clipped = coloured(seed, |y| y.min(rail));
            assert_eq!(named(&clipped), Some(vec!["clipping", "correlated_noise"]));
        }
    }
}
