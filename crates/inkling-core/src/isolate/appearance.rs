//! A description of a flagged signal that is of no known class, for a technician: mostly there is a
//! fault of the measurement (cable, amplifier) and not of the nozzle.
//!
//! In: the signal, the healthy one, and the signal's misfit beside its ring. Out: [`Appearance`],
//! by a chain of tests of which the first that fits wins; their bounds are heuristic:
//!
//! 1. hardly more than noise about its mean: the healthy ring in another unit, a constant, or noise alone;
//! 2. the healthy signal, with all that it holds beside its ring, of another gain;
//! 3. the ring leaves little more than noise: another ring;
//! 4. few samples hold most of the misfit: jumps;
//! 5. one spectral line holds most of the misfit: a slow change, else a tone;
//! 6. else something else.

use crate::model::inner_product::dot;
use crate::model::simd_math::sin_cos;
use crate::numbers::LITTLE;
use crate::processor::for_processor;
use crate::verdict::Appearance;

#[derive(Clone, Copy, Debug)]
pub struct UnknownSignal<'a> {
    /// N, counts, per unit drive, as is `healthy`.
    pub signal: &'a [f64],
    /// Standard deviation of one sample's noise in `signal`, counts.
    pub noise: f64,
    pub healthy: &'a [f64],
    /// Beside the ring, N, in standard deviations of the noise; without a ring the whole signal.
    pub misfit: &'a [f64],
    pub dt_s: f64,
}

impl UnknownSignal<'_> {
    /// The signal has at least 2 samples.
    pub fn appearance(&self) -> Appearance {
        let n = self.signal.len() as f64;
        let mean = self.signal.iter().sum::<f64>() / n;
        // below twice the square sum of noise; a mean six standard errors off 0 makes it a constant
        let about: f64 = self.signal.iter().map(|y| (y - mean).powi(2)).sum::<f64>();
        if about < 2.0 * n * self.noise * self.noise {
            return self.of_hardly_more_than_noise(mean);
        }

        if let Some(gain) = self.other_gain() {
            return Appearance::OtherGain(gain);
        }

        // square sum of the misfit beyond the noise's, in noise variances
        let beyond = dot(self.misfit, self.misfit) - n;
        if beyond < n {
            return Appearance::OtherRing;
        }

        let mut squares: Vec<f64> = self.misfit.iter().map(|v| v * v).collect();
        let few = (squares.len() / 32).max(2).min(squares.len() - 1);
        squares.select_nth_unstable_by(few, |p, q| q.total_cmp(p));
        if squares[..few].iter().sum::<f64>() > MOST * beyond {
            return Appearance::Jumps;
        }

        let Some((share, cycles)) = self.line() else { return Appearance::Other };
        match share > MOST * beyond {
            true if cycles < 2.0 => Appearance::Slow,
            true => Appearance::Tone(cycles / (n * self.dt_s)),
            false => Appearance::Other,
        }
    }

    /// A constant, noise, or the healthy signal so small that it is less than the design's noise, as in another unit.
    fn of_hardly_more_than_noise(&self, mean: f64) -> Appearance {
        let gain = self.gain();
        let left = self.beside(gain);
        if left < LITTLE * self.beside(0.0) && left < (1.0 - MOST) * self.beside(1.0) {
            return Appearance::OtherGain(gain);
        }
        let stands = mean.abs() > 6.0 * self.noise / (self.signal.len() as f64).sqrt();
        if stands { Appearance::Constant } else { Appearance::NoiseAlone }
    }

    /// The gain with which the healthy signal leaves little of this one (negative: upside down), unlike a ring of another
    /// damping or frequency, and explains most of the difference, unlike one whose gain hardly differs.
    fn other_gain(&self) -> Option<f64> {
        let gain = self.gain();
        let of_noise = self.signal.len() as f64 * self.noise * self.noise;
        let [left, own, other] = [gain, 0.0, 1.0].map(|gain| self.beside(gain) - of_noise);
        // a tenth of the signal is a hundredth of its energy; the noise's own energy differs by an eighth or so
        let little = (LITTLE * LITTLE * own).max(0.5 * of_noise);
        (left < little && left < (1.0 - MOST) * other).then_some(gain)
    }

    /// That multiple of the healthy signal which is nearest to this one.
    fn gain(&self) -> f64 {
        dot(self.signal, self.healthy) / dot(self.healthy, self.healthy)
    }

    /// Square sum of what is left of the signal beside so many times the healthy one.
    fn beside(&self, gain: f64) -> f64 {
        self.signal.iter().zip(self.healthy).map(|(y, h)| (y - gain * h).powi(2)).sum()
    }

    /// The spectral line that explains most of the misfit: energy, in noise variances, and cycles
    /// in the signal, a multiple of one half, 511.5 at most. `None`: no misfit.
    fn line(&self) -> Option<(f64, f64)> {
        let lines = self.misfit.len().min(1024);
        let energies =
            (0..lines).step_by(LINES).flat_map(|from| energies_of_lines(self.misfit, from));
        // at frequency 0 there is no sine, so that the formula counts the cosine twice
        let of_line = |(k, energy): (usize, f64)| {
            (if k == 0 { energy / 2.0 } else { energy }, k as f64 / 2.0)
        };
        let of_lines = (0..lines).zip(energies).map(of_line);
        of_lines.reduce(|most, line| if line.0 >= most.0 { line } else { most })
    }
}

/// Share of the misfit's energy beyond the noise that a shape must explain: more than all else.
const MOST: f64 = 0.5;
/// Lines that are computed at once, as each recursion waits for its own last step.
const LINES: usize = 64;

for_processor! {
    /// Energies in `y` of spectral lines with `from`, `from` + 1, .. half cycles in its length
    /// (Goertzel 1958): 2/N |sum of y_i e^(-j w i)|².
    fn energies_of_lines(y: &[f64], from: usize) -> [f64; LINES] { energies_at_once }
}

#[inline(always)] // body of `energies_of_lines`, compiled once per instruction set
fn energies_at_once(y: &[f64], from: usize) -> [f64; LINES] {
    let n = y.len() as f64;
    let twice_cos: [f64; LINES] =
        std::array::from_fn(|k| 2.0 * sin_cos(std::f64::consts::PI * (from + k) as f64 / n).1);
    let (mut last, mut before) = ([0.0; LINES], [0.0; LINES]);
    for v in y {
        for k in 0..LINES {
            let next = v + twice_cos[k] * last[k] - before[k];
            (before[k], last[k]) = (last[k], next);
        }
    }
    let mut energies = [0.0; LINES];
    for k in 0..LINES {
        let square = last[k] * last[k] + before[k] * before[k] - twice_cos[k] * last[k] * before[k];
        energies[k] = 2.0 * square / n;
    }
    energies
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::normal::draws;

    #[test]
    fn energies_of_lines_are_those_of_their_definition() {
        let mut normal = draws(58);
        for n in [37, 128, 1500] {
            let y: Vec<f64> = (0..n).map(|_| normal()).collect();
            for from in [0, 16, n.min(1024)] {
                for (k, energy) in (from..).zip(energies_of_lines(&y, from)) {
                    let angle = |i: usize| std::f64::consts::PI * (k * i) as f64 / n as f64;
                    let along = |wave: fn(f64) -> f64| -> f64 {
                        y.iter().enumerate().map(|(i, v)| v * wave(angle(i))).sum()
                    };
                    let square = along(f64::cos).powi(2) + along(f64::sin).powi(2);
                    assert!((energy - 2.0 * square / n as f64).abs() < 1e-8, "{k} of {n}");
                }
            }
        }
    }

    #[test]
    fn each_kind_has_its_name() {
        let mut normal = draws(8);
        let ring = |size: f64, damping: f64, omega: f64| {
            move |k: usize| size * (-damping * k as f64).exp() * (omega * k as f64).cos()
        };
        let healthy: Vec<f64> = (0..128).map(ring(100.0, 0.02, 0.5)).collect();
        let mut of_ring = |shape: &dyn Fn(f64) -> f64, (size, damping, omega): (f64, f64, f64)| {
            let misfit: Vec<f64> = (0..128).map(|k| normal() + shape(k as f64)).collect();
            let ring = (0..128).map(ring(size, damping, omega));
            let signal: Vec<f64> = misfit.iter().zip(ring).map(|(v, ring)| v + ring).collect();
            let misfit = &misfit;
            UnknownSignal { signal: &signal, noise: 1.0, healthy: &healthy, misfit, dt_s: 1e-6 }
                .appearance()
        };
        // of another frequency, however large, and of three times the damping
        for other in [(90.0, 0.02, 0.7), (30.0, 0.02, 0.7), (300.0, 0.02, 0.7), (100.0, 0.06, 0.5)]
        {
            assert_eq!(of_ring(&|_| 0.0, other), Appearance::OtherRing, "{other:?}");
        }
        let mut of = |shape: &dyn Fn(f64) -> f64, (size, damping): (f64, f64)| {
            of_ring(shape, (size, damping, 0.5))
        };
        let half = (50.0, 0.02);
        assert_eq!(of(&|_| 0.0, (0.0, 0.02)), Appearance::NoiseAlone);
        assert_eq!(of(&|_| 40.0, (0.0, 0.02)), Appearance::Constant);
        // upside down, with an offset that belongs to the healthy signal, too
        let healthy_about: Vec<f64> = healthy.iter().map(|y| y + 30.0).collect();
        let mut noise = draws(9);
        let down: Vec<f64> = healthy_about.iter().map(|y| noise() - y).collect();
        let (signal, healthy_there, misfit) = (&down[..], &healthy_about[..], &[-30.0; 128][..]);
        let wires =
            UnknownSignal { signal, noise: 1.0, healthy: healthy_there, misfit, dt_s: 1e-6 };
        assert!(
            matches!(wires.appearance(), Appearance::OtherGain(gain) if (gain + 1.0).abs() < 0.01)
        );
        // a dead line that stands where healthy signals do is a constant
        let (signal, far): (Vec<f64>, Vec<f64>) =
            healthy.iter().map(|y| (2048.0, y + 2048.0)).unzip();
        let (signal, healthy_there, misfit) = (&signal[..], &far[..], &signal[..]);
        let dead = UnknownSignal { signal, noise: 1.0, healthy: healthy_there, misfit, dt_s: 1e-6 };
        assert_eq!(dead.appearance(), Appearance::Constant);
        // in volts instead of counts: far below the noise that the design knows
        let volts: Vec<f64> = healthy.iter().map(|y| y * 1e-4).collect();
        let (signal, misfit) = (&volts[..], &volts[..]);
        let tiny = UnknownSignal { signal, noise: 1.0, healthy: &healthy, misfit, dt_s: 1e-6 };
        assert!(
            matches!(tiny.appearance(), Appearance::OtherGain(gain) if (gain - 1e-4).abs() < 1e-9)
        );
        let gain = |of: Appearance| match of {
            Appearance::OtherGain(gain) => gain,
            other => panic!("{other:?}"),
        };
        assert!((gain(of(&|_| 0.0, half)) - 0.5).abs() < 0.01);
        assert!((gain(of(&|_| 0.0, (-100.0, 0.02))) + 1.0).abs() < 0.01);
        // the damping differs by four fifths, or by a tenth and the gain by 5 % or by half
        assert_eq!(of(&|_| 0.0, (100.0, 0.036)), Appearance::OtherRing);
        assert_eq!(of(&|_| 0.0, (105.0, 0.022)), Appearance::OtherRing);
        assert!((gain(of(&|_| 0.0, (150.0, 0.022))) - 1.4).abs() < 0.05);
        let odd = |k: f64| if k == 40.0 { 60.0 } else { 0.0 };
        assert_eq!(of(&odd, half), Appearance::Jumps);
        assert_eq!(of(&|_| 5.0, half), Appearance::Slow);
        let tone = of(&|k| 6.0 * (1.3 * k).sin(), half);
        let Appearance::Tone(hz) = tone else { panic!("{tone:?}") };
        assert!((hz / (1.3e6 / std::f64::consts::TAU) - 1.0).abs() < 0.02, "{hz}");
    }
}
