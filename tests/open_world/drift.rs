//! What moves all channels of a head alike, while nobody records why.

use super::ranges::Features;
use clap::ValueEnum;
use std::f64::consts::TAU;
use std::fmt;
use std::ops::RangeInclusive;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Drift {
    Still,
    /// Damping +8 % over ten minutes.
    Warming,
    /// Damping up and down by 8 %, 200 s a turn, from the end of the first window on.
    Swinging,
    /// Damping +10 % from one burst to the next.
    OtherInk,
    /// Damping +20 % over ten minutes, frequency -.4 %.
    Thickening,
    /// Amplitude up and down by 3 %, 90 s a turn.
    Sagging,
    /// All three, each at a pace of its own.
    Everything,
    /// Damping +20 % from one burst to the next.
    FarInk,
    /// Damping 20 % too large at first, and 200 s to settle.
    Settling,
    /// Frequency up and down by .8 %, 200 s a turn, the phase with it, as of a ring that began 10 µs before.
    Retuned,
    /// The same, and the phase stays.
    Detuned,
    /// Amplitude of each burst anew, within 8 %.
    Flickering,
}

impl Drift {
    /// How often it may be said, by the default bounds of `[identify]`: the step lies at one of them.
    pub fn warnings(self) -> RangeInclusive<usize> {
        match self {
            Drift::Thickening | Drift::FarInk | Drift::Settling => 1..=1,
            Drift::OtherInk => 0..=1,
            _ => 0..=0,
        }
    }

    pub fn at(self, t_s: f64, of: Features) -> Features {
        let turn = |period_s: f64| (TAU * t_s / period_s).sin();
        let [amplitude, damping, frequency] = match self {
            Drift::Still => [0.0; 3],
            Drift::Warming => [0.0, 0.08 * t_s / 600.0, 0.0],
            Drift::Swinging if t_s < 20.0 => [0.0; 3],
            Drift::Swinging => [0.0, 0.08 * (TAU * (t_s - 20.0) / 200.0).sin(), 0.0],
            Drift::OtherInk => [0.0, if t_s < 305.0 { 0.0 } else { 0.10 }, 0.0],
            Drift::Thickening => [0.0, 0.2 * t_s / 600.0, -0.004 * t_s / 600.0],
            Drift::Sagging => [0.03 * turn(90.0), 0.0, 0.0],
            Drift::Everything => [0.02 * turn(130.0), 0.05 * turn(310.0), 0.003 * turn(170.0)],
            Drift::FarInk => [0.0, if t_s < 305.0 { 0.0 } else { 0.20 }, 0.0],
            Drift::Settling => [0.0, 0.2 * (-t_s / 200.0).exp(), 0.0],
            Drift::Retuned | Drift::Detuned => [0.0, 0.0, 0.008 * turn(200.0)],
            // a sum of turns without a common period has no pattern
            Drift::Flickering => {
                [0.02 * [0.73, 1.91, 2.62, 3.37].map(turn).iter().sum::<f64>(), 0.0, 0.0]
            }
        };
        let turned = match self {
            Drift::Retuned => TAU * 10e-6 * of.frequency_hz * frequency,
            _ => 0.0,
        };
        Features {
            turned_rad: of.turned_rad + turned,
            amplitude: of.amplitude * (1.0 + amplitude),
            damping_per_s: of.damping_per_s * (1.0 + damping),
            frequency_hz: of.frequency_hz * (1.0 + frequency),
            ..of
        }
    }
}

impl fmt::Display for Drift {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Drift::Still => "none",
            Drift::Warming => "damping +8 %, slowly",
            Drift::Swinging => "damping ± 8 %, 200 s",
            Drift::OtherInk => "damping +10 %, a step",
            Drift::Thickening => "damping +20 %, slowly",
            Drift::Sagging => "amplitude ± 3 %, 90 s",
            Drift::Everything => "all three",
            Drift::FarInk => "damping +20 %, a step",
            Drift::Settling => "damping +20 %, settles",
            Drift::Retuned => "frequency ± .8 %, turned",
            Drift::Detuned => "frequency ± .8 %",
            Drift::Flickering => "amplitude, flickering",
        })
    }
}
