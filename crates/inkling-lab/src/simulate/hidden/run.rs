//! Simulates a print run with something hidden in it. In: the scenario's healthy run, effects with their
//! sizes, circumstances, a seed. Out: acquisitions of all channels of a printhead, burst by burst (used by
//! `hidden::planted`), and clean signals for any conditions (used to find sizes, in `strength.rs` and
//! `baseline.rs`).
//!
//! [`Base`] holds what is constant in a recording, [`Acquisitions`] the random streams of the run. A signal is
//! made in these steps: draw its conditions; let the scatter and the effects on plant and trigger change the
//! channel's equation; integrate pulse and wait (`plant.rs`); scatter the state; integrate the decay; add the
//! previous ring's tail; let effects on the output change the samples ([`Base::clean`]); add noise; let
//! effects on codes change the samples; round ([`Acquisitions::acquire`]).

use super::effect::{Acts, Conditions, Effect, Samples, stiffen, thin};
use super::plant::{Equation, State};
use crate::score::truth::Circumstance;
use crate::simulate::draws::{Purpose, about_one, part, stream};
use crate::simulate::print_run::{RECORDED_TEMPERATURE_SD_K, draw_level, time_ns};
use crate::simulate::scenario::{HiddenRun, Physics, PrintRun, Recorded, Spread};
use crate::simulate::sensor::{Channel, NOMINAL_DRIVE_V, NOMINAL_TEMPERATURE_C};
use crate::simulate::simulated::{burst_of, digitise};
use inkling_core::burst::Burst;
use inkling_core::model::{InkChannel, faults};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{StandardNormal, StudentT};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Degrees of freedom of the heavy-tailed noise (Student's t).
const TAIL_DOF: f64 = 4.0;
/// Half-widths of a recording's nominal rates and peak about the scenario's, relative.
const BASE_SPREAD: Spread = Spread { a: 0.10, b: 0.10, g: 0.15, d: 0.15, gain: 0.15 };

/// The constants of one channel.
#[derive(Clone, Copy, Debug)]
pub struct RunChannel {
    /// Its rates at 25 °C, with its fault if it has one.
    pub rates: InkChannel,
    pub gain: f64,
    pub faulty: bool,
}

/// What is the same for the whole recording, and known to the simulator alone.
#[derive(Clone)]
pub struct Base {
    pub physics: Arc<Physics>,
    pub run: PrintRun,
    pub hidden: HiddenRun,
    pub circumstances: Vec<Circumstance>,
    pub rates: InkChannel,
    /// Peak of the nominal channel at nominal drive, counts.
    pub peak_counts: f64,
    /// Displaced volume per volt, counts·s.
    displaced_per_v: f64,
    pub heads: Vec<Vec<RunChannel>>,
    seed: u64,
}

impl Base {
    /// Draws the base of a recording: its nominal rates, its peak, and all channels.
    pub fn new(
        physics: &Arc<Physics>,
        run: &PrintRun,
        hidden: &HiddenRun,
        circumstances: &[Circumstance],
        seed: u64,
    ) -> Base {
        let mut rng = stream(seed, Purpose::Hidden, part::HIDDEN);
        let Channel { rates, gain } = Channel::about(&physics.channel, &BASE_SPREAD, &mut rng);
        let mut base = Base {
            physics: physics.clone(),
            run: run.clone(),
            hidden: hidden.clone(),
            circumstances: circumstances.to_vec(),
            rates,
            peak_counts: physics.acquisition.largest_healthy_counts * gain,
            displaced_per_v: 1.0,
            heads: Vec::new(),
            seed,
        };

        // scale the displaced volume such that the nominal channel has this recording's peak
        let unit = base.linear(&rates, NOMINAL_DRIVE_V);
        let largest = unit.iter().fold(0.0_f64, |m, y| m.max(y.abs()));
        base.displaced_per_v = if largest > 0.0 { base.peak_counts / largest } else { 1.0 };
        base.heads = (0..run.printheads).map(|head| base.channels(head as u32)).collect();
        base
    }

    /// Draws one healthy channel's constants about the base.
    pub fn draw(&self, rng: &mut ChaCha8Rng) -> RunChannel {
        let Channel { mut rates, gain } = Channel::about(&self.rates, &self.physics.spread, rng);
        // drawn in any case, so that circumstances do not shift the random numbers; its sd is 1/sqrt(3)
        let scattered = about_one(1.0, rng) - 1.0;
        for circumstance in &self.circumstances {
            if let Circumstance::FrequencyScatter(sd) = circumstance {
                let stiffness = (1.0 + 3.0_f64.sqrt() * sd * scattered).powi(2);
                rates = rates.times([stiffness, stiffness, 1.0, 1.0]);
            }
        }
        RunChannel { rates, gain, faulty: false }
    }

    /// Draws the channels of a printhead, of which 6 % are faulty with [`Circumstance::FaultyChannels`].
    fn channels(&self, head: u32) -> Vec<RunChannel> {
        let mut rng = stream(self.seed, Purpose::Spread, part::HIDDEN + 1 + head);
        let mut channels: Vec<RunChannel> =
            (0..self.run.channels).map(|_| self.draw(&mut rng)).collect();
        let faulty = self.circumstances.contains(&Circumstance::FaultyChannels);
        for made in channels.iter_mut().filter(|_| faulty) {
            let (hit, class) = (rng.random::<f64>() < 0.06, rng.random_range(0..3usize));
            let (class, severity) = [("PBN", 0.25), ("IDN", 1.7), ("AB2", 0.3)][class];
            if hit && let Some(rates) = faults::apply(class, severity, &made.rates) {
                (made.rates, made.faulty) = (rates, true);
            }
        }
        channels
    }

    /// Standard deviations of the seven numbers of [`Conditions::shot`], in their order.
    pub fn shot_sd(&self) -> [f64; 7] {
        let (shot, hidden) = (&self.physics.shot, &self.hidden);
        let wide = |of: &Circumstance| match of {
            Circumstance::BurstScatter(sd) => Some(*sd),
            _ => None,
        };
        let frequency_sd = self.circumstances.iter().find_map(wide).unwrap_or(hidden.frequency_sd);
        let state = shot.state;
        [shot.gain, state, state, state, state, frequency_sd, hidden.damping_sd]
    }

    pub fn dt_s(&self) -> f64 {
        self.physics.acquisition.sample_period_s()
    }

    /// The equation of a healthy channel with the given rates.
    fn equation(&self, rates: &InkChannel) -> Equation {
        let half_order_rad_s = rates.poles().map_or(4e5, |p| TAU * p.frequency_hz);
        Equation { rates: *rates, half_order_rad_s, ..Equation::default() }
    }

    /// The state at t_a, which is later than nominal by `late_s`, after a pulse of `drive_v` volts.
    fn rung(&self, equation: &Equation, drive_v: f64, late_s: f64) -> State {
        let acquisition = &self.physics.acquisition;
        let (pulse_s, wait_s) = (acquisition.pulse_us * 1e-6, acquisition.delay_us * 1e-6);
        // the trigger cannot come before the end of the pulse
        let wait_s = (wait_s + late_s).max(0.0);
        equation.rung(drive_v * self.displaced_per_v, pulse_s, wait_s, self.dt_s())
    }

    /// N samples of a decay by thesis (2-2) alone, without scatter, effects and noise; counts.
    pub fn linear(&self, rates: &InkChannel, drive_v: f64) -> Vec<f64> {
        let equation = self.equation(rates);
        let n = self.physics.acquisition.samples;
        equation.sample(self.rung(&equation, drive_v, 0.0), self.dt_s(), n)
    }

    /// Decays of the nominal channel, each from one component of its acquisition state alone.
    pub fn components(&self, drive_v: f64) -> [Vec<f64>; 4] {
        let equation = self.equation(&self.rates);
        let state = self.rung(&equation, drive_v, 0.0);
        std::array::from_fn(|i| {
            let mut one = equation.at_rest();
            one.x[i] = state.x[i];
            equation.sample(one, self.dt_s(), self.physics.acquisition.samples)
        })
    }

    /// What `of` makes of the states of the nominal channel's decay, N samples.
    pub fn course(&self, drive_v: f64, of: fn(&State) -> f64) -> Vec<f64> {
        let equation = self.equation(&self.rates);
        let n = self.physics.acquisition.samples;
        equation.course(self.rung(&equation, drive_v, 0.0), self.dt_s(), n, of)
    }

    /// Peak of the nominal channel at the highest drive level, counts.
    pub fn largest_counts(&self) -> f64 {
        self.peak_counts * self.drive_range_v()[1] / NOMINAL_DRIVE_V
    }

    pub fn drive_range_v(&self) -> [f64; 2] {
        let levels = self.physics.drive.levels_v.iter().copied();
        [levels.clone().fold(f64::INFINITY, f64::min), levels.fold(0.0, f64::max)]
    }

    /// One signal of a channel with scatter and effects, before noise and codes; N samples, counts.
    pub fn clean(&self, made: &RunChannel, c: &Conditions, effects: &[Effect]) -> Vec<f64> {
        let (n, dt) = (self.physics.acquisition.samples, self.dt_s());
        let mut equation = self.equation(&made.rates);
        // scatter of frequency and damping from burst to burst, then effects on the equation and the trigger
        stiffen(&mut equation, c.shot[5]);
        thin(&mut equation, c.shot[6]);
        let mut late_s = 0.0;
        for effect in effects {
            match effect.acts {
                Acts::Plant(act) => act(effect, c, &mut equation),
                Acts::Trigger => late_s += effect.size * c.trigger,
                _ => {}
            }
        }
        let mut state = self.rung(&equation, c.drive_v, late_s);
        for (x, of_component) in state.x.iter_mut().zip(&c.shot[1..5]) {
            *x *= made.gain * (1.0 + c.shot[0]) * (1.0 + of_component);
        }
        // the decay, and the tail: the same decay as it is after the idle time, times the size of the effect
        let tails = effects.iter().filter(|e| matches!(e.acts, Acts::Tail));
        let tail: f64 = if c.idle_s.is_nan() { 0.0 } else { tails.map(|e| e.size).sum() };
        let mut y = equation.sample(state.clone(), dt, n);
        if tail != 0.0 {
            equation.advance(&mut state, 0.0, c.idle_s, dt / 8.0);
            let later = equation.sample(state, dt, n);
            y.iter_mut().zip(later).for_each(|(y, later)| *y += tail * later);
        }
        for effect in effects {
            if let Acts::Output(act) = effect.acts {
                let peak_counts = self.peak_counts;
                act(effect, c, &mut Samples { y: &mut y, period_s: dt, peak_counts });
            }
        }
        y
    }
}

/// Simulates the acquisitions of a run in order.
pub struct Acquisitions {
    pub base: Base,
    pub effects: Vec<Effect>,
    streams: Vec<Streams>,
}

/// The random streams of one printhead, one for each purpose.
struct Streams {
    /// Drive, phase, idle time, neighbours and trigger.
    conditions: ChaCha8Rng,
    /// The healthy scatter from burst to burst.
    shots: ChaCha8Rng,
    /// The noise, and the error of the recorded temperature.
    noise: ChaCha8Rng,
    phase_rad: f64,
}

impl Acquisitions {
    pub fn new(base: Base, effects: Vec<Effect>) -> Acquisitions {
        let of_head = |head| {
            let of = |purpose| stream(base.seed, purpose, part::HIDDEN + 1 + head);
            Streams {
                conditions: of(Purpose::Drive),
                shots: of(Purpose::Shot),
                noise: of(Purpose::Noise),
                phase_rad: TAU * of(Purpose::Temperature).random::<f64>(),
            }
        };
        let streams = (0..base.run.printheads as u32).map(of_head).collect();
        Acquisitions { streams, base, effects }
    }

    /// Draws the conditions of all channels at burst `step`. Steps must be asked for in order, each once.
    pub fn conditions(&mut self, head: usize, step: usize) -> Vec<Conditions> {
        let (physics, run) = (&self.base.physics, &self.base.run);
        let Streams { conditions: rng, shots, phase_rad, .. } = &mut self.streams[head];
        let last = (run.bursts_per_channel - 1).max(1) as f64;
        let progress = step as f64 / last;

        // course of the temperature from -1 to 1: a sine, or along with time
        let phase = TAU * step as f64 * run.interval_s / physics.temperature.period_s;
        let follows = self.base.circumstances.contains(&Circumstance::TemperatureFollowsTime);
        let course = if follows { 2.0 * progress - 1.0 } else { (phase + *phase_rad).sin() };
        let above_c = physics.temperature.swing_c * course;
        // what all channels of the burst share, then what each has for itself
        let drive_v = draw_level(&physics.drive, rng);
        let phase_rad = TAU * rng.random::<f64>();
        let last_channel = (run.channels - 1).max(1) as f64;
        let shot_sd = self.base.shot_sd();
        let mut all: Vec<Conditions> = (0..run.channels)
            .map(|channel| {
                let idle = &self.base.hidden.idle_times_us;
                // one value more than there are idle times stands for no previous actuation
                let drawn = rng.random_range(0..=idle.len());
                Conditions {
                    progress,
                    position: channel as f64 / last_channel - 0.5,
                    drive_v,
                    above_c,
                    idle_s: idle.get(drawn).map_or(f64::NAN, |us| us * 1e-6),
                    neighbours: rng.random_range(0..=2),
                    trigger: rng.sample(StandardNormal),
                    phase_rad,
                    burst: step,
                    shot: shot_sd.map(|sd| sd * shots.sample::<f64, _>(StandardNormal)),
                }
            })
            .collect();
        // All channels of a burst share the trigger of the first one. The others have drawn one all the same,
        // so that a seed's other random numbers stay what they were in earlier versions.
        let trigger = all.first().map_or(0.0, |c| c.trigger);
        all.iter_mut().for_each(|c| c.trigger = trigger);
        all
    }

    /// Adds noise, lets effects on codes change the samples, and appends them to `counts` as int16. The noise
    /// is AR(1) with correlation rho and unit variance, times its standard deviation, times the root of 1 +
    /// growth (y/largest)².
    fn digitised(&mut self, head: usize, clean: &[f64], counts: &mut Vec<i16>) {
        let (base, rng) = (&self.base, &mut self.streams[head].noise);
        let acts = |wanted: fn(&Acts) -> bool| -> f64 {
            self.effects.iter().filter(|e| wanted(&e.acts)).map(|e| e.size).sum()
        };
        let rho = acts(|a| matches!(a, Acts::Correlation));
        let growth = acts(|a| matches!(a, Acts::NoiseGrowth));
        let heavy = base.circumstances.contains(&Circumstance::HeavyTails);
        // more than 2 degrees of freedom, so that there is a variance
        let student = StudentT::new(TAIL_DOF).ok();
        let student_sd = (TAIL_DOF / (TAIL_DOF - 2.0)).sqrt();
        let sd = base.physics.acquisition.noise_sd_counts;
        let largest = base.largest_counts();
        let mut before: f64 = rng.sample(StandardNormal);
        for y in clean {
            let white: f64 = match (&student, heavy) {
                (Some(student), true) => rng.sample::<f64, _>(student) / student_sd,
                _ => rng.sample(StandardNormal),
            };
            let noise = rho * before + (1.0 - rho * rho).sqrt() * white;
            before = noise;
            let grown = (1.0 + growth * (y / largest).powi(2)).max(0.0).sqrt();
            let mut sample = y + sd * grown * noise;
            for effect in &self.effects {
                if let Acts::Code(act) = effect.acts {
                    sample = act(effect, sample);
                }
            }
            counts.push(digitise(sample));
        }
    }

    /// Simulates the acquisition of a printhead at burst `step`; the steps must be asked for in order, each
    /// once. `start_ns`: time of the first burst.
    pub fn acquire(&mut self, head: usize, step: usize, start_ns: i64) -> Burst {
        let conditions = self.conditions(head, step);
        let n = self.base.physics.acquisition.samples;
        let mut counts = Vec::with_capacity(conditions.len() * n);
        for (c, made) in conditions.iter().zip(self.base.heads[head].clone()) {
            let clean = self.base.clean(&made, c, &self.effects);
            self.digitised(head, &clean, &mut counts);
        }
        let misread: f64 = self.streams[head].noise.sample(StandardNormal);
        let run = &self.base.run;
        let recorded = |what: Recorded| self.base.hidden.recorded.contains(&what);
        let all = |what: Recorded| conditions.iter().filter(move |_| recorded(what));
        let beside = Burst {
            t_acq_ns: time_ns(run, start_ns, step),
            printhead: run.name(head).into(),
            sample_period_s: self.base.dt_s(),
            samples_per_channel: n as u32,
            // temperature and drive are the same for all channels of a burst
            temperature_c: all(Recorded::Temperature)
                .next()
                .map(|c| NOMINAL_TEMPERATURE_C + c.above_c + RECORDED_TEMPERATURE_SD_K * misread),
            drive_voltage_v: all(Recorded::Drive).next().map(|c| c.drive_v),
            idle_time_s: all(Recorded::Idle).map(|c| c.idle_s as f32).collect(),
            neighbours_fired: all(Recorded::Neighbours).map(|c| c.neighbours).collect(),
            ..Burst::default()
        };
        burst_of(beside, &counts)
    }
}
