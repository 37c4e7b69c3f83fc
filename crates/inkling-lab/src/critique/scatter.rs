//! `Model::fit`: estimates how channels differ, how a channel's signals differ from burst to burst, the mean
//! channel, the noise, and the rate of the real pole.
//!
//! In: a model and signals. Out: the same model with new `mean`, `between`, `within`, `noise_var` and
//! channels. Each round moves all channels and signals to their most probable parameters (`Model::settle`),
//! and then does three things:
//!
//! 1. the noise variance is the mean square that single signals leave once their own parameters are free;
//! 2. ln lambda/sigma takes one Gauss-Newton step, with a Gaussian prior;
//! 3. EM (expectation and maximisation) estimates the mean b0 and the covariances B and W of the linear model
//!    r_i = J_i (b_channel + w_i) + noise, b ~ N(b0, B), w ~ N(0, W).
//!
//! All vectors and matrices here are over the five free parameters in units of `Model::scale`.

use super::matrices::{
    Matrix5, Vector5, floored, free_part, inverse, inverse_or_zero, means_of_groups, scaled,
    unscaled,
};
use super::model::{Model, free_products};
use super::observations::Observations;
use super::tuned::{LN_LAMBDA_SD, UNTOLD_NOISE};
use inkling_core::model::free_decay::{ALL, FREE};
use inkling_core::model::inner_product::dot;

/// Information and score of one signal about its channel's parameters.
struct OneSignal {
    unit: usize,
    gram: Matrix5,
    /// J^T r / noise variance, with the residual r about the parameters of the channel, not the signal's own.
    product: Vector5,
}

/// The state of EM: the mean b0 relative to the model's mean, and the covariances B and W.
struct Estimate {
    mean: Vector5,
    between: Matrix5,
    within: Matrix5,
}

impl Model {
    /// The first model of these signals, fitted in so many `rounds`; `None` where nothing rings.
    pub fn fitted(data: &Observations, rounds: usize) -> Option<Model> {
        let mut model = Model::start(data)?;
        model.fit(data, rounds);
        Some(model)
    }

    pub fn fit(&mut self, data: &Observations, rounds: usize) {
        for _ in 0..rounds {
            self.settle(data);
            self.estimate_scatter(data, 30);
        }
    }

    fn estimate_scatter(&mut self, data: &Observations, steps: usize) {
        let scale = self.scale();
        let signals = self.signals_and_noise(data, &scale);
        let repeated = data.len() > data.units;
        // the point at which each channel is linearised, relative to the model's mean
        let offset: Vec<Vector5> =
            self.units.iter().map(|u| free_part(&(u - self.mean), &scale)).collect();
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

    /// Steps 1 and 2. Returns every signal's information and score.
    fn signals_and_noise(&mut self, data: &Observations, scale: &Vector5) -> Vec<OneSignal> {
        // information and score about ln lambda/sigma, not divided by the noise variance
        let (mut information, mut score) = (0.0, 0.0);
        let each = self.of_each(data, |i, linear| {
            let (gram, product) = free_products(linear, scale);
            let square = dot(&linear.residual, &linear.residual);
            // the tiny ridge keeps the matrix invertible where a parameter moves nothing
            let ridge = gram + Matrix5::identity() * (1e-9 * gram.trace());
            let columns = &linear.tangent.columns;
            let pole = &columns[ALL - 1];
            let along = Vector5::from_fn(|j, _| dot(&columns[j], pole) * scale[j]);
            let solved = ridge.cholesky().map(|c| [c.solve(&product), c.solve(&along)]);
            let [of_residual, of_along] = solved.unwrap_or_default();
            let explained = product.dot(&of_residual).min(square);
            // what a signal's own columns explain of the pole's tells nothing about the rate (Schur complement)
            information += (dot(pole, pole) - along.dot(&of_along)).max(0.0);
            score += dot(pole, &linear.residual) - product.dot(&of_along);
            let left = (square - explained) / (linear.counted() - FREE as f64).max(1.0);
            // adding J times the own deviation gives the residual about the channel alone, to first order
            let own = free_part(&self.each[i], scale);
            let product = product + gram * own;
            (OneSignal { unit: data.rows[i].unit, gram, product }, left)
        });
        let (mut signals, mut left): (Vec<OneSignal>, Vec<f64>) = each.into_iter().unzip();

        // the noisiest hundredth of the signals may have more than noise
        left.sort_by(f64::total_cmp);
        let kept = &left[..(left.len() as f64 * (1.0 - UNTOLD_NOISE)).ceil() as usize];
        self.noise_var = (kept.iter().sum::<f64>() / kept.len() as f64).max(1e-300);
        for signal in &mut signals {
            signal.gram /= self.noise_var;
            signal.product /= self.noise_var;
        }
        // a Newton step, with a Gaussian prior
        let prior = 1.0 / (LN_LAMBDA_SD * LN_LAMBDA_SD);
        let score = score / self.noise_var - self.lambda_off() * prior;
        self.shift_lambda(score / (information / self.noise_var + prior));
        signals
    }
}

/// Estimates `between` and `within` by moments, as a start for EM: the scatter of single signals'
/// least-squares estimates, less that of their errors. `offset`: the point at which each channel is
/// linearised, relative to the model's mean.
fn moments(signals: &[OneSignal], offset: &[Vector5], units: usize) -> (Matrix5, Matrix5) {
    // The ridge is a prior of standard deviation 0.1 about the channel, for what a signal does not determine.
    let estimates: Vec<(usize, Vector5, Matrix5)> = signals
        .iter()
        .map(|OneSignal { unit, gram, product }| {
            let ridge = gram + Matrix5::identity() * 1e2;
            let inverse = inverse_or_zero(ridge);
            (*unit, inverse * product + offset[*unit], inverse)
        })
        .collect();

    let means = means_of_groups(units, estimates.iter().map(|(unit, x, _)| (*unit, *x)));

    // The variance about the channels' means is `within` plus that of the errors; that of the means is
    // `between` plus a share (channels over signals) of both.
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
    /// One step of EM. `offset`: as of `moments`; `repeated`: channels were heard more than once.
    ///
    /// The score of a signal about b0 is q = product + G (offset - b0) with G = `gram`. Let D = (W^-1 +
    /// G)^-1. If the signal's own deviation w is integrated out, G - G D G is left as its information about
    /// the channel, and q - G D q as its score; both are summed over the channel's signals.
    fn step(&mut self, signals: &[OneSignal], offset: &[Vector5], repeated: bool) {
        if !repeated {
            self.within = Matrix5::zeros();
        }
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

        // E step, channels: the posterior is N(b, C) with C = (B^-1 + information)^-1 and b = C score
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
        // E step, signals: given b, a signal's deviation is N(D (q - G b), D); the channel's own uncertainty
        // C adds D G C (D G)^T
        for (OneSignal { unit, gram, .. }, (q, d)) in signals.iter().zip(&each) {
            let (b, c) = posterior[*unit];
            let w = d * (q - gram * b);
            let dg = d * gram;
            sum_w += w * w.transpose() + d + dg * c * dg.transpose();
        }

        // M step: b0 moves to the average of the channels' posterior means; B, their covariance about it,
        // takes n / (n - 1), since the average comes from the same n channels
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
