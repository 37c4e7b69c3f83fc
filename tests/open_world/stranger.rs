//! Rings of channels, but of no class that anyone has labelled.

use super::plant::{Plant, Random};
use super::ranges::{Features, Range};
use clap::ValueEnum;
use rand::RngExt;

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub enum Stranger {
    /// Resonances between and beyond the classes'.
    Frequency,
    /// A resonance that healthy or faulty channels have, a damping that none of those has.
    Damping,
    /// Resonance and damping of a class, two to three times its amplitude or as much less.
    Amplitude,
    /// A class's ring with a second mode that this class does not have.
    Overtone,
}

/// A class is left by a factor of its bounds.
const FREQUENCY_FACTOR: f64 = 1.12;
const DAMPING_FACTOR: f64 = 1.6;
const AMPLITUDE_FACTOR: f64 = 2.0;

impl Stranger {
    pub fn signal(self, plant: &Plant, rng: &mut Random) -> Vec<f32> {
        let features = std::iter::repeat_with(|| self.drawn(plant, rng))
            .find(|features| self == Stranger::Overtone || is_far(features, plant))
            .expect("the classes do not fill the world");
        plant.signal(features, rng)
    }

    fn drawn(self, plant: &Plant, rng: &mut Random) -> Features {
        let mut classes: Vec<_> = plant.faults.values().chain([&plant.healthy]).collect();
        if self == Stranger::Overtone {
            classes.retain(|class| class.overtone.is_none());
        }
        let known = classes[rng.random_range(0..classes.len())].draw(rng);
        match self {
            Stranger::Frequency => Features {
                // two cycles a signal to a tenth of the sample rate
                frequency_hz: logarithmic(
                    2.0 / plant.duration_s,
                    0.1 * plant.samples as f64 / plant.duration_s,
                    rng,
                ),
                damping_per_s: logarithmic(3e3, 6e4, rng),
                ..known
            },
            Stranger::Damping => Features { damping_per_s: logarithmic(1e3, 1.2e5, rng), ..known },
            Stranger::Amplitude => {
                let more = logarithmic(2.0, 3.0, rng);
                let factor = if rng.random_bool(0.5) { more } else { 1.0 / more };
                Features { amplitude: known.amplitude * factor, ..known }
            }
            Stranger::Overtone => Features { overtone: rng.random_range(0.4..0.9), ..known },
        }
    }
}

fn logarithmic(low: f64, high: f64, rng: &mut Random) -> f64 {
    rng.random_range(low.ln()..high.ln()).exp()
}

fn is_far(features: &Features, plant: &Plant) -> bool {
    let outside = |value: f64, range: Range, factor: f64| {
        value < range.low / factor || value > range.high * factor
    };
    plant.faults.values().chain([&plant.healthy]).all(|class| {
        outside(features.frequency_hz, class.frequency_hz, FREQUENCY_FACTOR)
            || outside(features.damping_per_s, class.damping_per_s, DAMPING_FACTOR)
            || outside(features.amplitude, class.amplitude, AMPLITUDE_FACTOR)
    })
}
