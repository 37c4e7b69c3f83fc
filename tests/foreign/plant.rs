//! Another printhead's ink channel: thesis (2-2) with whatever bends it, by Runge and Kutta.
//!
//! In: a channel's rates and terms, a kick of the piezo. Out: its state at t_a, and samples from there on.
//! Nothing here is shared with the library: other rates, another integrator, other constants.

/// Rates of thesis (2-2), 1/s² and 1/s: a = 1/(I_r B), b = 1/(I_n B), g = R_r/I_r, d = R_n/I_n.
#[derive(Clone, Copy, Debug)]
pub struct Rates {
    pub a: f64,
    pub b: f64,
    pub g: f64,
    pub d: f64,
}

impl Rates {
    /// With so many times the stiffness and the losses.
    pub fn scaled(self, stiffness: f64, losses: f64) -> Rates {
        let Rates { a, b, g, d } = self;
        Rates { a: a * stiffness, b: b * stiffness, g: g * losses, d: d * losses }
    }
}

/// What bends the linear channel; all zero: nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Terms {
    /// -k |q_n| q_n, 1/(s count).
    pub drag: f64,
    /// -mu sign(q_n), counts/s.
    pub friction: f64,
    /// a and b grow by k3 V², 1/(count s)².
    pub cubic: f64,
    /// Stiffness of the meniscus over that of the chamber.
    pub meniscus: f64,
    /// Stiffness that is added beyond a displacement, relative; the displacement, counts s.
    pub stop: [f64; 2],
    /// Relative change of the losses, and of the stiffness, long after t_a.
    pub settles: [f64; 2],
}

/// Chamber volume (counts·s), flows through restrictor and nozzle (counts), volume at the meniscus (counts·s).
#[derive(Clone, Copy, Debug, Default)]
pub struct State {
    pub v: f64,
    pub q_r: f64,
    pub q_n: f64,
    pub v_n: f64,
}

impl State {
    fn plus(self, h: f64, by: State) -> State {
        State {
            v: self.v + h * by.v,
            q_r: self.q_r + h * by.q_r,
            q_n: self.q_n + h * by.q_n,
            v_n: self.v_n + h * by.v_n,
        }
    }

    /// Multiplies chamber volume and both flows, each by a factor of its own.
    pub fn scale(&mut self, mut factor: impl FnMut() -> f64) {
        for part in [&mut self.v, &mut self.q_r, &mut self.q_n] {
            *part *= factor();
        }
    }

    /// What the piezo senses.
    pub fn seen(self) -> f64 {
        self.q_r + self.q_n
    }
}

/// A channel that rings.
#[derive(Clone, Copy, Debug)]
pub struct Plant {
    pub rates: Rates,
    pub terms: Terms,
}

/// No step is longer, s.
const LONGEST_STEP: f64 = 0.25e-6;
/// In which losses and stiffness settle, s.
const SETTLES: f64 = 35e-6;
/// Below this flow dry friction is smooth, counts.
const SMOOTH: f64 = 0.4;

impl Plant {
    fn slope(&self, x: State) -> State {
        let Rates { a, b, g, d } = self.rates;
        let Terms { drag, friction, cubic, meniscus, stop: [stop, beyond], .. } = self.terms;
        let mut stiffer = 1.0 + cubic * x.v * x.v;
        if x.v > beyond {
            stiffer += stop * (x.v - beyond) / x.v;
        }
        let bent = drag * x.q_n.abs() * x.q_n + friction * (x.q_n / SMOOTH).tanh();
        State {
            v: x.q_r + x.q_n,
            q_r: -a * stiffer * x.v - g * x.q_r,
            q_n: -b * stiffer * x.v - d * x.q_n - bent - b * meniscus * x.v_n,
            v_n: x.q_n,
        }
    }

    /// The state `time` later (or earlier), s.
    pub fn after(&self, mut x: State, time: f64) -> State {
        let steps = (time.abs() / LONGEST_STEP).ceil().max(1.0);
        let h = time / steps;
        for _ in 0..steps as usize {
            let k1 = self.slope(x);
            let k2 = self.slope(x.plus(0.5 * h, k1));
            let k3 = self.slope(x.plus(0.5 * h, k2));
            let k4 = self.slope(x.plus(h, k3));
            x = x.plus(h / 6.0, k1).plus(h / 3.0, k2).plus(h / 3.0, k3).plus(h / 6.0, k4);
        }
        x
    }

    /// `n` samples from a state on.
    pub fn samples(&self, mut x: State, period_s: f64, n: usize) -> Vec<f64> {
        (0..n)
            .map(|k| {
                let y = x.seen();
                x = self.settled((k as f64 + 0.5) * period_s).after(x, period_s);
                y
            })
            .collect()
    }

    /// As it is some time after t_a.
    fn settled(&self, time: f64) -> Plant {
        let share = 1.0 - (-time / SETTLES).exp();
        let [losses, stiffness] = self.terms.settles.map(|change| 1.0 + change * share);
        Plant { rates: self.rates.scaled(stiffness, losses), ..*self }
    }

    /// Angular frequency, rad/s, but for losses.
    pub fn omega(&self) -> f64 {
        (self.rates.a + self.rates.b).sqrt()
    }

    /// Damping of the pair, 1/s, to first order: each flow's loss by its share.
    pub fn sigma(&self) -> f64 {
        let Rates { a, b, g, d } = self.rates;
        0.5 * (a * g + b * d) / (a + b)
    }
}
