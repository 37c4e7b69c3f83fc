//! Estimates how channels differ, how a channel's signals differ from burst to burst, and the noise.
//!
//! In: a model about which signals are linearised. Out: its covariances `between` and `within` and its mean,
//! by EM; its noise, by what single signals leave once their own parameters are free; and the rate of its
//! real pole, by one step of Gauss and Newton.

use super::matrices::{
    Matrix5, Vector5, floored, free_part, inverse, inverse_or_zero, means_of_groups, scaled,
    unscaled,
};
use super::model::{Linear, Model, free_products};
use super::observations::Observations;
use super::tuned::{ln_lambda_sd, untold_noise};
use inkling_core::model::free_decay::{ALL, FREE};
use inkling_core::model::inner_product::dot;

/// Information and score of one signal about its channel's parameters, in units of [`Model::scale`].
struct OneSignal {
    unit: usize,
    gram: Matrix5,
    product: Vector5,
}

/// Information and score of all signals about the real pole's rate, after each one's own parameters.
#[derive(Default)]
struct OfPole {
    information: f64,
    score: f64,
}

/// The estimate on its way: mean relative to the model's, and covariances.
struct Estimate {
    mean: Vector5,
    between: Matrix5,
    within: Matrix5,
}

impl OfPole {
    /// Adds a signal. `along`: inner products of the pole's column with the signal's own; `solved`: the
    /// coefficients with which these explain it.
    fn add(&mut self, linear: &Linear, product: &Vector5, along: &Vector5, solved: &Vector5) {
        let column = &linear.tangent.columns[ALL - 1];
        self.information += (dot(column, column) - along.dot(solved)).max(0.0);
        self.score += dot(column, &linear.residual) - product.dot(solved);
    }

    /// Step to the most probable rate. `off`: ln lambda/sigma of the model less the mean of its prior.
    fn step(&self, off: f64, noise_var: f64) -> f64 {
        let prior = 1.0 / (ln_lambda_sd() * ln_lambda_sd());
        (self.score / noise_var - off * prior) / (self.information / noise_var + prior)
    }
}

impl Model {
    /// Alternates linearisation and estimation, `rounds` times.
    pub fn fit(&mut self, data: &Observations, rounds: usize) {
        for _ in 0..rounds {
            self.settle(data);
            self.estimate_scatter(data, 30);
        }
    }

    /// Estimates noise, scatter and mean at the present linearisation; `steps`: of EM.
    fn estimate_scatter(&mut self, data: &Observations, steps: usize) {
        let scale = self.scale();
        let signals = self.signals_and_noise(data, &scale);
        let repeated = data.len() > data.units;
        let offset: Vec<Vector5> =
            self.units.iter().map(|u| free_part(&(u - self.mean), &scale)).collect();
        // EM starts from the last estimate, or at first from moments
        let (between, within) = match self.estimated {
            true => (scaled(&self.between, &scale), scaled(&self.within, &scale)),
            false => moments(&signals, &offset, data.units),
        };
        self.estimated = true;
        let mut now = Estimate { mean: Vector5::zeros(), between, within };
        for _ in 0..steps {
            now.step(&signals, &offset, repeated);
        }
        let back = |m| unscaled(&floored(m), &scale);
        self.between = back(&now.between);
        self.within = if repeated { back(&now.within) } else { Matrix5::zeros() };
        for j in 0..FREE {
            self.mean[j] += now.mean[j] * scale[j];
        }
    }

    /// Estimates the noise, moves the real pole's rate, and returns every signal in the metric of the noise.
    fn signals_and_noise(&mut self, data: &Observations, scale: &Vector5) -> Vec<OneSignal> {
        let mut linear = Linear::default();
        let mut signals = Vec::with_capacity(data.len());
        let mut left = Vec::with_capacity(data.len());
        let mut of_pole = OfPole::default();
        for i in 0..data.len() {
            self.linearise(i, data, &mut linear);
            let (gram, product) = free_products(&linear, scale);
            let square = dot(&linear.residual, &linear.residual);
            let ridge = gram + Matrix5::identity() * (1e-9 * gram.trace());
            // inner products of the real pole's column with those of the signal's own parameters
            let columns = &linear.tangent.columns;
            let along = Vector5::from_fn(|j, _| dot(&columns[j], &columns[ALL - 1]) * scale[j]);
            let solved = ridge.cholesky().map(|c| [c.solve(&product), c.solve(&along)]);
            // what is left once the signal's own parameters are free estimates the noise
            let [of_residual, of_along] = solved.unwrap_or_default();
            let explained = product.dot(&of_residual).min(square);
            of_pole.add(&linear, &product, &along, &of_along);
            left.push((square - explained) / (linear.counted() - FREE as f64).max(1.0));
            let own = free_part(&self.each[i], scale);
            // the score is taken about the channel, not about the signal's own parameters
            let product = product + gram * own;
            signals.push(OneSignal { unit: data.rows[i].unit, gram, product });
        }
        // the mean over all but the noisiest signals, whose noise may be something else
        left.sort_by(f64::total_cmp);
        let kept = &left[..(left.len() as f64 * (1.0 - untold_noise())).ceil() as usize];
        self.noise_var = (kept.iter().sum::<f64>() / kept.len() as f64).max(1e-300);
        for signal in &mut signals {
            signal.gram /= self.noise_var;
            signal.product /= self.noise_var;
        }
        if self.real {
            self.shift_lambda(of_pole.step(self.lambda_off(), self.noise_var));
        }
        signals
    }
}

/// Estimates the scatter by moments, as a start for EM: the scatter of each signal's own estimates, less
/// what their errors contribute.
fn moments(signals: &[OneSignal], offset: &[Vector5], units: usize) -> (Matrix5, Matrix5) {
    // estimates of single signals, with a ridge for what a signal does not determine
    let estimates: Vec<(usize, Vector5, Matrix5)> = signals
        .iter()
        .map(|OneSignal { unit, gram, product }| {
            let ridge = gram + Matrix5::identity() * 1e2;
            let inverse = inverse_or_zero(ridge);
            (*unit, inverse * product + offset[*unit], inverse)
        })
        .collect();

    let means = means_of_groups(units, estimates.iter().map(|(unit, x, _)| (*unit, *x)));

    // variance about these means is that of bursts plus the errors'; variance of the means is that of
    // channels plus a share of both
    let mut within = Matrix5::zeros();
    let mut noise = Matrix5::zeros();
    for (unit, x, covariance) in &estimates {
        let d = x - means[*unit];
        within += d * d.transpose();
        noise += covariance;
    }
    let (count, units) = (estimates.len() as f64, units as f64);
    noise /= count;
    within = within / (count - units).max(1.0) - noise;
    let centre = means.iter().sum::<Vector5>() / units;
    let mut between = Matrix5::zeros();
    for mean in &means {
        let d = mean - centre;
        between += d * d.transpose() / (units - 1.0).max(1.0);
    }
    between -= (noise + within) * (units / count);
    (floored(&between), floored(&within))
}

impl Estimate {
    /// One step of EM. `offset`: each channel's parameters less the model's mean; `repeated`: channels were
    /// heard more than once.
    fn step(&mut self, signals: &[OneSignal], offset: &[Vector5], repeated: bool) {
        if !repeated {
            self.within = Matrix5::zeros();
        }
        // information and score of each channel, its signals' own deviations integrated out
        let (precision_b, precision_w) = (inverse(&self.between), inverse(&self.within));
        let mut info = vec![Matrix5::zeros(); offset.len()];
        let mut score = vec![Vector5::zeros(); offset.len()];
        let mut each = Vec::with_capacity(signals.len());
        for OneSignal { unit, gram, product } in signals {
            let q = product + gram * (offset[*unit] - self.mean);
            let d = if repeated { inverse_or_zero(precision_w + gram) } else { Matrix5::zeros() };
            info[*unit] += gram - gram * d * gram;
            score[*unit] += q - gram * (d * q);
            each.push((q, d));
        }
        // E step: posterior mean and covariance of each channel, then of each signal's deviation
        let mut sum_b = Matrix5::zeros();
        let mut sum_w = Matrix5::zeros();
        let mut centre = Vector5::zeros();
        let mut posterior = Vec::with_capacity(offset.len());
        for (info, score) in info.iter().zip(&score) {
            let c = inverse_or_zero(precision_b + info);
            let b = c * score;
            sum_b += b * b.transpose() + c;
            centre += b;
            posterior.push((b, c));
        }
        for (OneSignal { unit, gram, .. }, (q, d)) in signals.iter().zip(&each) {
            let (b, c) = posterior[*unit];
            let w = d * (q - gram * b);
            let dg = d * gram;
            sum_w += w * w.transpose() + d + dg * c * dg.transpose();
        }
        // M step: the mean moves to the average of the channels, and `between` is their covariance about it,
        // over one channel less, since the average comes from the same channels
        let units = offset.len() as f64;
        centre /= units;
        self.between = (sum_b / units - centre * centre.transpose())
            * if units > 1.0 { units / (units - 1.0) } else { 1.0 };
        if repeated {
            self.within = sum_w / signals.len() as f64;
        }
        self.mean += centre;
    }
}
