//! Channels' own baselines while the signals flow, in the filter stage: signals are judged by them, and what they say
//! is remembered.
//!
//! In: batches with their statistics. Out: the statistics of signals whose channel has a baseline, and per worker what
//! it heard. Sums do not depend on the order of the signals ([`Heard`]), so workers need not wait for each other.

use super::baseline::{HeardOf, InUse, Told};
use super::statistics::Statistics;
use crate::burst::{Acquisition, Burst};
use crate::design::{Detection, Judge, JudgeKey, OwnChannels, Said};
use crate::verdict::Reason;
use nalgebra::{Matrix3, Vector4};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Whoever waits looks up so often whether the run goes on.
const PATIENCE: Duration = Duration::from_millis(20);

/// What all filter workers share.
#[derive(Debug)]
pub struct Hearing<'a> {
    pub in_use: &'a InUse,
    /// Channels that a worker may meet, at most. `None`: what there is to hear was heard before.
    room: Option<usize>,
    workers: Mutex<Vec<Arc<Mutex<HeardOf>>>>,
    /// Batches that were heard.
    batches: Mutex<u64>,
    changed: Condvar,
}

/// One worker's.
pub struct Listener<'a> {
    hearing: &'a Hearing<'a>,
    heard: Arc<Mutex<HeardOf>>,
    room: usize,
    features: Vec<Vector4<f64>>,
    said: Vec<Option<Said>>,
    metric: Option<Metric>,
}

/// A batch that is at work: once this is dropped it counts as heard, whatever became of it, since somebody may wait.
pub struct AtWork<'a>(&'a Hearing<'a>);

impl Drop for AtWork<'_> {
    fn drop(&mut self) {
        *lock(&self.0.batches) += 1;
        self.0.changed.notify_all();
    }
}

fn lock<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<'a> Hearing<'a> {
    pub fn new(in_use: &'a InUse, room: Option<usize>) -> Hearing<'a> {
        Hearing {
            in_use,
            room,
            workers: Mutex::default(),
            batches: Mutex::default(),
            changed: Condvar::new(),
        }
    }

    /// Whether anything is still to be learned.
    pub fn hears(&self) -> bool {
        self.room.is_some()
    }

    pub fn listener(&'a self) -> Listener<'a> {
        let heard = Arc::<Mutex<HeardOf>>::default();
        lock(&self.workers).push(heard.clone());
        let room = self.room.unwrap_or_default();
        let (features, said, metric) = (Vec::new(), Vec::new(), None);
        Listener { hearing: self, heard, room, features, said, metric }
    }

    pub fn at_work(&'a self) -> AtWork<'a> {
        AtWork(self)
    }

    /// Waits until so many batches were heard. False: `ended`.
    pub fn wait_for(&self, batches: u64, ended: impl Fn() -> bool) -> bool {
        let mut heard = lock(&self.batches);
        while *heard < batches {
            if ended() {
                return false;
            }
            let waited = self.changed.wait_timeout(heard, PATIENCE);
            heard = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        true
    }

    /// What all workers have heard of a printhead so far.
    pub fn of(&self, printhead: &str) -> Told {
        let mut all = Told::default();
        for worker in lock(&self.workers).iter() {
            if let Some(told) = lock(worker).get(printhead) {
                all.add(told);
            }
        }
        all
    }

    /// What all workers have heard.
    pub fn all(&self) -> HeardOf {
        let mut all = HeardOf::new();
        for worker in lock(&self.workers).iter() {
            for (printhead, told) in lock(worker).iter() {
                all.entry(printhead.clone()).or_default().add(told);
            }
        }
        all
    }
}

impl Listener<'_> {
    /// Judges again by its own baseline every signal of a batch that has one, and hears all. `heard`: acquisitions that
    /// were heard before; empty: none.
    pub fn judge(
        &mut self,
        acquisitions: &[Acquisition],
        judges: &[Result<Arc<Judge>, Reason>],
        heard: &[bool],
        statistics: &mut Statistics,
        statistic: &mut [Result<Detection, Reason>],
    ) {
        let mut first = 0;
        for (i, (acquisition, judge)) in acquisitions.iter().zip(judges).enumerate() {
            let rows = first..first + acquisition.rows();
            first = rows.end;
            let (Acquisition::Usable(burst), Ok(judge)) = (acquisition, judge) else { continue };
            let hears = self.hearing.hears() && !heard.get(i).is_some_and(|heard| *heard);
            self.judge_burst(burst, judge, hears, statistics, &mut statistic[rows]);
        }
    }

    fn judge_burst(
        &mut self,
        burst: &Burst,
        judge: &Judge,
        hears: bool,
        statistics: &mut Statistics,
        statistic: &mut [Result<Detection, Reason>],
    ) {
        let Some(detector) = judge.detector() else { return };
        let own = self.hearing.in_use.at(&burst.printhead, burst.t_acq_ns);
        if own.is_none() && !hears {
            return;
        }
        statistics.features(judge, burst, &mut self.features);
        self.said.clear();
        let said = |of: (&Result<Detection, Reason>, &Vector4<f64>)| {
            let (found, features) = (of.0.ok()?, *of.1);
            Some(Said { features, healthy: !judge.test(found).is_flagged() })
        };
        self.said.extend(statistic.iter().zip(&self.features).map(said));
        let [near, estranged] = match own {
            Some(own) => self.judge_by(&own, burst, judge, statistics, statistic),
            None => [0; 2],
        };
        if hears {
            let mut heard = lock(&self.heard);
            let told = heard.entry(burst.printhead.clone()).or_default();
            told.near += near;
            told.estranged += estranged;
            told.meet(judge, detector.own_noise());
            told.heard.take(burst.first_channel, &self.said, judge.drive(burst), &mut self.room);
        }
    }

    /// Judges a burst's signals by their channels' baselines. How many of these look healthy beside all channels, and how
    /// many of them do not beside their own.
    fn judge_by(
        &mut self,
        own: &Arc<OwnChannels>,
        burst: &Burst,
        judge: &Judge,
        statistics: &mut Statistics,
        statistic: &mut [Result<Detection, Reason>],
    ) -> [u64; 2] {
        let (drive, threshold) = (judge.drive(burst), judge.model.threshold.value);
        let (mut near, mut estranged) = (0, 0);
        let known = own.from(burst.first_channel, statistic.len());
        for (row, (found, known)) in statistic.iter_mut().zip(known).enumerate() {
            let (Ok(of_all), Some(known)) = (*found, known) else { continue };
            let features = &self.features[row];
            let metric = Metric::of(&mut self.metric, judge, own, known.signals, drive);
            let distance = metric.zip(judge.detector()).map(|(metric, detector)| {
                match detector.own_look(metric, features, known) {
                    (distance, true) => distance,
                    (distance, false) => statistics
                        .own_distance((judge, burst, row), metric, (features, known))
                        .unwrap_or(distance),
                }
            });
            let ring = distance.map_or(f64::INFINITY, |distance| judge.of_own(distance, own));
            *found = match ring.is_finite() {
                true => Ok(Detection { ring, ..of_all }),
                false => Err(Reason::NonFinite),
            };
            if let Some(said) = &mut self.said[row]
                && said.healthy
            {
                said.healthy = ring <= threshold;
                near += 1;
                estranged += u64::from(!said.healthy);
            }
        }
        [near, estranged]
    }
}

/// The metric of distances from baselines, of the signal before: most signals have the same.
struct Metric {
    judge: JudgeKey,
    own: Arc<OwnChannels>,
    signals: f64,
    drive: f64,
    metric: Option<Matrix3<f64>>,
}

impl Metric {
    /// Of baselines that rest on so many signals, for signals of one drive.
    fn of<'a>(
        last: &'a mut Option<Metric>,
        judge: &Judge,
        own: &Arc<OwnChannels>,
        signals: f64,
        drive: f64,
    ) -> Option<&'a Matrix3<f64>> {
        let is_it = |of: &&mut Metric| {
            (of.judge, of.signals, of.drive) == (judge.key(), signals, drive)
                && Arc::ptr_eq(&of.own, own)
        };
        if last.as_mut().filter(is_it).is_none() {
            let metric = judge.detector().and_then(|by| by.own_metric(own, signals, drive));
            *last = Some(Metric { judge: judge.key(), own: own.clone(), signals, drive, metric });
        }
        last.as_ref()?.metric.as_ref()
    }
}
