//! Few, long decays of one system, in the form in which the plant is fitted to them.
//!
//! In: observations, one row for each output (channel) of each burst. Out: [`Decays`]: complete bursts in the
//! order of their times (of many a few), every output divided by its largest deviation from its mean (which
//! is not subtracted), the output with the largest variance first: it counts as the displacement.

use super::noise::sizes;
use crate::critique::candidates::LEAST_PERIODS;
use crate::critique::observations::Observations;
use crate::critique::outcome::CritiqueError;
use crate::critique::work::Work;
use std::f64::consts::TAU;

/// The fit has two numbers for each burst and for each output, and its time grows with their cube.
const MOST_BURSTS: usize = 32;
const MOST_OUTPUTS: usize = 64;
/// Longer decays are cut to so many samples, by whoever reads them.
pub const MOST_SAMPLES: usize = 32_768;
/// Largest number of samples in all, for reasonable time.
const MOST_IN_ALL: usize = 8 * MOST_SAMPLES;

#[derive(Clone, Debug)]
pub struct Decays {
    pub dt_s: f64,
    /// Numbers of complete bursts that are looked at, of outputs, and of samples of each.
    pub bursts: usize,
    pub outputs: usize,
    pub samples: usize,
    /// How many samples of the record come before the first one that is looked at.
    pub skipped: usize,
    /// The scaled samples: bursts x outputs x samples.
    pub y: Vec<f64>,
    pub channels: Vec<u32>,
    /// What each output was divided by, in the unit of the recording ("counts").
    pub scale: Vec<f64>,
    /// Whether all samples of all complete bursts are looked at.
    pub whole: bool,
    pub incomplete: usize,
    /// Told while they are worked on.
    pub work: Work,
}

impl Decays {
    /// Error: there are several printheads, too many outputs or no complete bursts, or an output never moves.
    pub fn of(data: &Observations) -> Result<Decays, CritiqueError> {
        if data.printheads.len() > 1 {
            return Err(CritiqueError::SeveralPrintheads { printheads: data.printheads.len() });
        }
        let mut channels: Vec<u32> = data.rows.iter().map(|r| r.beside.channel).collect();
        channels.sort_unstable();
        channels.dedup();
        if channels.len() > MOST_OUTPUTS {
            return Err(CritiqueError::ManyOutputs { outputs: channels.len(), most: MOST_OUTPUTS });
        }

        // the rows of each burst, which come in the order of channels; of a repeated one the last counts
        let mut all: Vec<Vec<usize>> = vec![Vec::new(); data.bursts];
        for (i, row) in data.rows.iter().enumerate() {
            let of = &mut all[row.burst];
            of.pop_if(|last| data.rows[*last].beside.channel == row.beside.channel);
            of.push(i);
        }
        all.retain(|of| of.len() == channels.len());
        all.sort_by_key(|b| data.rows[b[0]].beside.t_acq_ns);
        if all.is_empty() {
            return Err(CritiqueError::NoCompleteBurst { outputs: channels.len() });
        }
        let n = data.samples.min(MOST_IN_ALL / channels.len());
        let most = all.len().min(MOST_BURSTS).min(MOST_IN_ALL / (channels.len() * n));
        let looked_at: Vec<&Vec<usize>> = (0..most).map(|k| &all[k * all.len() / most]).collect();
        let signal = |i: usize| &data.signal(i)[..n];

        // of each output the largest deviation from its mean, and the sum of squares about it
        let spread = |o: usize| -> (f64, f64) {
            let each = || looked_at.iter().flat_map(|b| signal(b[o])).map(|y| f64::from(*y));
            let mean = each().sum::<f64>() / (n * most) as f64;
            let largest = each().fold(0.0_f64, |m, y| m.max((y - mean).abs()));
            (largest, each().map(|y| (y - mean).powi(2)).sum::<f64>())
        };
        let mut order: Vec<usize> = (0..channels.len()).collect();
        order.sort_by(|p, q| spread(*q).1.total_cmp(&spread(*p).1));
        let scale: Vec<f64> = order.iter().map(|&o| spread(o).0).collect();
        if let Some(still) = scale.iter().position(|s| s.is_nan() || *s <= 0.0) {
            return Err(CritiqueError::StillOutput { channel: channels[order[still]] });
        }

        let mut y = Vec::with_capacity(most * order.len() * n);
        for burst in &looked_at {
            for (&o, s) in order.iter().zip(&scale) {
                y.extend(signal(burst[o]).iter().map(|v| f64::from(*v) / s));
            }
        }
        Ok(Decays {
            dt_s: data.dt_s,
            skipped: 0,
            bursts: most,
            outputs: order.len(),
            samples: n,
            y,
            channels: order.iter().map(|&o| channels[o]).collect(),
            scale,
            whole: most == all.len() && n == data.samples,
            incomplete: data.bursts - all.len(),
            work: data.work.clone(),
        })
    }

    /// The same decays, from a later sample on.
    pub fn from(&self, skipped: usize) -> Decays {
        let y =
            self.y.chunks(self.samples).flat_map(|series| &series[skipped..]).copied().collect();
        let samples = self.samples - skipped;
        Decays { samples, skipped: self.skipped + skipped, y, ..self.clone() }
    }

    /// Time since the record's begin of a sample, counted as in `y`.
    pub fn time_s(&self, sample: usize) -> f64 {
        (self.skipped + sample % self.samples) as f64 * self.dt_s
    }

    /// The slowest frequency of a ring, or a line, per sample.
    pub fn lowest_line(&self) -> f64 {
        TAU * LEAST_PERIODS / self.samples as f64
    }

    /// Values (ordered as `y`), less the mean of each series.
    pub fn centred(&self, values: &[f64]) -> Vec<f64> {
        let mut centred = values.to_vec();
        for series in centred.chunks_mut(self.samples) {
            let mean = series.iter().sum::<f64>() / series.len() as f64;
            series.iter_mut().for_each(|v| *v -= mean);
        }
        centred
    }

    /// Root mean square of each output about its mean in each burst.
    pub fn movement(&self) -> Vec<f64> {
        sizes(&self.centred(&self.y), self)
    }

    /// Logarithm of the number of samples: the price of a parameter in the Bayesian information criterion.
    pub fn ln_samples(&self) -> f64 {
        (self.y.len() as f64).ln()
    }

    /// The parts of `values` (ordered as `y`) that belong to one output, burst by burst.
    pub fn of_output<'a>(
        &self,
        values: &'a [f64],
        output: usize,
    ) -> impl Iterator<Item = &'a [f64]> + use<'a> {
        values.chunks(self.samples).skip(output).step_by(self.outputs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::critique::observations::Sampler;
    use inkling_core::burst::Beside;

    /// Two outputs of which the second has the samples `second`, in bursts of these times.
    fn outputs(second: &[f64], t_acq_ns: [i64; 2]) -> Result<Decays, CritiqueError> {
        let first: Vec<f64> = (0..second.len()).map(|k| (0.7 * k as f64).cos()).collect();
        let mut sampler = Sampler::new(1e-3, usize::MAX);
        for (channel, y) in [&first[..], second].into_iter().enumerate() {
            sampler.offer("one", Beside::alone(channel as u32, t_acq_ns[channel]), y);
        }
        Decays::of(&sampler.finish())
    }

    #[test]
    fn what_is_no_decay_of_all_outputs_is_told() {
        let rings: Vec<f64> = (0..64).map(|k| (0.7 * k as f64).sin()).collect();
        assert!(outputs(&rings, [0, 0]).is_ok());
        let apart = outputs(&rings, [0, 1_000_000_000]);
        assert!(matches!(apart, Err(CritiqueError::NoCompleteBurst { outputs: 2 })), "{apart:?}");
        let mut sampler = Sampler::new(1e-3, usize::MAX);
        for name in ["one", "other"] {
            sampler.offer(name, Beside::alone(0, 0), &rings);
        }
        let several = Decays::of(&sampler.finish());
        let two = matches!(several, Err(CritiqueError::SeveralPrintheads { printheads: 2 }));
        assert!(two, "{several:?}");
        let still = outputs(&[3.0; 64], [0, 0]);
        assert!(matches!(still, Err(CritiqueError::StillOutput { channel: 1 })), "{still:?}");
    }
}
