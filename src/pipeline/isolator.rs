//! What the isolate stage does to a batch: one function per thing that happens to a signal.
//!
//! In: a batch with every signal's statistics and whether it passed the gate. Out: its rows.

use super::batches::{AssignedBatch, FilteredBatch, FlaggedSignal, GatedBatch, JudgedBatch};
use super::buffer_pools::BufferPools;
use super::rings::{self, Rings};
use super::rows::{self, Id, Row};
use crate::settings::{RingsOf, Settings};
use inkling_core::burst::{Acquisition, Burst};
use inkling_core::design::{Detection, Isolation, Judge, OwnChannels, Tested, Workspace};
use inkling_core::isolate::Likeness;
use inkling_core::verdict::{Appearance, Reason, Verdicts};
use std::sync::Arc;

/// One worker's.
pub struct Isolator<'a> {
    settings: &'a Settings,
    pools: &'a BufferPools,
    rings: Rings,
    work: Workspace,
    signal: Vec<f64>,
    expected: Vec<f64>,
}

/// Rows of a batch as they come to be.
struct Rows {
    verdicts: Verdicts,
    flagged: Vec<FlaggedSignal>,
}

/// A burst as it comes from the gate: with its judge, its channels' own levels, and every signal's statistics.
struct GatedBurst<'a> {
    burst: &'a Burst,
    judge: Result<&'a Judge, Reason>,
    own: Option<&'a OwnChannels>,
    /// Row by row.
    statistic: &'a [Result<Detection, Reason>],
    /// Its first signal's place in the batch.
    first: usize,
    /// Its place among the batch's.
    printhead: u32,
}

/// One signal of a burst that was judged.
#[derive(Clone, Copy)]
struct Signal<'a> {
    burst: &'a Burst,
    row: usize,
    judge: &'a Judge,
    own: Option<&'a OwnChannels>,
    detection: Detection,
    passed: bool,
}

impl Signal<'_> {
    /// Leaves it per unit drive.
    fn per_drive(&self, y: &mut Vec<f64>) {
        y.resize(self.burst.samples_per_channel as usize, 0.0);
        rings::per_drive(self.judge, self.burst, self.row, y);
    }
}

impl GatedBurst<'_> {
    fn id(&self, row: usize) -> Id {
        Id {
            t_ns: self.burst.t_acq_ns,
            printhead: self.printhead,
            channel: self.burst.first_channel + row as u32, // a burst has few
        }
    }
}

impl<'a> Isolator<'a> {
    pub fn new(settings: &'a Settings, pools: &'a BufferPools) -> Isolator<'a> {
        Isolator {
            settings,
            pools,
            rings: Rings::default(),
            work: Workspace::default(),
            signal: Vec::new(),
            expected: Vec::new(),
        }
    }

    /// All rows of a batch.
    pub fn judge(&mut self, gated: GatedBatch) -> JudgedBatch {
        self.rings.fit(&gated, !self.settings.isolate.gate);
        let GatedBatch { filtered, tests } = gated;
        let FilteredBatch { assigned: AssignedBatch { read, judges, own }, statistic } = filtered;
        let verdicts = Verdicts { parts: Vec::new(), tests, rows: self.pools.rows.take() };
        let mut rows = Rows { verdicts, flagged: Vec::new() };
        rows.verdicts.rows.clear();
        let mut from = 0;
        let mut own_of = Vec::new();
        for ((acquisition, judge), own) in read.batch.acquisitions.iter().zip(&judges).zip(&own) {
            let to = from + acquisition.rows();
            match acquisition {
                Acquisition::Unusable(unusable) => {
                    let columns = &mut rows.verdicts.rows;
                    let printhead = rows::intern(columns, &unusable.printhead);
                    let (t_ns, channel) = (unusable.t_acq_ns, unusable.first_channel);
                    let id = Id { t_ns, printhead, channel };
                    rows::push_rejected(columns, id, unusable.why.into());
                    rows.verdicts.close_rows();
                }
                Acquisition::Usable(burst) => {
                    let printhead = rows::intern(&mut rows.verdicts.rows, &burst.printhead);
                    let at = (burst.t_acq_ns, printhead);
                    if let Some(own) = own
                        .as_ref()
                        .filter(|_| own_of.last().is_none_or(|(t, p, _)| (*t, *p) != at))
                    {
                        own_of.push((at.0, at.1, own.clone()));
                    }
                    let gated = GatedBurst {
                        burst,
                        judge: judge.as_deref().map_err(|reason| *reason),
                        own: own.as_deref(),
                        statistic: &statistic[from..to],
                        first: from,
                        printhead,
                    };
                    self.judge_burst(&gated, &mut rows);
                }
            }
            from = to;
        }
        self.pools.statistic.give(statistic);
        JudgedBatch {
            place: read.batch.place,
            leaves: read.leaves,
            damage: read.damage,
            verdicts: rows.verdicts,
            judges: each_once(judges),
            own: own_of,
            flagged: rows.flagged,
            bursts: read.batch.acquisitions.len() as u64,
        }
    }

    /// Rows of one burst: runs of healthy signals at once, what is rejected or looked at closely one by one.
    fn judge_burst(&mut self, of: &GatedBurst, rows: &mut Rows) {
        let isolates_all = |judge: &Judge| !self.settings.isolate.gate && judge.can_isolate();
        let all_rings = self.settings.output.ring == RingsOf::All;
        let at_once = of.judge.ok().filter(|judge| !isolates_all(judge) && !all_rings);
        let mut expected_ready = false;
        let mut row = 0;
        while row < of.statistic.len() {
            let here = of.first + row;
            if let Some(judge) = at_once {
                let left = &rows.verdicts.tests.healthy[here..of.first + of.statistic.len()];
                let healthy = left.iter().take_while(|healthy| **healthy).count();
                if healthy > 0 {
                    let run = rows::healthy_run(of.id(row), here..here + healthy, judge);
                    rows.verdicts.parts.push(run);
                    row += healthy;
                    continue;
                }
            }
            match of.statistic[row].and_then(|detection| Ok((detection, of.judge?))) {
                Err(reason) => rows::push_rejected(&mut rows.verdicts.rows, of.id(row), reason),
                Ok((detection, judge)) => {
                    let (burst, passed) = (of.burst, !rows.verdicts.tests.healthy[here]);
                    let signal = Signal { burst, row, judge, own: of.own, detection, passed };
                    self.judge_signal(signal, of.id(row), &mut expected_ready, rows);
                }
            }
            rows.verdicts.close_rows();
            row += 1;
        }
    }

    /// The row of one signal. `expected_ready`: of its burst.
    fn judge_signal(&mut self, of: Signal, id: Id, expected_ready: &mut bool, rows: &mut Rows) {
        self.work.forget();
        let isolates = of.judge.can_isolate() && (of.passed || !self.settings.isolate.gate);
        let mut isolation = isolates.then(|| self.isolate(of, expected_ready)).flatten();
        let beside_only = of.passed && !of.judge.is_faulty_ring(of.detection);
        if beside_only || (of.passed && !of.judge.can_isolate() && self.is_no_ring(of)) {
            // along the ring it is healthy: what else it holds is none of a fault's; or there is no ring
            self.work.severity = None;
            self.work.weights.clear();
            isolation = Some(Isolation::of_no_ring());
        }
        let mut tested: Tested = of.judge.test(of.detection);
        if tested.misfit.is_nan() && isolation.is_some() {
            tested.misfit = self.work.misfit;
        }
        let ring = self.ring_of(of, expected_ready);
        if of.passed {
            let flagged = self.flag(of, isolation.as_ref(), ring, rows.verdicts.rows.len());
            rows.flagged.push(flagged);
        }
        let told = self.settings.output.weights && isolation.is_some();
        let weights = Some(self.work.weights.as_slice()).filter(|of| told && !of.is_empty());
        let (isolation, model) = (isolation.as_ref(), of.judge.index);
        let columns = &mut rows.verdicts.rows;
        rows::push_judged(columns, id, Row { tested, model, isolation, weights, ring });
        rows::set_severity(columns, self.work.severity.take());
    }

    /// Names a signal, where the method can: by its fitted ring, or by its deviation from what is expected.
    fn isolate(&mut self, of: Signal, expected_ready: &mut bool) -> Option<Isolation> {
        let Signal { burst, row, judge, .. } = of;
        let channel = burst.first_channel.saturating_add(row as u32);
        self.work.own = of.own.and_then(|own| own.of(channel));
        self.work.warmer = judge.warmer(burst);
        let drive = judge.drive(burst);
        if let Some(fit) = judge.rings().and_then(|_| self.rings.take()) {
            return judge.isolate_ring(fit.as_ref(), drive, |y| of.per_drive(y), &mut self.work);
        }
        self.deviate(of, expected_ready);
        judge.isolate(&self.signal, drive, &mut self.work)
    }

    /// Leaves a signal's deviation from what is expected in `signal`. `expected_ready`: of its burst.
    fn deviate(&mut self, Signal { burst, row, judge, .. }: Signal, expected_ready: &mut bool) {
        let n = burst.samples_per_channel as usize;
        self.signal.resize(n, 0.0);
        if !*expected_ready {
            self.expected.resize(n, 0.0);
            judge.expect(burst, &mut self.expected);
            *expected_ready = true;
        }
        burst.copy_signal(row, &mut self.signal);
        judge.deviate(burst, row, &self.expected, &mut self.signal);
    }

    /// Resonance, Hz, and damping, 1/s: of what is flagged by a fit, of the rest, where that is asked for, in closed form.
    fn ring_of(&mut self, of: Signal, expected_ready: &mut bool) -> Option<[f64; 2]> {
        let Signal { burst, judge, passed, .. } = of;
        let (drive, copy) = (judge.drive(burst), |y: &mut Vec<f64>| of.per_drive(y));
        match (passed, self.settings.output.ring) {
            (true, _) => judge.ring_of(copy, drive, &mut self.work),
            (false, RingsOf::Flagged) => None,
            (false, RingsOf::All) => {
                self.deviate(of, expected_ready);
                let warmer = judge.warmer(burst);
                let ring = judge.ring_in_closed_form(&self.signal, drive, warmer);
                ring.or_else(|| judge.ring_of(copy, drive, &mut self.work))
            }
        }
    }

    /// What is remembered of a flagged signal for the evidence over time. `row`: among its batch's.
    fn flag(
        &mut self,
        of: Signal,
        isolation: Option<&Isolation>,
        ring: Option<[f64; 2]>,
        row: usize,
    ) -> FlaggedSignal {
        let strange = isolation.is_some_and(|isolation| isolation.likeness != Likeness::Known);
        let poles = of.judge.model.identification.poles;
        let relative = |[f, damping]: [f64; 2]| {
            [(damping / poles.damping_per_s).ln(), (f / poles.frequency_hz).ln()]
        };
        let alternative = self.work.alternative.take();
        let appearance = alternative.or_else(|| strange.then(|| self.appearance(of)).flatten());
        FlaggedSignal {
            appearance,
            row: row as u32, // a batch is far smaller
            weights: self.work.weights.iter().map(|&w| (w * self.work.of_any) as f32).collect(),
            ring: self.work.ring.or(ring.map(relative)),
        }
    }

    /// Whether a flagged signal rings at all, where no classes are known.
    fn is_no_ring(&mut self, of: Signal) -> bool {
        of.per_drive(&mut self.signal);
        of.judge.is_no_ring(&self.signal, of.judge.drive(of.burst), &mut self.work)
    }

    /// What a signal looks like that belongs to no class.
    fn appearance(&mut self, of: Signal) -> Option<Appearance> {
        of.per_drive(&mut self.signal);
        of.judge.appearance(&self.signal, of.judge.drive(of.burst), &mut self.work)
    }
}

/// Judges of a batch by their numbers.
fn each_once(judges: Vec<Result<Arc<Judge>, Reason>>) -> Vec<Arc<Judge>> {
    let mut judges: Vec<Arc<Judge>> = judges.into_iter().flatten().collect();
    judges.sort_by_key(|judge| judge.index);
    judges.dedup_by_key(|judge| judge.index);
    judges
}
