//! Thesis (3-1): the rates of A and the acquisition state whose free decay is nearest to the average.
//!
//! In: the average signal. Out: [`Identification`]. The state enters linearly and is eliminated (variable
//! projection, Golub & Pereyra 1973), so the search is over three log-rates only. It is a bounded
//! Levenberg-Marquardt search, whose box-constrained subproblem is solved by an interior-point method
//! where the free step leaves the box. There are several starts, all inside the bounds.
//!
//! Departs: thesis (3-1) fits all of A and x_a. One decay carries 6 numbers, A and x_a have 8: the ratio g/d
//! (that is A_n/A_r, thesis (2-3), (2-4)) is held at the guess, and the state's component along (1, -1, 0, 0)
//! at 0. The result says what was held.

use super::averaging::{MeanSignal, SignalSet};
use super::cubic::{basis, poles_of};
use super::damped_cosine::damped_cosine;
use super::identification::{Convergence, Scatter};
use super::scatter::scatter;
use super::{GreyBoxSettings, IdentifyError, identifiability};
use crate::model::InkChannel;
use crate::model::inner_product::dot;
use crate::model::programme::minimise;
use nalgebra::{DVector, Matrix3, MatrixXx3, Vector3, matrix};

pub use super::identification::Identification;

/// Smallest number of samples: 6 numbers are fitted, and the misfit needs degrees of freedom.
pub const FEWEST_SAMPLES: usize = 12;
/// A search that ends at a misfit so many times that of the best damped cosine of a coarse grid has not found the
/// ring.
const WORSE: f64 = 1.5;
/// Standard deviation of the prior on ln (a / b) about the guess: a factor e. An average often does not determine the
/// real pole; without a prior the search would then wander along a flat valley of the cost. Where the data
/// determine it, the prior is negligible.
const PRIOR_SD: f64 = 1.0;

/// Solves thesis (3-1). `y`: average signal, counts. `noise`: standard deviation of one sample of `y`, counts
/// (0: it is estimated from the misfit). `near`: a channel to which this one is expected to be close; the
/// search starts elsewhere only if the fit found from there explains too little, or ends at a bound.
pub fn identify(
    y: &[f64],
    dt_s: f64,
    noise: f64,
    settings: &GreyBoxSettings,
    near: Option<&InkChannel>,
) -> Result<Identification, IdentifyError> {
    if y.len() < FEWEST_SAMPLES {
        return Err(IdentifyError::TooFewSamples { samples: y.len(), needed: FEWEST_SAMPLES });
    }
    let scale = damped_cosine(y, dt_s).ok_or(IdentifyError::NoRingDown)?;
    // The yardstick: the cosine has four free numbers and a constant, the model six, so the model should do
    // better.
    let most = WORSE * scale.misfit_rms + noise;
    let settings = settings.at_frequency(scale.frequency_hz);
    if let Some(near) = near
        && let Ok(found) = identify_from(y, dt_s, noise, &settings, Some(near))
        && found.misfit_rms <= most
        && found.at_bounds.is_empty()
    {
        return Ok(found);
    }
    let found = identify_from(y, dt_s, noise, &settings, None)?;
    if found.misfit_rms > most {
        return Err(IdentifyError::WorseThanACosine {
            model: found.misfit_rms,
            cosine: scale.misfit_rms,
            frequency_hz: scale.frequency_hz,
        });
    }
    Ok(found)
}

/// Thesis (3-1), searched from one start if it is given, or from several.
fn identify_from(
    y: &[f64],
    dt_s: f64,
    noise: f64,
    settings: &GreyBoxSettings,
    start: Option<&InkChannel>,
) -> Result<Identification, IdentifyError> {
    let mean = y.iter().sum::<f64>() / y.len() as f64;
    let spread = y.iter().map(|v| (v - mean).powi(2)).sum::<f64>().sqrt();
    if !spread.is_finite() || spread <= f64::MIN_POSITIVE {
        return Err(IdentifyError::NoRingDown);
    }

    let problem = Problem::new(y, dt_s, noise, settings);
    let starts = start.map_or_else(|| problem.starts(), |near| vec![problem.theta(near)]);
    let mut ends: Vec<End> = starts.iter().filter_map(|&start| problem.search(start)).collect();
    ends.sort_by(|p, q| p.cost.total_cmp(&q.cost));
    let best = ends.first().cloned().ok_or_else(|| {
        IdentifyError::NotConverged(format!(
            "{} starts within bound_factor = {} of the guess; give rates of the right order",
            starts.len(),
            settings.bound_factor
        ))
    })?;
    // Ends of equal cost are the same optimum. Relative to ||y||^2 rounding makes costs differ by 1e-16 and
    // less.
    let same =
        |end: &&End| end.cost - best.cost <= 1e-3 * best.cost + 1e-14 * problem.y.norm_squared();
    let agreeing = ends.iter().filter(same).count();

    let channel = problem.channel(&best.theta);
    let cubic = channel.cubic();
    let Projection { state, misfit, .. } =
        problem.project(&best.theta).ok_or(IdentifyError::NoRingDown)?;
    let output_state = [state[0], state[1] * 1e6, state[2] * 1e12];
    Ok(Identification {
        poles: poles_of(cubic)
            .ok_or_else(|| IdentifyError::NotConverged("the fit does not oscillate".into()))?,
        acquisition_state: acquisition_state(&channel, output_state),
        fit_percent: 100.0 * (1.0 - misfit.norm() / spread),
        misfit_rms: misfit.norm() / (y.len() as f64).sqrt(),
        convergence: best.convergence,
        iterations: best.iterations,
        starts_agreeing: agreeing,
        starts: starts.len(),
        uncertainty: identifiability::uncertainty(cubic, &state, dt_s, y.len(), noise, &misfit),
        scatter: Scatter::default(),
        held_fixed: problem.held_fixed(),
        at_bounds: problem.at_bounds(&best.theta),
        not_identifiable: identifiability::in_words(),
        channel,
        cubic,
        output_state,
    })
}

/// Thesis (3-1) for a window: the average is fitted, the curvature that scattering channels leave in it is
/// taken out ([`super::scatter`]), and the rest is fitted again, until the damping no longer changes.
///
/// Departs: the thesis fits the plain average, whose damping is then biased and whose real pole takes up the
/// curvature. With `plain_mean` that is done here, too, as by `--preset thesis`. `near`: as in [`identify`].
pub fn identify_scattered(
    set: &SignalSet,
    mean: &MeanSignal,
    dt_s: f64,
    settings: &GreyBoxSettings,
    near: Option<&InkChannel>,
) -> Result<Identification, IdentifyError> {
    const ROUNDS: usize = 8;
    let mut fit = identify(&mean.y, dt_s, mean.standard_error(), settings, near)?;
    if settings.plain_mean {
        return Ok(fit);
    }
    let settings = &settings.at_frequency(fit.poles.frequency_hz);
    for _ in 0..ROUNDS {
        let Some((found, straight)) = scatter(set, &fit, mean, dt_s) else { break };
        let near = Some(&fit.channel);
        let next = identify_from(&straight, dt_s, mean.standard_error(), settings, near)?;
        let step = (next.poles.damping_per_s / fit.poles.damping_per_s - 1.0).abs();
        let (starts, starts_agreeing) = (fit.starts, fit.starts_agreeing);
        fit = Identification { scatter: found, starts, starts_agreeing, ..next };
        if step < 1e-5 {
            break;
        }
    }
    // the mean over channels is at least as uncertain as the channels' own spread makes it
    let (poles, sd) = (fit.poles, &mut fit.uncertainty);
    sd.damping_sd_per_s = sd.damping_sd_per_s.max(fit.scatter.damping_se * poles.damping_per_s);
    sd.frequency_sd_hz = sd.frequency_sd_hz.max(fit.scatter.frequency_se * poles.frequency_hz);
    Ok(fit)
}

/// Where a search ended.
#[derive(Clone, Debug)]
struct End {
    theta: Vector3<f64>,
    cost: f64,
    convergence: Convergence,
    iterations: usize,
}

/// The least-squares problem (3-1) in the coordinates theta = (ln (a + b), ln (a / b), ln d) relative to the
/// guess, with g = kappa d. In these the decay is close to linear: the first moves the frequency, the last
/// the damping, the middle one the real pole. The bounds apply to (ln a, ln b, ln d), relative to the guess,
/// each by itself. Inside, time is in microseconds.
struct Problem {
    y: DVector<f64>,
    dt_us: f64,
    /// The guess of a + b per µs², a / b, and d per µs.
    guess: [f64; 3],
    /// The ratio g / d, which is held.
    kappa: f64,
    /// Bounds of (ln a, ln b, ln d), relative to the guess.
    lowest: Vector3<f64>,
    highest: Vector3<f64>,
    /// Weight of the prior on ln (a / b), counts².
    prior: f64,
}

impl Problem {
    fn new(y: &[f64], dt_s: f64, noise: f64, settings: &GreyBoxSettings) -> Problem {
        let (factor, bounds) = (settings.bound_factor, settings.bounds);
        let guess = [settings.a_per_s2, settings.b_per_s2, settings.d_per_s];
        let given = [bounds.a_per_s2, bounds.b_per_s2, bounds.d_per_s];
        // the bound given for a rate, else the guess by the common factor
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

    /// What one average cannot tell and is therefore held or has a prior, in words.
    fn held_fixed(&self) -> Vec<String> {
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

    /// The inverse of [`Problem::ln_rates`].
    fn theta_of(&self, ln_rates: &Vector3<f64>) -> Vector3<f64> {
        let ratio = ln_rates[0] - ln_rates[1];
        Vector3::new(ln_rates[1] + self.sum_over_b(ratio), ratio, ln_rates[2])
    }

    /// ln ((a + b) / b) over the guess's, as a function of ln (a / b) over the guess's.
    fn sum_over_b(&self, ln_ratio: f64) -> f64 {
        let guess = self.guess[1];
        ((1.0 + guess * ln_ratio.exp()) / (1.0 + guess)).ln()
    }

    /// The Jacobian d (ln a, ln b, ln d) / d theta.
    fn slope_of_rates(&self, theta: &Vector3<f64>) -> Matrix3<f64> {
        let ratio = self.guess[1] * theta[1].exp();
        let of_a = ratio / (1.0 + ratio);
        Matrix3::new(1.0, 1.0 - of_a, 0.0, 1.0, -of_a, 0.0, 0.0, 0.0, 1.0)
    }

    /// Moves rates that lie beyond their bounds, or nearer to them than `near`, onto the bounds.
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

    /// Starts of the search: the guess with compliance and viscosity scaled over the bounded range.
    fn starts(&self) -> Vec<Vector3<f64>> {
        let mut starts = Vec::new();
        for stiffness in [1.0f64, 0.6, 1.5, 0.35, 2.2] {
            for viscosity in [1.0f64, 0.4, 2.2] {
                let (s, v) = (stiffness.ln(), viscosity.ln());
                starts.push(self.within(Vector3::new(s, 0.0, v), 0.0));
            }
        }
        // only from the five with the least cost a search starts
        let cost = |t: &Vector3<f64>| self.project(t).map_or(f64::INFINITY, |p| self.cost(t, &p));
        let mut starts: Vec<_> = starts.into_iter().map(|t| (cost(&t), t)).collect();
        starts.sort_by(|p, q| p.0.total_cmp(&q.0));
        starts.into_iter().take(5).map(|(_, t)| t).collect()
    }

    /// theta of a channel, moved into the bounds.
    fn theta(&self, channel: &InkChannel) -> Vector3<f64> {
        let rates = [channel.a_per_s2 * 1e-12, channel.b_per_s2 * 1e-12, channel.d_per_s * 1e-6];
        let relative = [rates[0] + rates[1], rates[0] / rates[1], rates[2]];
        self.within(Vector3::from_fn(|k, _| (relative[k] / self.guess[k]).ln()), 0.0)
    }

    /// a, b, g, d of theta, in powers of 1/µs.
    fn rates_per_us(&self, theta: &Vector3<f64>) -> [f64; 4] {
        let [sum, ratio, d]: [f64; 3] = std::array::from_fn(|k| self.guess[k] * theta[k].exp());
        let b = sum / (1.0 + ratio);
        [sum - b, b, self.kappa * d, d]
    }

    /// The channel of theta.
    fn channel(&self, theta: &Vector3<f64>) -> InkChannel {
        let [a, b, g, d] = self.rates_per_us(theta);
        InkChannel { a_per_s2: a * 1e12, b_per_s2: b * 1e12, g_per_s: g * 1e6, d_per_s: d * 1e6 }
    }

    /// The outputs from unit y, y', y'' at t_a, by the rates of theta ([`basis`]).
    fn basis(&self, theta: &Vector3<f64>) -> MatrixXx3<f64> {
        let [a, b, g, d] = self.rates_per_us(theta);
        basis([g + d, g * d + a + b, a * d + b * g], self.dt_us, self.y.len())
    }

    /// The best state for these rates, which is a linear least-squares problem, and its misfit.
    fn project(&self, theta: &Vector3<f64>) -> Option<Projection> {
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

    /// Gradient and Gauss-Newton matrix of [`Problem::cost`] after the state was eliminated. They use the
    /// full Jacobian of the projection, whose second term matters along the weakly known real pole.
    fn normal_equations(
        &self,
        theta: &Vector3<f64>,
        at: &Projection,
    ) -> (Vector3<f64>, Matrix3<f64>) {
        let Projection { state, misfit, q, r } = at;
        let columns: [DVector<f64>; 3] = std::array::from_fn(|k| {
            let h = 1e-5;
            let (mut up, mut down) = (*theta, *theta);
            up[k] += h;
            down[k] -= h;
            // With E = q r and the state c, the misfit's derivative is -(1 - q q^T) dE c - q r^-T dE^T
            // misfit, where dE is the derivative of E (Golub and Pereyra).
            let slope = (self.basis(&up) - self.basis(&down)) / (2.0 * h);
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

    /// Levenberg and Marquardt's search from one start. `None`: it did not end within 200 iterations, or the
    /// model could not be evaluated.
    fn search(&self, start: Vector3<f64>) -> Option<End> {
        let mut theta = start;
        let mut at = self.project(&theta)?;
        let mut damping = 1e-3;
        for iterations in 1..=200 {
            let cost = self.cost(&theta, &at);
            let (gradient, hessian) = self.normal_equations(&theta, &at);
            let here = theta;
            let end = |convergence| End { theta: here, cost, convergence, iterations };
            let scale = hessian.diagonal().map(|h| h.sqrt().max(f64::MIN_POSITIVE));
            // Converged by the gradient: the cosine of the angle between the misfit and every direction that
            // no bound holds. At 1e-6 the optimum is nearer than a hundred-thousandth of a standard
            // deviation.
            let slope = self.projected(&theta, &gradient).component_div(&scale).amax();
            if slope <= 1e-6 * at.misfit.norm() + 1e-13 * self.y.norm() {
                return Some(end(Convergence::Gradient));
            }
            // Converged by the gain: the decrease that the undamped step predicts. 1e-9 of the cost is 1e-4
            // standard deviations.
            let gain =
                |step: &Vector3<f64>| -gradient.dot(step) - step.dot(&(hessian * step)) / 2.0;
            let ridge = hessian + Matrix3::identity() * (1e-14 * hessian.amax());
            if self.bounded_step(&ridge, &gradient, &theta).is_some_and(|s| gain(&s) <= 1e-9 * cost)
            {
                return Some(end(Convergence::Gain));
            }
            // raise the damping until a step reduces the cost by enough of what was predicted
            let mut moved = false;
            while damping < 1e12 {
                let mut damped = hessian;
                for k in 0..3 {
                    damped[(k, k)] += damping * hessian[(k, k)].max(1e-12 * hessian.amax());
                }
                let step = self.bounded_step(&damped, &gradient, &theta)?;
                if step.amax() <= 1e-11 {
                    return Some(end(Convergence::Step));
                }
                let trial = theta + step;
                let predicted = gain(&step);
                let there = self.project(&trial).map(|there| {
                    let gained = cost - self.cost(&trial, &there);
                    (gained / predicted.max(f64::MIN_POSITIVE), there)
                });
                match there {
                    Some((ratio, there)) if ratio > 1e-3 => {
                        (theta, at) = (trial, there);
                        if ratio > 0.75 {
                            damping = (damping / 10.0).max(1e-14);
                        } else if ratio < 0.25 {
                            damping *= 4.0;
                        }
                        moved = true;
                        break;
                    }
                    _ => damping *= 10.0,
                }
            }
            if !moved {
                return Some(end(Convergence::Step));
            }
        }
        None
    }

    /// The gradient without its components that push rates against their bounds.
    fn projected(&self, theta: &Vector3<f64>, gradient: &Vector3<f64>) -> Vector3<f64> {
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

    /// The step x that minimises 1/2 x'Hx + g'x such that the rates at theta + x are within their bounds, to
    /// first order; if the free minimum is within them, that one.
    fn bounded_step(
        &self,
        h: &Matrix3<f64>,
        g: &Vector3<f64>,
        theta: &Vector3<f64>,
    ) -> Option<Vector3<f64>> {
        // the free minimum, if the bounds allow it
        let inside = |x: &Vector3<f64>| self.within(theta + x, 0.0) == theta + x;
        if let Some(step) = h.cholesky().map(|l| l.solve(&-g)).filter(inside) {
            return Some(step);
        }
        // scaled to unit curvature, so that the programme's tolerances mean the same in each direction
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
        // six inequalities: each rate below its highest and above its lowest value, linear in the step
        for k in 0..3 {
            for j in 0..3 {
                rows[k][j] = slope[(k, j)] * unit[j];
                rows[k + 3][j] = -rows[k][j];
            }
            limits[k] = (self.highest[k] - rates[k]) / size;
            limits[k + 3] = (rates[k] - self.lowest[k]) / size;
        }
        let (x, _) = minimise(&hessian, &linear, &rows, &limits)?;
        let end = Vector3::from_fn(|k, _| theta[k] + x[k] * unit[k] * size);
        // an interior-point method ends just inside an active bound: move it onto the bound
        let step = self.within(end, 1e-6) - theta;
        step.amax().is_finite().then_some(step)
    }

    /// Names of the rates that lie at a bound.
    fn at_bounds(&self, theta: &Vector3<f64>) -> Vec<String> {
        let rates = self.ln_rates(theta);
        let is_at =
            |k: &usize| rates[*k] >= self.highest[*k] - 1e-6 || rates[*k] <= self.lowest[*k] + 1e-6;
        let names = ["a_per_s2", "b_per_s2", "d_per_s"];
        (0..3).filter(is_at).map(|k| names[k].to_owned()).collect()
    }
}

/// The best state for some rates, and what it leaves.
struct Projection {
    /// The state c: y, y', y'' at t_a, per µs.
    state: Vector3<f64>,
    /// The misfit y - E c, where E is the basis.
    misfit: DVector<f64>,
    /// The factors of E = q r.
    q: MatrixXx3<f64>,
    r: Matrix3<f64>,
}

/// The factors q, r of N x 3 columns, by Gram and Schmidt, twice: as orthogonal as Householder's (Giraud,
/// Langou and Rozloznik 2005). Linearly dependent columns give numbers that are not finite.
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

/// The acquisition state of thesis (2-2) that has this output and these derivatives; its component along the
/// unobservable (1, -1, 0, 0) is zero: V_r = V_n = V/2.
fn acquisition_state(channel: &InkChannel, [y, dy, ddy]: [f64; 3]) -> [f64; 4] {
    let InkChannel { a_per_s2: a, b_per_s2: b, g_per_s: g, d_per_s: d } = *channel;
    // y = q_r + q_n;  y' = -(a+b) V - g q_r - d q_n;
    // y'' = -(a+b) y + (g a + d b) V + g^2 q_r + d^2 q_n. In units of 1 µs against overflow.
    let (a, b, g, d) = (a * 1e-12, b * 1e-12, g * 1e-6, d * 1e-6);
    let (dy, ddy) = (dy * 1e-6, ddy * 1e-12);
    let m = matrix![
        0.0, 1.0, 1.0;
        -(a + b), -g, -d;
        g * a + d * b, g * g - (a + b), d * d - (a + b)];
    let x = m.lu().solve(&Vector3::new(y, dy, ddy)).unwrap_or_else(Vector3::zeros);
    [x[0] * 0.5e-6, x[0] * 0.5e-6, x[1], x[2]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::normal::draws;
    use crate::model::ring_down::ring_down;

    const DT_S: f64 = 0.78125e-6;
    const PLANTED: InkChannel =
        InkChannel { a_per_s2: 6.1e10, b_per_s2: 1.02e11, g_per_s: 1.9e4, d_per_s: 7.1e4 };

    fn decay() -> Vec<f64> {
        let x_a = DVector::from_row_slice(&[3e-4, 1e-4, 150.0, 240.0]);
        ring_down(&PLANTED, &x_a, DT_S, 128)
    }

    fn close(a: f64, b: f64, relative: f64) -> bool {
        (a - b).abs() <= relative * b.abs()
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
    fn planted_poles_come_back_from_a_clean_decay() {
        let fit = identify(&decay(), DT_S, 0.0, &GreyBoxSettings::default(), None).unwrap();
        let truth = poles_of(PLANTED.cubic()).unwrap();
        assert!(close(fit.poles.damping_per_s, truth.damping_per_s, 1e-6), "{fit:?}");
        assert!(close(fit.poles.frequency_hz, truth.frequency_hz, 1e-8));
        assert!(close(fit.poles.lambda_per_s, truth.lambda_per_s, 1e-4));
        assert!(fit.at_bounds.is_empty());
    }

    #[test]
    fn acquisition_state_rings_like_the_signal() {
        let fit = identify(&decay(), DT_S, 0.0, &GreyBoxSettings::default(), None).unwrap();
        let again =
            ring_down(&fit.channel, &DVector::from_row_slice(&fit.acquisition_state), DT_S, 128);
        for (y, z) in decay().iter().zip(&again) {
            assert!((y - z).abs() < 1e-5, "{y} {z}");
        }
        for (y, z) in decay().iter().zip(&fit.expected(DT_S, 128)) {
            assert!((y - z).abs() < 1e-5);
        }
    }

    #[test]
    fn planted_poles_lie_within_their_stated_intervals() {
        let truth = poles_of(PLANTED.cubic()).unwrap();
        let (clean, noise) = (decay(), 4.0);
        let mut normal = draws(7);
        let (mut covered, runs) = ([0; 3], 200);
        for _ in 0..runs {
            let y: Vec<f64> = clean.iter().map(|v| v + noise * normal()).collect();
            let fit = identify(&y, DT_S, noise, &GreyBoxSettings::default(), None).unwrap();
            let u = &fit.uncertainty;
            let pairs = [
                (fit.poles.damping_per_s - truth.damping_per_s, u.damping_sd_per_s),
                (fit.poles.frequency_hz - truth.frequency_hz, u.frequency_sd_hz),
            ];
            for (k, (off, sd)) in pairs.iter().enumerate() {
                covered[k] += usize::from(off.abs() <= 1.96 * sd);
            }
        }
        for hits in &covered[..2] {
            let share = *hits as f64 / f64::from(runs);
            assert!((0.90..=0.99).contains(&share), "95 % intervals cover {share}");
        }
    }

    #[test]
    fn wherever_it_starts_a_search_ends_where_all_starts_do() {
        let settings = GreyBoxSettings::default();
        let by = |stiffness: f64, loss: f64| InkChannel {
            a_per_s2: PLANTED.a_per_s2 * stiffness,
            b_per_s2: PLANTED.b_per_s2 * stiffness,
            g_per_s: PLANTED.g_per_s * loss,
            d_per_s: PLANTED.d_per_s * loss,
        };
        for seed in 0..20 {
            let mut normal = draws(seed);
            let y: Vec<f64> = decay().iter().map(|v| v + 2.0 * normal()).collect();
            let cold = identify(&y, DT_S, 2.0, &settings, None).unwrap();
            // starts from the window before, from another ink, and from what no ink is
            for near in [by(1.01, 0.96), by(0.8, 1.5), by(4.0, 0.1)] {
                let warm = identify(&y, DT_S, 2.0, &settings, Some(&near)).unwrap();
                let off = [
                    (warm.poles.damping_per_s - cold.poles.damping_per_s)
                        / cold.uncertainty.damping_sd_per_s,
                    (warm.poles.frequency_hz - cold.poles.frequency_hz)
                        / cold.uncertainty.frequency_sd_hz,
                ];
                assert!(off.iter().all(|off| off.abs() < 0.01), "{near:?}: {off:?}");
            }
        }
    }

    #[test]
    fn thin_qr_is_orthonormal_and_gives_the_columns_back() {
        let columns = basis(super::super::cubic::cubic_per_us(PLANTED.cubic()), 0.78125, 128);
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

    /// Thesis (3-1) bounds the parameters of A by predetermined values, each its own.
    #[test]
    fn a_bound_of_ones_own_holds_and_is_told() {
        let free = identify(&decay(), DT_S, 1.0, &GreyBoxSettings::default(), None).unwrap();
        let mut settings = GreyBoxSettings { plain_mean: true, ..GreyBoxSettings::default() };
        let low = 1.2 * free.channel.d_per_s;
        settings.d_per_s = 1.3 * free.channel.d_per_s;
        settings.g_per_s = 0.2 * settings.d_per_s;
        settings.bounds.d_per_s = Some([low, 2.0 * low]);
        settings.check().unwrap();
        // the settings' channel is scaled to the ring's own time scale, its bounds are not
        let fit = identify_from(&decay(), DT_S, 1.0, &settings, None).unwrap();
        assert!((fit.channel.d_per_s / low - 1.0).abs() < 1e-6, "{}", fit.channel.d_per_s / low);
        assert_eq!(fit.at_bounds, ["d_per_s"]);
        assert!(fit.held_fixed.iter().all(|what| !what.contains("prior")), "{:?}", fit.held_fixed);
    }

    #[test]
    fn nothing_that_rings_is_an_error() {
        let settings = GreyBoxSettings::default();
        let flat = identify(&[3.0; 128], DT_S, 1.0, &settings, None);
        assert!(matches!(flat, Err(IdentifyError::NoRingDown)));
        let short = identify(&[1.0; 5], DT_S, 1.0, &settings, None);
        assert!(matches!(short, Err(IdentifyError::TooFewSamples { .. })));
    }
}
