//! Simulates the experiment of thesis §4-1, in which nozzles are dried on purpose and opened by pre-firing.
//!
//! In: a physics scenario. Out: the signals of the experiment, each with the state that the number of
//! pre-fires before it makes: none leaves the nozzle deeply dried (DDN), one intermediately dried (IDN),
//! eight healthy.
//!
//! The model of drying: a nozzle is dried by a factor on its viscosity that is uniform in the range of class
//! DDN, and pre-firing carries dried ink out, so that each pre-fire leaves the share `LEFT` of the excess:
//! factor = 1 + (dried - 1) LEFT^pre-fires.

use super::draws::{Purpose, part, stream};
use super::scenario::Physics;
use super::sensor::{Channel, NOMINAL_DRIVE_V, Sensor};
use inkling_core::fault::HEALTHY;
use inkling_core::model::faults;
use rand::RngExt;
use rand::seq::SliceRandom;

/// Drive voltage of the actuation that every signal rings from, V.
pub const DRIVE_V: f64 = NOMINAL_DRIVE_V;
/// Share of the excess viscosity that a pre-fire leaves: with it the three states form clusters as in Fig. 4-2.
const LEFT: f64 = 0.25;
/// State, number of signals and number of pre-fires of each set; the numbers of signals are the thesis's.
const SETS: [(&str, usize, i32); 3] = [(HEALTHY, 48, 8), ("IDN", 39, 1), ("DDN", 60, 0)];

/// Simulates one experiment: state and counts of each of its 147 signals, shuffled. `repeat`: which one.
pub fn experiment(physics: &Physics, seed: u64, repeat: u32) -> Vec<(&'static str, Vec<i16>)> {
    let part = part::DRYING + repeat;
    let mut spread = stream(seed, Purpose::Spread, part);
    let mut truth = stream(seed, Purpose::Truth, part);
    let mut sensor = Sensor::new(physics, seed, part);
    let [low, high] = physics.fault.get("DDN").map_or([2.0, 4.0], |fault| fault.range);
    let mut signals = Vec::new();
    for (state, count, pre_fires) in SETS {
        for _ in 0..count {
            let Channel { rates, gain } = Channel::draw(physics, &mut spread);
            // how dried the nozzle was, as a factor on its viscosity, and what the pre-fires leave of it
            let dried = low + (high - low) * truth.random::<f64>();
            let factor = 1.0 + (dried - 1.0) * LEFT.powi(pre_fires);
            let rates = faults::apply("DDN", factor, &rates).unwrap_or(rates);
            let mut counts = Vec::with_capacity(physics.acquisition.samples);
            sensor.sense(&rates, gain, NOMINAL_DRIVE_V, &mut counts);
            signals.push((state, counts));
        }
    }
    signals.shuffle(&mut truth);
    signals
}
