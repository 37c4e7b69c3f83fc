//! Signals that nothing was fitted to: splits signals into a part that models are fitted to and a part that they are
//! judged on ([`TrainTestSplit`], by channel, by time or by both), fits models to a part, and judges the others.
//!
//! A model expects of a signal that its parameters are drawn from a Gaussian, the [`Population`]. For a channel that
//! was never heard that is N(mean, between + within), with `between` shrunk because it is known from few channels
//! (`population`); for one that was heard it is N(the channel's own parameters, within + what is unknown of these)
//! ([`Population::of_channel`]). A [`Signal`] is linearised at its most probable parameters once it was measured. All
//! vectors and matrices are over the five free parameters in units of `Model::scale`.

use super::candidates::{Applied, Setting};
use super::matrices::{Matrix5, Vector5, floored, free_part, inverse, inverse_or_zero, scaled};
use super::model::{Linear, Model};
use super::observations::Observations;
use super::refit::{apply, refit};
use inkling_core::model::free_decay::{FREE, Theta};
use inkling_core::model::inner_product::dot;
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;

const FEWEST: usize = 8;
/// Number of blocks of time, of equally many moments each.
const BLOCKS: usize = 5;

fn held_out_by_time(data: &Observations) -> Vec<bool> {
    let mut times: Vec<i64> = data.rows.iter().map(|r| r.beside.t_acq_ns).collect();
    times.sort_unstable();
    times.dedup();
    // of few moments each is a block
    let blocks = BLOCKS.min(times.len());
    let bounds: Vec<i64> = (1..blocks).map(|block| times[times.len() * block / blocks]).collect();
    let block = |t: i64| bounds.partition_point(|bound| *bound <= t);
    data.rows.iter().map(|row| block(row.beside.t_acq_ns) % 2 == 1).collect()
}

/// The two parts; in both, channels and bursts are numbered anew.
pub struct TrainTestSplit {
    pub train: Observations,
    pub test: Observations,
    /// For each channel of `test`, its place among the channels of `train`; `None` if it is not there.
    pub in_train: Vec<Option<usize>>,
    /// Number of signals of each channel in `train`.
    pub counts: Vec<f64>,
}

impl TrainTestSplit {
    /// `by_channel`: every other channel is held out. `by_time`: the second and the fourth of five blocks of
    /// time are, so that drift is judged between the times that it was learned at. With both, signals of which
    /// only channel or time is held out are in no part. `None`: fewer than eight signals in a part.
    pub fn of(data: &Observations, by_channel: bool, by_time: bool) -> Option<TrainTestSplit> {
        let held_out = held_out_by_time(data);
        let is_in = |test: bool, i: usize| {
            (!by_channel || (data.rows[i].unit % 2 == 1) == test)
                && (!by_time || held_out[i] == test)
        };
        let [train, test] = [false, true].map(|test| data.select(|i| is_in(test, i)));
        // printhead and number of each channel, in the order in which `select` numbers channels
        let channels = |of: &Observations| -> Vec<(usize, u32)> {
            let first = of.channels().map(|rows| &of.rows[rows.start]);
            first.map(|row| (row.printhead, row.beside.channel)).collect()
        };
        let fitted = channels(&train);
        let place = |channel| fitted.iter().position(|known| *known == channel);
        let in_train = channels(&test).into_iter().map(place).collect();
        let counts = train.channels().map(|rows| rows.len() as f64).collect();
        let enough = train.len() >= FEWEST && test.len() >= FEWEST;
        enough.then_some(TrainTestSplit { train, test, in_train, counts })
    }
}

/// Groups of signals that are drawn together in resampling, by their indices: those of a channel, or, with
/// few channels, each signal alone. `units`: the channel of each signal.
pub fn by_channel(units: impl Iterator<Item = usize>) -> Vec<Vec<usize>> {
    let mut groups = BTreeMap::<usize, Vec<usize>>::new();
    units.enumerate().for_each(|(i, unit)| groups.entry(unit).or_default().push(i));
    match groups.len() < FEWEST_UNITS {
        true => groups.into_values().flatten().map(|i| vec![i]).collect(),
        false => groups.into_values().collect(),
    }
}

/// Fits the baseline, a model without causes, to a part. `codes`: a model whose clipping and coarse step are
/// taken over. `None`: nothing rings.
pub fn baseline(codes: Option<&Model>, part: Setting) -> Option<Model> {
    let mut start = Model::start(part.data)?;
    if let Some(codes) = codes {
        start.codes = codes.codes.clone();
    }
    start.fit(part.data, 2);
    Some(refit(start, Vec::new(), part, 2, true).model)
}

pub fn with(plain: &Model, causes: &[Applied], part: Setting) -> Model {
    let mut model = plain.clone();
    if causes.is_empty() {
        return model;
    }
    causes.iter().for_each(|cause| apply(&mut model, cause, 1.0, part));
    refit(model, causes.to_vec(), part, 3, true).model
}

/// With fewer channels, held-out signals are split off by time alone.
pub const FEWEST_UNITS: usize = 6;
/// Weight, in channels, of the guess that the parameters scatter independently: the smallest with which an
/// inverse Wishart prior has a mean.
pub const SHRINKAGE: f64 = FREE as f64 + 1.0;
#[derive(Clone, Copy)]
pub struct Population {
    shift: Vector5,
    spread: Matrix5,
}

/// The population of signals of channels that were never heard. `between` is shrunk towards independent
/// scatter of amplitude, phase and the other parameters (after Ledoit and Wolf 2004, with a weight of
/// [`SHRINKAGE`] channels), and multiplied by 1 + 1/channels for the error of the mean, unless there are
/// fewer than five channels. `without`: a channel that is taken out first, as if it had not been heard;
/// ignored with fewer than [`FEWEST_UNITS`] channels.
pub fn population(model: &Model, without: Option<usize>) -> Population {
    let scale = model.scale();
    let (mut between, mut shift) = (scaled(&model.between, &scale), Vector5::zeros());
    let mut units = model.units.len() as f64;
    // the usual updates of a sample mean and a sample covariance (over n - 1) of n channels
    if let Some(unit) = without.filter(|_| units >= FEWEST_UNITS as f64) {
        let off = free_part(&(model.units[unit] - model.mean), &scale);
        let own = off * off.transpose() * (units / (units - 1.0));
        between = (between * (units - 1.0) - own) / (units - 2.0);
        shift = -off / (units - 1.0);
        units -= 1.0;
    }
    // turn (a, b) to (amplitude, phase) and shrink towards the diagonal there
    if units >= (FEWEST_UNITS - 1) as f64 {
        let mut turn = Matrix5::identity();
        let (a, b) = (model.mean[2], model.mean[3]);
        let size = a.hypot(b).max(f64::MIN_POSITIVE);
        (turn[(2, 2)], turn[(2, 3)]) = (a / size, b / size);
        (turn[(3, 2)], turn[(3, 3)]) = (-b / size, a / size);
        let own = turn * between * turn.transpose();
        let weight = SHRINKAGE / (units - 1.0 + SHRINKAGE);
        let alone = Matrix5::from_diagonal(&own.diagonal().map(|v| v.max(0.0)));
        let drawn = own * (1.0 - weight) + alone * weight;
        between = turn.transpose() * drawn * turn * (1.0 + 1.0 / units);
    }
    Population { shift, spread: floored(&(between + scaled(&model.within, &scale))) }
}

/// One signal, and what a model expects of it, linearised at its most probable parameters, which minimise
/// |r|²/v + about^T spread^-1 about with the noise variance v. Samples are in counts, parameters in units of
/// [`Model::scale`].
pub struct Signal {
    /// Indices of its burst and of its channel among those of its set of signals.
    pub burst: usize,
    pub unit: usize,
    pub y: Vec<f64>,
    /// The model's output there, and the measured samples less that.
    pub expected: Vec<f64>,
    pub residual: DVector<f64>,
    /// 1 for every sample that counts, 0 where it may be clipped.
    pub counts: Vec<f64>,
    /// Jacobian of the output by the parameters; N x FREE.
    pub tangent: DMatrix<f64>,
    /// The most probable parameters relative to the population's mean, and that population's covariance.
    pub about: Vector5,
    pub spread: Matrix5,
    /// Variance of the noise, counts², and sum of squares of the residual about the model's mean.
    pub noise_var: f64,
    pub square: f64,
}

/// What a model expects of signals whose channels have these populations. Channels differ by per cents, so that one
/// linear step from the mean would not be enough.
pub fn signals(model: &Model, data: &Observations, of_unit: Vec<Population>) -> Vec<Signal> {
    // the model with all channels at its mean; `each` holds the signal that is being fitted
    let mut mean = model.clone();
    mean.units = vec![model.mean; data.units];
    mean.each = vec![Theta::zeros(); data.len()];
    let scale = model.scale();
    let mut linear = Linear::default();
    let each = |i: usize| {
        let Population { shift, spread } = of_unit[data.rows[i].unit];
        let mut centre = Theta::zeros();
        mean.linearise(i, data, &mut linear);
        let square = dot(&linear.residual, &linear.residual);
        centre.fixed_rows_mut::<FREE>(0).copy_from(&shift.component_mul(&scale));
        let most_probable = mean.fit_one(i, data, centre, inverse_or_zero(spread));
        mean.each[i] = most_probable;
        mean.linearise(i, data, &mut linear);
        // the signal goes back to the mean, so that the model is as it was
        mean.each[i] = Theta::zeros();
        Signal {
            burst: data.rows[i].burst,
            unit: data.rows[i].unit,
            y: data.signal(i).iter().map(|y| f64::from(*y)).collect(),
            expected: linear.model.clone(),
            residual: DVector::from_column_slice(&linear.residual),
            counts: linear.counts.clone(),
            tangent: linear.by_free(&scale),
            about: free_part(&most_probable, &scale) - shift,
            spread,
            noise_var: model.noise_var,
            square,
        }
    };
    (0..data.len()).map(each).collect()
}

impl Population {
    /// The population of further signals of a channel that the model was fitted to with so many `signals`.
    pub fn of_channel(model: &Model, unit: usize, signals: f64) -> Population {
        let scale = model.scale();
        let shift = free_part(&(model.units[unit] - model.mean), &scale);
        // the posterior covariance of the channel's own parameters neglects the noise of the fitted signals
        let within = floored(&scaled(&model.within, &scale));
        let of_within = inverse_or_zero(within) * signals;
        let of_between = inverse(&scaled(&model.between, &scale));
        let unknown = inverse_or_zero(of_within + of_between);
        Population { shift, spread: floored(&(within + unknown)) }
    }
}

#[cfg(test)]
mod tests {
    use super::super::generator::{Run, draw};
    use super::*;

    #[test]
    fn some_moments_are_held_out_however_few_there_are() {
        for (bursts, held_out) in [(2, 1), (3, 1), (4, 2), (5, 2), (10, 4)] {
            let mut data = draw(&Run { channels: 12, bursts, ..Run::default() }, 4);
            // all channels at the same moments
            let mut heard = [0; 12];
            for row in &mut data.rows {
                row.beside.t_acq_ns = heard[row.unit];
                heard[row.unit] += 1;
            }
            let split = TrainTestSplit::of(&data, false, true).unwrap();
            let [train, test] = [split.train.len(), split.test.len()];
            assert_eq!((train + test, test), (data.len(), 12 * held_out), "{bursts}");
        }
    }
}
