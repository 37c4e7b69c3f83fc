//! Splits signals into a part that models are fitted to and a part that they are judged on ([`TrainTestSplit`], by
//! channel, by time or by both), and fits models to a part.

use super::candidates::{Applied, Setting};
use super::model::Model;
use super::observations::Observations;
use super::population::FEWEST_UNITS;
use super::refit::{apply, refit};
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
