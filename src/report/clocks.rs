//! Puts the times of a recording whose clock was wrong into the order of the others.
//!
//! In: stretches of printheads' bursts that are dated wrongly ([`WrongStretch`], from the recording's summary), its
//! episodes, and its verdicts in the order of the file. Out: the same with times that can be compared: those of the
//! records for bursts that cannot have been acquired when they say, after a clock that was set back those that the
//! clock would have had, and for a burst that is dated apart that of the burst before it. The tables keep the times
//! that the bursts have.

use inkling_core::episodes::Episode;
use inkling_core::verdict::VerdictColumns;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::HashMap;

/// Bursts of a printhead, up to the end of the recording, to whose times something is to be added.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WrongStretch {
    pub printhead: String,
    /// The first and the latest time of the bursts before it in the file; `None`: there are none.
    pub before_ns: Option<[i64; 2]>,
    /// The time of its first burst.
    pub from_ns: i64,
    /// What is to be added to its times, besides what the stretches before it add.
    pub by_ns: i64,
    /// From when to when bursts in it are dated that are apart from the others: they count as of the time of the one
    /// before them.
    #[serde(default)]
    pub strays_ns: Vec<[i64; 2]>,
}

/// The wrong stretches of one recording, and how far its rows were read.
#[derive(Clone, Debug, Default)]
pub struct Clocks {
    heads: HashMap<String, HeadTimes>,
}

#[derive(Clone, Debug, Default)]
struct HeadTimes {
    stretches: Vec<WrongStretch>,
    /// Of the rows read so far: number of stretches that began, what they add, and whether the latest burst before
    /// the next one was met.
    begun: usize,
    by_ns: i64,
    /// The time, put right, of the latest row that is no stray.
    latest_ns: Option<i64>,
    is_before_met: bool,
}

impl Clocks {
    /// `document`: the recording's summary.
    pub fn of(document: &Value) -> Clocks {
        let told = document["wrong_times"].as_array().into_iter().flatten();
        let stretches =
            told.filter_map(|of| serde_json::from_value::<WrongStretch>(of.clone()).ok());
        let mut heads: HashMap<String, HeadTimes> = HashMap::new();
        for of in stretches {
            heads.entry(of.printhead.clone()).or_default().stretches.push(of);
        }
        Clocks { heads }
    }

    /// `episodes`: in the order of the table, in which they ended.
    pub fn put_right(&self, episodes: &mut [Episode]) {
        for (name, head) in &self.heads {
            let of_head = episodes.iter_mut().filter(|of| *of.printhead == **name);
            let mut of_head: Vec<&mut Episode> = of_head.collect();
            let added: Vec<i64> = {
                let of_head: Vec<&Episode> = of_head.iter().map(|of| &**of).collect();
                (0..of_head.len()).map(|at| head.of_episode(&of_head, at)).collect()
            };
            for (episode, by_ns) in of_head.iter_mut().zip(added) {
                let times = [&mut episode.raised_at_ns, &mut episode.began_at_ns];
                let times = times.into_iter().chain(&mut episode.ended_at_ns);
                times.for_each(|t_ns| *t_ns = t_ns.saturating_add(by_ns));
            }
        }
    }

    /// Puts the next rows of the table right.
    pub fn put_rows_right(&mut self, rows: &mut VerdictColumns) {
        if self.heads.is_empty() {
            return;
        }
        for (t_ns, printhead) in rows.acquired_at_ns.iter_mut().zip(&rows.printhead) {
            let name = rows.printheads.get(*printhead as usize);
            if let Some(head) = name.and_then(|name| self.heads.get_mut(&**name)) {
                *t_ns = head.of_next_row(*t_ns);
            }
        }
    }
}

impl HeadTimes {
    /// Adds up the stretches up to the one that an episode ended in. All episodes that are on end at a step, with the
    /// latest burst before it; where none was on, an episode that lies before the step by its times does.
    fn of_episode(&self, episodes: &[&Episode], at: usize) -> i64 {
        let is_before = |[first_ns, latest_ns]: [i64; 2]| {
            let ended_then = |of: &&Episode| of.ended_at_ns == Some(latest_ns);
            let of = episodes[at];
            let lies_before =
                of.began_at_ns >= first_ns && of.ended_at_ns.is_some_and(|end| end <= latest_ns);
            episodes.iter().rposition(ended_then).map_or(lies_before, |last| at <= last)
        };
        let begun = self.stretches.iter().take_while(|next| !next.before_ns.is_some_and(is_before));
        begun.map(|of| of.by_ns).fold(0, i64::saturating_add)
    }

    /// The time of the next row, put right.
    fn of_next_row(&mut self, t_ns: i64) -> i64 {
        let mut strays = self.stretches.iter().flat_map(|of| &of.strays_ns);
        if strays.any(|[from_ns, to_ns]| (*from_ns..=*to_ns).contains(&t_ns)) {
            let first = self.stretches.first().map(|of| of.from_ns.saturating_add(of.by_ns));
            return self.latest_ns.or(first).unwrap_or(t_ns);
        }
        while let Some(next) = self.stretches.get(self.begun) {
            self.is_before_met |= next.before_ns.is_none_or(|[_, latest_ns]| t_ns == latest_ns);
            let begins = next.before_ns.is_none() || self.is_before_met && t_ns == next.from_ns;
            if !begins {
                break;
            }
            self.by_ns = self.by_ns.saturating_add(next.by_ns);
            (self.begun, self.is_before_met) = (self.begun + 1, false);
        }
        *self.latest_ns.insert(t_ns.saturating_add(self.by_ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    const S: i64 = 1_000_000_000;

    /// One channel's rows and an episode in each stretch: dated 1000 s too early, and set back by 30 s after 40 s.
    fn wrong() -> (Clocks, VerdictColumns, Vec<Episode>) {
        let document = json!({ "wrong_times": [
            { "printhead": "K", "before_ns": null, "from_ns": 0, "by_ns": 1000 * S,
              "strays_ns": [[-9 * S, -9 * S]] },
            { "printhead": "K", "before_ns": [0, 39 * S], "from_ns": 10 * S, "by_ns": 30 * S },
        ]});
        let times = (0..40).chain([-9]).chain(10..40).map(|s| s * S);
        let rows = VerdictColumns {
            acquired_at_ns: times.collect(),
            printhead: vec![0; 71],
            printheads: vec!["K".into()],
            ..VerdictColumns::default()
        };
        let episode = |began: i64, ended: Option<i64>| Episode {
            printhead: "K".into(),
            began_at_ns: began * S,
            raised_at_ns: began * S,
            ended_at_ns: ended.map(|s| s * S),
            ..Episode::default()
        };
        (Clocks::of(&document), rows, vec![episode(20, Some(39)), episode(15, None)])
    }

    #[test]
    fn rows_and_episodes_of_a_clock_that_was_set_back_follow_each_other() {
        let (mut clocks, mut rows, mut episodes) = wrong();
        clocks.put_rows_right(&mut rows);
        let right: Vec<i64> = (1000..1040).chain([1039]).chain(1040..1070).map(|s| s * S).collect();
        assert_eq!(rows.acquired_at_ns, right);
        clocks.put_right(&mut episodes);
        let began: Vec<i64> = episodes.iter().map(|of| of.began_at_ns / S).collect();
        assert_eq!(began, [1020, 1045]);
        assert_eq!(episodes[0].ended_at_ns, Some(1039 * S));
    }
}
