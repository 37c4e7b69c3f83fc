//! What was odd about the times of a recording's bursts, in words.
//!
//! In: the clocks of its printheads, once all bursts were heard. Out: a sentence for each that was odd, and the stretches
//! of bursts whose times stand in no order with others ([`told`]).

use super::head_clock::{HeadClock, Step, Stretch};
use super::not_judged::NotJudged;
use super::numbers::DIFFER_NS;
use crate::report::{WrongStretch, clock};
use inkling_io::when::{YEAR_2010_NS, is_far_ahead};
use std::collections::BTreeSet;

/// What was odd about the times of a recording, each printhead once: by its own times, or else by those of others; and
/// what puts them right.
pub fn told(mut clocks: Vec<HeadClock>) -> (Vec<NotJudged>, Vec<WrongStretch>) {
    let against = against_each_other(&clocks);
    // a printhead that was sampled in two ways has two clocks in here, and its times are put right once
    let mut met = BTreeSet::new();
    let each_once = clocks.iter_mut().filter(|of| met.insert(of.key.printhead.clone()));
    let wrong = each_once.flat_map(HeadClock::wrong_times).collect();
    let mut told: Vec<NotJudged> = clocks.into_iter().filter_map(HeadClock::told).collect();
    let is_new = |of: &NotJudged| told.iter().all(|known| known.printhead != of.printhead);
    let against: Vec<NotJudged> = against.into_iter().filter(is_new).collect();
    told.extend(against);
    (told, wrong)
}

/// What printheads say of each other's clocks: those that are dated otherwise than the one nearest to its records,
/// though they were recorded together. Which of them is right nobody knows: one may have waited for its recorder.
fn against_each_other(clocks: &[HeadClock]) -> Vec<NotJudged> {
    let leads = || clocks.iter().filter_map(|of| Some((of, of.against_log.lead_ns()?)));
    let Some((nearest, lead_ns)) = leads().min_by_key(|(_, lead_ns)| lead_ns.unsigned_abs()) else {
        return Vec::new();
    };
    let others = leads().filter(|(of, lead)| {
        lead.abs_diff(lead_ns) > DIFFER_NS && of.key.printhead != nearest.key.printhead
    });
    let told = others.map(|(of, lead)| {
        let [name, nearest] = [of, nearest].map(|of| inkling_io::printable::line(&of.key.printhead, 64));
        let way = if lead < lead_ns { "earlier" } else { "later" };
        let what = format!(
            "the bursts of {name} are dated {} {way} than those of {nearest} that were recorded with them: is its clock \
             wrong?",
            duration(lead.abs_diff(lead_ns))
        );
        NotJudged::of_printhead(&of.key.printhead, what)
    });
    told.collect()
}

/// From when to when.
fn span(from_ns: i64, to_ns: i64) -> String {
    match from_ns == to_ns {
        true => clock(from_ns),
        false => format!("{} to {}", clock(from_ns), clock(to_ns)),
    }
}

/// A time span with one decimal, in the largest unit of which it is at least one.
fn duration(ns: u64) -> String {
    let s = ns as f64 / 1e9;
    let units = [(31_557_600.0, "years"), (86_400.0, "days"), (3600.0, "h"), (60.0, "min")];
    match units.iter().find(|(unit, _)| s >= 2.0 * unit) {
        Some((unit, name)) => format!("{:.1} {name}", s / unit),
        None => format!("{s:.1} s"),
    }
}

impl HeadClock {
    /// What was odd about the times, with numbers, as sentences without a full stop; `None`: nothing was.
    pub(super) fn in_words(&self) -> Option<String> {
        let name = inkling_io::printable::line(&self.key.printhead, 64);
        let told = [
            self.step_in_words(&name),
            self.strays_in_words(&name),
            self.late_in_words(&name),
            self.date_in_words(&name),
        ];
        let told: Vec<String> = told.into_iter().flatten().collect();
        (!told.is_empty()).then(|| told.join("; "))
    }

    fn step_in_words(&self, name: &str) -> Option<String> {
        let Some(Step { before_ns, expected_ns, after_ns, is_of_records }) = self.largest else {
            let forward = self.against_log.forward()?;
            let (by, to) = (duration(forward.by_ns), clock(forward.to_ns));
            return Some(format!(
                "the clock of {name} went forward by {by} to {to}, while the times at which its bursts were recorded went \
                 on: a fault that was on then seems to have lasted longer by that"
            ));
        };
        let way = if after_ns < expected_ns { "back" } else { "forward" };
        let by = duration(after_ns.abs_diff(expected_ns));
        let times = match self.steps {
            1 => String::new(),
            n => format!("; it was set {n} times, this was the largest step"),
        };
        // a recorder whose clock was set, too, looks like parts of a recording in another order
        let order = match is_of_records {
            true => ". If the recording was put together of parts, `mcap sort` puts them in order",
            false => "",
        };
        Some(format!(
            "the clock of {name} went {way} by {by} after {}{times}: faults are followed up to there, and anew from \
             there on{order}",
            clock(before_ns)
        ))
    }

    fn strays_in_words(&self, name: &str) -> Option<String> {
        let (from_ns, to_ns) = self.strays_at?;
        let (strays, of) = (self.strays, self.bursts);
        let is = if strays == 1 { "is" } else { "are" };
        Some(format!(
            "{strays} of {of} bursts of {name} {is} dated {}, apart from the others: no fault was followed over them, and \
             nothing was learned from them",
            span(from_ns, to_ns)
        ))
    }

    fn late_in_words(&self, name: &str) -> Option<String> {
        let (late, of) = (self.late, self.bursts);
        let stands = if late == 1 { "stands" } else { "stand" };
        let by = duration(self.latest_ns);
        (late > 0).then(|| {
            format!(
                "{late} of {of} bursts of {name} {stands} in the file after later ones, by up to {by}: they were judged by \
                 what was known of the printhead by then, and taught nothing"
            )
        })
    }

    /// Says so where the bursts are dated by a clock that nobody had set.
    fn date_in_words(&self, name: &str) -> Option<String> {
        let Stretch { first_ns, latest_ns, .. } = self.stretch?;
        if let Some(ahead_ns) = self.against_log.ahead_ns() {
            return Some(format!(
                "the bursts of {name} are dated {} later than they were recorded: is its clock ahead, or in local time?",
                duration(ahead_ns)
            ));
        }
        if let Some([dated, logged]) = self.against_log.slow() {
            return Some(format!(
                "the bursts of {name} are dated within {}, and were recorded within {}: is the unit of their times another \
                 one?",
                duration(dated),
                duration(logged)
            ));
        }
        let misdated_by = self.against_log.misdated_by_ns();
        let is_far_ahead = is_far_ahead(first_ns);
        (misdated_by.is_some() || latest_ns < YEAR_2010_NS || is_far_ahead).then(|| {
            let dated = span(first_ns, latest_ns);
            let times = match misdated_by {
                _ if is_far_ahead => ": nothing was learned from them, and no account tells of them".into(),
                Some(by_ns) => format!(
                    ", and were recorded from {} on: page and account have the times of the records, the tables those of \
                     the bursts",
                    clock(first_ns.saturating_add(by_ns))
                ),
                None => ": all that is told of them has these times".into(),
            };
            format!(
                "the bursts of {name} are dated {dated}{times}. Was its clock not set, or the unit of its times another \
                 one?"
            )
        })
    }
}
