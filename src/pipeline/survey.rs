//! Surveys a recording: which printheads it holds, and when they printed. This pass
//! comes before windows can be placed.
//!
//! A window is a span of the bursts' `timestamp`s. A chunk index holds log times, which need not agree with
//! them, so every burst is looked at once; only the blocks that touch a window are looked at again.

use super::{Control, PipelineError, visit};
use inkling_core::burst::Burst;
use inkling_io::recording::Recording;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// Identifies the signals that one model can judge. Windows are per (printhead, sample period, samples).
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct GroupKey {
    pub printhead: Arc<str>,
    pub samples: u32,
    /// Sample period in steps of 1e-6 of itself: equal up to the contract's tolerance.
    period: i64,
}

impl GroupKey {
    pub fn of(burst: &Burst) -> GroupKey {
        GroupKey {
            printhead: burst.printhead.clone(),
            samples: burst.samples_per_channel,
            period: (burst.sample_period_s.ln() * 1e6).round() as i64,
        }
    }
}

/// A map from groups to what is known of them. A burst that follows one of its own group, as bursts of one
/// printhead mostly do, is found without hashing.
#[derive(Debug)]
pub struct ByGroup<T> {
    of: HashMap<GroupKey, T>,
    /// The group that was asked for last, with the bits of its sample period and its value.
    last: Option<(GroupKey, u64, T)>,
}

impl<T> Default for ByGroup<T> {
    fn default() -> ByGroup<T> {
        ByGroup { of: HashMap::new(), last: None }
    }
}

impl<T: Copy + Default> ByGroup<T> {
    /// The value of a burst's group. For a group that is met for the first time it is what `meet` says, and
    /// the default for groups beyond [`MOST_GROUPS`].
    pub fn of(&mut self, burst: &Burst, meet: impl FnOnce(&GroupKey) -> T) -> T {
        // the usual case, a burst of the group before, needs no logarithm and no hash
        let period = burst.sample_period_s.to_bits();
        if let Some((key, of_period, last)) = &self.last
            && (*of_period, key.samples) == (period, burst.samples_per_channel)
            && (Arc::ptr_eq(&key.printhead, &burst.printhead) || key.printhead == burst.printhead)
        {
            return *last;
        }
        let key = GroupKey::of(burst);
        let found = match self.of.get(&key) {
            Some(known) => *known,
            None if self.of.len() >= MOST_GROUPS => T::default(),
            None => {
                let new = meet(&key);
                self.of.insert(key.clone(), new);
                new
            }
        };
        self.last = Some((key, period, found));
        found
    }
}

/// Maximum number of groups in one recording; groups beyond are not given models.
pub const MOST_GROUPS: usize = 4096;

/// Maximum number of bins over all groups. There are about as many windows as bins, and more windows than
/// this would be too many models.
const MOST_BINS: usize = 1 << 18;

#[derive(Clone, Debug)]
pub struct Group {
    pub key: GroupKey,
    pub sample_period_s: f64,
    pub first_ns: i64,
    pub last_ns: i64,
    /// Times of the first and last burst in every bin that holds some, by the bin's number. A bin is as long
    /// as windows are apart, and begins at a multiple of that.
    pub bins: BTreeMap<i64, (i64, i64)>,
}

#[derive(Debug, Default)]
pub struct Survey {
    pub groups: Vec<Group>,
    /// By block index: the groups in the block (indices) and the spans of their times.
    pub blocks: HashMap<u64, Vec<(u32, i64, i64)>>,
}

/// Surveys a recording. `every_ns`: the time from the begin of a window to that of the
/// next; 0: there is only one window.
pub fn survey(
    recording: &Recording,
    every_ns: i64,
    control: &Control,
) -> Result<Survey, PipelineError> {
    let mut survey = Survey::default();
    let mut bins = 0;
    let mut index: HashMap<GroupKey, u32> = HashMap::new();
    let Survey { groups, blocks } = &mut survey;
    visit::bursts(
        recording,
        control,
        |_| true,
        |block, burst| {
            let key = GroupKey::of(burst);
            let t = burst.t_acq_ns;
            // the burst's group; a new one gets the next index, and bursts of groups
            // beyond the maximum are passed over
            let g = match index.get(&key) {
                Some(&g) => g,
                None if groups.len() >= MOST_GROUPS => return,
                None => {
                    let g = groups.len() as u32;
                    index.insert(key.clone(), g);
                    let sample_period_s = burst.sample_period_s;
                    let (first_ns, last_ns, bins) = (t, t, BTreeMap::new());
                    groups.push(Group { key, sample_period_s, first_ns, last_ns, bins });
                    g
                }
            };

            let group = &mut groups[g as usize];
            group.first_ns = group.first_ns.min(t);
            group.last_ns = group.last_ns.max(t);
            if every_ns > 0 && bins < MOST_BINS {
                let (first, last) = group.bins.entry(t.div_euclid(every_ns)).or_insert_with(|| {
                    bins += 1;
                    (t, t)
                });
                (*first, *last) = ((*first).min(t), (*last).max(t));
            }

            let spans = blocks.entry(block).or_default();
            match spans.iter_mut().find(|(of, _, _)| *of == g) {
                Some((_, from, to)) => (*from, *to) = ((*from).min(t), (*to).max(t)),
                None => spans.push((g, t, t)),
            }
        },
    )?;

    if bins >= MOST_BINS {
        let (windows, most) = (bins as u64, u64::from(u16::MAX));
        return Err(PipelineError::TooManyWindows { windows, most });
    }
    Ok(survey)
}
