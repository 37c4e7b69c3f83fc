//! The maximum-likelihood ring of one signal: amplitude, damping, frequency, and phase if it is free.
//!
//! In: a signal, the healthy [`Ring`] that it is compared with. Out: [`Features`], log ratios to that
//! ring. Amplitude (and phase) enter linearly and are eliminated (variable projection); a coarse
//! start over damping and frequency is followed by a few damped Gauss-Newton steps. White noise.

use super::ring::Ring;
use nalgebra::{DMatrix, Matrix4, Vector4};

/// ln (A/A0), ln (sigma/sigma0), ln (f/f0), and phi - phi0 (0 where the phase is not free).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Features {
    pub ln_amplitude: f64,
    pub ln_damping: f64,
    pub ln_frequency: f64,
    pub phase_rad: f64,
}

impl Features {
    /// Of the healthy ring itself.
    pub const HEALTHY: Features =
        Features { ln_amplitude: 0.0, ln_damping: 0.0, ln_frequency: 0.0, phase_rad: 0.0 };

    /// ln amplitude, ln damping, ln frequency, phase.
    pub fn coordinates(&self) -> [f64; 4] {
        [self.ln_amplitude, self.ln_damping, self.ln_frequency, self.phase_rad]
    }
}

/// A fit and what it leaves.
#[derive(Clone, Copy, Debug)]
pub struct Fit {
    pub features: Features,
    /// ||y - fit||^2, counts².
    pub misfit: f64,
}

/// Coarse grid, relative to the healthy ring: damping from a thirtieth to five times, frequency from
/// 0.4 to 1.5 times. Steps of 5 % in frequency lie within reach of Gauss-Newton.
const DAMPINGS: [f64; 6] = [0.04, 0.2, 0.5, 1.0, 1.8, 3.2];
const FREQUENCIES: usize = 28;
const FREQUENCY_RANGE: (f64, f64) = (0.40, 1.55);
const STEPS: usize = 4;
/// ln of the largest change of damping and of frequency in one step.
const MOST_DAMPING: f64 = 0.7;
const MOST_FREQUENCY: f64 = 0.06;

/// Fits signals of one sampling; its coarse grid is computed once.
#[derive(Clone, Debug)]
pub struct RingFitter {
    ring: Ring,
    dt_s: f64,
    samples: usize,
    /// Real pole's part of the first column, N.
    real: Vec<f64>,
    grid: Vec<Start>,
}

#[derive(Clone, Debug)]
struct Start {
    damping: f64,
    frequency: f64,
    /// In phase with the healthy ring, and in quadrature, N each.
    columns: [Vec<f64>; 2],
    /// Upper triangle of the inverse of their Gram matrix.
    inverse: [f64; 3],
}

/// Scratch of one worker.
#[derive(Clone, Debug, Default)]
pub struct Columns {
    in_phase: Vec<f64>,
    quadrature: Vec<f64>,
}

impl RingFitter {
    pub fn new(ring: Ring, dt_s: f64, samples: usize) -> RingFitter {
        let real = (0..samples)
            .map(|k| ring.real_share * (-ring.lambda_per_s * k as f64 * dt_s).exp())
            .collect();
        let mut fitter = RingFitter { ring, dt_s, samples, real, grid: Vec::new() };
        let (low, high) = FREQUENCY_RANGE;
        for damping in DAMPINGS {
            for i in 0..FREQUENCIES {
                let share = i as f64 / (FREQUENCIES - 1) as f64;
                let frequency = low * (high / low).powf(share);
                let mut columns = Columns::default();
                fitter.columns(damping, frequency, &mut columns);
                let (p, q) = (columns.in_phase, columns.quadrature);
                let (pp, pq, qq) = (dot(&p, &p), dot(&p, &q), dot(&q, &q));
                let determinant = pp * qq - pq * pq;
                if determinant > 1e-9 * pp * qq {
                    let inverse = [qq / determinant, -pq / determinant, pp / determinant];
                    fitter.grid.push(Start { damping, frequency, columns: [p, q], inverse });
                }
            }
        }
        fitter
    }

    /// In-phase and quadrature columns of a ring with those ratios of damping and frequency, per
    /// unit amplitude; by recurrence, two multiplications a sample.
    fn columns(&self, damping: f64, frequency: f64, out: &mut Columns) {
        let omega = 2.0 * std::f64::consts::PI * self.ring.frequency_hz * frequency;
        let decay = (-self.ring.damping_per_s * damping * self.dt_s).exp();
        let (sin, cos) = (omega * self.dt_s).sin_cos();
        let (c, s) = (decay * cos, decay * sin);
        let (mut im, mut re) = self.ring.phase_rad.sin_cos();
        out.in_phase.clear();
        out.quadrature.clear();
        for k in 0..self.samples {
            out.in_phase.push(re + self.real[k]);
            out.quadrature.push(-im);
            (re, im) = (c * re - s * im, s * re + c * im);
        }
    }

    /// `y`: N, counts. `phase`: free. `None`: the signal is no ring (zero, or not finite).
    pub fn fit(&self, y: &[f64], phase: bool, work: &mut Columns) -> Option<Fit> {
        let yy = dot(y, y);
        if !(yy > 0.0 && yy.is_finite()) {
            return None;
        }
        let (mut best, mut start) = (f64::INFINITY, None);
        for at in &self.grid {
            let (u, v) = (dot(y, &at.columns[0]), dot(y, &at.columns[1]));
            let [i, j, k] = at.inverse;
            let explained = i * u * u + 2.0 * j * u * v + k * v * v;
            if -explained < best {
                best = -explained;
                start = Some(at);
            }
        }
        let start = start?;
        self.refine(y, start.damping, start.frequency, phase, work)
    }

    /// The same from a start that is near already: no coarse search. `y`: N, counts.
    pub fn fit_from(
        &self,
        y: &[f64],
        near: &Features,
        phase: bool,
        work: &mut Columns,
    ) -> Option<Fit> {
        let damping = near.ln_damping.clamp(-3.0, 2.0).exp();
        let frequency = near.ln_frequency.clamp(-0.9, 0.5).exp();
        self.refine(y, damping, frequency, phase, work)
    }

    fn refine(
        &self,
        y: &[f64],
        damping: f64,
        frequency: f64,
        phase: bool,
        work: &mut Columns,
    ) -> Option<Fit> {
        let (mut damping, mut frequency) = (damping, frequency);
        let mut state = self.state(y, damping, frequency, phase, work)?;
        let mut trust = 1.0;
        for _ in 0..STEPS {
            let step = self.step(y, damping, frequency, &state, phase, work)?;
            let mut accepted = false;
            for _ in 0..4 {
                let d = (trust * step.0).clamp(-MOST_DAMPING, MOST_DAMPING);
                let f = (trust * step.1).clamp(-MOST_FREQUENCY, MOST_FREQUENCY);
                let trial = (damping * d.exp(), frequency * f.exp());
                if let Some(next) = self.state(y, trial.0, trial.1, phase, work)
                    && next.misfit <= state.misfit
                {
                    (damping, frequency) = trial;
                    state = next;
                    trust = 1.0;
                    accepted = true;
                    break;
                }
                trust /= 4.0;
            }
            if !accepted || (step.0.abs() < 1e-5 && step.1.abs() < 1e-7) {
                break;
            }
        }
        let amplitude = state.a.hypot(state.b);
        let features = Features {
            ln_amplitude: (amplitude / self.ring.amplitude).ln(),
            ln_damping: damping.ln(),
            ln_frequency: frequency.ln(),
            phase_rad: state.b.atan2(state.a),
        };
        features
            .coordinates()
            .iter()
            .all(|v| v.is_finite())
            .then_some(Fit { features, misfit: state.misfit })
    }

    /// N x 4: dy/d(ln A, ln sigma, ln f, phi) at some features, counts.
    pub fn tangent(&self, at: &Features) -> DMatrix<f64> {
        let (damping, frequency) = (at.ln_damping.exp(), at.ln_frequency.exp());
        let mut work = Columns::default();
        self.columns(damping, frequency, &mut work);
        let amplitude = self.ring.amplitude * at.ln_amplitude.exp();
        let (sin, cos) = at.phase_rad.sin_cos();
        let (a, b) = (amplitude * cos, amplitude * sin);
        let sigma_dt = self.ring.damping_per_s * damping * self.dt_s;
        let omega_dt = 2.0 * std::f64::consts::PI * self.ring.frequency_hz * frequency * self.dt_s;
        let mut tangent = DMatrix::zeros(self.samples, 4);
        for k in 0..self.samples {
            let (p, q, t) = (work.in_phase[k], work.quadrature[k], k as f64);
            let pair = p - self.real[k];
            tangent[(k, 0)] = a * p + b * q;
            tangent[(k, 1)] = -sigma_dt * t * (a * pair + b * q);
            tangent[(k, 2)] = omega_dt * t * (a * q - b * pair);
            tangent[(k, 3)] = a * q - b * p;
        }
        tangent
    }

    /// Features of a small deviation from the healthy ring, to first order: coordinates of what it has
    /// in common with the tangent space. `deviation`: N, counts.
    pub fn features_of(&self, deviation: &[f64]) -> Option<[f64; 4]> {
        let tangent = self.tangent(&Features::HEALTHY);
        let gram = (tangent.transpose() * &tangent).try_inverse()?;
        let x = gram * tangent.transpose() * nalgebra::DVector::from_row_slice(deviation);
        Some(std::array::from_fn(|k| x[k]))
    }

    /// Covariance of the noise of a fit there, 4 x 4; with the phase held, of its first three. `noise`:
    /// of one sample, counts.
    pub fn noise_covariance(&self, at: &Features, phase: bool, noise: f64) -> Option<DMatrix<f64>> {
        let tangent = self.tangent(at);
        let free = if phase { 4 } else { 3 };
        let columns = tangent.columns(0, free);
        Some((columns.transpose() * columns).try_inverse()? * (noise * noise))
    }

    /// Best amplitude (and phase) at a damping and frequency.
    fn state(
        &self,
        y: &[f64],
        damping: f64,
        frequency: f64,
        phase: bool,
        work: &mut Columns,
    ) -> Option<State> {
        self.columns(damping, frequency, work);
        let (p, q) = (&work.in_phase, &work.quadrature);
        let (pp, up) = (dot(p, p), dot(y, p));
        let (a, b) = if phase {
            let (pq, qq, uq) = (dot(p, q), dot(q, q), dot(y, q));
            let determinant = pp * qq - pq * pq;
            ((qq * up - pq * uq) / determinant, (pp * uq - pq * up) / determinant)
        } else {
            (up / pp, 0.0)
        };
        let misfit = y
            .iter()
            .zip(p.iter().zip(q))
            .map(|(y, (p, q))| (y - a * p - b * q).powi(2))
            .sum::<f64>();
        misfit.is_finite().then_some(State { a, b, misfit })
    }

    /// Gauss-Newton step of (ln damping, ln frequency), amplitude (and phase) eliminated.
    fn step(
        &self,
        y: &[f64],
        damping: f64,
        frequency: f64,
        state: &State,
        phase: bool,
        work: &mut Columns,
    ) -> Option<(f64, f64)> {
        self.columns(damping, frequency, work);
        let sigma_dt = self.ring.damping_per_s * damping * self.dt_s;
        let omega_dt = 2.0 * std::f64::consts::PI * self.ring.frequency_hz * frequency * self.dt_s;
        let (mut gram, mut slope) = (Matrix4::zeros(), Vector4::zeros());
        for (k, y) in y.iter().enumerate() {
            let (p, q) = (work.in_phase[k], work.quadrature[k]);
            let pair = p - self.real[k];
            // the ring's own oscillation and its quarter turn
            let ring = state.a * pair + state.b * q;
            let turned = state.a * q - state.b * pair;
            let t = k as f64;
            let columns =
                [p, if phase { q } else { 0.0 }, -sigma_dt * t * ring, omega_dt * t * turned];
            let rest = y - state.a * p - state.b * q;
            for i in 0..4 {
                slope[i] += columns[i] * rest;
                for j in 0..=i {
                    gram[(i, j)] += columns[i] * columns[j];
                }
            }
        }
        if !phase {
            gram[(1, 1)] = 1.0;
        }
        gram.fill_upper_triangle_with_lower_triangle();
        let step = gram.cholesky()?.solve(&slope);
        Some((step[2], step[3]))
    }
}

struct State {
    a: f64,
    b: f64,
    misfit: f64,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::{Distribution, StandardNormal};

    const DT_S: f64 = 0.78125e-6;
    const HEALTHY: Ring = Ring {
        amplitude: 400.0,
        phase_rad: 0.4,
        damping_per_s: 2.9e4,
        frequency_hz: 64_700.0,
        real_share: 0.06,
        lambda_per_s: 3.7e4,
    };

    fn signal(a: f64, damping: f64, frequency: f64, turn: f64) -> Vec<f64> {
        (0..128)
            .map(|k| {
                let t = k as f64 * DT_S;
                let angle = 2.0 * std::f64::consts::PI * HEALTHY.frequency_hz * frequency * t;
                let pair = (-HEALTHY.damping_per_s * damping * t).exp()
                    * (angle + HEALTHY.phase_rad + turn).cos();
                let real = HEALTHY.real_share * (-HEALTHY.lambda_per_s * t).exp() * turn.cos();
                HEALTHY.amplitude * a * (pair + real)
            })
            .collect()
    }

    #[test]
    fn clean_rings_come_back_from_anywhere_in_the_range() {
        let fitter = RingFitter::new(HEALTHY, DT_S, 128);
        let mut work = Columns::default();
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        for _ in 0..500 {
            let (a, d) = (rng.random_range(0.5..1.6), rng.random_range(0.1..3.0));
            let (f, turn) = (rng.random_range(0.45..1.4), rng.random_range(-0.5..0.5));
            let fit = fitter.fit(&signal(a, d, f, turn), true, &mut work).unwrap();
            let x = fit.features;
            assert!((x.ln_frequency - f.ln()).abs() < 1e-4, "{a} {d} {f} {turn}: {x:?}");
            assert!((x.ln_damping - d.ln()).abs() < 5e-3, "{a} {d} {f} {turn}: {x:?}");
            assert!((x.phase_rad - turn).abs() < 1e-3);
        }
    }

    #[test]
    fn fit_is_a_stationary_point_of_the_misfit() {
        let fitter = RingFitter::new(HEALTHY, DT_S, 128);
        let mut work = Columns::default();
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(6);
        for _ in 0..50 {
            let y: Vec<f64> = signal(0.9, 1.5, 0.93, 0.0)
                .iter()
                .map(|v| {
                    let e: f64 = StandardNormal.sample(&mut rng);
                    v + 17.6 * e
                })
                .collect();
            for phase in [false, true] {
                let fit = fitter.fit(&y, phase, &mut work).unwrap();
                let at = |d: f64, f: f64, work: &mut Columns| {
                    let (damping, frequency) =
                        (fit.features.ln_damping + d, fit.features.ln_frequency + f);
                    fitter.state(&y, damping.exp(), frequency.exp(), phase, work).unwrap().misfit
                };
                let here = at(0.0, 0.0, &mut work);
                for (d, f) in [(0.01, 0.0), (-0.01, 0.0), (0.0, 0.001), (0.0, -0.001)] {
                    assert!(at(d, f, &mut work) >= here - 1e-9 * here, "lower beside the fit");
                }
            }
        }
    }

    #[test]
    fn tangent_is_the_slope_of_the_ring() {
        let fitter = RingFitter::new(HEALTHY, DT_S, 128);
        let at =
            Features { ln_amplitude: -0.1, ln_damping: 0.3, ln_frequency: -0.05, phase_rad: 0.0 };
        let ring = |d: [f64; 3]| {
            let x = [at.ln_amplitude + d[0], at.ln_damping + d[1], at.ln_frequency + d[2]];
            signal(x[0].exp(), x[1].exp(), x[2].exp(), 0.0)
        };
        let tangent = fitter.tangent(&at);
        for j in 0..3 {
            let mut d = [0.0; 3];
            d[j] = 1e-5;
            let (up, down) = (ring(d), ring(d.map(|v| -v)));
            for k in 0..128 {
                let slope = (up[k] - down[k]) / 2e-5;
                assert!((tangent[(k, j)] - slope).abs() < 1e-3 + 1e-5 * slope.abs(), "{j} {k}");
            }
        }
    }

    #[test]
    fn nothing_is_no_ring() {
        let fitter = RingFitter::new(HEALTHY, DT_S, 128);
        assert!(fitter.fit(&[0.0; 128], true, &mut Columns::default()).is_none());
        assert!(fitter.fit(&[f64::NAN; 128], true, &mut Columns::default()).is_none());
    }
}
