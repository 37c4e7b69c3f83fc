//! Signals with what was recorded with them: what parameters, thresholds and classes are learned from.
//!
//! In: the signals of a window, or those that one label names, of one printhead: n signals of N
//! samples, counts. Out: the same row by row, with channel, drive, temperature and severity.

use crate::burst::Beside;

#[derive(Clone, Debug, Default)]
pub struct SignalSet {
    pub samples: usize,
    /// The rows, concatenated, counts. Samples of int16 and of float are both exact in f32.
    pub data: Vec<f32>,
    pub channel: Vec<u32>,
    /// Acquisition time of each signal's burst, ns since the epoch.
    pub t_acq_ns: Vec<i64>,
    /// Over the reference voltage; 1 where it was not recorded.
    pub drive: Vec<f64>,
    /// Temperature of each signal, °C; NaN where it was not recorded.
    pub temperature_c: Vec<f64>,
    /// Severity that the signal's label gives; NaN where it gives none.
    pub severity: Vec<f64>,
}

impl SignalSet {
    pub fn new(samples: usize) -> SignalSet {
        SignalSet { samples, ..SignalSet::default() }
    }

    pub fn len(&self) -> usize {
        self.channel.len()
    }

    pub fn is_empty(&self) -> bool {
        self.channel.is_empty()
    }

    pub fn signal(&self, i: usize) -> &[f32] {
        &self.data[i * self.samples..(i + 1) * self.samples]
    }

    /// Adds a signal, N counts, without a severity. `drive`: relative to the reference.
    pub fn push(&mut self, signal: &[f32], drive: f64, beside: &Beside) {
        debug_assert_eq!(signal.len(), self.samples);
        self.data.extend_from_slice(signal);
        self.channel.push(beside.channel);
        self.t_acq_ns.push(beside.t_acq_ns);
        self.drive.push(drive);
        self.temperature_c.push(beside.temperature_c);
        self.severity.push(f64::NAN);
    }

    /// Of the signal last pushed.
    pub fn set_severity(&mut self, severity: f64) {
        if let Some(last) = self.severity.last_mut() {
            *last = severity;
        }
    }

    /// What was recorded beside a signal, as far as it is held.
    pub fn beside(&self, i: usize) -> Beside {
        let alone = Beside::alone(self.channel[i], self.t_acq_ns[i]);
        Beside { temperature_c: self.temperature_c[i], ..alone }
    }

    pub fn select(&self, keep: &[usize]) -> SignalSet {
        let mut chosen = SignalSet::new(self.samples);
        for &i in keep {
            chosen.push(self.signal(i), self.drive[i], &self.beside(i));
            chosen.set_severity(self.severity[i]);
        }
        chosen
    }

    /// The same signals with `offset`, counts, taken off all samples.
    pub fn less(&self, offset: f64) -> SignalSet {
        let data = self.data.iter().map(|y| (f64::from(*y) - offset) as f32).collect();
        SignalSet { data, ..self.clone() }
    }

    pub fn first(&self, most: usize) -> SignalSet {
        self.select(&(0..self.len().min(most)).collect::<Vec<_>>())
    }

    /// Mean of the recorded temperatures, °C; `None`: none was recorded.
    pub fn mean_temperature_c(&self) -> Option<f64> {
        let known: Vec<f64> =
            self.temperature_c.iter().copied().filter(|t| t.is_finite()).collect();
        (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
    }
}
