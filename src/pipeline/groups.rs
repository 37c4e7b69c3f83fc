//! Groups of signals: a *group* is a printhead of a recording at one sampling (sample period and number of
//! samples), the signals that one model can judge. In: bursts. Out: for each burst the number of its group, by which
//! the identify stage keeps judges, clocks and heads ([`Groups`]).

use inkling_core::burst::Burst;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct GroupKey {
    pub printhead: Arc<str>,
    pub samples: u32,
    /// ln of the sample period in s, in steps of 1e-6, so that rounding mostly changes nothing.
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

/// The groups of a recording, numbered as they are met. A burst of the same group as the one before is found
/// without hashing.
#[derive(Debug, Default)]
pub struct Groups {
    numbers: HashMap<GroupKey, usize>,
    /// The group that was asked for last, with the bits of its sample period and its number.
    last: Option<(GroupKey, u64, usize)>,
}

impl Groups {
    /// The number of a group that was met.
    pub fn get(&self, key: &GroupKey) -> Option<usize> {
        self.numbers.get(key).copied()
    }

    /// The number of a burst's group; a new one is numbered. `None`: it is one beyond [`MOST_GROUPS`].
    pub fn of(&mut self, burst: &Burst) -> Option<usize> {
        let period = burst.sample_period_s.to_bits();
        if let Some((key, of_period, last)) = &self.last
            && (*of_period, key.samples) == (period, burst.samples_per_channel)
            && (Arc::ptr_eq(&key.printhead, &burst.printhead) || key.printhead == burst.printhead)
        {
            return Some(*last);
        }
        let key = GroupKey::of(burst);
        let number = match self.numbers.get(&key) {
            Some(known) => *known,
            None if self.numbers.len() >= MOST_GROUPS => return None,
            None => {
                let new = self.numbers.len();
                self.numbers.insert(key.clone(), new);
                new
            }
        };
        self.last = Some((key, period, number));
        Some(number)
    }
}

/// `None`: the printhead is new, and `most` are kept already, which bounds memory.
pub fn of_printhead<'a, T>(
    kept: &'a mut BTreeMap<Arc<str>, T>,
    printhead: &Arc<str>,
    most: usize,
    new: impl FnOnce() -> T,
) -> Option<&'a mut T> {
    if kept.len() < most && !kept.contains_key(printhead) {
        kept.insert(printhead.clone(), new());
    }
    kept.get_mut(printhead)
}

/// Maximum number of groups in one recording; groups beyond are not given models.
pub const MOST_GROUPS: usize = 4096;
