//! What the isolate stage does to a batch, with one function for each thing that may happen to a signal.
//!
//! In: a batch with every signal's statistics and whether it was flagged. Out: its verdicts (rows of the
//! table), and what the episodes need to know of flagged signals ([`FlaggedSignal`]).
//!
//! Nearly all signals are healthy: neighbouring healthy signals of a burst become one run (`judge_burst`).
//! Each other signal becomes a row: a rejected one with its reason; a flagged one with its name, its size and
//! its ring, as far as the judge can tell them (`judge_signal`, `isolate`). What misses along the ring and is
//! no ring at all is named `no_ring`, whatever class would come nearest.

use super::batches::{
    AssignedJudge, BufferPools, Detected, FilteredBatch, FlaggedSignal, GatedBatch, JudgedBatch,
};
use super::head_clock::Standing;
use super::rings::{self, Deviations, Rings};
use super::rows::{self, Id, Row};
use crate::settings::{RingsOf, Settings};
use inkling_core::burst::{Acquisition, Burst};
use inkling_core::design::{Detection, Isolation, Judge, OwnChannels, Tested, Workspace};
use inkling_core::episodes;
use inkling_core::isolate::Likeness;
use inkling_core::verdict::{Appearance, Reason, Verdicts};
use std::sync::Arc;

pub struct Isolator<'a> {
    settings: &'a Settings,
    pools: &'a BufferPools,
    /// Rings that were fitted to the signals of the batch at hand, and not taken yet.
    rings: Rings,
    work: Workspace,
    deviations: Deviations,
}

struct GatedBurst<'a> {
    burst: &'a Burst,
    judge: Result<&'a Judge, Reason>,
    own: Option<&'a OwnChannels>,
    statistic: &'a [Detected],
    first: usize,
    /// What identifies its first signal.
    id: Id,
}

#[derive(Clone, Copy)]
struct Signal<'a> {
    burst: &'a Burst,
    row: usize,
    judge: &'a Judge,
    own: Option<&'a OwnChannels>,
    detection: Detection,
    is_flagged: bool,
}

impl Signal<'_> {
    fn per_drive(&self, y: &mut Vec<f64>) {
        y.resize(self.burst.samples_per_channel as usize, 0.0);
        rings::per_drive(self.judge, self.burst, self.row, y);
    }
}

impl<'a> Isolator<'a> {
    pub fn new(settings: &'a Settings, pools: &'a BufferPools) -> Isolator<'a> {
        Isolator {
            settings,
            pools,
            rings: Rings::default(),
            work: Workspace::default(),
            deviations: Deviations::default(),
        }
    }

    /// Makes all rows of a batch, and gives the buffer of its statistics back.
    pub fn judge(&mut self, gated: GatedBatch) -> JudgedBatch {
        // all rings of the batch are fitted first, side by side, and then taken row by row
        self.rings.fit(&gated, !self.settings.isolate.gate);

        let GatedBatch { filtered, tests } = gated;
        let FilteredBatch { mut assigned, statistic } = filtered;
        let mut columns = self.pools.rows.take();
        columns.clear();
        let read = &mut assigned.read;
        let mut judged = JudgedBatch {
            place: read.batch.place,
            leaves: read.leaves,
            damage: std::mem::take(&mut read.damage),
            verdicts: Verdicts { parts: Vec::new(), tests, rows: columns },
            bursts: read.batch.acquisitions.len() as u64,
            ..JudgedBatch::default()
        };

        // burst by burst; an unusable burst is one row, with the reason
        for (signals, acquisition, AssignedJudge { judge, own, standing }) in assigned.placed() {
            let columns = &mut judged.verdicts.rows;
            match acquisition {
                Acquisition::Unusable(unusable) => {
                    let printhead = rows::intern(columns, &unusable.printhead);
                    let (t_ns, channel) = (unusable.t_acq_ns, unusable.first_channel);
                    let id = Id { t_ns, printhead, channel };
                    rows::push_rejected(columns, id, unusable.why);
                    judged.verdicts.close_rows();
                }
                Acquisition::Usable(burst) => {
                    let t_ns = burst.t_acq_ns;
                    let printhead = rows::intern(columns, &burst.printhead);
                    if *standing != Standing::InOrder {
                        judged.out_of_order.insert((t_ns, printhead), *standing);
                    }
                    // own levels are the same for all bursts of a moment: they are noted once
                    let last = judged.own.last().map(|(t_ns, printhead, _)| (*t_ns, *printhead));
                    if let Some(own) = own.as_ref().filter(|_| last != Some((t_ns, printhead))) {
                        judged.own.push((t_ns, printhead, own.clone()));
                    }
                    let gated = GatedBurst {
                        burst,
                        judge: judge.as_deref().map_err(|reason| *reason),
                        own: own.as_deref(),
                        first: signals.start,
                        statistic: &statistic[signals],
                        id: Id { t_ns, printhead, channel: burst.first_channel },
                    };
                    let from = judged.verdicts.rows.len();
                    self.judge_burst(&gated, &mut judged);
                    rows::add_recorded(&mut judged.verdicts.rows, from, burst);
                }
            }
        }
        self.pools.statistic.give(statistic);
        judged.judges = each_once(assigned.judges);
        judged
    }

    fn judge_burst(&mut self, of: &GatedBurst, rows: &mut JudgedBatch) {
        // runs need nothing more, unless all signals are isolated or their rings asked for
        let isolates_all = |judge: &Judge| !self.settings.isolate.gate && judge.can_isolate();
        let all_rings = self.settings.output.ring == RingsOf::All;
        let at_once = of.judge.ok().filter(|judge| !isolates_all(judge) && !all_rings);

        let id = |row: usize| Id { channel: of.id.channel + row as u32, ..of.id }; // a burst has few
        let mut row = 0;
        while row < of.statistic.len() {
            let here = of.first + row; // the signal's index in the batch
            // a run, as long as the next signals are healthy
            if let Some(judge) = at_once {
                let left = &rows.verdicts.tests.healthy[here..of.first + of.statistic.len()];
                let healthy = left.iter().take_while(|healthy| **healthy).count();
                if healthy > 0 {
                    let run = rows::healthy_run(id(row), here..here + healthy, of.burst, judge);
                    rows.verdicts.parts.push(run);
                    row += healthy;
                    continue;
                }
            }

            // a single row: nobody judged the signal, or it is flagged (or everything is isolated)
            match of.statistic[row].and_then(|detection| Ok((detection, of.judge?))) {
                Err(reason) => rows::push_rejected(&mut rows.verdicts.rows, id(row), reason),
                Ok((detection, judge)) => {
                    let (burst, is_flagged) = (of.burst, !rows.verdicts.tests.healthy[here]);
                    let signal = Signal { burst, row, judge, own: of.own, detection, is_flagged };
                    self.judge_signal(signal, id(row), rows);
                }
            }
            rows.verdicts.close_rows();
            row += 1;
        }
    }

    fn judge_signal(&mut self, of: Signal, id: Id, rows: &mut JudgedBatch) {
        // 1. the name, where the judge knows classes; `work` holds what belongs to it
        self.work.forget();
        let isolates = of.judge.can_isolate() && (of.is_flagged || !self.settings.isolate.gate);
        let mut isolation = isolates.then(|| self.isolate(of)).flatten();

        // 2. A flagged signal that is healthy along the ring was flagged for what it holds beside the ring.
        // That is no fault of a class, and neither is a signal that is no ring.
        let beside_only = of.is_flagged && !of.judge.model.threshold.is_faulty(of.detection.ring);
        if beside_only || (of.is_flagged && !of.judge.can_isolate() && self.is_no_ring(of)) {
            self.work.drop_name();
            isolation = Some(Isolation::of_no_ring());
        }

        // 3. what detection said; where it measured no misfit, that of the ring fitted for isolation
        let mut tested: Tested = of.judge.test(of.detection);
        if tested.misfit.is_nan() && isolation.is_some() {
            tested.misfit = self.work.misfit;
        }

        // 4. resonance and damping; and for flagged signals what the episodes need
        let ring = self.ring_of(of);
        if of.is_flagged {
            let flagged = self.flag(of, isolation.as_ref(), ring, rows.verdicts.rows.len());
            rows.flagged.push(flagged);
        }

        let severity = self.work.severity.take();
        let told = self.settings.output.weights && isolation.is_some();
        let weights = Some(self.work.weights.as_slice()).filter(|of| told && !of.is_empty());
        let (isolation, model) = (isolation.as_ref(), of.judge.index);
        let columns = &mut rows.verdicts.rows;
        rows::push_judged(columns, id, Row { tested, model, isolation, weights, ring, severity });
    }

    /// Names a signal's fault, where the method can: by its fitted ring (`posterior`), or by its deviation from
    /// what is expected. Results beside the name stay in `work`.
    fn isolate(&mut self, of: Signal) -> Option<Isolation> {
        let Signal { burst, row, judge, .. } = of;
        let channel = burst.first_channel.saturating_add(row as u32);
        self.work.own = of.own.and_then(|own| own.of(channel));
        self.work.warmer = judge.warmer(burst);
        let drive = judge.drive(burst);

        // the fits are taken in the order of the rows, so this one is the signal's
        if let Some(fit) = judge.rings().and_then(|_| self.rings.fits.next()) {
            return judge.isolate_ring(fit.as_ref(), drive, |y| of.per_drive(y), &mut self.work);
        }
        self.deviations.copy(burst, row);
        let deviation = self.deviations.deviate(judge, burst, row);
        judge.isolate(deviation, drive, &mut self.work)
    }

    /// Resonance, Hz, and damping, 1/s, of a signal: by a fit for flagged signals; for the others, where
    /// `output.ring` = `all`, in closed form if that is possible. `None`: not asked for, or no ring.
    fn ring_of(&mut self, of: Signal) -> Option<[f64; 2]> {
        let Signal { burst, judge, is_flagged, .. } = of;
        let (drive, copy) = (judge.drive(burst), |y: &mut Vec<f64>| of.per_drive(y));
        match (is_flagged, self.settings.output.ring) {
            (true, _) => judge.ring_of(copy, drive, &mut self.work),
            (false, RingsOf::Flagged) => None,
            (false, RingsOf::All) => {
                self.deviations.copy(burst, of.row);
                let deviation = self.deviations.deviate(judge, burst, of.row);
                let ring = judge.ring_in_closed_form(deviation, drive, judge.warmer(burst));
                ring.or_else(|| judge.ring_of(copy, drive, &mut self.work))
            }
        }
    }

    /// What the evidence over time needs to know of a flagged signal. `row`: its index among the batch's rows.
    /// The weights are multiplied by the probability that the signal is of any class.
    fn flag(
        &mut self,
        of: Signal,
        isolation: Option<&Isolation>,
        ring: Option<[f64; 2]>,
        row: usize,
    ) -> FlaggedSignal {
        let strange = isolation.is_some_and(|isolation| isolation.likeness != Likeness::KnownClass);
        let channel = of.burst.first_channel.saturating_add(of.row as u32);
        let own = of.own.and_then(|own| own.of(channel)).map(|own| own.baseline);
        let healthy = of.judge.healthy_ring(of.judge.warmer(of.burst), own);
        let rings = ring.map(|[frequency_hz, damping_per_s]| episodes::Rings {
            frequency_hz,
            damping_per_s,
            healthy_frequency_hz: healthy[0],
            healthy_damping_per_s: healthy[1],
        });
        let alternative = self.work.alternative.take();
        let appearance = alternative.or_else(|| strange.then(|| self.appearance(of)).flatten());
        FlaggedSignal {
            appearance,
            row: row as u32, // a batch is far smaller
            weights: self.work.weights.iter().map(|&w| (w * self.work.of_any) as f32).collect(),
            rings,
        }
    }

    /// Whether a flagged signal is no ring; asked where no classes are known.
    fn is_no_ring(&mut self, of: Signal) -> bool {
        let signal = &mut self.deviations.signal;
        of.per_drive(signal);
        of.judge.is_no_ring(signal, of.judge.drive(of.burst), &mut self.work)
    }

    fn appearance(&mut self, of: Signal) -> Option<Appearance> {
        let signal = &mut self.deviations.signal;
        of.per_drive(signal);
        of.judge.appearance(signal, of.judge.drive(of.burst), &mut self.work)
    }
}

/// The judges of a batch, one per model, by number. (A model's judges, moved, tell the same of the model.)
fn each_once(judges: Vec<AssignedJudge>) -> Vec<Arc<Judge>> {
    let mut judges: Vec<Arc<Judge>> = judges.into_iter().flat_map(|of| of.judge).collect();
    judges.sort_by_key(|judge| judge.index);
    judges.dedup_by_key(|judge| judge.index);
    judges
}
