//! Whether so many of a printhead's channels are flagged at once that what they share is the likelier cause.
//!
//! In: a printhead's judged signals, in the recording's order. Out: since when that was so, and for how long.

use super::head_movement::at;
use inkling_core::verdict::at_once::{ADVICE, FEWEST_CHANNELS, MOST_AT_ONCE};

/// So many looks at all channels in a row are no disturbance that passes, as a supply that is switched. The number is
/// derived from nothing; half and twice of it were not tried.
const IN_A_ROW: u64 = 8;

#[derive(Clone, Debug, Default)]
pub struct AtOnce {
    from_ns: i64,
    t_ns: i64,
    judged: u64,
    flagged: u64,
    /// Looks in a row in which so many were flagged, and when the first of them was.
    in_a_row: u64,
    row_from_ns: i64,
    longest: Option<Stretch>,
}

/// Looks in a row at all of a printhead's channels in which so many of these were flagged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
    /// So many signals of a printhead that has so many channels.
    pub fn see(&mut self, t_ns: i64, judged: u64, flagged: u64, channels: u64) {
        // a look ends with a moment, and not before all channels had time to be heard
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
            if self.in_a_row == 0 {
                self.row_from_ns = self.from_ns;
            }
            self.in_a_row += 1;
            let now = Stretch { from_ns: self.row_from_ns, looks: self.in_a_row };
            if self.longest.is_none_or(|longest| now.looks > longest.looks) {
                self.longest = Some(now);
            }
        } else {
            self.in_a_row = 0;
        }
        (self.judged, self.flagged) = (0, 0);
    }

    /// The longest of those that are worth a word.
    pub fn longest(&self) -> Option<Stretch> {
        self.longest.filter(|of| of.looks >= IN_A_ROW)
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
        // the last look has not ended
        assert_eq!(seen((0..40).map(bad)), Some(Stretch { from_ns: 10, looks: 29 }));
        assert_eq!(seen((0..40).map(|_| (20, 6))), None);
        assert_eq!(seen((0..40).map(|t| (20, if t % 8 < 7 { 20 } else { 0 }))), None);
        assert_eq!(seen((0..40).map(|_| (1, 1))), None, "two looks at twenty channels");
        assert!(seen((0..400).map(|_| (1, 1))).is_some());
    }
}
