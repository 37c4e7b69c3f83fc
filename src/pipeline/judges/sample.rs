//! Reads the signals of a window that were chosen, and puts them into an order that depends on nothing but the
//! signals: numbers of channels are given anew by what the channels measured.
//!
//! In: windows with the times of the bursts to read ([`Window`]). Out: for each the usable signals, healthy ones where
//! labels say which are ([`read`]), as a [`SignalSet`] ([`Sample::to_set`]).

use super::super::Result;
use super::super::groups::GroupKey;
use super::super::run::Replay;
use super::super::visit;
use super::survey::Window;
use super::windows::Ahead;
use inkling_core::burst::{Beside, Burst};
use inkling_core::design::DesignError;
use inkling_core::identify::IdentifyError;
use inkling_core::identify::SignalSet;
use inkling_core::identify::reservoir::{drawn_by, relative_drive};
use inkling_core::verdict::{Reason, unusable_signal};
use std::cmp::Ordering;
use std::collections::{BTreeMap, HashMap};
use std::ops::ControlFlow;

#[derive(Debug)]
struct Kept {
    beside: Beside,
    samples: Vec<f32>,
}

impl Kept {
    /// A number that looks random, by time and samples alone.
    fn drawn(&self) -> u64 {
        let of = |drawn: u64, y: &f32| drawn_by((drawn ^ u64::from(y.to_bits())) as i64);
        self.samples.iter().fold(drawn_by(self.beside.t_acq_ns), of)
    }

    /// Compares the samples, one after the other.
    fn by_samples(&self, other: &Kept) -> Ordering {
        let mut pairs = self.samples.iter().zip(&other.samples);
        pairs
            .try_for_each(|(p, q)| match p.total_cmp(q) {
                Ordering::Equal => ControlFlow::Continue(()),
                unequal => ControlFlow::Break(unequal),
            })
            .break_value()
            .unwrap_or(Ordering::Equal)
    }
}

/// The signals of a window.
#[derive(Debug, Default)]
pub struct Sample {
    samples: usize,
    most: usize,
    kept: Vec<Kept>,
    /// Number of signals that cannot be used, by why.
    unusable: BTreeMap<Reason, u64>,
}

impl Sample {
    fn take(&mut self, replay: &Replay, burst: &Burst) {
        let mut signal = vec![0.0; self.samples];
        for row in 0..burst.channels as usize {
            let beside = burst.beside(row);
            if !visit::is_healthy(replay.labels.as_ref(), burst, beside.channel) {
                continue;
            }
            burst.copy_signal(row, &mut signal);
            if let Some(why) = unusable_signal(&signal, replay.settings.input.rails) {
                *self.unusable.entry(why).or_default() += 1;
            } else {
                if let Some(design) = &replay.design {
                    design.take_off_extension(burst, row, &mut signal);
                }
                let samples = signal.iter().map(|&y| y as f32).collect();
                self.kept.push(Kept { beside, samples });
            }
        }
        // a moment may hold any number of bursts, of a recorder whose clock stands
        if self.kept.len() > 2 * self.most.max(burst.channels as usize) {
            self.kept.sort_by_cached_key(Kept::drawn);
            self.kept.dedup_by_key(|of| of.drawn());
            self.kept.truncate(self.most);
        }
    }

    /// Numbers the channels, the first being the one whose first signal is the least, and puts the signals in an
    /// order. A signal that was recorded twice counts once.
    fn sort(&mut self) {
        let by_time = |p: &Kept, q: &Kept| {
            let key = |of: &Kept| (of.beside.channel, of.beside.t_acq_ns);
            key(p).cmp(&key(q)).then_with(|| p.by_samples(q))
        };
        self.kept.sort_by(by_time);
        self.kept.dedup_by(|p, q| by_time(p, q).is_eq());

        let mut firsts: Vec<&Kept> = self.kept.iter().collect();
        firsts.dedup_by_key(|of| of.beside.channel);
        firsts.sort_by(|p, q| p.by_samples(q));
        let number: HashMap<u32, u32> =
            firsts.iter().map(|of| of.beside.channel).zip(0..).collect();
        self.kept.iter_mut().for_each(|of| of.beside.channel = number[&of.beside.channel]);
        // moments in an order that looks random: who learns from the first signals alone learns from all channels
        let first_ns = self.kept.iter().map(|of| of.beside.t_acq_ns).min().unwrap_or(0);
        self.kept.sort_by_cached_key(|Kept { beside, .. }| {
            (drawn_by(beside.t_acq_ns.saturating_sub(first_ns)), beside.channel)
        });
        self.kept.truncate(self.most);
    }

    /// Why nothing can be learned from these signals, with what helps. `labelled`: labels tell what is healthy.
    pub fn advice(&self, e: &DesignError, labelled: bool) -> String {
        let commonest = self.unusable.iter().max_by_key(|(_, n)| **n);
        match (e, commonest) {
            (DesignError::Identify(IdentifyError::TooFewSignals { found, .. }), Some((why, n)))
                if *n > *found as u64 =>
            {
                let rails = match why {
                    Reason::Saturated => ": these are input.rails, by default those of 16 bits",
                    _ => "",
                };
                format!("{e}, and {n} others cannot be used: {}{rails}", why.in_words())
            }
            _ => e.advice(labelled),
        }
    }

    /// Mean of the recorded drive voltages, V; `None`: none was recorded.
    pub fn mean_voltage(&self) -> Option<f64> {
        let all = self.kept.iter().map(|of| of.beside.drive_v);
        let known: Vec<f64> = all.filter(|v| *v > 0.0 && v.is_finite()).collect();
        (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
    }

    /// The signals with drives relative to `reference_v`.
    pub fn to_set(&self, reference_v: Option<f64>) -> SignalSet {
        let mut set = SignalSet::new(self.samples);
        for Kept { beside, samples } in &self.kept {
            let drive = relative_drive(beside.drive_v, reference_v);
            set.push(samples, drive, beside);
        }
        set
    }
}

/// Reads what was chosen of some windows, in their order; `last`: index of the last block that may hold some of it.
pub fn read(replay: &Replay, ahead: &Ahead, last: u64, windows: &[Window]) -> Result<Vec<Sample>> {
    let number: BTreeMap<&GroupKey, usize> = windows.iter().map(|of| &of.key).zip(0..).collect();
    let sample = |of: &Window| Sample {
        samples: of.key.samples as usize,
        most: of.most,
        ..Sample::default()
    };
    let mut all: Vec<Sample> = windows.iter().map(sample).collect();
    if windows.iter().all(|of| of.chosen.is_empty()) {
        return Ok(all);
    }
    ahead.read(Some(last), |_, burst| {
        let found = number.get(&GroupKey::of(burst));
        if let Some(&n) = found.filter(|&&n| windows[n].chosen.contains(&burst.t_acq_ns)) {
            all[n].take(replay, burst);
        }
        ControlFlow::Continue(())
    })?;
    all.iter_mut().for_each(Sample::sort);
    Ok(all)
}
