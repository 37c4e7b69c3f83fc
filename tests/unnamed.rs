//! Oscillators whose effect the catalogue does not hold, but something near it: the critique may not give that name. Beside
//! them what the catalogue does hold, which must have its name.

use crate::goals::Goals;
use clap::ValueEnum;
use inkling::burst::Beside;
use inkling::critique::engine::{Rings, critique};
use inkling::critique::finding::Verdict;
use inkling::critique::observations::{Observations, Sampler};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;
use std::ops::Range;

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
enum Effect {
    /// An amplifier that turns itself up as the ring falls.
    GainControl,
    /// Loss that grows while the ring falls.
    GrowingLoss,
    /// Frequency that follows time.
    Drift,
    /// Spring of even order.
    Even,
    /// A stop on one side.
    OneSided,
    /// A gap in the spring.
    Play,
    /// A sensor that saturates softly.
    Soft,
    /// A sensor that is deaf about its zero.
    Crossover,
    /// A gain that sways, wherever each decay meets it.
    Sway,
    /// A pulse of interference in each decay.
    Pulse,
    /// What the catalogue holds: `tone` of another phase in each decay.
    Tone,
    /// `second_mode`, little beside the noise of a long decay.
    Mode,
}

impl Effect {
    /// The catalogue's, if it holds the effect.
    fn name(self) -> Option<&'static str> {
        Some(match self {
            Effect::Tone => "tone",
            Effect::Mode => "second_mode",
            _ => return None,
        })
    }
}

/// Decays by Runge and Kutta, from amplitude one on: three where what is there differs from one to the next.
fn recording(effect: Effect, seed: u64) -> Observations {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let per_swing = rng.random_range(14.0..28.0);
    let (swings, falls_to) = (rng.random_range(20.0..40.0), rng.random_range(0.1..0.3_f64));
    let n = (per_swing * swings) as usize;
    let (w, loss) = (TAU / per_swing, -falls_to.ln() / (per_swing * swings));
    let strength = rng.random_range(0.5..1.0);
    let noise = 0.003;
    let force = |x: f64, v: f64, t: f64| -> f64 {
        let (mut spring, mut s, mut rate) = (x, loss, w);
        match effect {
            Effect::GrowingLoss => s *= 1.0 + 2.0 * strength * t / n as f64,
            Effect::Drift => rate *= 1.0 + 0.03 * strength * t / n as f64,
            Effect::Even => spring += 0.3 * strength * x * x,
            Effect::OneSided => spring += 0.2 * strength * x.max(0.0),
            Effect::Play => spring -= x.clamp(-0.05 * strength, 0.05 * strength),
            _ => {}
        }
        -2.0 * s * v - rate * rate * spring
    };
    let several = matches!(effect, Effect::Sway | Effect::Pulse | Effect::Tone | Effect::Mode);
    let mut sampler = Sampler::new(1e-3, 64);
    for burst in 0..if several { 3 } else { 1 } {
        let met = if several { TAU * rng.random::<f64>() } else { 0.0 };
        let phase = TAU * rng.random::<f64>();
        let (mut x, mut v) = (phase.cos(), -w * phase.sin());
        const STEPS: usize = 8;
        let h = 1.0 / STEPS as f64;
        let mut y = Vec::with_capacity(n);
        let mut level = 1.0;
        for k in 0..n {
            let envelope = x.hypot(v / w);
            level += (envelope - level) / (2.0 * per_swing);
            let seen = match effect {
                Effect::GainControl => x / (1.0 + strength * level),
                Effect::Soft => (strength * x).tanh() / strength,
                Effect::Crossover => x - x.clamp(-0.06 * strength, 0.06 * strength),
                Effect::Sway => x * (1.0 + 0.01 * strength * (0.13 * w * k as f64 + met).sin()),
                Effect::Pulse => {
                    let off = (k as f64 - 0.6 * n as f64) / per_swing;
                    x + 0.02 * strength * (-off * off).exp() * (11.0 * off + met).cos()
                }
                Effect::Tone => x + 0.002 * strength * (2.3 * w * k as f64 + met).cos(),
                Effect::Mode => {
                    let fall = (-0.7 * loss * k as f64).exp();
                    x + 0.003 * strength * fall * (1.6 * w * k as f64 + met).cos()
                }
                _ => x,
            };
            let e: f64 = StandardNormal.sample(&mut rng);
            y.push(1000.0 * (seen + noise * e));
            for i in 0..STEPS {
                let t = k as f64 + i as f64 * h;
                let a1 = force(x, v, t);
                let a2 = force(x + 0.5 * h * v, v + 0.5 * h * a1, t + 0.5 * h);
                let (v2, v3) = (v + 0.5 * h * a1, v + 0.5 * h * a2);
                let a3 = force(x + 0.5 * h * v2, v3, t + 0.5 * h);
                let v4 = v + h * a3;
                let a4 = force(x + h * v3, v4, t + h);
                x += h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4);
                v += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
            }
        }
        sampler.offer("decay", Beside::alone(0, burst * 100_000_000_000), &y);
    }
    sampler.finish()
}

/// What is said of an oscillator, and whether that is right: what the catalogue holds is called by its name and no other,
/// alone or in a tie; what it does not hold has no name for certain.
fn answer(effect: Effect, seed: u64) -> (bool, String) {
    let c = critique(&recording(effect, seed), Rings::Oscillator, false).unwrap().critique;
    let names: Vec<&str> = c.causes.iter().map(|c| c.id.name()).collect();
    let is_tied =
        |name: &str| c.causes.iter().any(|of| of.tied_with.iter().any(|id| id.name() == name));
    let is_right = match effect.name() {
        Some(name) => match c.verdict {
            Verdict::Named => names == [name],
            Verdict::Tie => names == [name] || names.len() == 1 && is_tied(name),
            _ => false,
        },
        None => c.verdict != Verdict::Named,
    };
    (is_right, format!("{effect:?} {seed}: {:?} {names:?}: {}", c.verdict, c.sentence))
}

/// The answers to oscillators of each of these effects and seeds.
fn answers(is_asked: impl Fn(&Effect) -> bool, seeds: Range<u64>) -> Vec<(bool, String)> {
    let effects = Effect::value_variants().iter().filter(|effect| is_asked(effect));
    effects.flat_map(|&effect| seeds.clone().map(move |seed| answer(effect, seed))).collect()
}

#[track_caller]
fn all_are_right(answers: Vec<(bool, String)>) {
    let mut goals = Goals::default();
    answers.into_iter().for_each(|(is_right, words)| goals.met(is_right, words));
    goals.all_are_met();
}

/// Seeds that nothing was tuned on.
#[test]
fn what_is_near_the_catalogue_is_not_given_its_names() {
    all_are_right(answers(|effect| effect.name().is_none(), 9_400_000..9_400_003));
}

#[test]
fn what_the_catalogue_holds_is_named_beside_rivals() {
    all_are_right(answers(|effect| effect.name().is_some(), 9_500_000..9_500_003));
}
