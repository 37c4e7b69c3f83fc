//! Gathers the evidence over time at the writer stage, where rows come in the recording's order, and raises
//! episodes from it.
//!
//! In: judged batches, one after another ([`EpisodeTap::add`]). Out: the table of episodes as they end, the list
//! for the report, and, where somebody follows the recording, each episode as soon as it is raised.
//!
//! The sequential test itself is `inkling_core::episodes::Tracker`. Here the rows and runs of a batch are put
//! together into bursts again ([`Looks`]: for each channel the statistic over its threshold), with what isolation
//! says of the flagged signals. There are two trackers where somebody watches: the table's, which waits for
//! bursts that come late, and one that tells at once, which `replay::EpisodeAnnouncer` later corrects.
//!
//! Whether late bursts, or those dated apart, are of a clock that was set shows only with those that follow. Until then
//! they are held (`Held`): they belong to the stretch that begins; or else late ones to the one that goes on, and
//! no fault is followed over the others.

use super::Result;
use super::batches::{FlaggedSignal, JudgedBatch};
use super::head_clock::Standing;
use super::numbers::STEADY;
use super::rows::Id;
use super::run::{EpisodeEvent, Replay, Watch};
use inkling_core::design::{Design, HealthyModel, OwnChannels};
use inkling_core::episodes::{
    Counts, Episode, IsolatedSignal, Looks, Tracker, TrackerResult, Untimely,
};
use inkling_core::isolate::IsolateMethod;
use inkling_core::verdict::{HealthyRun, Part, Tests, VerdictColumns, Verdicts};
use inkling_io::episode_table::EpisodeWriter;
use std::collections::BTreeMap;
use std::sync::Arc;

const MOST_LISTED: usize = 1 << 14;
/// Most signals that are held, of all printheads.
const MOST_HELD: usize = 1 << 22;

pub struct EpisodeTap<'a> {
    tracker: Tracker,
    /// Where somebody watches: a second tracker, which raises episodes at once.
    watched: Option<(&'a Watch<'a>, Tracker)>,
    table: Option<EpisodeWriter>,
    /// Bursts that are late or dated apart, by printhead.
    held: BTreeMap<Arc<str>, Held>,
    /// Number of their signals.
    held_signals: usize,
    /// The models of the judges met so far, with which signals are compared, by number.
    models: BTreeMap<u16, Arc<HealthyModel>>,
    listed: Vec<Episode>,
}

#[derive(Debug, Default)]
pub struct EpisodeReport {
    pub counts: Counts,
    /// The episodes, at most `MOST_LISTED`, sorted by printhead, begin and channel.
    pub listed: Vec<Episode>,
    /// Signals whose times were of no use, by printhead.
    pub untimely: Vec<Untimely>,
}

impl<'a> EpisodeTap<'a> {
    /// `watch`: who is told at once. An error if the settings give priors of classes that there are not.
    pub fn create(
        replay: &Replay,
        watch: Option<&'a Watch<'a>>,
        table: Option<EpisodeWriter>,
    ) -> Result<EpisodeTap<'a>> {
        let settings = &replay.settings;
        let design = replay.design.as_ref();
        let classes = replay.fault_classes();
        // the weights of methods other than the posterior know no priors: all classes count alike
        let priors = match settings.isolate.method {
            IsolateMethod::Posterior => {
                let priors = settings.isolate.prior_weights(&replay.classes())?;
                // the rest of the probability is of no class
                let known = 1.0 - design.map_or(0.0, Design::of_no_class);
                priors.iter().map(|prior| prior * known).collect()
            }
            _ => vec![1.0 / classes.len().max(1) as f64; classes.len()],
        };

        let certainty = settings.isolate.certainty;
        let tracker = || Tracker::new(&classes, &priors, certainty, &settings.episodes);
        Ok(EpisodeTap {
            tracker: tracker(),
            watched: watch.map(|watch| (watch, tracker().at_once())),
            table,
            held: BTreeMap::new(),
            held_signals: 0,
            models: BTreeMap::new(),
            listed: Vec::new(),
        })
    }

    pub fn add(&mut self, judged: &mut JudgedBatch) -> Result<()> {
        for judge in &judged.judges {
            self.models.entry(judge.index).or_insert_with(|| judge.model.clone());
        }
        let mut flagged = std::mem::take(&mut judged.flagged).into_iter().peekable();
        let Verdicts { parts, tests, rows: c } = &judged.verdicts;

        // gather the rows burst by burst: the rows of a burst are its channels in order
        let mut bursts = Vec::new();
        for part in parts {
            match part {
                Part::Healthy(run) => {
                    let HealthyRun { t_ns, printhead, first_channel: channel, .. } = *run;
                    open(&mut bursts, Id { t_ns, printhead, channel }).add_healthy(run, tests);
                }
                Part::Rows(rows) => {
                    for row in rows.clone() {
                        let at = Id {
                            t_ns: c.acquired_at_ns[row],
                            printhead: c.printhead[row],
                            channel: c.channel[row],
                        };
                        let burst = open(&mut bursts, at);
                        burst.add_row(c, row);
                        // flagged signals come in the order of their rows
                        if let Some(of) = flagged.next_if(|f| f.row as usize == row) {
                            let in_burst = (burst.looks.ratios.len() - 1) as u32; // a batch is far smaller
                            burst.looks.named.push(Self::named(of, c, row, in_burst));
                        }
                    }
                }
            }
        }

        let mut set = None;
        for burst in bursts {
            let at = burst.at;
            match judged.standing(burst.at.t_ns, burst.at.printhead) {
                standing @ (Standing::Stray | Standing::Late) => {
                    let (printhead, looks) = self.looks(burst, &c.printheads, &judged.own);
                    if let Some(given_up) = self.hold(&printhead, looks, standing) {
                        self.look_at_late(&printhead, given_up);
                    }
                    continue;
                }
                // once for all messages of the moment
                Standing::Set if set != Some((burst.looks.t_ns, burst.at.printhead)) => {
                    set = Some((burst.looks.t_ns, burst.at.printhead));
                    self.begin_anew(&c.printheads[burst.at.printhead as usize]);
                }
                Standing::Set | Standing::InOrder => {}
            }
            let (printhead, looks) = self.looks(burst, &c.printheads, &judged.own);
            let mut held = self.release(&printhead);
            if set == Some((looks.t_ns, at.printhead)) {
                held.bursts.iter_mut().for_each(|(_, standing)| *standing = Standing::InOrder);
            }
            self.look_at_late(&printhead, held);
            self.look_at(&printhead, looks);
        }
        list(&mut self.listed, &mut self.table, self.tracker.take_ended())
    }

    fn model_of(&self, number: u16) -> Option<&HealthyModel> {
        self.models.get(&number).map(|model| &**model)
    }

    /// What isolation says of a row. `row`, `in_burst`: its index in `c` and among the burst's signals.
    fn named(
        flagged: FlaggedSignal,
        c: &VerdictColumns,
        row: usize,
        in_burst: u32,
    ) -> IsolatedSignal {
        IsolatedSignal {
            row: in_burst,
            weights: flagged.weights,
            appearance: flagged.appearance,
            reason: c.reason[row],
            candidate: c.candidate[row],
            severity: c.severity[row],
            severity_sd: c.severity_sd[row],
            rings: flagged.rings,
            resonance: c.resonance_hz[row].zip(c.damping_per_s[row]),
        }
    }

    /// Ends the episodes of a printhead whose clock was set: none runs over that.
    fn begin_anew(&mut self, printhead: &Arc<str>) {
        if let Some((watch, tracker)) = &mut self.watched {
            tracker.begin_anew(printhead);
            tracker.take_ended().iter().for_each(|of| (watch.episode)(EpisodeEvent::Ended(of)));
        }
        self.tracker.begin_anew(printhead);
    }

    /// Holds a burst. Gives those that are held if they are more than a clock that is set would leave.
    fn hold(&mut self, printhead: &Arc<str>, looks: Looks, standing: Standing) -> Option<Held> {
        let held = self.held.entry(printhead.clone()).or_default();
        let is_next_moment = held.bursts.last().is_none_or(|(last, _)| last.t_ns != looks.t_ns);
        held.moments += u32::from(is_next_moment);
        self.held_signals += looks.ratios.len();
        held.bursts.push((looks, standing));
        let are_many = held.moments >= STEADY || self.held_signals > MOST_HELD;
        are_many.then(|| self.release(printhead))
    }

    /// The bursts of a printhead that were held; no more are.
    fn release(&mut self, printhead: &Arc<str>) -> Held {
        let held = self.held.remove(printhead).unwrap_or_default();
        self.held_signals -= held.bursts.iter().map(|(looks, _)| looks.ratios.len()).sum::<usize>();
        held
    }

    /// A burst as the trackers take it. `own`: as in [`JudgedBatch::own`].
    fn looks(
        &self,
        burst: OpenBurst,
        printheads: &[Arc<str>],
        own: &[(i64, u32, Arc<OwnChannels>)],
    ) -> (Arc<str>, Looks) {
        let OpenBurst { at, model, mut looks } = burst;
        let printhead = &printheads[at.printhead as usize];
        // a burst has one model; where all its signals were rejected, nothing is asked of it
        looks.model = model.unwrap_or_default();
        looks.in_medians = self.model_of(looks.model).map_or(0.0, HealthyModel::in_medians);
        let (first, n) = (looks.first_channel, looks.ratios.len());

        // which of the channels were judged about their own levels: their statistics scatter otherwise
        let own = own.iter().find(|(t_ns, of, _)| (*t_ns, *of) == (looks.t_ns, at.printhead));
        if let Some((_, _, own)) = own {
            looks.own = own.from(first, n).map(|level| level.is_some()).collect();
        }
        (printhead.clone(), looks)
    }

    /// Looks at bursts that were held, but for those that are dated apart.
    fn look_at_late(&mut self, printhead: &Arc<str>, held: Held) {
        let late = held.bursts.into_iter().filter(|(_, standing)| *standing != Standing::Stray);
        late.for_each(|(looks, _)| self.look_at(printhead, looks));
    }

    /// Announces what the burst raises or ends.
    fn look_at(&mut self, printhead: &Arc<str>, looks: Looks) {
        if let Some((watch, tracker)) = &mut self.watched {
            tracker.push(printhead, looks.clone());
            let (raised, ended) = (tracker.take_raised(), tracker.take_ended());
            raised.iter().for_each(|episode| (watch.episode)(EpisodeEvent::Raised(episode)));
            ended.iter().for_each(|episode| (watch.episode)(EpisodeEvent::Ended(episode)));
        }
        self.tracker.push(printhead, looks);
    }

    /// Ends the recording: episodes that are still on have no end. The table is not complete yet.
    pub fn finish(mut self) -> Result<(EpisodeReport, Option<EpisodeWriter>)> {
        for (printhead, held) in std::mem::take(&mut self.held) {
            self.look_at_late(&printhead, held);
        }
        let EpisodeTap { tracker, mut table, mut listed, .. } = self;
        let TrackerResult { last, counts, untimely } = tracker.finish();
        list(&mut listed, &mut table, last)?;
        listed.sort_by_cached_key(|of| (of.printhead.clone(), of.began_at_ns, of.channel));
        Ok((EpisodeReport { counts, listed, untimely }, table))
    }
}

fn list(
    listed: &mut Vec<Episode>,
    table: &mut Option<EpisodeWriter>,
    episodes: Vec<Episode>,
) -> Result<()> {
    let room = MOST_LISTED.saturating_sub(listed.len());
    listed.extend(episodes.iter().take(room).cloned());
    match table {
        Some(table) if !episodes.is_empty() => Ok(table.write(episodes)?),
        _ => Ok(()),
    }
}

/// Bursts of a printhead that are late or dated apart, in a row, in the order of the file.
#[derive(Default)]
struct Held {
    bursts: Vec<(Looks, Standing)>,
    moments: u32,
}

struct OpenBurst {
    /// What identifies the signal that would continue it.
    at: Id,
    /// The model of its first row that has one.
    model: Option<u16>,
    looks: Looks,
}

/// The burst that the next rows belong to: the last one, if they continue its channels, else a new one.
fn open(bursts: &mut Vec<OpenBurst>, at: Id) -> &mut OpenBurst {
    if bursts.last().is_none_or(|last| last.at != at) {
        let looks = Looks { t_ns: at.t_ns, first_channel: at.channel, ..Looks::default() };
        bursts.push(OpenBurst { at, model: None, looks });
    }
    let last = bursts.len() - 1;
    &mut bursts[last]
}

impl OpenBurst {
    fn add_healthy(&mut self, run: &HealthyRun, tests: &Tests) {
        self.model.get_or_insert(run.model);
        // the threshold of each signal is that of the test that decided (`beside`: the second one)
        let thresholds = [run.threshold, run.beside];
        let beside = &tests.beside[run.signals.clone()];
        let tests = tests.statistic[run.signals.clone()].iter().zip(beside);
        let ratio = |(statistic, beside): (&f32, &bool)| {
            ratio(*statistic, thresholds[usize::from(*beside)])
        };
        self.looks.ratios.extend(tests.map(ratio));
        self.at.channel = run.first_channel.saturating_add(run.signals.len() as u32); // a burst has few
    }

    /// Adds a single row of `c`; NaN stands for a signal that was rejected.
    fn add_row(&mut self, c: &VerdictColumns, row: usize) {
        self.model = self.model.or(c.model[row]);
        let of = c.statistic[row].zip(c.threshold[row]);
        let ratio = of.map_or(f32::NAN, |(statistic, threshold)| ratio(statistic, threshold));
        self.looks.ratios.push(ratio);
        self.at.channel = self.at.channel.saturating_add(1);
    }
}

/// Statistic divided by threshold; NaN if there is no positive threshold.
fn ratio(statistic: f32, threshold: f32) -> f32 {
    if threshold > 0.0 { statistic / threshold } else { f32::NAN }
}
