//! What moves all channels of a head alike, while nobody records why.

use super::ranges::Features;
use std::f64::consts::TAU;
use std::fmt;
use std::ops::RangeInclusive;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
}

impl Drift {
    pub const ALL: [Drift; 7] = [
        Drift::Still,
        Drift::Warming,
        Drift::Swinging,
        Drift::OtherInk,
        Drift::Thickening,
        Drift::Sagging,
        Drift::Everything,
    ];

    /// How often it may be said, by the default bounds of `[identify]`: the step lies at one of them.
    pub fn warnings(self) -> RangeInclusive<usize> {
        match self {
            Drift::Thickening => 1..=1,
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
        };
        Features {
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
        })
    }
}
