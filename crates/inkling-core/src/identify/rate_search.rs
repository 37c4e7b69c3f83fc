//! The search for the rates whose free decay is nearest to a signal, thesis (3-1).
//!
//! In: a signal (N counts), a guess of the rates, bounds. Out: where a search ended ([`End`]), for
//! `grey_box`, which starts several searches and takes the best end.
//!
//! The cost of the rates is 1/2 ||y - E c||² plus a weak prior, where E is the basis of their
//! decays (N x 3) and c the state y, y', y'' at t_a, which enters linearly and is solved by least
//! squares for each trial of the rates (variable projection, Golub & Pereyra 1973). So the search
//! is over three coordinates theta of the rates only ([`Problem`]). It is Levenberg and Marquardt's,
//! in a box: each iteration takes the step of the damped Gauss-Newton equations, or, where that
//! leaves the bounds, the best step within them, by an interior-point method.

use super::GreyBoxSettings;
use super::cubic::{RATES_PER_US, basis};
use super::identification::Convergence;
use crate::model::InkChannel;
use crate::model::inner_product::dot;
use crate::model::programme::minimise;
use nalgebra::{DVector, Matrix3, MatrixXx3, Vector3};

/// Standard deviation of the prior on ln (a / b) about the guess: a factor e (somewhat arbitrary).
/// An average often does not determine the real pole; without a prior the search would then wander
/// along a flat valley of the cost. Where the data determine it, the prior is negligible.
const PRIOR_SD: f64 = 1.0;

#[derive(Clone, Debug)]
pub(super) struct End {
    /// The rates there, in the coordinates of [`Problem`].
    pub theta: Vector3<f64>,
    /// The cost there, counts².
    pub cost: f64,
    pub convergence: Convergence,
    pub iterations: usize,
}

/// The least-squares problem (3-1) in the coordinates theta = (ln (a + b), ln (a / b), ln d)
/// relative to the guess, with g = kappa d, in which the decay is close to linear: the first moves
/// the frequency, the last the damping, the middle one the real pole. The bounds apply to (ln a, ln
/// b, ln d) each by itself, so theirs is a curved box. Inside, time is in microseconds.
pub(super) struct Problem {
    pub y: DVector<f64>,
    dt_us: f64,
    /// The guess of a + b per µs², a / b, and d per µs.
    guess: [f64; 3],
    kappa: f64,
    lowest: Vector3<f64>,
    highest: Vector3<f64>,
    /// Weight of the prior on ln (a / b): the noise's variance over that of the prior, counts².
    prior: f64,
}

impl Problem {
    /// `y`, counts, with noise of the standard deviation `noise`, counts, per sample.
    pub fn new(y: &[f64], dt_s: f64, noise: f64, settings: &GreyBoxSettings) -> Problem {
        let (factor, bounds) = (settings.bound_factor, settings.bounds);
        let guess = [settings.a_per_s2, settings.b_per_s2, settings.d_per_s];
        let given = [bounds.a_per_s2, bounds.b_per_s2, bounds.d_per_s];
        let bound = |k: usize, end: usize| {
            let by_factor = [1.0 / factor, factor][end];
            given[k].map_or(by_factor, |given: [f64; 2]| given[end] / guess[k]).ln()
        };
        Problem {
            y: DVector::from_row_slice(y),
            dt_us: dt_s * 1e6,
            guess: [(guess[0] + guess[1]) * 1e-12, guess[0] / guess[1], guess[2] * 1e-6],
            kappa: settings.g_per_s / settings.d_per_s,
            lowest: Vector3::from_fn(|k, _| bound(k, 0)),
            highest: Vector3::from_fn(|k, _| bound(k, 1)),
            // thesis (3-1) has no prior
            prior: if settings.plain_mean { 0.0 } else { (noise / PRIOR_SD).powi(2) },
        }
    }

    pub fn held_fixed(&self) -> Vec<String> {
        let kappa = format!("R_r/I_r over R_n/I_n = {:.4} (the guess's)", self.kappa);
        let prior = "a / b: prior of a factor e about the guess's (it weighs only where the real pole is hardly known)";
        let state = "acquisition state along (1, -1, 0, 0) = 0";
        let all = [kappa, prior.into(), state.into()];
        all.into_iter().filter(|what| self.prior > 0.0 || what != prior).collect()
    }

    /// (ln a, ln b, ln d), relative to the guess, from theta.
    fn ln_rates(&self, theta: &Vector3<f64>) -> Vector3<f64> {
        let b = theta[0] - self.sum_over_b(theta[1]);
        Vector3::new(b + theta[1], b, theta[2])
    }

    fn theta_of(&self, ln_rates: &Vector3<f64>) -> Vector3<f64> {
        let ratio = ln_rates[0] - ln_rates[1];
        Vector3::new(ln_rates[1] + self.sum_over_b(ratio), ratio, ln_rates[2])
    }

    /// ln ((a + b) / b) over the guess's, as a function of ln (a / b) over the guess's.
    fn sum_over_b(&self, ln_ratio: f64) -> f64 {
        let guess = self.guess[1];
        ((1.0 + guess * ln_ratio.exp()) / (1.0 + guess)).ln()
    }

    fn slope_of_rates(&self, theta: &Vector3<f64>) -> Matrix3<f64> {
        let ratio = self.guess[1] * theta[1].exp();
        let of_a = ratio / (1.0 + ratio);
        Matrix3::new(1.0, 1.0 - of_a, 0.0, 1.0, -of_a, 0.0, 0.0, 0.0, 1.0)
    }

    /// Moves rates that lie beyond their bounds, or nearer than `near` (a difference of logarithms),
    /// onto the bounds. Rates that lie within stay the same to the last bit.
    fn within(&self, theta: Vector3<f64>, near: f64) -> Vector3<f64> {
        let rates = self.ln_rates(&theta);
        let bounded =
            rates.zip_zip_map(&self.lowest, &self.highest, |rate, low, high| match rate {
                rate if rate > high - near => high,
                rate if rate < low + near => low,
                rate => rate,
            });
        if bounded == rates { theta } else { self.theta_of(&bounded) }
    }

    /// Five of fifteen, by cost: the guess with stiffness and viscosity scaled, within the bounds.
    pub fn starts(&self) -> Vec<Vector3<f64>> {
        let factors = [1.0f64, 0.6, 1.5, 0.35, 2.2].map(|stiffness| {
            [1.0f64, 0.4, 2.2].map(|viscosity| [stiffness.ln(), 0.0, viscosity.ln()])
        });
        let starts = factors.into_iter().flatten().map(|t| self.within(Vector3::from(t), 0.0));

        let cost = |t: &Vector3<f64>| self.project(t).map_or(f64::INFINITY, |p| self.cost(t, &p));
        let mut starts: Vec<_> = starts.map(|t| (cost(&t), t)).collect();
        starts.sort_by(|p, q| p.0.total_cmp(&q.0));
        starts.into_iter().take(5).map(|(_, t)| t).collect()
    }

    pub fn theta(&self, channel: &InkChannel) -> Vector3<f64> {
        let [a, b, _, d] = channel.times(RATES_PER_US).rates();
        let relative = [a + b, a / b, d];
        self.within(Vector3::from_fn(|k, _| (relative[k] / self.guess[k]).ln()), 0.0)
    }

    /// a, b, g, d of theta, in powers of 1/µs.
    fn rates_per_us(&self, theta: &Vector3<f64>) -> [f64; 4] {
        let [sum, ratio, d]: [f64; 3] = std::array::from_fn(|k| self.guess[k] * theta[k].exp());
        let b = sum / (1.0 + ratio);
        [sum - b, b, self.kappa * d, d]
    }

    pub fn channel(&self, theta: &Vector3<f64>) -> InkChannel {
        InkChannel::of(self.rates_per_us(theta)).times([1e12, 1e12, 1e6, 1e6])
    }

    /// E, N x 3: the outputs from unit y, y', y'' at t_a (per µs), by the rates of theta.
    fn basis(&self, theta: &Vector3<f64>) -> MatrixXx3<f64> {
        basis(InkChannel::of(self.rates_per_us(theta)).cubic(), self.dt_us, self.y.len())
    }

    /// The best state for these rates and its misfit. `None`: linearly dependent, or not finite.
    pub fn project(&self, theta: &Vector3<f64>) -> Option<Projection> {
        let (q, r) = thin_qr(self.basis(theta));
        let along = q.tr_mul(&self.y);
        let state = r.solve_upper_triangular(&along)?;
        let misfit = &self.y - &q * along;
        misfit.norm().is_finite().then_some(Projection { state, misfit, q, r })
    }

    /// 1/2 ||misfit||^2 plus the prior's share, counts².
    fn cost(&self, theta: &Vector3<f64>, at: &Projection) -> f64 {
        (at.misfit.norm_squared() + self.prior * theta[1].powi(2)) / 2.0
    }

    /// Gradient and Gauss-Newton matrix of [`Problem::cost`] by theta, the state eliminated.
    ///
    /// The misfit is (1 - q q') y with E = q r. When theta changes, E changes by dE (central
    /// differences), and the misfit by -(1 - q q') dE c - q r^-T dE' misfit. The second term, the
    /// change of the best state, is often left out; it matters along the weakly known real pole.
    fn normal_equations(
        &self,
        theta: &Vector3<f64>,
        at: &Projection,
    ) -> (Vector3<f64>, Matrix3<f64>) {
        let Projection { state, misfit, q, r } = at;
        let columns: [DVector<f64>; 3] = std::array::from_fn(|k| {
            let h = 1e-5;
            let step = Vector3::ith(k, h);
            // Golub and Pereyra's derivative, as q (q' dE c - r^-T dE' misfit) - dE c
            let slope = (self.basis(&(theta + step)) - self.basis(&(theta - step))) / (2.0 * h);
            let de = &slope * state;
            let mut along = q.tr_mul(&de);
            if let Some(of_state) = r.tr_solve_upper_triangular(&slope.tr_mul(misfit)) {
                along -= of_state;
            }
            q * along - de
        });

        let mut gradient = Vector3::from_fn(|k, _| columns[k].dot(misfit));
        let mut gauss_newton = Matrix3::from_fn(|j, k| columns[j].dot(&columns[k]));
        gradient[1] += self.prior * theta[1];
        gauss_newton[(1, 1)] += self.prior;
        (gradient, gauss_newton)
    }

    /// `None`: the search did not end within 200 iterations, or the model could not be evaluated.
    pub fn search(&self, start: Vector3<f64>) -> Option<End> {
        let mut theta = start;
        let mut at = self.project(&theta)?;
        let mut damping = 1e-3;
        for iterations in 1..=200 {
            let cost = self.cost(&theta, &at);
            let (gradient, hessian) = self.normal_equations(&theta, &at);
            let here = theta;
            let end = |convergence| End { theta: here, cost, convergence, iterations };

            // Converged by the gradient: the cosine between the misfit and each free direction; 1e-6
            // is nearer than 1e-5 standard deviations. Without noise rounding is the limit.
            let scale = hessian.diagonal().map(|h| h.sqrt().max(f64::MIN_POSITIVE));
            let slope = self.projected(&theta, &gradient).component_div(&scale).amax();
            if slope <= 1e-6 * at.misfit.norm() + 1e-13 * self.y.norm() {
                return Some(end(Convergence::Gradient));
            }

            // Converged by the gain, the decrease of the cost that the undamped step predicts: 1e-9
            // of the cost is a step of about 1e-4 standard deviations.
            let gain =
                |step: &Vector3<f64>| -gradient.dot(step) - step.dot(&(hessian * step)) / 2.0;
            let ridge = hessian + Matrix3::identity() * (1e-14 * hessian.amax());
            if self.bounded_step(&ridge, &gradient, &theta).is_some_and(|s| gain(&s) <= 1e-9 * cost)
            {
                return Some(end(Convergence::Gain));
            }

            // Raise the damping until a step reduces the cost by a thousandth of what was predicted.
            // One that does nearly all of it lowers the damping, one that does little raises it.
            loop {
                if damping >= 1e12 {
                    return Some(end(Convergence::Step));
                }
                let mut damped = hessian;
                for k in 0..3 {
                    damped[(k, k)] += damping * hessian[(k, k)].max(1e-12 * hessian.amax());
                }

                let step = self.bounded_step(&damped, &gradient, &theta)?;
                if step.amax() <= 1e-11 {
                    return Some(end(Convergence::Step));
                }
                let trial = theta + step;
                let there = self.project(&trial).map(|there| {
                    let gained = cost - self.cost(&trial, &there);
                    (gained / gain(&step).max(f64::MIN_POSITIVE), there)
                });
                let Some((ratio, there)) = there.filter(|(ratio, _)| *ratio > 1e-3) else {
                    damping *= 10.0;
                    continue;
                };
                (theta, at) = (trial, there);
                if ratio > 0.75 {
                    damping = (damping / 10.0).max(1e-14);
                } else if ratio < 0.25 {
                    damping *= 4.0;
                }
                break;
            }
        }
        None
    }

    /// The gradient by theta without its components that push rates against their bounds, by way of
    /// the gradient by (ln a, ln b, ln d), where each bound belongs to one component.
    fn projected(&self, theta: &Vector3<f64>, gradient: &Vector3<f64>) -> Vector3<f64> {
        // a rate within 1e-9 of a bound lies at it
        let (rates, slope) = (self.ln_rates(theta), self.slope_of_rates(theta));
        let is_high = |k: usize| rates[k] >= self.highest[k] - 1e-9;
        let is_low = |k: usize| rates[k] <= self.lowest[k] + 1e-9;
        if !(0..3).any(|k| is_high(k) || is_low(k)) {
            return *gradient;
        }
        let Some(of_rates) = slope.transpose().try_inverse().map(|back| back * gradient) else {
            return *gradient;
        };
        let free = Vector3::from_fn(|k, _| {
            let g = of_rates[k];
            if (is_high(k) && g < 0.0) || (is_low(k) && g > 0.0) { 0.0 } else { g }
        });
        slope.tr_mul(&free)
    }

    /// The step x that minimises 1/2 x'Hx + g'x such that the rates at theta + x are within their
    /// bounds, to first order. `None`: there is none, or it is not finite.
    fn bounded_step(
        &self,
        h: &Matrix3<f64>,
        g: &Vector3<f64>,
        theta: &Vector3<f64>,
    ) -> Option<Vector3<f64>> {
        let inside = |x: &Vector3<f64>| self.within(theta + x, 0.0) == theta + x;
        if let Some(step) = h.cholesky().map(|l| l.solve(&-g)).filter(inside) {
            return Some(step);
        }

        // else a quadratic programme, scaled so that its tolerances mean the same for each signal
        let unit = h.diagonal().map(|v| 1.0 / v.sqrt().max(1e-300));
        let hessian: Vec<Vec<f64>> = (0..3)
            .map(|j| {
                (0..3).map(|k| if j <= k { h[(j, k)] * unit[j] * unit[k] } else { 0.0 }).collect()
            })
            .collect();
        let size = g.component_mul(&unit).amax().max(1e-300);
        let linear: Vec<f64> = (0..3).map(|k| g[k] * unit[k] / size).collect();

        let (rates, slope) = (self.ln_rates(theta), self.slope_of_rates(theta));
        let mut rows = vec![vec![0.0; 3]; 6];
        let mut limits = vec![0.0; 6];
        for k in 0..3 {
            for j in 0..3 {
                rows[k][j] = slope[(k, j)] * unit[j];
                rows[k + 3][j] = -rows[k][j];
            }
            limits[k] = (self.highest[k] - rates[k]) / size;
            limits[k + 3] = (rates[k] - self.lowest[k]) / size;
        }
        let (x, _) = minimise(&hessian, &linear, &rows, &limits)?;

        // an interior-point method ends just inside an active bound
        let end = Vector3::from_fn(|k, _| theta[k] + x[k] * unit[k] * size);
        let step = self.within(end, 1e-6) - theta;
        step.amax().is_finite().then_some(step)
    }

    /// Names of the rates that lie at a bound, as the settings call them.
    pub fn at_bounds(&self, theta: &Vector3<f64>) -> Vec<String> {
        let rates = self.ln_rates(theta);
        let is_at =
            |k: &usize| rates[*k] >= self.highest[*k] - 1e-6 || rates[*k] <= self.lowest[*k] + 1e-6;
        let names = ["a_per_s2", "b_per_s2", "d_per_s"];
        (0..3).filter(is_at).map(|k| names[k].to_owned()).collect()
    }
}

pub(super) struct Projection {
    /// The state c: y, y', y'' at t_a, per µs.
    pub state: Vector3<f64>,
    /// The misfit y - E c, where E is the basis.
    pub misfit: DVector<f64>,
    q: MatrixXx3<f64>,
    r: Matrix3<f64>,
}

/// E = q r of N x 3 columns: Gram and Schmidt's method twice is as orthogonal as Householder's
/// (Giraud, Langou and Rozloznik 2005). Linearly dependent columns give numbers that are not finite.
fn thin_qr(mut q: MatrixXx3<f64>) -> (MatrixXx3<f64>, Matrix3<f64>) {
    let (n, mut r) = (q.nrows(), Matrix3::zeros());
    for k in 0..3 {
        let (before, rest) = q.as_mut_slice().split_at_mut(k * n);
        let column = &mut rest[..n];
        for _ in 0..2 {
            for (j, other) in before.chunks_exact(n).enumerate() {
                let along = dot(other, column);
                r[(j, k)] += along;
                column.iter_mut().zip(other).for_each(|(v, o)| *v -= along * o);
            }
        }
        r[(k, k)] = dot(column, column).sqrt();
        column.iter_mut().for_each(|v| *v /= r[(k, k)]);
    }
    (q, r)
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::cubic::cubic_per_us;
    use super::*;
    use crate::model::ring_down::ring_down;

    pub const DT_S: f64 = 0.78125e-6;
    pub const PLANTED: InkChannel =
        InkChannel { a_per_s2: 6.1e10, b_per_s2: 1.02e11, g_per_s: 1.9e4, d_per_s: 7.1e4 };

    /// The decay of this channel from one and the same state.
    pub fn decay_of(channel: &InkChannel) -> Vec<f64> {
        let x_a = DVector::from_row_slice(&[3e-4, 1e-4, 150.0, 240.0]);
        ring_down(channel, &x_a, DT_S, 128)
    }

    pub fn decay() -> Vec<f64> {
        decay_of(&PLANTED)
    }

    #[test]
    fn rates_and_their_coordinates_are_each_others_inverse_within_the_bounds() {
        let (y, settings) = (decay(), GreyBoxSettings::default());
        let problem = Problem::new(&y, DT_S, 1.0, &settings);
        for theta in [[0.0, 0.0, 0.0], [0.3, -0.2, 0.5], [-1.0, 0.7, -0.4]].map(Vector3::from) {
            let back = problem.theta(&problem.channel(&theta));
            assert!((back - theta).amax() < 1e-12, "{back}");
        }
        let far = InkChannel {
            a_per_s2: 1e3 * settings.a_per_s2,
            b_per_s2: 1e-3 * settings.b_per_s2,
            d_per_s: 1e3 * settings.d_per_s,
            ..PLANTED
        };
        let bounded = problem.ln_rates(&problem.theta(&far));
        assert!((bounded - Vector3::new(1.0, -1.0, 1.0) * 8f64.ln()).amax() < 1e-12, "{bounded}");
        // the slope of rates is their difference quotient
        let (theta, h) = (Vector3::new(0.3, -0.2, 0.5), 1e-6);
        for k in 0..3 {
            let step = Vector3::from_fn(|j, _| if j == k { h } else { 0.0 });
            let slope =
                (problem.ln_rates(&(theta + step)) - problem.ln_rates(&(theta - step))) / (2.0 * h);
            assert!((slope - problem.slope_of_rates(&theta).column(k)).amax() < 1e-8);
        }
    }

    #[test]
    fn a_bound_stops_what_would_go_beyond_it_and_nothing_else() {
        let (y, settings) = (decay(), GreyBoxSettings::default());
        let problem = Problem::new(&y, DT_S, 1.0, &settings);
        let gradient = Vector3::new(1.0, -2.0, 3.0);
        // the cost falls in the direction opposite to the gradient
        assert_eq!(problem.projected(&Vector3::zeros(), &gradient), gradient);
        for sign in [1.0, -1.0] {
            let theta = problem.theta_of(&(Vector3::repeat(sign) * 8f64.ln()));
            let of_rates = |g: &Vector3<f64>| {
                problem.slope_of_rates(&theta).transpose().try_inverse().unwrap() * g
            };
            let (all, free) =
                (of_rates(&gradient), of_rates(&problem.projected(&theta, &gradient)));
            for k in 0..3 {
                let stopped = all[k] * sign < 0.0;
                assert!((free[k] - if stopped { 0.0 } else { all[k] }).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn thin_qr_is_orthonormal_and_gives_the_columns_back() {
        let columns = basis(cubic_per_us(PLANTED.cubic()), 0.78125, 128);
        let (q, r) = thin_qr(columns.clone());
        assert!((q.tr_mul(&q) - Matrix3::identity()).amax() < 1e-14);
        assert!((&q * r - &columns).amax() < 1e-14 * columns.amax());
        assert!(r[(1, 0)] == 0.0 && r[(2, 0)] == 0.0 && r[(2, 1)] == 0.0);
    }

    #[test]
    fn bounded_step_is_the_constrained_minimum() {
        // within so narrow bounds rates are linear
        let settings = GreyBoxSettings { bound_factor: 1.001, ..GreyBoxSettings::default() };
        let problem = Problem::new(&decay(), DT_S, 0.0, &settings);
        let h = Matrix3::new(4.0, 1.0, 0.5, 1.0, 3.0, 0.2, 0.5, 0.2, 2.0);
        let g = Vector3::new(-4e-2, 1e-3, 9e-4);
        let step = problem.bounded_step(&h, &g, &Vector3::zeros()).unwrap();
        let back = problem.slope_of_rates(&step).transpose().try_inverse().unwrap();
        let (slope, rates) = (back * (h * step + g), problem.ln_rates(&step));
        for k in 0..3 {
            let at_bound = (rates[k].abs() - settings.bound_factor.ln()).abs() < 1e-9;
            // KKT: a free direction has no slope, a bounded one pushes against its bound
            assert!(if at_bound { slope[k] * rates[k] <= 0.0 } else { slope[k].abs() < 1e-5 });
        }
        assert!((rates.amax() - settings.bound_factor.ln()).abs() < 1e-9, "the box binds here");
    }
}
