//! Announces the episodes of a recording that is being written: each once, and
//! again when it has changed since.
//!
//! In: episodes when they are raised, named otherwise, or judged again; at the end those of the table. Out:
//! [`EpisodeEvent`]s.

use super::episodes::EpisodeReport;
use super::job::EpisodeEvent;
use inkling_core::episodes::Episode;
use std::collections::HashMap;
use std::sync::Arc;

/// Maximum number of episodes that are remembered as announced.
const MOST_ANNOUNCED: usize = 1 << 20;

/// Remembers which episodes were announced, and with which name and time.
#[derive(Debug, Default)]
pub struct EpisodeAnnouncer {
    /// By printhead and channel, the episodes as each was last announced.
    announced: HashMap<(Arc<str>, u32), Vec<Episode>>,
    /// Number of episodes in `announced`, over all channels.
    number: usize,
}

impl EpisodeAnnouncer {
    /// Sends an event if an episode is new, or if its name or the time at which it was raised is not the
    /// announced one.
    pub fn announce(&mut self, now: &Episode, send: &dyn Fn(EpisodeEvent)) {
        let of_channel = self.announced.entry((now.printhead.clone(), now.channel)).or_default();
        match of_channel.iter_mut().find(|before| is_same(before, now)) {
            Some(before) => {
                if name(before) != name(now) || before.raised_at_ns != now.raised_at_ns {
                    send(EpisodeEvent::Revised { now, before });
                    before.clone_from(now);
                }
            }
            None => {
                send(EpisodeEvent::Raised(now));
                if self.number < MOST_ANNOUNCED {
                    self.number += 1;
                    of_channel.push(now.clone());
                }
            }
        }
    }

    /// Corrects what was announced, where the finished table says otherwise: announces what is new or has
    /// changed, and withdraws what the table does not have.
    pub fn settle(&mut self, table: &EpisodeReport, send: &dyn Fn(EpisodeEvent)) {
        table.listed.iter().for_each(|episode| self.announce(episode, send));
        if table.counts.episodes > table.listed.len() as u64 {
            return; // those that are not listed here may be what was announced
        }
        let mut gone: Vec<&Episode> = self
            .announced
            .values()
            .flatten()
            .filter(|announced| !table.listed.iter().any(|of| is_same(announced, of)))
            .collect();
        gone.sort_by_key(|of| (of.raised_at_ns, of.printhead.clone(), of.channel));
        gone.into_iter().for_each(|announced| send(EpisodeEvent::Withdrawn(announced)));
    }
}

/// Whether `a` and `b` are states of one episode: raised at the same time, or each while the other was on.
fn is_same(a: &Episode, b: &Episode) -> bool {
    let during = |of: &Episode, t_ns: i64| {
        of.began_at_ns <= t_ns && of.ended_at_ns.is_none_or(|end| t_ns < end)
    };
    a.printhead == b.printhead
        && a.channel == b.channel
        && (a.raised_at_ns == b.raised_at_ns
            || during(a, b.raised_at_ns) && during(b, a.raised_at_ns))
}

/// Category and fault that an episode is named with.
fn name(of: &Episode) -> (Option<&str>, Option<&str>) {
    (of.category.as_deref(), of.fault.as_deref())
}
