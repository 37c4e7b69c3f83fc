//! What of a recording that is being written was told, so that nothing is told twice, and what has changed since is told
//! again.
//!
//! In: episodes as they are raised, named otherwise, or judged again; at the end those of the table. Out: tellings.

use super::episodes::EpisodeReport;
use super::job::Telling;
use crate::episodes::Episode;
use std::collections::HashMap;
use std::sync::Arc;

/// Episodes that are remembered as told.
const MOST_TOLD: usize = 1 << 20;

#[derive(Debug, Default)]
pub struct Told {
    /// By printhead and channel, as each was told last.
    told: HashMap<(Arc<str>, u32), Vec<Episode>>,
    /// Over all channels.
    number: usize,
}

impl Told {
    /// Tells an episode if it is new, or named or raised otherwise than it was told.
    pub fn tell(&mut self, now: &Episode, tell: &dyn Fn(Telling)) {
        let of_channel = self.told.entry((now.printhead.clone(), now.channel)).or_default();
        match of_channel.iter_mut().find(|before| is_same(before, now)) {
            Some(before) => {
                if name(before) != name(now) || before.raised_at_ns != now.raised_at_ns {
                    tell(Telling::Revised { now, before });
                    before.clone_from(now);
                }
            }
            None => {
                tell(Telling::Raised(now));
                if self.number < MOST_TOLD {
                    self.number += 1;
                    of_channel.push(now.clone());
                }
            }
        }
    }

    /// Tells what the finished table says otherwise.
    pub fn settle(&mut self, table: &EpisodeReport, tell: &dyn Fn(Telling)) {
        table.listed.iter().for_each(|episode| self.tell(episode, tell));
        if table.counts.episodes > table.listed.len() as u64 {
            return; // those that are not listed here may be what was told
        }
        let mut gone: Vec<&Episode> = self
            .told
            .values()
            .flatten()
            .filter(|told| !table.listed.iter().any(|of| is_same(told, of)))
            .collect();
        gone.sort_by_key(|of| (of.raised_at_ns, of.printhead.clone(), of.channel));
        gone.into_iter().for_each(|told| tell(Telling::Withdrawn(told)));
    }
}

/// Whether two tellings are of one episode: raised at the same time, or while the other was on.
fn is_same(a: &Episode, b: &Episode) -> bool {
    let during = |of: &Episode, t_ns: i64| {
        of.began_at_ns <= t_ns && of.ended_at_ns.is_none_or(|end| t_ns < end)
    };
    a.printhead == b.printhead
        && a.channel == b.channel
        && (a.raised_at_ns == b.raised_at_ns
            || during(a, b.raised_at_ns) && during(b, a.raised_at_ns))
}

fn name(of: &Episode) -> (Option<&str>, Option<&str>) {
    (of.category.as_deref(), of.fault.as_deref())
}
