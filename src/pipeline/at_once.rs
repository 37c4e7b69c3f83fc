//! Finds out whether so many of a printhead's channels are flagged at once that a cause which they share is
//! likelier than that many faults.
//!
//! In: a printhead's judged signals, in the recording's order, from `tally`. Out: since when that was so, and in
//! how many looks, as a warning ([`AtOnce::longest`]).
//!
//! A *look* here is a stretch of time in which as many signals were judged as the printhead has channels (and at
//! least five). A look is bad if more than a third of its signals are flagged ([`MOST_AT_ONCE`]).

use super::head_movement::at;
use inkling_core::verdict::at_once::{ADVICE, FEWEST_CHANNELS, MOST_AT_ONCE};

/// Least number of consecutive bad looks to be told of: a disturbance that passes does not last so long. It is
/// derived from nothing; half and twice of it were not tried.
const IN_A_ROW: u64 = 8;

#[derive(Clone, Debug, Default)]
pub struct AtOnce {
    /// When the look at hand began, and the time of its latest signal, ns.
    from_ns: i64,
    t_ns: i64,
    /// Number of signals that were judged, and of those that were flagged, in the look at hand.
    judged: u64,
    flagged: u64,
    /// The consecutive bad looks, up to the last one.
    row: Stretch,
    longest: Stretch,
}

/// A row of consecutive looks, in each of which more than a third of the judged signals were flagged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stretch {
    pub from_ns: i64,
    pub looks: u64,
}

impl Stretch {
    pub fn in_words(&self) -> String {
        format!(
            "from {} on more than a third of its channels are flagged at once, in {} looks in a row. {ADVICE}",
            at(self.from_ns),
            self.looks
        )
    }
}

impl AtOnce {
    /// Takes in signals of a moment. `channels`: number of the printhead's channels that were met so far.
    pub fn see(&mut self, t_ns: i64, judged: u64, flagged: u64, channels: u64) {
        // a look ends between two moments, once as many signals as there are channels were heard
        if t_ns != self.t_ns && self.judged >= channels.max(FEWEST_CHANNELS as u64) {
            self.end_look();
        }
        if self.judged == 0 {
            self.from_ns = t_ns;
        }
        self.t_ns = t_ns;
        self.judged += judged;
        self.flagged += flagged;
    }

    fn end_look(&mut self) {
        if self.flagged as f64 > MOST_AT_ONCE * self.judged as f64 {
            if self.row.looks == 0 {
                self.row.from_ns = self.from_ns;
            }
            self.row.looks += 1;
            if self.row.looks > self.longest.looks {
                self.longest = self.row;
            }
        } else {
            self.row.looks = 0;
        }
        (self.judged, self.flagged) = (0, 0);
    }

    /// The longest run of looks, if it is long enough to be told of.
    pub fn longest(&self) -> Option<Stretch> {
        Some(self.longest).filter(|of| of.looks >= IN_A_ROW)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(looks: impl Iterator<Item = (u64, u64)>) -> Option<Stretch> {
        let mut of = AtOnce::default();
        for (t, (judged, flagged)) in looks.enumerate() {
            of.see(t as i64, judged, flagged, 20);
        }
        of.longest()
    }

    #[test]
    fn most_channels_in_many_looks_are_told_and_few_or_short_ones_are_not() {
        let bad = |t: u64| (20, if t >= 10 { 20 } else { 1 });
        // from 10 on, all channels are flagged in 30 looks, of which the last one has not ended
        assert_eq!(seen((0..40).map(bad)), Some(Stretch { from_ns: 10, looks: 29 }));
        assert_eq!(seen((0..40).map(|_| (20, 6))), None);
        assert_eq!(seen((0..40).map(|t| (20, if t % 8 < 7 { 20 } else { 0 }))), None);
        assert_eq!(seen((0..40).map(|_| (1, 1))), None, "two looks at twenty channels");
        assert!(seen((0..400).map(|_| (1, 1))).is_some());
    }
}
