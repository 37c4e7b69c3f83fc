//! Simulates decays of a channel with a fault, and fits rings to them as to signals.
//!
//! In: a healthy channel's rates (a, b, g, d) and actuation, the law of a fault, a severity. Out: a
//! [`Point`]: the features of the fitted ring, and their derivatives by each channel's own changes
//! of its rates and gain, and by errors of the parameters that all channels share. The fit's own
//! bias (it holds the healthy real pole) is thus part of a fault curve.

use crate::model::faults::Law;
use crate::model::ring_down::{Poles, ring_down_into};
use crate::model::ring_fit::{Features, FitBuffers, RingFitter};
use crate::model::{Actuation, InkChannel};
use nalgebra::{Matrix4, Matrix4x2, SMatrix, SVector, Vector4};

/// Number of parameters in which channels differ: ln a, ln b, ln g, ln d, ln gain.
pub const CHANGES: usize = 5;
/// A channel's own changes of these; or errors of what all share: ln a, ln b, ln g, ln d, ln pulse.
pub type Changes = SVector<f64, CHANGES>;
pub type Square = SMatrix<f64, CHANGES, CHANGES>;
/// Jacobian of the features with respect to [`Changes`].
pub type Slope = SMatrix<f64, 4, CHANGES>;

#[derive(Clone, Copy, Debug)]
pub struct ActuatedChannel {
    pub channel: InkChannel,
    pub actuation: Actuation,
}

/// Features of the mean channel with a fault of one severity, and their derivatives.
#[derive(Clone, Debug)]
pub struct Point {
    pub place: f64,
    pub mean: Vector4<f64>,
    /// Derivatives by one channel's own [`CHANGES`].
    pub slope: Slope,
    /// Derivatives by errors of the shared parameters. The healthy features do not change with
    /// these errors, since they were measured.
    pub belief_slope: Slope,
    pub noise: Matrix4<f64>,
}

/// An actuation, and the features of the healthy channel after it.
#[derive(Clone, Copy, Debug)]
struct Reference {
    actuation: Actuation,
    origin: Vector4<f64>,
}

#[derive(Clone)]
pub struct FaultSimulator<'a> {
    fitter: &'a RingFitter,
    channel: InkChannel,
    /// Standard deviation of one sample's noise, counts.
    noise: f64,
    /// The actuation with the nominal pulse, with a longer and with a shorter one.
    references: [Reference; 3],
    /// Derivatives of the healthy features by a channel's own changes.
    pub healthy_slope: Slope,
    healthy_poles: Poles,
    /// Buffers: the decay that is fitted, N, and the fitter's own.
    decay: Vec<f64>,
    work: FitBuffers,
}

const STEP: f64 = 0.01;

impl<'a> FaultSimulator<'a> {
    /// `noise`: of one sample, counts. `None`: the healthy channel does not ring.
    pub fn new(fitter: &'a RingFitter, healthy: ActuatedChannel, noise: f64) -> Option<Self> {
        let ActuatedChannel { channel, actuation } = healthy;
        let reference = Reference { actuation, origin: Vector4::zeros() };
        let mut simulator = FaultSimulator {
            fitter,
            channel,
            noise,
            references: [reference; 3],
            healthy_slope: Slope::zeros(),
            healthy_poles: channel.poles()?,
            decay: vec![0.0; fitter.samples],
            work: FitBuffers::default(),
        };
        // each pulse length needs a delay of its own to keep the measured healthy phase
        for (k, by) in [0.0, STEP, -STEP].into_iter().enumerate() {
            let pulse_s = actuation.pulse_s * by.exp();
            simulator.references[k] = simulator.reference(Actuation { pulse_s, ..actuation })?;
        }
        simulator.healthy_slope = simulator.slope(&Some)?.1;
        Some(simulator)
    }

    /// The actuation `set` with the delay that makes the simulated healthy phase the measured one (a
    /// fitted phase of 0), which determines it best; and the healthy features then. The delay
    /// remains as set if it would be negative or shift the phase beyond 1.5 rad.
    fn reference(&mut self, set: Actuation) -> Option<Reference> {
        const MOST_PHASE_RAD: f64 = 1.5;
        let omega = std::f64::consts::TAU * self.healthy_poles.frequency_hz;
        let channel = self.channel;
        let mut actuation = set;
        for _ in 0..4 {
            // a phase that is ahead of the measured one: the acquisition begins too late
            let ahead = self.fit(&channel, &actuation, None)?[3];
            let delay_s = actuation.delay_s - ahead / omega;
            if ahead.abs() > MOST_PHASE_RAD || delay_s < 0.0 {
                actuation = set;
                break;
            }
            actuation.delay_s = delay_s;
        }
        let origin = self.fit(&channel, &actuation, None)?;
        Some(Reference { actuation, origin })
    }

    /// Features fitted, the phase free, to a decay with gain 1, from `near` or by a coarse search.
    fn fit(
        &mut self,
        channel: &InkChannel,
        actuation: &Actuation,
        near: Option<&Vector4<f64>>,
    ) -> Option<Vector4<f64>> {
        let x_a = actuation.acquisition_state(channel, 1.0);
        ring_down_into(channel, &x_a, self.fitter.dt_s, &mut self.decay);
        let fit = match near {
            Some(x) => self.fitter.fit_from(&self.decay, &Features::from(*x), true),
            None => self.fitter.fit(&self.decay, true, &mut self.work),
        };
        Some(fit?.features.coordinates())
    }

    /// Features, as fitted, of the channel after `fault` has changed its rates, and their
    /// derivatives by the channel's own [`CHANGES`] before the fault, by central differences.
    fn slope(
        &mut self,
        fault: &dyn Fn(InkChannel) -> Option<InkChannel>,
    ) -> Option<(Vector4<f64>, Slope)> {
        let (channel, actuation) = (self.channel, self.references[0].actuation);
        let found = self.fit(&fault(channel)?, &actuation, None)?;
        let mut slope = Slope::zeros();
        slope[(0, 4)] = 1.0; // ln gain adds to ln amplitude
        for j in 0..4 {
            let mut moved = |step: f64| {
                let mut by = [1.0; 4];
                by[j] = step.exp();
                self.fit(&fault(channel.times(by))?, &actuation, Some(&found))
            };
            let (up, down) = (moved(STEP)?, moved(-STEP)?);
            slope.set_column(j, &(wrapped(up - down) / (2.0 * STEP)));
        }
        Some((found, slope))
    }

    /// A channel's decay, N, counts, with the gain that gives the healthy channel its measured
    /// amplitude. `None`: it is not finite.
    pub fn decay(&self, channel: &InkChannel) -> Option<Vec<f64>> {
        let Reference { actuation, origin } = self.references[0];
        let x_a = actuation.acquisition_state(channel, (-origin[0]).exp());
        let mut decay = vec![0.0; self.decay.len()];
        ring_down_into(channel, &x_a, self.fitter.dt_s, &mut decay);
        decay.iter().all(|y| y.is_finite()).then_some(decay)
    }

    /// `place`: the severity in the coordinate of [`Law::scale`]. `None`: no ring fits the decay.
    pub fn point(&mut self, law: &Law, place: f64) -> Option<Point> {
        let severity = law.severity_at(place);
        let fault = |channel: InkChannel| law.apply(severity, &channel);
        let (found, slope) = self.slope(&fault)?;
        let faulty = fault(self.channel)?;

        // by ln pulse, relative to the healthy features with the same pulse: these were measured
        let [believed, longer, shorter] = self.references;
        let mut moved =
            |to: Reference| Some(self.fit(&faulty, &to.actuation, Some(&found))? - to.origin);
        let of_pulse = wrapped(moved(longer)? - moved(shorter)?) / (2.0 * STEP);

        // a fault may also change the signal by a factor, which no rate does
        let gain = Vector4::new(law.gain(severity).ln(), 0.0, 0.0, 0.0);
        let mean = wrapped(found + gain - believed.origin);

        // Errors of the believed rates change healthy and faulty features alike, but the healthy
        // ones were measured: only the difference of the derivatives counts. The healthy phase is
        // kept by another delay, 1 / omega times what the error would add to the phase, which turns
        // and damps the faulty ring otherwise than the healthy one: hence the corrections.
        let Poles { damping_per_s, frequency_hz, .. } = self.healthy_poles;
        let omega = std::f64::consts::TAU * frequency_hz;
        let mut belief_slope = slope - self.healthy_slope;
        for j in 0..4 {
            let phase = self.healthy_slope[(3, j)];
            belief_slope[(0, j)] += phase * damping_per_s * mean[1].exp_m1() / omega;
            belief_slope[(3, j)] = slope[(3, j)] - phase * mean[2].exp();
        }
        belief_slope.set_column(4, &of_pulse);
        let noise = self.noise_at(mean)?;
        Some(Point { place, mean, slope, belief_slope, noise })
    }

    /// Covariance of a fit's noise at these features.
    pub fn noise_at(&self, features: Vector4<f64>) -> Option<Matrix4<f64>> {
        self.fitter.noise_covariance(&Features::from(features), self.noise)
    }
}

/// Derivatives by ln stiffness (of a and b alike) and by ln viscosity (of g and d alike).
pub fn of_change(slope: &Slope) -> Matrix4x2<f64> {
    let column = |i: usize, j: usize| slope.column(i) + slope.column(j);
    Matrix4x2::from_columns(&[column(0, 1), column(2, 3)])
}

/// The features with their phase brought to -pi .. pi by whole turns.
pub fn wrapped(mut x: Vector4<f64>) -> Vector4<f64> {
    if x[3].abs() <= std::f64::consts::PI {
        return x;
    }
    x[3] -= std::f64::consts::TAU * (x[3] / std::f64::consts::TAU).round();
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ring::Ring;

    const DT_S: f64 = 0.8e-6;
    const SAMPLES: usize = 120;
    const NOISE: f64 = 12.0;
    const TRUE: ActuatedChannel = ActuatedChannel {
        channel: InkChannel { a_per_s2: 6.0e10, b_per_s2: 1.0e11, g_per_s: 1.7e4, d_per_s: 7.5e4 },
        actuation: Actuation::pulse(8.5e-6, 5e-6),
    };

    /// A fitter about the ring of the true channel, as it would be measured `delay_s` after the pulse.
    fn fitter(delay_s: f64) -> RingFitter {
        let actuation = Actuation { delay_s, ..TRUE.actuation };
        let x = actuation.acquisition_state(&TRUE.channel, 1.0);
        let state = TRUE.channel.output_state(x.into());
        let ring = Ring::new(TRUE.channel.poles().unwrap(), state).unwrap();
        RingFitter::new(ring, DT_S, SAMPLES)
    }

    /// The true channel and actuation, with parameter number `j` (ln a, ln b, ln g, ln d, ln pulse) off by
    /// `by`.
    fn off(j: usize, by: f64) -> ActuatedChannel {
        let mut believed = TRUE;
        let ActuatedChannel { channel: c, actuation } = &mut believed;
        let all = [
            &mut c.a_per_s2,
            &mut c.b_per_s2,
            &mut c.g_per_s,
            &mut c.d_per_s,
            &mut actuation.pulse_s,
        ];
        *all.into_iter().nth(j).unwrap() *= by.exp();
        believed
    }

    #[test]
    fn slopes_by_errors_of_belief_are_those_of_whoever_believes_otherwise() {
        let fitter = fitter(TRUE.actuation.delay_s);
        let mean = |believed: ActuatedChannel, law: &Law, place: f64| {
            let mut simulator = FaultSimulator::new(&fitter, believed, NOISE).unwrap();
            simulator.point(law, place).unwrap()
        };
        for class in crate::fault::CLASSES {
            let law = crate::model::faults::law(class).unwrap();
            let [low, high] = law.range;
            let place = law.scale(low + 0.1 * (high - low));
            let point = mean(TRUE, law, place);
            for j in 0..CHANGES {
                const BY: f64 = 0.004;
                // the derivative as somebody finds it who believes in other parameters
                let [up, down] = [BY, -BY].map(|by| mean(off(j, by), law, place).mean);
                let found = wrapped(up - down) / (2.0 * BY);
                let error = (found - point.belief_slope.column(j)).norm();
                assert!(error < 0.01, "{class} by {j}: {error}");
            }
        }
    }

    #[test]
    fn the_delay_is_as_measured_where_that_can_be_and_else_as_set() {
        let found = |measured_s: f64, set_s: f64| {
            let fitter = fitter(measured_s);
            let actuation = Actuation { delay_s: set_s, ..TRUE.actuation };
            let believed = ActuatedChannel { actuation, ..TRUE };
            let simulator = FaultSimulator::new(&fitter, believed, NOISE).unwrap();
            simulator.references[0].actuation.delay_s
        };
        for (measured_s, set_s) in [(5e-6, 4e-6), (5e-6, 6e-6), (1e-7, 1e-6)] {
            let error_s = found(measured_s, set_s) - measured_s;
            assert!(error_s.abs() < 1e-9, "{measured_s}, set {set_s}: {error_s} off");
        }
        // The delay remains as set where the measured phase would need a negative delay, and where it differs
        // by more than a quarter of a period.
        assert_eq!(found(-1e-6, 1e-7), 1e-7);
        assert_eq!(found(5e-6, 11e-6), 11e-6);
    }
}
