//! Effects and base plants that the library has never seen: they exist in the tests alone.

use inkling::simulate::hidden::effect::{Acts, Conditions, Effect, Needs, Samples};
use inkling::simulate::hidden::plant::Equation;

/// An effect without shape and ties.
fn plain(id: &'static str, needs: Needs, size: f64, acts: Acts) -> Effect {
    let (parameter, unit) = ("share", "1");
    Effect { id, parameter, unit, needs, acts, size, shape: 0.0, shapes: [0.0; 2], ties: &[] }
}

/// Outside the catalogue, and not among what `simulate --hide` draws.
pub fn unseen() -> Vec<Effect> {
    vec![
        plain("outside_soft_saturation", Needs::Nothing, 0.02, Acts::Output(soft_saturation)),
        plain("outside_interleaving", Needs::Nothing, 0.005, Acts::Output(interleaving)),
        plain("outside_baseline_step", Needs::Nothing, 0.2, Acts::Output(baseline_step)),
        plain("outside_chirp", Needs::Nothing, 0.15, Acts::Output(chirp)),
        plain("outside_held_sample", Needs::Nothing, 0.2, Acts::Output(held_sample)),
        plain("outside_stiff_neighbours", Needs::Neighbours, 0.001, Acts::Plant(stiff_neighbours)),
    ]
}

/// In the catalogue by its name, put in by other means: warm ink thins in the nozzle alone.
pub fn warm_nozzle() -> Effect {
    let thins = Acts::Plant(|effect, conditions, equation| {
        equation.d_per_s *= (effect.size * conditions.above_c).exp();
    });
    let effect = plain("temperature", Needs::Temperature, -0.002, thins);
    Effect { parameter: "damping_change", unit: "1/K", ..effect }
}

fn soft_saturation(effect: &Effect, _: &Conditions, samples: &mut Samples) {
    let (share, peak) = (effect.size, samples.peak_counts);
    // compresses upwards only: an amplifier near one rail
    samples.y.iter_mut().for_each(|y| *y -= share * peak * (y.max(0.0) / peak).powi(4));
}

fn interleaving(effect: &Effect, _: &Conditions, samples: &mut Samples) {
    for (k, y) in samples.y.iter_mut().enumerate() {
        *y *= 1.0 + effect.size * if k % 2 == 0 { 1.0 } else { -1.0 };
    }
}

fn baseline_step(effect: &Effect, _: &Conditions, samples: &mut Samples) {
    let half = samples.y.len() * 2 / 5;
    samples.y[half..].iter_mut().for_each(|y| *y += effect.size);
}

fn chirp(effect: &Effect, _: &Conditions, samples: &mut Samples) {
    let end = samples.y.len() as f64 * samples.period_s;
    for (k, y) in samples.y.iter_mut().enumerate() {
        let t = k as f64 * samples.period_s;
        let cycles = 90e3 * t + 0.5 * (220e3 - 90e3) * t * t / end;
        *y += effect.size * (std::f64::consts::TAU * cycles).sin();
    }
}

fn held_sample(effect: &Effect, _: &Conditions, samples: &mut Samples) {
    // a share of the samples' step is lost in every sixteenth sample
    for k in (16..samples.y.len()).step_by(16) {
        samples.y[k] += effect.size * (samples.y[k - 1] - samples.y[k]);
    }
}

fn stiff_neighbours(effect: &Effect, conditions: &Conditions, equation: &mut Equation) {
    let factor = 1.0 + effect.size * f64::from(conditions.neighbours);
    equation.a_per_s2 *= factor;
    equation.b_per_s2 *= factor;
}

/// Another printhead: rings lower and longer, is sampled slower.
pub fn other_base(scenario: &str) -> String {
    let changes = [
        ("a_per_s2 = 5.6e10", "a_per_s2 = 4.4e10"),
        ("b_per_s2 = 1.11e11", "b_per_s2 = 6.0e10"),
        ("g_per_s = 1.6e4", "g_per_s = 1.2e4"),
        ("d_per_s = 8.0e4", "d_per_s = 4.5e4"),
        ("sample_period_us = 0.78125", "sample_period_us = 1.0"),
        ("samples = 128", "samples = 150"),
        ("largest_healthy_counts = 100.0", "largest_healthy_counts = 140.0"),
    ];
    changes.iter().fold(scenario.to_owned(), |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    })
}
