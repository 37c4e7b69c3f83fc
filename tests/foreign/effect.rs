//! One effect each of the catalogue, and some outside it, put into a foreign run by code of its own.

use super::healthy::{Channel, Layout, Signal};
use super::plant::{Plant, State, Terms};
use clap::ValueEnum;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::{PI, TAU};

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "snake_case")]
pub enum Effect {
    Nothing,
    Offset,
    Droop,
    Meniscus,
    Lowpass,
    SecondMode,
    QuadraticDrag,
    DryFriction,
    CubicStiffness,
    Tone,
    RandomTone,
    TriggerJitter,
    Clipping,
    CoarseLsb,
    PreviousTail,
    Crosstalk,
    Temperature,
    Ageing,
    PositionGradient,
    ClockDrift,
    CorrelatedNoise,
    HeteroscedasticNoise,
    /// A mode below half of the ring's frequency looks like a meniscus that is pulled back, and is none.
    SlowMode,
    /// Warm ink thins in the nozzle alone.
    WarmNozzle,
    /// A neighbour's own ring is heard, at whatever phase its way leaves it.
    NeighboursRing,
    /// Outside the catalogue: the sensor's gain drifts.
    GainDrift,
    /// Two neighbouring codes of sixteen are never given.
    MissingCodes,
    /// The sensor is not linear: y + c y².
    EvenOrder,
    /// The baseline steps.
    BaselineStep,
    /// A pulse of four samples in few signals.
    Pulses,
    /// Loss, or stiffness, settles to another value while the signal is acquired.
    LossSettles,
    StiffnessSettles,
    /// The spring is stiffer beyond some displacement to one side.
    OneSidedStop,
    /// The sensor hears nothing about its zero; hears little there; saturates softly.
    DeadZone,
    Crossover,
    SoftSensor,
    /// The gain falls with the running mean of the signal's size.
    GainControl,
    /// Sampling times sway; the gain does.
    TimeBaseSways,
    Mixer,
    /// A copy comes later.
    Echo,
    GainStep,
    /// A line of fixed phase whose frequency rises.
    Chirp,
    /// Two converters take turns, of gains that differ.
    Interleaving,
    /// A share of the step is lost in every sixteenth sample.
    HeldSample,
    /// Neighbours that fire stiffen the channel.
    StiffNeighbours,
    /// Beside the white noise, a trap that is filled and emptied at random: two levels.
    TelegraphNoise,
    /// Beside the white noise, noise of the same power in each octave.
    PinkNoise,
}

/// What is known of a signal where an effect acts.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// 0 at the first burst, 1 at the last.
    pub progress: f64,
    /// -1/2 at the first channel, 1/2 at the last.
    pub position: f64,
    /// Above the mean.
    pub warmer_c: f64,
    pub idle_s: f64,
    pub neighbours: f64,
    /// The channel beside it, and how long after its kick its ring is heard, s.
    pub neighbour: Channel,
    pub way_s: f64,
    /// Over the nominal.
    pub drive: f64,
    /// Normal and uniform deviates of the burst.
    pub trigger: f64,
    pub phase: f64,
    /// Number of the signal.
    pub number: usize,
}

/// An effect, `strength` times about one detection limit of 208 signals of 120 samples at 2.4 counts.
#[derive(Clone, Copy, Debug)]
pub struct Hidden {
    pub effect: Effect,
    pub strength: f64,
}

impl Effect {
    /// As the contract has it.
    pub fn id(self) -> String {
        match self {
            Effect::SlowMode => Effect::SecondMode.id(),
            Effect::WarmNozzle => Effect::Temperature.id(),
            Effect::NeighboursRing => Effect::Crosstalk.id(),
            _ => self.to_possible_value().unwrap().get_name().to_owned(),
        }
    }

    /// `None`: nothing is put in.
    pub fn is_in_the_catalogue(self) -> Option<bool> {
        (self != Effect::Nothing).then_some((self as usize) < Effect::GainDrift as usize)
    }

    /// All of the catalogue, or all outside it.
    pub fn all(in_the_catalogue: bool) -> Vec<Effect> {
        let mut all = Effect::value_variants().to_vec();
        all.retain(|effect| effect.is_in_the_catalogue() == Some(in_the_catalogue));
        all
    }

    /// Names that an honest critic may leave it tied with.
    pub fn ties(self) -> &'static [&'static str] {
        match self {
            Effect::Offset | Effect::Droop | Effect::Meniscus => &["offset", "droop", "meniscus"],
            Effect::Lowpass => &["lowpass", "fractional_damping"],
            _ => &[],
        }
    }
}

impl Hidden {
    fn of(&self, effect: Effect) -> f64 {
        if self.effect == effect { self.strength } else { 0.0 }
    }

    /// What moves a signal's rates, gain and trigger.
    pub fn moves(&self, signal: &mut Signal, at: &Place, layout: &Layout) {
        let time = at.progress - 0.5;
        signal.loss *= 1.0 + 0.0035 * self.of(Effect::Temperature) * at.warmer_c;
        signal.loss *= 1.0 + 0.03 * self.of(Effect::Ageing) * time;
        signal.clock *= 1.0 + 0.0045 * self.of(Effect::ClockDrift) * time;
        // of the stiffness, so twice that of the frequency
        signal.stiff *= 1.0 + 0.012 * self.of(Effect::PositionGradient) * at.position;
        signal.channel.rates.d *= 1.0 - 0.006 * self.of(Effect::WarmNozzle) * at.warmer_c;
        signal.stiff *= 1.0 + 0.002 * self.of(Effect::StiffNeighbours) * at.neighbours;
        signal.gain *= 1.0 + 0.004 * self.of(Effect::Crosstalk) * at.neighbours;
        signal.gain *= 1.0 + 0.012 * self.of(Effect::GainDrift) * time;
        let jitter_s = 40e-9 * (self.of(Effect::TriggerJitter) / layout.a_burst as f64).sqrt();
        signal.late_s += jitter_s * at.trigger;
    }

    /// What bends the plant; strengths are of the nominal ring, 100 counts.
    pub fn terms(&self, sigma: f64, omega: f64) -> Terms {
        let of_flow = 50.0; // amplitude of the nozzle's flow, counts
        let extra = 0.03 * sigma;
        Terms {
            drag: self.of(Effect::QuadraticDrag) * 2.0 * extra / of_flow,
            friction: self.of(Effect::DryFriction) * 1.4 * extra * of_flow,
            cubic: self.of(Effect::CubicStiffness) * 0.006 * (omega / 100.0).powi(2),
            meniscus: self.of(Effect::Meniscus) * 0.05,
            stop: [0.008 * self.of(Effect::OneSidedStop), 30.0 / omega],
            settles: [
                0.06 * self.of(Effect::LossSettles),
                0.0049 * self.of(Effect::StiffnessSettles),
            ],
        }
    }

    /// What is added to the samples, `dt` seconds apart.
    pub fn senses(&self, y: &mut [f64], plant: &Plant, x: State, at: &Place, dt: f64) {
        let tail = (0.3 * self.of(Effect::PreviousTail)).min(1.2);
        if tail > 0.0 && at.idle_s.is_finite() {
            let later = plant.samples(plant.after(x, at.idle_s), dt, y.len());
            y.iter_mut().zip(later).for_each(|(y, later)| *y += tail * later);
        }
        let heard = 0.004 * self.of(Effect::NeighboursRing) * at.neighbours;
        if heard > 0.0 {
            let (plant, x) = at.neighbour.kicked(at.drive, at.way_s);
            let ring = plant.samples(x, dt, y.len());
            y.iter_mut().zip(ring).for_each(|(y, ring)| *y += heard * ring);
        }
        let sway = 7e-9 * self.of(Effect::TimeBaseSways);
        if sway > 0.0 {
            let at = |k: usize| (k as f64 * dt, sway * (TAU * 37e3 * k as f64 * dt + 0.6).sin());
            let late = |k: usize| plant.after(x, at(k).0 + at(k).1).seen();
            y.iter_mut().enumerate().for_each(|(k, y)| *y = late(k));
        }
        let echo = 0.005 * self.of(Effect::Echo);
        (27..y.len()).rev().for_each(|k| y[k] += echo * y[k - 27]);
        let mut size = 0.7 * y[0].abs().max(y[1].abs());
        for y in y.iter_mut() {
            size += (y.abs() - size) / 25.0;
            *y /= 1.0 + 0.0009 * self.of(Effect::GainControl) * size;
        }
        let droop = 1150.0 * self.of(Effect::Droop) * dt;
        let (mut charge, first, n) = (0.0, y[0], y.len());
        for (k, y) in y.iter_mut().enumerate() {
            let t = k as f64 * dt;
            let plain = *y;
            *y -= droop * charge;
            charge = charge * (-droop).exp() + plain;
            *y -= 0.02 * self.of(Effect::Lowpass) * first * (-t / 1.3e-6).exp();
            *y += 0.09 * self.of(Effect::Offset);
            *y += 0.1 * self.of(Effect::Tone) * (TAU * 118e3 * t + 0.8).cos();
            let random = 0.25 * self.of(Effect::RandomTone).sqrt();
            *y += random * (TAU * 131e3 * t + at.phase).cos();
            let mode = 0.3 * self.of(Effect::SecondMode) * at.drive;
            *y += mode * (-t / 45e-6).exp() * (TAU * 104e3 * t + 1.1).cos();
            let slow = 0.3 * self.of(Effect::SlowMode) * at.drive;
            *y += slow * (-t / 45e-6).exp() * (TAU * 26e3 * t + 1.1).cos();
            *y += 0.00025 * self.of(Effect::EvenOrder) * plain * plain;
            *y += if k > n / 3 { 0.2 * self.of(Effect::BaselineStep) } else { 0.0 };
            *y = self.senses_otherwise(*y, plain);
            *y += 0.01 * self.of(Effect::GainStep) * if k > n / 3 { plain } else { 0.0 };
            let chirp = 0.1 * self.of(Effect::Chirp);
            *y += chirp * (TAU * (150e3 + 0.55e9 * t) * t + 0.3).cos();
            *y *= 1.0 + 0.0035 * self.of(Effect::Mixer) * (TAU * 29e3 * t + 1.9).cos();
            *y *= 1.0 + 0.004 * self.of(Effect::Interleaving) * if k % 2 == 0 { 1.0 } else { -1.0 };
            let odd = at.number % 97 == 5 && (n / 2..n / 2 + 4).contains(&k);
            *y += if odd { 6.0 * self.of(Effect::Pulses) } else { 0.0 };
        }
        let lost = (0.1 * self.of(Effect::HeldSample)).min(1.0);
        (16..n).step_by(16).for_each(|k| y[k] += lost * (y[k - 1] - y[k]));
    }

    /// What the sensor makes of `plain`, of which other effects made `y`.
    fn senses_otherwise(&self, y: f64, plain: f64) -> f64 {
        let of = |effect: Effect, size: f64| size * self.of(effect);
        let deaf = of(Effect::DeadZone, 0.15);
        let crossover = of(Effect::Crossover, 1.0).sqrt();
        let soft = 2.2e-3 * self.of(Effect::SoftSensor).sqrt();
        let mut y = y - plain.clamp(-deaf, deaf);
        if crossover > 0.0 {
            y -= plain * (-plain.abs() / crossover).exp();
        }
        if soft > 0.0 { (soft * y).tanh() / soft } else { y }
    }

    /// Correlation of the noise, and the growth of its variance up to 100 counts.
    pub fn noise(&self) -> [f64; 2] {
        let rho = (0.03 * self.of(Effect::CorrelatedNoise)).min(0.9);
        [rho, 0.2 * self.of(Effect::HeteroscedasticNoise)]
    }

    /// Share of the noise's variance that is not white. Of that part neighbours are correlated by `rho`, of all
    /// noise as of an autoregression of the same strength.
    fn coloured(&self, effect: Effect, rho: f64) -> f64 {
        (0.03 * self.of(effect) / rho).min(0.98)
    }

    /// What becomes of one signal's `white` noise. `slowness`: uniform, one of a recording.
    pub fn stray(&self, white: &mut [f64], slowness: f64, rng: &mut ChaCha8Rng) {
        // a level lasts for 4 to 40 samples in the mean
        let leaves = 0.25 * 10f64.powf(-slowness);
        let trap = self.coloured(Effect::TelegraphNoise, 1.0 - 2.0 * leaves);
        let pink = self.coloured(Effect::PinkNoise, 0.8);
        if trap == 0.0 && pink == 0.0 {
            return;
        }
        let mut level = if rng.random::<bool>() { 1.0 } else { -1.0 };
        // sixteen waves an octave, down to a fiftieth of a turn in a signal
        let octaves = (25.0 * white.len() as f64).log2();
        let waves: Vec<[f64; 2]> = (0..(16.0 * octaves) as i32)
            .map(|wave| [PI * 2f64.powf(-f64::from(wave) / 16.0), TAU * rng.random::<f64>()])
            .collect();
        let size = (2.0 / waves.len() as f64).sqrt();
        for (k, e) in white.iter_mut().enumerate() {
            let all = waves.iter().map(|[omega, phase]| (omega * k as f64 + phase).cos());
            *e *= (1.0 - trap - pink).sqrt();
            *e += trap.sqrt() * level + pink.sqrt() * size * all.sum::<f64>();
            level *= if rng.random::<f64>() < leaves { -1.0 } else { 1.0 };
        }
    }

    /// What the converter makes of a sample.
    pub fn code(&self, y: f64) -> f64 {
        let mut code = y;
        if self.effect == Effect::CoarseLsb {
            let step = 1.0 + self.strength.min(6.0);
            code = ((y - 1.0) / step).round() * step + 1.0;
        }
        if self.effect == Effect::Clipping {
            code = code.min(92.0 - 2.0 * self.strength); // the largest peaks are of 85 to 95
        }
        let whole = code.round();
        match (self.effect, whole.rem_euclid(16.0) as u8) {
            (Effect::MissingCodes, 3) => whole - 1.0,
            (Effect::MissingCodes, 4) => whole + 1.0,
            _ => whole,
        }
    }
}
