//! Learns the models of printheads that begin at some place of a recording, each from its first healthy window.
//!
//! In: where the recording is read on from ([`Ahead`]), and which groups have no judge yet. Out: for each group that
//! begins there its model, or the windows that were refused ([`learn`]).
//!
//! 1. `survey` finds the groups that begin there, and of their windows the bursts to learn from.
//! 2. `sample` reads these, a few windows at a time, so that memory is bounded.
//! 3. `healthy_window` averages and identifies. After a window that is refused up to [`MOST_WINDOWS`] are tried, each
//!    as long after the end of the one before as the group was printing before that. A printhead that the design knows
//!    has one window: if that is refused, the design judges.

use super::super::Result;
use super::super::batches::{MOST_ROWS, ReadBatch, usable};
use super::super::groups::GroupKey;
use super::super::head_clock::FileOrder;
use super::super::numbers::MOST_WINDOWS;
use super::super::run::Replay;
use super::super::visit::Pass;
use super::healthy_window::{self, Accepted};
use super::survey::{self, Window};
use super::{Refusal, sample};
use inkling_core::burst::Burst;
use inkling_core::design::HealthyModel;
use inkling_core::side_by_side::side_by_side;
use inkling_io::block::Block;
use inkling_io::block_reader::Definitions;
use std::ops::ControlFlow;
use std::sync::Arc;

/// Maximum bytes of signals that are held for the windows of several groups.
const HELD_BYTES: usize = 64 << 20;

/// Where a recording is read on from, beside the stages.
#[derive(Debug)]
pub struct Ahead<'a> {
    pass: Pass<'a>,
    workers: usize,
    block: Block,
    definitions: Option<Definitions>,
    /// By how much bursts may be earlier than such before them, ns; `None`: they may come in any order.
    pub reorder_ns: Option<i64>,
}

impl<'a> Ahead<'a> {
    /// From the block on that a batch is of.
    pub fn of(pass: Pass<'a>, workers: usize, read: &ReadBatch) -> Ahead<'a> {
        let recording = pass.recording;
        let order = FileOrder::of(recording);
        let reorder_ns = order.is_of_times.then_some(order.reorder_ns);
        let (block, definitions) = (read.block, read.definitions.clone());
        Ahead { pass, workers, block, definitions, reorder_ns }
    }

    /// Calls `see` with the index of the block and each usable burst, of all blocks or up to block `last`, until it
    /// breaks. Of a recording that is being written it waits for more. What is damaged the stages tell.
    pub fn read(
        &self,
        last: Option<u64>,
        mut see: impl FnMut(u64, &Burst) -> ControlFlow<()>,
    ) -> Result<()> {
        let Pass { recording, control } = self.pass;
        let mut reader = recording.reader().knowing(self.definitions.as_ref());
        let mut blocks = recording.blocks().after(Some(&self.block));
        let mut next = Some(Ok(self.block));
        while let Some(block) = next {
            control.check()?;
            if let Ok(block) = block {
                if last.is_some_and(|last| block.index > last) {
                    return Ok(());
                }
                reader.load(&block);
                while let Some(piece) = reader.next_piece(MOST_ROWS) {
                    for burst in piece.acquisitions.iter().filter_map(usable) {
                        if see(block.index, burst).is_break() {
                            return Ok(());
                        }
                    }
                }
            }
            next = control.next_block(recording, &mut blocks)?;
        }
        Ok(())
    }
}

/// What is known of a group after its windows.
#[derive(Debug)]
pub struct Learned {
    pub key: GroupKey,
    /// `None`: no window gave one.
    pub model: Option<Arc<HealthyModel>>,
    /// Drive voltage at which the model expects its signals, V; `None`: not known.
    pub reference_v: Option<f64>,
    pub refusals: Vec<Refusal>,
}

/// A group whose windows are looked at one after the other.
#[derive(Debug)]
struct Waiting {
    learned: Learned,
    start_ns: i64,
    sample_period_s: f64,
    /// Number of windows that were looked at.
    windows: u32,
}

/// Learns the groups that begin where `ahead` begins and that are new.
pub fn learn(
    replay: &Replay,
    ahead: &Ahead,
    is_new: impl Fn(&Burst, &GroupKey) -> bool,
) -> Result<Vec<Learned>> {
    let mut waiting: Vec<Waiting> = survey::starts(ahead, is_new)?
        .into_iter()
        .map(|(key, (start_ns, sample_period_s))| {
            let reference_v = replay.design.as_ref().and_then(|design| design.drive_voltage_v);
            let learned = Learned { key, model: None, reference_v, refusals: Vec::new() };
            Waiting { learned, start_ns, sample_period_s, windows: 0 }
        })
        .collect();

    let mut done = Vec::new();
    while !waiting.is_empty() {
        let next = |of: &Waiting| {
            let span = replay.window(of)?;
            Some(Window::new(of.learned.key.clone(), of.start_ns, span))
        };
        let (going_on, ended): (Vec<_>, Vec<_>) =
            waiting.into_iter().map(|of| (next(&of), of)).partition(|(window, _)| window.is_some());
        done.extend(ended.into_iter().map(|(_, of)| of.learned));

        let (windows, groups): (Vec<_>, Vec<_>) = going_on.into_iter().unzip();
        let mut windows: Vec<Window> = windows.into_iter().flatten().collect();
        let last = survey::choose(replay, ahead, &mut windows)?;
        let (learned, again) = learn_from(replay, ahead, last, windows, groups)?;
        done.extend(learned);
        waiting = again;
    }
    Ok(done)
}

/// Learns from one window of each group. `last`: index of the last block that holds some of it. Returns the groups that
/// have a model, or no further window, and the others.
fn learn_from(
    replay: &Replay,
    ahead: &Ahead,
    last: u64,
    windows: Vec<Window>,
    groups: Vec<Waiting>,
) -> Result<(Vec<Learned>, Vec<Waiting>)> {
    let bytes = |of: &Window| size_of::<f32>() * of.key.samples as usize * of.most;
    let at_a_time = HELD_BYTES / windows.iter().map(bytes).max().unwrap_or(0).max(1);
    let (mut done, mut again) = (Vec::new(), Vec::new());
    let mut groups = groups.into_iter();
    for few in windows.chunks(at_a_time.max(1)) {
        let samples = sample::read(replay, ahead, last, few)?;
        let work: Vec<_> = few.iter().zip(samples).zip(groups.by_ref()).collect();
        let learned = side_by_side(ahead.workers, work, |((window, sample), mut of)| {
            of.take(replay, window, &sample);
            (window.is_reached, of)
        });
        for (is_reached, of) in learned {
            match of.learned.model.is_some() || !is_reached {
                true => done.push(of.learned),
                false => again.push(of),
            }
        }
    }
    Ok((done, again))
}

impl Waiting {
    fn take(&mut self, replay: &Replay, window: &Window, sample: &sample::Sample) {
        self.windows += 1;
        if window.chosen.is_empty() && replay.labels.is_none() {
            return; // nothing was printed then
        }
        let Learned { key, model, reference_v, refusals } = &mut self.learned;
        match healthy_window::learn(replay, &key.printhead, self.sample_period_s, sample) {
            Ok(Accepted { model: of_window, reference_v: at_v }) => {
                let of_window = HealthyModel { valid_from_ns: Some(self.start_ns), ..of_window };
                // where the design judges, the window has said that its pooled model agrees with the printhead
                let offset = of_window.offset;
                let pooled = || {
                    let design = replay.design.as_ref()?;
                    Some(HealthyModel { offset, ..design.pooled.clone() })
                };
                let by_design = replay.knows_by_design().then(pooled).flatten();
                *model = Some(Arc::new(by_design.unwrap_or(of_window)));
                *reference_v = at_v;
            }
            Err((why, drifted)) => {
                let (from_ns, to_ns) = (window.from_ns, window.to_ns);
                let printhead = key.printhead.to_string();
                refusals.push(Refusal { printhead, from_ns, to_ns, why, drifted });
            }
        }
    }
}

impl Replay {
    /// The next window of a group, from and to, ns; `None`: there is none.
    fn window(&self, of: &Waiting) -> Option<[i64; 2]> {
        let is_known = self
            .design
            .as_ref()
            .is_some_and(|design| design.model_of(&of.learned.key.printhead).is_some());
        if of.windows >= if is_known { 1 } else { MOST_WINDOWS } {
            return None;
        }
        // the first window begins with the first burst, and each further one twice as late as the one before ended
        let first_ns = (self.settings.identify.first * 1e9) as i64;
        let before = (1_i64 << of.windows) - 1;
        let from_ns = of.start_ns.checked_add(first_ns.checked_mul(before)?)?;
        Some([from_ns, from_ns.saturating_add(first_ns)])
    }
}
