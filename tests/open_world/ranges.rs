//! Boxes that classes fill, and places in them.

use super::plant::Random;
use rand::RngExt;
use serde::Deserialize;

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(from = "[f64; 2]")]
pub struct Range {
    pub low: f64,
    pub high: f64,
}

impl From<[f64; 2]> for Range {
    fn from([low, high]: [f64; 2]) -> Range {
        Range { low, high }
    }
}

impl Range {
    pub fn centre(self) -> f64 {
        (self.low + self.high) / 2.0
    }

    /// Of the uniform distribution over it.
    pub fn sd(self) -> f64 {
        (self.high - self.low) / 12_f64.sqrt()
    }

    pub fn draw(self, rng: &mut Random) -> f64 {
        rng.random_range(self.low..=self.high)
    }
}

/// Of one class.
#[derive(Clone, Copy, Debug, Deserialize)]
pub struct Ranges {
    #[serde(rename = "amplitude_counts")]
    pub amplitude: Range,
    #[serde(rename = "sigma_per_s")]
    pub damping_per_s: Range,
    #[serde(rename = "freq_hz")]
    pub frequency_hz: Range,
    /// Of a second mode, if it has one.
    #[serde(default)]
    pub overtone: Option<Range>,
}

impl Ranges {
    pub fn centre(&self) -> Features {
        self.at(Range::centre)
    }

    pub fn draw(&self, rng: &mut Random) -> Features {
        self.at(|range| range.draw(rng))
    }

    /// A place in the box.
    fn at(&self, mut place: impl FnMut(Range) -> f64) -> Features {
        Features {
            amplitude: place(self.amplitude),
            damping_per_s: place(self.damping_per_s),
            frequency_hz: place(self.frequency_hz),
            overtone: self.overtone.map_or(0.0, place),
            turned_rad: 0.0,
        }
    }
}

/// What tells the signals of a class from others, in the units of `classes.json`.
#[derive(Clone, Copy, Debug)]
pub struct Features {
    pub amplitude: f64,
    pub damping_per_s: f64,
    pub frequency_hz: f64,
    pub overtone: f64,
    /// Beyond the plant's own phase.
    pub turned_rad: f64,
}
