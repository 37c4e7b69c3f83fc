//! The effects that can be hidden in a recording, and what each does to one signal. In: an effect of some
//! size, and the conditions of a signal. Out: a changed equation of motion, changed samples, or changed
//! codes; effects on trigger, tail and noise are only named here, and `run.rs` carries them out.
//!
//! [`CATALOGUE`] and [`OUTSIDE`] are the lists. Identifiers, parameters and units are those of the critique's
//! catalogue (contract, `critique.json`); an [`Effect`] with another identifier is outside it. The
//! definitions are written from the catalogue's words alone: the critique's own models are other code.

use super::plant::Equation;
use crate::simulate::sensor::at_viscosity;
use Acts::{Code, Output, Plant};
use Needs::{DriveScan, Idle, Neighbours, Nothing, Temperature};
use std::f64::consts::TAU;

/// The conditions of one signal: what is recorded beside it (or could be), and what chance has drawn for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conditions {
    /// Progress of the run: 0 at its first burst, 1 at its last.
    pub progress: f64,
    /// Place on the printhead: -1/2 at the first channel, 1/2 at the last.
    pub position: f64,
    pub drive_v: f64,
    pub above_c: f64,
    /// Time since the previous actuation; NaN: there was none.
    pub idle_s: f64,
    pub neighbours: u8,
    /// The trigger's jitter in units of its size, the same for all channels of a burst.
    pub trigger: f64,
    /// Phase of a random tone, uniform, the same for all channels of a burst.
    pub phase_rad: f64,
    pub burst: usize,
    /// Healthy relative scatter of the gain, of the state's four components, of frequency and damping.
    pub shot: [f64; 7],
}

/// The samples of a signal, and what is needed to change them.
pub struct Samples<'a> {
    /// The sensor's output without noise, counts; it is changed in place.
    pub y: &'a mut [f64],
    pub period_s: f64,
    /// Peak of the nominal channel at 30 V, counts.
    pub peak_counts: f64,
}

#[derive(Clone, Copy, Debug)]
pub enum Acts {
    Plant(fn(&Effect, &Conditions, &mut Equation)),
    /// The sensor's output, before noise.
    Output(fn(&Effect, &Conditions, &mut Samples)),
    /// The trigger: the acquisition begins `size * trigger` later.
    Trigger,
    /// The tail of the previous ring: `size` times what the previous actuation would still give is added.
    Tail,
    /// The noise's correlation: `size` from sample to sample.
    Correlation,
    /// The noise's variance: it grows by the share `size` from zero to the largest signal.
    NoiseGrowth,
    /// The codes: what is done to a sample after noise, when it is digitised.
    Code(fn(&Effect, f64) -> f64),
}

/// What must have been recorded, or varied, for an effect to be seen at all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs {
    Nothing,
    DriveScan,
    Temperature,
    Idle,
    Neighbours,
}

/// One effect of one size.
#[derive(Clone, Copy, Debug)]
pub struct Effect {
    /// Identifier, and name and unit of the parameter that the critique is to find, as in the contract.
    pub id: &'static str,
    pub parameter: &'static str,
    pub unit: &'static str,
    pub needs: Needs,
    pub acts: Acts,
    /// What grows with the strength: the parameter itself, an amplitude in counts, or a coefficient of the
    /// equation of motion.
    pub size: f64,
    /// What does not grow with the strength: a frequency in Hz, a rate in 1/s, a delay in s, or a place as a
    /// share of the signal.
    pub shape: f64,
    /// Range that `shape` is drawn from; where both ends are 0, there is no shape.
    pub shapes: [f64; 2],
    /// Names that an honest critic may leave it tied with.
    pub ties: &'static [&'static str],
}

impl Effect {
    /// The same effect with another size.
    pub fn of_size(self, size: f64) -> Effect {
        Effect { size, ..self }
    }

    /// The effect with the range that its shape is drawn from.
    const fn of(self, least: f64, most: f64) -> Effect {
        Effect { shapes: [least, most], ..self }
    }

    /// The effect with the names that it may be tied with, its own among them.
    const fn tied(self, ties: &'static [&'static str]) -> Effect {
        Effect { ties, ..self }
    }

    /// Largest size (in magnitude) that is physical; infinite where nothing bounds it.
    pub fn largest(&self) -> f64 {
        match self.id {
            // shares of a loss, of what has not settled, of a neighbour's ring, of the channel's stiffness
            "fractional_damping" | "lowpass" | "crosstalk" | "meniscus" => 1.0,
            // the previous actuation was no more than twice as strong
            "previous_tail" => 2.0,
            // an amplifier that forgets within the acquisition is another sensor
            "droop" => 3e4,
            _ => f64::INFINITY,
        }
    }

    /// Whether its spectrum is a line at `shape`.
    pub fn is_line(&self) -> bool {
        matches!(self.id, "tone" | "random_tone" | "second_mode")
    }
}

/// An effect without shape and ties, for the lists below.
const fn effect(
    id: &'static str,
    parameter: &'static str,
    unit: &'static str,
    needs: Needs,
    size: f64,
    acts: Acts,
) -> Effect {
    Effect { id, parameter, unit, needs, acts, size, shape: 0.0, shapes: [0.0; 2], ties: &[] }
}

/// The two classes of causes whose members may honestly be left as a tie.
const SLOW: &[&str] = &["offset", "droop", "meniscus"];
const EARLY: &[&str] = &["lowpass", "fractional_damping"];

/// The effects of the catalogue. Each `size`, from which searches start, is about one detection limit. What is
/// one statement stands in the row: `e` is the effect, `c` the signal's conditions, `q` the equation of motion.
#[rustfmt::skip]
pub static CATALOGUE: [Effect; 22] = [
    effect("offset", "offset", "counts", Nothing, 0.1, Output(offset)).tied(SLOW),
    effect("droop", "rate", "1/s", DriveScan, 1e3, Output(droop)).tied(SLOW),
    effect("meniscus", "compliance_ratio", "1", DriveScan, 0.02, Plant(|e, _, q| q.meniscus = e.size)).tied(SLOW),
    effect("lowpass", "rate", "1/s", Nothing, 0.015, Output(lowpass)).tied(EARLY).of(3e5, 1.2e6),
    effect("second_mode", "frequency", "Hz", DriveScan, 0.25, Output(second_mode)).of(25e3, 240e3),
    effect("quadratic_drag", "damping_change", "1", DriveScan, 30.0, Plant(|e, _, q| q.drag_per_s_count = e.size)),
    effect("dry_friction", "damping_change", "1", DriveScan, 3e4, Plant(|e, _, q| q.friction_counts_per_s = e.size)),
    effect("cubic_stiffness", "frequency_change", "1", DriveScan, 1e5, Plant(|e, _, q| q.cubic = e.size)),
    effect("fractional_damping", "eta", "1", Nothing, 0.1, Plant(|e, _, q| q.half_order = e.size)).tied(EARLY),
    effect("tone", "frequency", "Hz", Nothing, 0.09, Output(tone)).of(15e3, 280e3),
    effect("random_tone", "frequency", "Hz", Nothing, 0.2, Output(tone)).of(15e3, 280e3),
    effect("trigger_jitter", "sd", "s", Nothing, 27e-9, Acts::Trigger),
    effect("clipping", "level", "counts", Nothing, 90.0, Code(|e, y| y.min(e.size))),
    effect("coarse_lsb", "step", "counts", Nothing, 2.0, Code(|e, y| (y / e.size).round() * e.size)),
    effect("previous_tail", "gain", "1", Idle, 0.3, Acts::Tail),
    effect("crosstalk", "kappa", "1", Neighbours, 0.012, Output(crosstalk)),
    effect("temperature", "damping_change", "1/K", Temperature, -0.003, Plant(|e, c, q| thin(q, e.size * c.above_c))),
    effect("ageing", "damping_change", "1", Nothing, 0.03, Plant(|e, c, q| thin(q, e.size * c.progress))),
    effect("position_gradient", "frequency_change", "1", Nothing, 0.005,
        Plant(|e, c, q| stiffen(q, e.size * c.position))),
    effect("clock_drift", "rate_change", "1", Nothing, 0.005, Plant(clock_drift)),
    effect("correlated_noise", "rho", "1", Nothing, 0.03, Acts::Correlation),
    effect("heteroscedastic_noise", "h", "1", Nothing, 0.1, Acts::NoiseGrowth),
];

/// Effects that the catalogue does not have, to which `unknown` is the right answer. The last one is stiffness
/// that follows temperature; in the catalogue only damping does.
#[rustfmt::skip]
pub static OUTSIDE: [Effect; 4] = [
    effect("outside_even_order", "share", "1", DriveScan, 0.02, Output(even_order)),
    effect("outside_echo", "share", "1", Nothing, 0.02, Output(echo)).of(25e-6, 45e-6),
    effect("outside_glitch", "counts", "counts", Nothing, 1.0, Output(glitch)).of(0.2, 0.8),
    effect("outside_warm_stiffness", "1/K", "1/K", Temperature, 0.001, Plant(|e, c, q| stiffen(q, e.size * c.above_c))),
];

// effects on the equation of motion: each sets or changes a coefficient

fn clock_drift(effect: &Effect, conditions: &Conditions, equation: &mut Equation) {
    stiffen(equation, effect.size * conditions.progress);
    thin(equation, effect.size * conditions.progress);
}

/// Changes all losses by the share `by`.
pub fn thin(equation: &mut Equation, by: f64) {
    equation.rates = at_viscosity(&equation.rates, 1.0 + by);
}

/// Changes the frequency by the share `by`: both stiffnesses by the square of that factor.
pub fn stiffen(equation: &mut Equation, by: f64) {
    let square = (1.0 + by) * (1.0 + by);
    equation.rates = equation.rates.times([square, square, 1.0, 1.0]);
}

// effects on the sensor's output: each changes the samples of a signal

fn offset(effect: &Effect, _: &Conditions, samples: &mut Samples) {
    samples.y.iter_mut().for_each(|y| *y += effect.size);
}

/// A charge amplifier with a high-pass of rate w = `size`, reset at t_a: y(t) becomes y - w I with I(t) =
/// int_0^t e^{-w(t-s)} y(s) ds. I is integrated from sample to sample by a rule that is exact if what the
/// amplifier still holds of y is a cubic in time (a quadratic in the first and the last step).
fn droop(effect: &Effect, _: &Conditions, samples: &mut Samples) {
    let (w, dt) = (effect.size, samples.period_s);
    let y = samples.y.to_vec();
    let mut leaked = 0.0;
    for k in 1..y.len() {
        // sample k - 2 + j, times what the leak leaves of it until sample k; the step is from j = 1 to j = 2
        let seen = |j: usize| y[k + j - 2] * (-w * dt * (2.0 - j as f64)).exp();
        let step = match (k >= 2, k + 1 < y.len()) {
            (true, true) => (13.0 * (seen(1) + seen(2)) - seen(0) - seen(3)) / 24.0,
            (false, true) => (5.0 * seen(1) + 8.0 * seen(2) - seen(3)) / 12.0,
            (true, false) => (5.0 * seen(2) + 8.0 * seen(1) - seen(0)) / 12.0,
            (false, false) => 0.5 * (seen(1) + seen(2)),
        };
        leaked = leaked * (-w * dt).exp() + step * dt;
        samples.y[k] = y[k] - w * leaked;
    }
}

/// An amplifier of finite bandwidth that has not settled at t_a: the share `size` of the first sample is
/// missing, and the missing part dies away at the rate `shape`.
fn lowpass(effect: &Effect, _: &Conditions, samples: &mut Samples) {
    let (missing, decay) = (effect.size * samples.y[0], (-effect.shape * samples.period_s).exp());
    let mut left = missing;
    for y in samples.y.iter_mut() {
        *y -= left;
        left *= decay;
    }
}

/// Another resonance, rung by the same pulse, so that it scales with the drive: `size` counts at 30 V,
/// frequency `shape`, damping 4 % of that number.
fn second_mode(effect: &Effect, conditions: &Conditions, samples: &mut Samples) {
    let amplitude = effect.size * conditions.drive_v / 30.0;
    let sigma = 0.04 * effect.shape;
    for (k, y) in samples.y.iter_mut().enumerate() {
        let t = k as f64 * samples.period_s;
        *y += amplitude * (-sigma * t).exp() * (TAU * effect.shape * t + 1.1).cos();
    }
}

/// A tone of amplitude `size` and frequency `shape`; its phase is the same in all bursts (`tone`) or drawn
/// for each (`random_tone`).
fn tone(effect: &Effect, conditions: &Conditions, samples: &mut Samples) {
    let phase_rad = if effect.id == "random_tone" { conditions.phase_rad } else { 0.7 };
    for (k, y) in samples.y.iter_mut().enumerate() {
        *y += effect.size * (TAU * effect.shape * k as f64 * samples.period_s + phase_rad).cos();
    }
}

fn crosstalk(effect: &Effect, conditions: &Conditions, samples: &mut Samples) {
    let share = 1.0 + effect.size * f64::from(conditions.neighbours);
    samples.y.iter_mut().for_each(|y| *y *= share);
}

/// Distortion of second order by the amplifier: `size` times the square of the sample over the peak.
fn even_order(effect: &Effect, _: &Conditions, samples: &mut Samples) {
    let peak_counts = samples.peak_counts;
    samples.y.iter_mut().for_each(|y| *y += effect.size * *y * *y / peak_counts);
}

/// A reflection: the share `size` of the signal arrives again, later by `shape` seconds, without an echo.
fn echo(effect: &Effect, _: &Conditions, samples: &mut Samples) {
    let late = ((effect.shape / samples.period_s) as usize).min(samples.y.len() - 1);
    for k in (late..samples.y.len()).rev() {
        samples.y[k] += effect.size * samples.y[k - late];
    }
}

/// A spike of `size` counts at the same sample of every signal, at the share `shape` of its length.
fn glitch(effect: &Effect, _: &Conditions, samples: &mut Samples) {
    let k = (effect.shape * samples.y.len() as f64) as usize;
    samples.y[k.min(samples.y.len() - 1)] += effect.size;
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: Conditions = Conditions {
        progress: 0.0,
        position: 0.0,
        drive_v: 30.0,
        above_c: 0.0,
        idle_s: f64::NAN,
        neighbours: 0,
        trigger: 0.0,
        phase_rad: 0.0,
        burst: 0,
        shot: [0.0; 7],
    };

    #[test]
    fn droop_subtracts_the_charge_that_leaked() {
        // y - w int_0^t e^{-w(t-s)} y ds, by a fine sum
        let f = |t: f64| (-3e4 * t).exp() * (4e5 * t).cos();
        let (dt, w) = (0.78125e-6, 4e3);
        let mut y: Vec<f64> = (0..128).map(|k| f(k as f64 * dt)).collect();
        let effect = CATALOGUE[1].of_size(w);
        droop(&effect, &PLAIN, &mut Samples { y: &mut y, period_s: dt, peak_counts: 1.0 });
        for k in [1, 40, 127] {
            let (t, n) = (k as f64 * dt, 40_000);
            let sum: f64 = (0..n)
                .map(|i| (i as f64 + 0.5) / n as f64 * t)
                .map(|s| (-w * (t - s)).exp() * f(s) * t / n as f64)
                .sum();
            assert!((y[k] - (f(t) - w * sum)).abs() < 2e-6, "{k}");
        }
    }

    #[test]
    fn identifiers_are_told_apart_and_outsiders_say_so() {
        let ids: Vec<&str> = CATALOGUE.iter().map(|e| e.id).collect();
        let mut sorted = ids.clone();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!((ids.len(), sorted.len()), (22, 22));
        assert!(OUTSIDE.iter().all(|e| e.id.starts_with("outside_")));
        for effect in &CATALOGUE {
            assert!(effect.ties.is_empty() || effect.ties.contains(&effect.id));
        }
    }
}
