//! Computes how far signals deviate from what their judges expect of them.

use inkling_core::burst::Burst;
use inkling_core::design::{Judge, JudgeKey};

/// The buffers for one signal after the other.
#[derive(Debug, Default)]
pub(super) struct Deviations {
    /// The signal at hand: as it was acquired, or its deviation.
    pub signal: Vec<f64>,
    expected: Vec<f64>,
    /// What `expected` was computed for: judge, drive and temperature, the latter two as bits.
    expected_of: Option<(JudgeKey, u64, Option<u64>)>,
}

impl Deviations {
    /// Copies a signal, counts.
    pub fn copy(&mut self, burst: &Burst, row: usize) -> &[f64] {
        self.signal.resize(burst.samples_per_channel as usize, 0.0);
        burst.copy_signal(row, &mut self.signal);
        &self.signal
    }

    /// Turns the signal that was copied into its deviation from what is expected of it.
    pub fn deviate(&mut self, judge: &Judge, burst: &Burst, row: usize) -> &[f64] {
        // bursts that follow each other mostly expect the same signal
        let drive = judge.drive(burst).to_bits();
        let of = (judge.key(), drive, burst.temperature_c.map(f64::to_bits));
        let n = self.signal.len();
        if self.expected_of != Some(of) || self.expected.len() != n {
            self.expected.resize(n, 0.0);
            judge.expect(burst, &mut self.expected);
            self.expected_of = Some(of);
        }
        judge.deviate(burst, row, &self.expected, &mut self.signal);
        &self.signal
    }
}
