//! Families of healthy behaviour, each of which breaks something that a critic could assume.

use super::plant::{Plant, Rates, State, Terms};
use clap::ValueEnum;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Exp1, StandardNormal, StudentT};

/// What is unusual about a healthy run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Family {
    /// V, q_r and q_n scatter by independent shares of their own.
    Proportional,
    /// The state scatters alike in all directions.
    Isotropic,
    /// Amplitude, damping and frequency follow each other.
    Tied,
    /// Scatter that has one long tail.
    Skewed,
    /// Every signal has its own shift in time; nothing else scatters.
    AlongTheShift,
    /// Amplitude is common to a burst.
    CommonAmplitude,
    /// The whole state is, in all directions alike.
    CommonState,
    /// A channel's own state is unlike the others', and lasts.
    Lasting,
    HeavyTails,
    /// Rings at a third of the frequency, long.
    Slow,
    /// Rings half as high again, with more loss.
    Lossy,
    /// The nozzle's loss is a tenth of the restrictor's.
    OtherLosses,
    Short,
    Long,
    FewChannels,
    NoDriveScan,
    /// The drive varies, and nobody wrote it down.
    DriveUnrecorded,
}

/// How a run is acquired.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    pub channels: usize,
    /// Channels that one burst hears.
    pub a_burst: usize,
    pub signals: usize,
    pub samples: usize,
    pub period_s: f64,
    pub noise: f64,
    /// Lowest and highest drive, V.
    pub drives: [f64; 2],
    pub drive_recorded: bool,
}

impl Family {
    /// `turn`: bursts of 1, 4, 8 and 64 channels in turns.
    pub fn layout(self, turn: u64) -> Layout {
        let a_burst = [8, 1, 4, 64][(turn % 4) as usize];
        let plain = Layout {
            channels: if a_burst == 64 { 64 } else { 16 },
            a_burst,
            signals: if a_burst == 64 { 448 } else { 208 },
            samples: 120,
            period_s: 0.81e-6,
            noise: 2.4,
            drives: [13.0, 27.0],
            drive_recorded: true,
        };
        match self {
            Family::Slow => Layout { samples: 200, period_s: 1.3e-6, ..plain },
            Family::Short => Layout { samples: 64, period_s: 1.1e-6, ..plain },
            Family::Long => Layout { samples: 256, period_s: 0.6e-6, noise: 3.1, ..plain },
            Family::FewChannels => {
                Layout { channels: 3, a_burst: [1, 3][(turn % 2) as usize], signals: 150, ..plain }
            }
            Family::NoDriveScan => Layout { drives: [20.0, 20.0], ..plain },
            Family::DriveUnrecorded => Layout { drive_recorded: false, ..plain },
            _ => plain,
        }
    }

    fn nominal(self) -> Rates {
        match self {
            Family::Slow => Rates { a: 1.0e10, b: 1.2e10, g: 0.9e4, d: 1.7e4 },
            Family::Lossy => Rates { a: 1.6e11, b: 2.0e11, g: 5.0e4, d: 9.5e4 },
            Family::OtherLosses => Rates { a: 5.0e10, b: 9.0e10, g: 9.0e4, d: 0.9e4 },
            _ => Rates { a: 7.1e10, b: 8.3e10, g: 2.6e4, d: 5.4e4 },
        }
    }

    /// A channel's rates, its gain, and what its own state has over the others', relative.
    pub fn channel(self, rng: &mut ChaCha8Rng) -> Channel {
        let mut about = |sd: f64| 1.0 + sd * normal(rng);
        let (stiff, loss) = (about(0.006), about(0.03));
        let rates = self.nominal().scaled(stiff, loss);
        let gain = about(0.02);
        let lasting = if self == Family::Lasting { 0.05 } else { 0.003 };
        Channel { rates, gain, state: [about(lasting), about(lasting), about(lasting)] }
    }

    /// What is common to all channels of a burst.
    pub fn burst(self, rng: &mut ChaCha8Rng) -> Common {
        let mut sd = |sd: f64| sd * normal(rng);
        match self {
            Family::CommonAmplitude => Common { gain: sd(0.03), along: 0.0, across: 0.0 },
            Family::CommonState => Common { gain: 0.0, along: sd(0.02), across: sd(0.02) },
            _ => Common::default(),
        }
    }

    /// One signal's plant, and its state at t_a: what a plain kick would give, scattered.
    pub fn scattered(self, one: &Signal, terms: Terms, rng: &mut ChaCha8Rng) -> (Plant, State) {
        let mut deviate = || match self {
            Family::Skewed => Distribution::<f64>::sample(&Exp1, rng) - 1.0,
            _ => normal(rng),
        };
        let (of_gain, of_stiffness, of_loss) = match self {
            Family::Tied => {
                let one = deviate();
                (0.012 * one, 0.005 * one, -0.02 * one)
            }
            Family::AlongTheShift => (0.0, 0.0, 0.0),
            Family::Skewed => (0.012 * deviate(), 0.004 * deviate(), 0.015 * deviate()),
            _ => (0.006 * deviate(), 0.003 * deviate(), 0.009 * deviate()),
        };
        let (stiff, loss) = ((1.0 + of_stiffness) * one.stiff, (1.0 + of_loss) * one.loss);
        let rates = one.channel.rates.scaled(stiff * one.clock * one.clock, loss * one.clock);
        let plant = Plant { rates, terms };
        let omega = plant.omega();
        let amplitude = 100.0 * one.drive * one.channel.gain * (1.0 + of_gain) * one.gain;
        let kicked = State { v: -amplitude / omega, ..State::default() };
        let mut x = plant.after(kicked, 7.0e-6 + one.late_s);
        let mut own = one.channel.state.into_iter();
        x.scale(|| own.next().unwrap());
        match self {
            Family::Proportional | Family::Skewed => x.scale(|| 1.0 + 0.012 * deviate()),
            Family::Isotropic => {
                x = turned(x, omega, amplitude, 0.012 * deviate(), 0.012 * deviate())
            }
            Family::AlongTheShift => x = plant.after(x, 45e-9 * deviate()),
            _ => x.scale(|| 1.0 + 0.004 * deviate()),
        }
        let Common { gain, along, across } = one.common;
        x = turned(x, omega, amplitude, along, across);
        x.scale(|| 1.0 + gain);
        (plant, x)
    }

    pub fn noise(self, rng: &mut ChaCha8Rng) -> f64 {
        match self {
            // Student's t of 4 degrees of freedom has variance 2
            Family::HeavyTails => {
                let t: f64 = StudentT::new(4.0).unwrap().sample(rng);
                t / 2f64.sqrt()
            }
            _ => normal(rng),
        }
    }
}

/// The state moved by shares of the ring's amplitude, in V and in the flow.
fn turned(mut x: State, omega: f64, amplitude: f64, of_v: f64, of_q: f64) -> State {
    x.v += of_v * amplitude / omega;
    x.q_r += 0.5 * of_q * amplitude;
    x.q_n += 0.5 * of_q * amplitude;
    x
}

/// A channel as it was made.
#[derive(Clone, Copy, Debug)]
pub struct Channel {
    pub rates: Rates,
    pub gain: f64,
    pub state: [f64; 3],
}

impl Channel {
    /// Its plant and its state some time after a kick.
    pub fn kicked(&self, drive: f64, later_s: f64) -> (Plant, State) {
        let plant = Plant { rates: self.rates, terms: Terms::default() };
        let v = -100.0 * drive * self.gain / plant.omega();
        (plant, plant.after(State { v, ..State::default() }, later_s))
    }
}

#[derive(Clone, Copy, Debug, Default)]
pub struct Common {
    pub gain: f64,
    pub along: f64,
    pub across: f64,
}

/// What a signal is made from: its channel, its burst, and what an effect makes of both.
#[derive(Clone, Copy, Debug)]
pub struct Signal {
    pub channel: Channel,
    pub common: Common,
    /// Over the nominal.
    pub drive: f64,
    pub gain: f64,
    /// Factors of stiffness, losses, and all rates.
    pub stiff: f64,
    pub loss: f64,
    pub clock: f64,
    /// The acquisition begins so much later, s.
    pub late_s: f64,
}

pub fn normal(rng: &mut ChaCha8Rng) -> f64 {
    rng.sample(StandardNormal)
}
