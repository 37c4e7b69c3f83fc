//! Simulates one channel's signal by thesis (2-2). In: the channel's rates (with temperature and faults
//! already in them), its gain and the drive level. Out: one signal of int16 counts.
//!
//! The steps ([`Sensor::sense`]): the actuation pulse, acting through the channel's own rates, gives the
//! acquisition state x_a; scatter from burst to burst ("shot") multiplies the gain and each component of x_a;
//! the free decay from x_a is sampled and scaled to counts; white noise is added; the sum is rounded.

use super::draws::{Purpose, about_one, stream};
use super::scenario::{Acquisition, Physics, Shot, Spread};
use super::simulated::digitise;
use inkling_core::model::InkChannel;
use inkling_core::model::ring_down::ring_down_into;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// The temperature at which a channel has the scenario's rates, °C.
pub const NOMINAL_TEMPERATURE_C: f64 = 25.0;
/// The drive level at which the nominal channel peaks at the scenario's `largest_healthy_counts`, V.
pub const NOMINAL_DRIVE_V: f64 = 30.0;

/// A channel as it was made: its rates at 25 °C without a fault, and its gain.
#[derive(Clone, Copy, Debug)]
pub struct Channel {
    pub rates: InkChannel,
    /// Gain relative to the nominal channel's.
    pub gain: f64,
}

impl Channel {
    /// Draws a healthy channel, with every rate and the gain uniform about nominal.
    pub fn draw(physics: &Physics, rng: &mut ChaCha8Rng) -> Channel {
        Channel::about(&physics.channel, &physics.spread, rng)
    }

    /// Draws a channel about these rates and a gain of 1.
    pub fn about(nominal: &InkChannel, spread: &Spread, rng: &mut ChaCha8Rng) -> Channel {
        let mut within = |half_width: f64| about_one(half_width, rng);
        Channel {
            rates: nominal.times([spread.a, spread.b, spread.g, spread.d].map(&mut within)),
            gain: within(spread.gain),
        }
    }
}

/// The rates after the viscosity was multiplied by a factor, and both resistances with it.
pub fn at_viscosity(rates: &InkChannel, factor: f64) -> InkChannel {
    InkChannel { g_per_s: rates.g_per_s * factor, d_per_s: rates.d_per_s * factor, ..*rates }
}

/// What turns rates into signals in one part of a scenario (a set, or a printhead of a run).
pub struct Sensor {
    acquisition: Acquisition,
    /// Factor from the model's flow to counts, such that the nominal channel has the scenario's peak.
    counts_per_flow: f64,
    /// How signals differ from burst to burst, and the random stream of that.
    shot: Shot,
    shots: ChaCha8Rng,
    noise: ChaCha8Rng,
    /// The decay without noise, N samples; kept so that its memory is used again.
    decay: Vec<f64>,
}

impl Sensor {
    /// The sensor of part `part` (see `draws::part`) of a scenario.
    pub fn new(physics: &Physics, seed: u64, part: u32) -> Sensor {
        let acquisition = &physics.acquisition;
        let mut sensor = Sensor {
            acquisition: acquisition.clone(),
            counts_per_flow: 1.0,
            shot: physics.shot.clone(),
            shots: stream(seed, Purpose::Shot, part),
            noise: stream(seed, Purpose::Noise, part),
            decay: vec![0.0; acquisition.samples],
        };
        // find the scale at which the nominal channel at nominal drive peaks at the scenario's largest counts
        let nominal = physics.channel;
        let x_a = acquisition.actuation().acquisition_state(&nominal, NOMINAL_DRIVE_V);
        ring_down_into(&nominal, &x_a, acquisition.sample_period_s(), &mut sensor.decay);
        let largest = sensor.decay.iter().fold(0.0_f64, |m, y| m.max(y.abs()));
        // checked: the pulse moves ink, so `largest` is 0 only by underflow, and then all signals are silent
        if largest > 0.0 {
            sensor.counts_per_flow = acquisition.largest_healthy_counts / largest;
        }
        sensor
    }

    /// Appends one signal of a channel with these rates and relative gain to `counts`. `drive_v`: drive level,
    /// V.
    pub fn sense(&mut self, rates: &InkChannel, gain: f64, drive_v: f64, counts: &mut Vec<i16>) {
        let mut shot = |sd: f64| 1.0 + sd * self.shots.sample::<f64, _>(StandardNormal);
        let gain = gain * self.counts_per_flow * shot(self.shot.gain);
        let x_a = self.acquisition.actuation().acquisition_state(rates, drive_v);
        let x_a = x_a.map(|x| x * gain * shot(self.shot.state));
        ring_down_into(rates, &x_a, self.acquisition.sample_period_s(), &mut self.decay);
        // white noise, then rounding
        let (noise, sd) = (&mut self.noise, self.acquisition.noise_sd_counts);
        counts.extend(self.decay.iter().map(|y| {
            let white: f64 = noise.sample(StandardNormal);
            digitise(y + sd * white)
        }));
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{PHYSICS, physics};
    use super::*;

    #[test]
    fn healthy_channels_fill_their_spread_and_stay_within() {
        let physics = physics(PHYSICS);
        let mut rng = stream(1, Purpose::Spread, 0);
        let (nominal, spread) = (physics.channel, &physics.spread);
        let mut extremes = [[f64::INFINITY, f64::NEG_INFINITY]; 5];
        for _ in 0..4000 {
            let Channel { rates, gain } = Channel::draw(&physics, &mut rng);
            let relative = [
                (rates.a_per_s2 / nominal.a_per_s2 - 1.0) / spread.a,
                (rates.b_per_s2 / nominal.b_per_s2 - 1.0) / spread.b,
                (rates.g_per_s / nominal.g_per_s - 1.0) / spread.g,
                (rates.d_per_s / nominal.d_per_s - 1.0) / spread.d,
                (gain - 1.0) / spread.gain,
            ];
            for (extreme, x) in extremes.iter_mut().zip(relative) {
                *extreme = [extreme[0].min(x), extreme[1].max(x)];
            }
        }
        for [low, high] in extremes {
            assert!((-1.0 - 1e-9..-0.99).contains(&low) && (0.99..1.0 + 1e-9).contains(&high));
        }
    }

    #[test]
    fn noise_about_the_decay_is_white_rounding_and_shot() {
        let physics = physics(PHYSICS);
        let mut sensor = Sensor::new(&physics, 1, 0);
        let (mut counts, signals, n) = (Vec::new(), 4000, physics.acquisition.samples);
        for _ in 0..signals {
            sensor.sense(&physics.channel, 1.0, 30.0, &mut counts);
        }
        let column = |k: usize| -> (f64, f64) {
            let y = || counts.iter().skip(k).step_by(n).map(|c| f64::from(*c));
            let mean = y().sum::<f64>() / f64::from(signals);
            (mean, (y().map(|y| (y - mean).powi(2)).sum::<f64>() / f64::from(signals)).sqrt())
        };
        // in late samples the decay is nearly over: what is left is white noise and rounding
        let quiet = (17.6_f64.powi(2) + 1.0 / 12.0).sqrt();
        for k in 100..n {
            assert!((column(k).1 / quiet - 1.0).abs() < 0.06, "{k} {:?}", column(k));
        }
        // the largest sample is 400 counts on average, its shot noise at least that of the gain
        let largest = (0..n).map(column).max_by(|x, y| x.0.abs().total_cmp(&y.0.abs())).unwrap();
        assert!((largest.0.abs() - 400.0).abs() < 3.0 * 0.3 + 0.3, "{largest:?}");
        assert!(largest.1 > quiet && largest.1 < quiet * 1.05, "{largest:?}");
    }
}
