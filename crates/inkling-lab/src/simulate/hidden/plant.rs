//! Simulates a channel whose equation of motion has more terms than thesis (2-2). In: an [`Equation`] (rates
//! and extra terms), a pulse. Out: samples without noise, counts.
//!
//! The state is (V_r, V_n, q_r, q_n), the displaced volumes and the flows of restrictor and nozzle. With the
//! volume V = V_r + V_n - displaced:
//!
//! ```text
//! V_r' = q_r,  V_n' = q_n
//! q_r' = -a p - g q_r,                                          p = V (1 + cubic V²)
//! q_n' = -b (p + meniscus V_n) - loss(q_n)
//! loss = d (1 - half_order) q + half-order part + drag |q| q + friction q/sqrt(q² + small²)
//! ```
//!
//! The half-order part is half_order d sqrt(2/omega0) D^{1/2} q, where D^{1/2} is a sum of relaxations
//! ([`Equation::advance`] carries their memory along). All is integrated by Runge-Kutta of fourth order; the
//! library's own models use matrix exponentials and closed forms instead, so that the critique is tested by
//! other code. Volumes are in counts·s, flows in counts: the output of a state is q_r + q_n.

use inkling_core::model::InkChannel;

/// Steps of the integrator per sample period: the error of a whole decay is below 1e-6 of its peak.
const STEPS_PER_SAMPLE: f64 = 8.0;
/// Relaxation rates of the half-order derivative: range, 1/s, and number, evenly spaced in the logarithm.
const RELAXATIONS: ([f64; 2], usize) = ([1e2, 1.2e7], 28);
/// Flow within which dry friction changes its sign smoothly, counts.
const STICTION_COUNTS: f64 = 0.02;

/// The equation of motion: the rates of thesis (2-2), and the terms that the thesis leaves out (0: absent).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Equation {
    pub rates: InkChannel,
    /// B_t/B_m, by which surface tension pulls the nozzle's volume back.
    pub meniscus: f64,
    /// Nozzle loss that grows with the square of the flow, 1/s per count.
    pub drag_per_s_count: f64,
    /// Nozzle loss that does not depend on the flow's magnitude, counts/s.
    pub friction_counts_per_s: f64,
    /// k3, 1/(counts·s)²: the chamber's pressure is V (1 + k3 V²)/B_t.
    pub cubic: f64,
    /// Share of the nozzle's loss that is a half-order derivative, with the same part in phase at the angular
    /// frequency `half_order_rad_s`.
    pub half_order: f64,
    pub half_order_rad_s: f64,
}

#[derive(Clone, Debug)]
pub struct State {
    /// V_r, V_n (counts·s), q_r, q_n (counts).
    pub x: [f64; 4],
    /// Memory z of each relaxation of the half-order loss, counts·s; empty where there is no such loss.
    memory: Vec<f64>,
}

impl Equation {
    /// The state of a channel that nothing has moved yet.
    pub fn at_rest(&self) -> State {
        let memory = if self.half_order == 0.0 { Vec::new() } else { vec![0.0; RELAXATIONS.1] };
        State { x: [0.0; 4], memory }
    }

    /// Writes the time derivative of (x, memory), which is the vector `x` here, to `rate` (equations in the
    /// file's doc). `displaced`: volume that the actuator displaces, counts·s.
    fn rate(&self, x: &[f64], displaced: f64, rate: &mut [f64]) {
        let volume = x[0] + x[1] - displaced;
        let pressure = volume * (1.0 + self.cubic * volume * volume);
        let [a, b, g, d] = self.rates.rates();
        let q = x[3];
        let mut loss = d * (1.0 - self.half_order) * q
            + self.drag_per_s_count * q.abs() * q
            + self.friction_counts_per_s * q / q.hypot(STICTION_COUNTS);
        if self.half_order != 0.0 {
            // s^{1/2} = s/pi int_0^inf x^{-1/2}/(s + x) dx. With x = e^u: D^{1/2} q = sum x^{1/2} du/pi (q - x
            // z_x), where z_x' = q - x z_x is the memory of the relaxation of rate x.
            let ([low, high], n) = RELAXATIONS;
            let step = (high / low).ln() / (n - 1) as f64;
            // Re (j omega)^{1/2} = (omega/2)^{1/2}: the loss at the resonance stays what it was
            let scale = self.half_order * d / (self.half_order_rad_s / 2.0).sqrt();
            let mut derivative = 0.0;
            let mut relaxation = low;
            let ratio = step.exp();
            for i in 0..n {
                let change = q - relaxation * x[4 + i];
                rate[4 + i] = change;
                derivative += relaxation.sqrt() * step / std::f64::consts::PI * change;
                relaxation *= ratio;
            }
            loss += scale * derivative;
        }
        rate[0] = x[2];
        rate[1] = x[3];
        rate[2] = -a * pressure - g * x[2];
        rate[3] = -b * (pressure + self.meniscus * x[1]) - loss;
    }

    /// Integrates over `duration_s` (0: nothing), in equal steps of at most `step_s`.
    pub fn advance(&self, state: &mut State, displaced: f64, duration_s: f64, step_s: f64) {
        if duration_s.is_nan() || duration_s <= 0.0 {
            return;
        }
        let steps = (duration_s / step_s - 1e-9).ceil().max(1.0);
        let h = duration_s / steps;
        let n = 4 + state.memory.len();
        let mut y: Vec<f64> = state.x.iter().chain(&state.memory).copied().collect();
        let mut k = [vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; n]];
        let mut at = vec![0.0; n];
        for _ in 0..steps as usize {
            let [k1, k2, k3, k4] = &mut k;
            self.rate(&y, displaced, k1);
            (0..n).for_each(|i| at[i] = y[i] + h / 2.0 * k1[i]);
            self.rate(&at, displaced, k2);
            (0..n).for_each(|i| at[i] = y[i] + h / 2.0 * k2[i]);
            self.rate(&at, displaced, k3);
            (0..n).for_each(|i| at[i] = y[i] + h * k3[i]);
            self.rate(&at, displaced, k4);
            (0..n).for_each(|i| y[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
        }
        state.x.copy_from_slice(&y[..4]);
        state.memory.copy_from_slice(&y[4..]);
    }

    /// The output (counts) at `n` times of the free decay from `state` on, one every `period_s`; the first one
    /// is the state's own.
    pub fn sample(&self, state: State, period_s: f64, n: usize) -> Vec<f64> {
        self.course(state, period_s, n, |state| state.x[2] + state.x[3])
    }

    /// What `of` makes of the states at the same times.
    pub fn course(
        &self,
        mut state: State,
        period_s: f64,
        n: usize,
        of: fn(&State) -> f64,
    ) -> Vec<f64> {
        let at = |k| {
            let duration_s = if k > 0 { period_s } else { 0.0 };
            self.advance(&mut state, 0.0, duration_s, period_s / STEPS_PER_SAMPLE);
            of(&state)
        };
        (0..n).map(at).collect()
    }

    /// The state after a rectangular pulse of length `pulse_s` and a wait of `wait_s`, from rest. `displaced`:
    /// volume that the pulse displaces, counts·s; `period_s`: sampling period.
    pub fn rung(&self, displaced: f64, pulse_s: f64, wait_s: f64, period_s: f64) -> State {
        let mut state = self.at_rest();
        self.advance(&mut state, displaced, pulse_s, period_s / STEPS_PER_SAMPLE);
        self.advance(&mut state, 0.0, wait_s, period_s / STEPS_PER_SAMPLE);
        state
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use inkling_core::model::Actuation;
    use inkling_core::model::ring_down::ring_down_into;

    const DT: f64 = 0.78125e-6;

    fn nominal() -> Equation {
        let rates = InkChannel::of([5.6e10, 1.11e11, 1.6e4, 8e4]);
        Equation { rates, ..Equation::default() }
    }

    fn decay(equation: &Equation, displaced: f64) -> Vec<f64> {
        equation.sample(equation.rung(displaced, 9e-6, 6e-6, DT), DT, 128)
    }

    fn largest_difference(x: &[f64], y: &[f64]) -> f64 {
        x.iter().zip(y).fold(0.0, |m, (x, y)| m.max((x - y).abs()))
    }

    #[test]
    fn without_extra_terms_it_is_the_librarys_linear_channel() {
        let channel = InkChannel::NOMINAL;
        let x_a = Actuation::pulse(9e-6, 6e-6).acquisition_state(&channel, 3e-4);
        let mut linear = vec![0.0; 128];
        ring_down_into(&channel, &x_a, DT, &mut linear);
        let own = decay(&nominal(), 3e-4);
        let largest = own.iter().fold(0.0_f64, |m, y| m.max(y.abs()));
        assert!(largest > 10.0 && largest_difference(&linear, &own) < 2e-5 * largest);
    }

    #[test]
    fn extra_terms_act_as_their_physics_says() {
        let crossings = |y: &[f64]| -> f64 {
            let at = |k: usize| k as f64 + y[k] / (y[k] - y[k + 1]);
            let mut zeros = (0..100).filter(|&k| y[k] * y[k + 1] < 0.0).map(at);
            let (first, rest) = (zeros.next().unwrap(), zeros.collect::<Vec<_>>());
            (rest[7] - first) / 8.0
        };
        let energy = |y: &[f64]| y[40..].iter().map(|y| y * y).sum::<f64>();
        let plain = decay(&nominal(), 3e-4);
        let with = |change: fn(&mut Equation)| {
            let mut equation = nominal();
            change(&mut equation);
            decay(&equation, 3e-4)
        };
        assert!(crossings(&with(|e| e.cubic = 1e6)) < crossings(&plain), "stiffer rings faster");
        assert!(energy(&with(|e| e.drag_per_s_count = 100.0)) < 0.9 * energy(&plain));
        assert!(energy(&with(|e| e.friction_counts_per_s = 2e5)) < 0.9 * energy(&plain));
        // the nozzle's volume is pulled back: the pole at 0 becomes a slow motion
        assert!(largest_difference(&with(|e| e.meniscus = 0.05), &plain) > 1e-3);
    }

    #[test]
    fn the_half_order_loss_is_the_half_order_derivative() {
        // with memory driven by q = cos wt from rest, the sum of w (q - x z) tends to (w)^{1/2} cos(wt + 45
        // deg)
        let w = 2.0 * std::f64::consts::PI * 64.7e3;
        let ([low, high], n) = RELAXATIONS;
        let step = (high / low).ln() / (n - 1) as f64;
        let (mut re, mut im) = (0.0, 0.0);
        for i in 0..n {
            let x = low * (step * i as f64).exp();
            // q - x z, with z = q/(jw + x), is jw/(jw + x) q
            let weight = x.sqrt() * step / std::f64::consts::PI / (w * w + x * x);
            re += weight * w * w;
            im += weight * w * x;
        }
        let expected = (w / 2.0).sqrt();
        assert!((re / expected - 1.0).abs() < 0.05, "{re} {expected}");
        assert!((im / expected - 1.0).abs() < 0.15, "{im} {expected}");
    }
}
