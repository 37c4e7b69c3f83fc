//! The times of a printhead's bursts against those at which they were recorded.
//!
//! In: both times of each burst in the order of the file ([`LogClock::hear`]). Out: a clock that was set forward, which
//! the times of bursts alone do not tell from a pause ([`LogClock::forward`]), and bursts that were dated later than
//! they were recorded ([`LogClock::ahead_ns`]) or by a clock that nobody had set ([`LogClock::misdated_by_ns`]).
//!
//! A recorder that writes bursts down as they come leaves a lead, `time of the burst - time of the record`, that is the
//! same but for delays of transport. So a step is only told between two stretches in which the lead was steady for ten
//! seconds: what writes in blocks, or copies an archive, has no steady lead and tells nothing of clocks.

use super::numbers::{DELAY_NS, DIFFER_NS, JUMP_NS, LASTS_NS, STEADY};
use crate::report::{Span, whole};
use inkling_io::when::{YEAR_2010_NS, is_misdated};

/// Bursts with one lead.
#[derive(Clone, Copy, Debug)]
struct SteadyLead {
    lead_ns: i64,
    moments: u32,
    first_logged_ns: i64,
    latest_logged_ns: i64,
    /// The time of its first burst.
    first_ns: i64,
}

impl SteadyLead {
    fn is_long(&self) -> bool {
        let lasted = self.latest_logged_ns.saturating_sub(self.first_logged_ns);
        self.moments >= STEADY && lasted >= LASTS_NS
    }
}

/// A clock that was set forward: by how much, and the time that the first burst has after it, ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Forward {
    pub by_ns: u64,
    pub to_ns: i64,
}

#[derive(Clone, Debug, Default)]
pub struct LogClock {
    lead: Option<SteadyLead>,
    /// Bursts that came last and have another lead.
    aside: Option<SteadyLead>,
    forward: Option<Forward>,
    /// Both times of the burst that was dated nearest to its record, ns.
    nearest: Option<(i64, i64)>,
    /// The first and the last of either, ns.
    dated: Option<Span>,
    logged: Option<Span>,
}

impl LogClock {
    pub fn hear(&mut self, t_ns: i64, logged_ns: i64) {
        for (span, t_ns) in [(&mut self.dated, t_ns), (&mut self.logged, logged_ns)] {
            *span = whole(span.take().into_iter().chain([(t_ns, t_ns)]));
        }
        let lead_ns = t_ns.saturating_sub(logged_ns);
        if self.nearest.is_none_or(|(t, logged)| lead_ns.unsigned_abs() < t.abs_diff(logged)) {
            self.nearest = Some((t_ns, logged_ns));
        }
        let continues = |of: &mut SteadyLead| {
            let same = of.lead_ns.abs_diff(lead_ns) <= DELAY_NS;
            if same {
                of.moments = of.moments.saturating_add(u32::from(logged_ns > of.latest_logged_ns));
                of.latest_logged_ns = of.latest_logged_ns.max(logged_ns);
            }
            same
        };
        if self.lead.as_mut().is_some_and(continues) {
            self.aside = None;
            return;
        }
        if !self.aside.as_mut().is_some_and(continues) {
            let (first_logged_ns, latest_logged_ns) = (logged_ns, logged_ns);
            let moments = 1;
            self.aside = Some(SteadyLead {
                lead_ns,
                moments,
                first_logged_ns,
                latest_logged_ns,
                first_ns: t_ns,
            });
        }
        let is_steady = |of: &SteadyLead| self.lead.is_none() || of.is_long();
        if let Some(aside) = self.aside.take_if(|of| is_steady(of)) {
            let before = self.lead.replace(aside).filter(SteadyLead::is_long);
            before.iter().for_each(|before| self.step(before, &aside));
        }
    }

    fn step(&mut self, from: &SteadyLead, to: &SteadyLead) {
        // a clock that runs fast leaves one stretch after the other, each by one delay ahead
        let by_ns = to.lead_ns.abs_diff(from.lead_ns);
        let is_larger = self.forward.is_none_or(|largest| by_ns > largest.by_ns);
        if to.lead_ns > from.lead_ns && by_ns > 2 * DELAY_NS && is_larger {
            self.forward = Some(Forward { by_ns, to_ns: to.first_ns });
        }
    }

    /// Whether a burst is dated ahead by more than two clocks differ, where bursts before it had one lead for long. A
    /// burst that is recorded late is dated behind, and its clock is right.
    pub fn is_ahead(&self, t_ns: i64, logged_ns: i64) -> bool {
        let steady = self.lead.filter(SteadyLead::is_long);
        let more = |of: SteadyLead| t_ns.saturating_sub(logged_ns).saturating_sub(of.lead_ns);
        steady.is_some_and(|of| more(of) > DIFFER_NS as i64)
    }

    /// The clock was set, by what the bursts say themselves: their lead is another one from now on.
    pub fn set(&mut self) {
        self.lead = self.aside.take().or(self.lead);
    }

    /// The largest step forward that is shorter than those that bursts tell themselves.
    pub fn forward(&self) -> Option<Forward> {
        self.forward.filter(|step| step.by_ns <= JUMP_NS as u64)
    }

    /// By how much, ns, all bursts are dated later than they were recorded, where no two clocks differ that much.
    pub fn ahead_ns(&self) -> Option<u64> {
        let (t_ns, logged_ns) = self.nearest?;
        let ahead_ns = t_ns.abs_diff(logged_ns);
        let is_ahead = t_ns > logged_ns && logged_ns >= YEAR_2010_NS;
        (is_ahead && (DIFFER_NS..JUMP_NS as u64).contains(&ahead_ns)).then_some(ahead_ns)
    }

    /// What is to be added to the times of bursts of which none can have been acquired when it says, so that they are
    /// those of the records, ns.
    pub fn misdated_by_ns(&self) -> Option<i64> {
        let (t_ns, logged_ns) = self.nearest.filter(|(t, logged)| is_misdated(*t, *logged))?;
        Some(logged_ns.saturating_sub(t_ns))
    }

    /// How far the bursts are dated apart and how far their records, ns, where time goes at less than a tenth of its
    /// pace: a recorder may hand on in a moment what took long, and hardly the other way round.
    pub fn slow(&self) -> Option<[u64; 2]> {
        self.logged.filter(|of| of.0 >= YEAR_2010_NS)?;
        let [dated, logged] = [self.dated?, self.logged?].map(|(from, to)| to.abs_diff(from));
        (logged >= LASTS_NS as u64 && dated > 0 && dated < logged / 10).then_some([dated, logged])
    }

    /// How much later the burst nearest to its record is dated than that, ns; where records have times.
    pub fn lead_ns(&self) -> Option<i64> {
        let (t_ns, logged_ns) = self.nearest?;
        (logged_ns >= YEAR_2010_NS).then(|| t_ns.saturating_sub(logged_ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: i64 = 1_000_000_000;
    const BEGAN: i64 = 1_700_000_000 * S;

    /// The clock that has heard a burst a second, for two minutes, whose times are given by those of their records.
    fn heard(t_of: impl Fn(i64) -> i64, logged: impl Fn(i64) -> i64) -> LogClock {
        let mut clock = LogClock::default();
        (0..120).for_each(|i| clock.hear(BEGAN + t_of(i * S), BEGAN + logged(i * S)));
        clock
    }

    #[test]
    fn a_clock_that_is_set_forward_is_told_and_a_pause_is_not() {
        let by = 1800 * S;
        let step = |t: i64| if t >= 60 * S { t + by } else { t };
        let late = |t: i64| t + t % 7 * 10_000_000; // of a transport that takes its time
        let forward = heard(step, late).forward().unwrap();
        assert!(forward.by_ns.abs_diff(by as u64) < DELAY_NS, "{forward:?}");
        assert_eq!(forward.to_ns, BEGAN + 60 * S + by);
        assert_eq!(heard(step, step).forward(), None);
        assert_eq!(heard(step, |t| step(late(t))).forward(), None);
    }

    #[test]
    fn blocks_that_are_written_later_drift_and_a_lag_are_no_steps() {
        let now = |t: i64| t;
        // written down once a minute; half a minute that the network held back; a clock that runs fast by 5 %
        assert_eq!(heard(now, |t| (t / (60 * S) + 1) * 60 * S).forward(), None);
        let lag = |t: i64| if (40 * S..70 * S).contains(&t) { 70 * S } else { t };
        assert_eq!(heard(now, lag).forward(), None);
        assert_eq!(heard(|t| t + t / 20, now).forward(), None);
    }

    #[test]
    fn bursts_that_cannot_have_been_acquired_then_are_told() {
        let uptime = |t: i64| t + 312 * S - BEGAN;
        assert_eq!(heard(uptime, |t| t).misdated_by_ns(), Some(BEGAN - 312 * S));
        // hours that a recorder waited for the network, and records without times
        assert_eq!(heard(|t| t, |t| t + 20 * 3600 * S).misdated_by_ns(), None);
        assert_eq!(heard(|t| t, |_| -BEGAN).misdated_by_ns(), None);
        let summer_time = |t: i64| t + 3600 * S;
        assert_eq!(heard(summer_time, |t| t).ahead_ns(), Some(3600 * S as u64));
        assert_eq!(heard(|t| t, summer_time).ahead_ns(), None);
    }

    #[test]
    fn times_in_another_unit_are_told() {
        assert_eq!(
            heard(|t| t / 1000, |t| t).slow(),
            Some([119 * S as u64 / 1000, 119 * S as u64])
        );
        assert_eq!(heard(|t| t, |t| t / 1000).slow(), None);
        assert_eq!(heard(|t| t, |t| t).slow(), None);
    }
}
