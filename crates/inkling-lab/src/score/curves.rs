//! What a detector could do with other thresholds, and what certainty is worth: sums for the curves
//! on the evaluation's page (`report::evaluation`).
//!
//! In: one labelled signal after another, from `inkling score`: its statistic over its threshold and
//! whether it is faulty (`add`), how certain its candidate was and whether that was right, its true and
//! stated severity, its true state and what was said. Out: points of ROC and DET (`operating`), delays
//! against false alarms (`delays`), risk against coverage (`risk`), pairs of severities, a confusion.
//!
//! The ratio statistic / threshold is all that another threshold needs: with the threshold multiplied by a
//! factor, those signals are flagged whose ratio exceeds the factor. So ratios are counted in 1600 bins of
//! their logarithm, and memory does not grow with signals. A fault counts as one event: it is found when
//! its first signal is flagged, and its other signals earn nothing more.

use std::collections::BTreeMap;
use std::sync::Arc;

/// The bins of ln(statistic / threshold) reach from -LN_RANGE to LN_RANGE, a factor of 3000 either
/// way; what lies beyond counts in the outermost bins.
const LN_RANGE: f64 = 8.0;
const BINS: usize = 1600;
const CERTAINTY_BINS: usize = 1000;
/// Most pairs of severities of a class that are kept and drawn.
const MOST_POINTS: usize = 1500;
/// Most labelled faults whose delays are kept; further faults count signal by signal only.
const MOST_EVENTS: usize = 1 << 18;

/// A labelled fault: printhead, channel and onset (ns; `None`: the label has no begin).
pub type Event = (Arc<str>, u32, Option<i64>);

/// The sums. `healthy` and `faulty` count signals by the bin of their ratio.
#[derive(Clone, Debug)]
pub struct Curves {
    healthy: Vec<u64>,
    faulty: Vec<u64>,
    /// By bin of certainty: number of faulty signals whose candidate is right, and of all with a
    /// candidate.
    certainty: Vec<[u64; 2]>,
    severities: BTreeMap<String, Points>,
    events: BTreeMap<Event, RunningMaximum>,
    /// Numbers of signals by true state and by the word that was said: healthy, undecided, a
    /// category, a class.
    pub confusion: BTreeMap<(String, String), u64>,
}

/// One in `every` of the pairs met is kept, so that those kept are spread evenly over all.
#[derive(Clone, Debug)]
struct Points {
    every: u64,
    met: u64,
    kept: Vec<(f64, f64)>,
}

/// The records of the ratio over the bursts of one fault: the number of bursts before, and the ratio. The
/// first record above a factor is the burst at which that factor flags the fault first.
#[derive(Clone, Debug, Default)]
struct RunningMaximum {
    bursts: u32,
    records: Vec<(u32, f32)>,
}

/// Rates of false alarms and misses if the threshold were multiplied by `factor`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Operating {
    pub factor: f64,
    /// Shares of the healthy, and of the faulty, signals.
    pub false_alarms: f64,
    pub misses: f64,
}

/// Delays over all events if the threshold were multiplied by `factor`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EventDelay {
    pub factor: f64,
    pub false_alarms: f64,
    /// Share of the labelled faults that have a flagged signal.
    pub found: f64,
    /// Number of bursts, of those before a fault's first flagged one, within which at least half of all
    /// faults are found; `None`: too few are found at all.
    pub median_bursts: Option<f64>,
    /// The same number within which at least nine of ten faults are found.
    pub most_bursts: Option<f64>,
}

impl Default for Curves {
    fn default() -> Curves {
        Curves {
            healthy: vec![0; BINS],
            faulty: vec![0; BINS],
            certainty: vec![[0; 2]; CERTAINTY_BINS],
            severities: BTreeMap::new(),
            events: BTreeMap::new(),
            confusion: BTreeMap::new(),
        }
    }
}

impl Curves {
    /// `ratio`: the signal's statistic over its threshold; NaN is passed over. `event`: the labelled fault
    /// that it belongs to; `None`: it is healthy. The signals of a fault must come in the order of time.
    pub fn add(&mut self, ratio: f64, event: Option<Event>) {
        if ratio.is_nan() {
            return;
        }
        let of = if event.is_some() { &mut self.faulty } else { &mut self.healthy };
        of[bin(ratio)] += 1;
        let Some(event) = event else { return };
        if self.events.len() >= MOST_EVENTS && !self.events.contains_key(&event) {
            return;
        }

        let maximum = self.events.entry(event).or_default();
        let highest = maximum.records.last().map_or(f32::NEG_INFINITY, |r| r.1);
        if ratio as f32 > highest {
            maximum.records.push((maximum.bursts, ratio as f32));
        }
        maximum.bursts += 1;
    }

    /// Adds how certain the candidate of a faulty signal was (0 to 1), and whether it was right.
    pub fn add_certainty(&mut self, certainty: f64, right: bool) {
        if certainty.is_finite() {
            let at = (certainty.clamp(0.0, 1.0) * CERTAINTY_BINS as f64) as usize;
            let of = &mut self.certainty[at.min(CERTAINTY_BINS - 1)];
            of[0] += u64::from(right);
            of[1] += 1;
        }
    }

    /// Adds a true and a stated severity. When more than `MOST_POINTS` pairs are kept, every second
    /// one is dropped, and from then on only half as many are kept.
    pub fn add_severity(&mut self, class: &str, truth: f64, stated: f64) {
        if !(truth.is_finite() && stated.is_finite()) {
            return;
        }
        let new = || Points { every: 1, met: 0, kept: Vec::new() };
        let of = self.severities.entry(class.to_owned()).or_insert_with(new);
        if of.met.is_multiple_of(of.every) {
            of.kept.push((truth, stated));
        }
        of.met += 1;
        if of.kept.len() > MOST_POINTS {
            let mut k = 0;
            of.kept.retain(|_| {
                k += 1;
                k % 2 == 1
            });
            of.every *= 2;
        }
    }

    pub fn add_confusion(&mut self, truth: &str, predicted: &str) {
        *self.confusion.entry((truth.to_owned(), predicted.to_owned())).or_default() += 1;
    }

    pub fn healthy(&self) -> u64 {
        self.healthy.iter().sum()
    }

    pub fn faulty(&self) -> u64 {
        self.faulty.iter().sum()
    }

    /// Number of labelled faults whose delays are kept.
    pub fn events(&self) -> usize {
        self.events.len()
    }

    /// Rates at every threshold where one of them changes, from the highest to the lowest: the points of
    /// ROC and DET. The thresholds are the lower edges of bins.
    pub fn operating(&self) -> Vec<Operating> {
        let (healthy, faulty) = (self.healthy().max(1) as f64, self.faulty().max(1) as f64);
        let (mut alarms, mut hits) = (0u64, 0u64);
        let mut points = Vec::new();
        for at in (0..BINS).rev() {
            if self.healthy[at] + self.faulty[at] == 0 {
                continue;
            }
            alarms += self.healthy[at];
            hits += self.faulty[at];
            points.push(Operating {
                factor: factor(at),
                false_alarms: alarms as f64 / healthy,
                misses: 1.0 - hits as f64 / faulty,
            });
        }
        points
    }

    /// The rates at the threshold that was used.
    pub fn working_point(&self) -> Operating {
        let beyond = |of: &[u64]| of[above(1.0)..].iter().sum::<u64>() as f64;
        Operating {
            factor: 1.0,
            false_alarms: beyond(&self.healthy) / self.healthy().max(1) as f64,
            misses: 1.0 - beyond(&self.faulty) / self.faulty().max(1) as f64,
        }
    }

    /// Area under the ROC curve: the probability that a faulty signal's ratio exceeds a healthy
    /// one's. Two signals of one bin count as a tie, which is half.
    pub fn area(&self) -> f64 {
        let (mut below, mut area) = (0.0, 0.0);
        for (h, f) in self.healthy.iter().zip(&self.faulty) {
            area += *f as f64 * (below + 0.5 * *h as f64);
            below += *h as f64;
        }
        area / (self.healthy().max(1) as f64 * self.faulty().max(1) as f64)
    }

    /// `factors`: on the threshold that was used. Only ratios of faults are compared exactly.
    pub fn delays(&self, factors: &[f64]) -> Vec<EventDelay> {
        let healthy = self.healthy().max(1) as f64;
        let at = |&factor: &f64| {
            let mut delays: Vec<u32> = Vec::new();
            for maximum in self.events.values() {
                let first = maximum.records.iter().find(|r| f64::from(r.1) > factor);
                delays.extend(first.map(|r| r.0));
            }
            delays.sort_unstable();
            let alarms: u64 = self.healthy[above(factor)..].iter().sum();
            let within = |n: usize| delays.get(n.checked_sub(1)?).copied().map(f64::from);
            EventDelay {
                factor,
                false_alarms: alarms as f64 / healthy,
                found: delays.len() as f64 / self.events.len().max(1) as f64,
                median_bursts: within(self.events.len().div_ceil(2)),
                most_bursts: within((9 * self.events.len()).div_ceil(10)),
            }
        };
        factors.iter().map(at).collect()
    }

    /// Risk against coverage, the most certain signals first: pairs of the share of the isolated
    /// signals that is kept, and the share of the kept ones that is wrong.
    pub fn risk(&self) -> Vec<(f64, f64)> {
        let all = self.certainty.iter().map(|b| b[1]).sum::<u64>().max(1) as f64;
        let (mut right, mut n) = (0, 0);
        let kept = self.certainty.iter().rev().filter(|b| b[1] > 0);
        kept.map(|b| {
            right += b[0];
            n += b[1];
            (n as f64 / all, 1.0 - right as f64 / n as f64)
        })
        .collect()
    }

    pub fn severities(&self) -> impl Iterator<Item = (&str, &[(f64, f64)])> {
        self.severities.iter().map(|(class, points)| (class.as_str(), points.kept.as_slice()))
    }
}

/// Lower edge of a bin, as a factor on the threshold.
fn factor(bin: usize) -> f64 {
    (2.0 * LN_RANGE * bin as f64 / BINS as f64 - LN_RANGE).exp()
}

/// Place of a ratio among the bins' lower edges: a whole number on an edge, to the rounding of a logarithm.
fn place(ratio: f64) -> f64 {
    let share = (ratio.max(f64::MIN_POSITIVE).ln() + LN_RANGE) / (2.0 * LN_RANGE);
    let place = share * BINS as f64;
    if (place - place.round()).abs() < 1e-9 { place.round() } else { place }
}

/// Bin of a ratio. A bin holds its upper edge and not its lower one, since a signal at the threshold is not
/// flagged.
fn bin(ratio: f64) -> usize {
    ((place(ratio).ceil() - 1.0).max(0.0) as usize).min(BINS - 1)
}

/// The first bin that lies whole above a threshold, given as factor on the one that was used.
fn above(factor: f64) -> usize {
    (place(factor).ceil().max(0.0) as usize).min(BINS - 1)
}

/// 95 % interval of a share from `hits` among `n` independent signals (Wilson 1927). Both may be fractions,
/// as for an effective number of signals.
pub fn wilson(hits: f64, n: f64) -> [f64; 2] {
    const Z2: f64 = 1.96 * 1.96;
    let share = hits / n.max(1.0);
    let middle = (share + Z2 / (2.0 * n.max(1.0))) / (1.0 + Z2 / n.max(1.0));
    let spread = share * (1.0 - share) / n.max(1.0) + Z2 / (4.0 * n.max(1.0).powi(2));
    let half = (Z2 * spread).sqrt() / (1.0 + Z2 / n.max(1.0));
    [(middle - half).max(0.0), (middle + half).min(1.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(channel: u32) -> Option<Event> {
        Some(("p".into(), channel, Some(0)))
    }

    #[test]
    fn curves_of_a_few_signals_are_those_by_hand() {
        let mut curves = Curves::default();
        for ratio in [0.1, 0.2, 0.5, 2.0] {
            curves.add(ratio, None);
        }
        for (channel, ratio) in [(1, 0.3), (1, 3.0), (2, 0.8), (2, 0.9), (3, 9.0), (3, 0.1)] {
            curves.add(ratio, event(channel));
        }
        let at = curves.working_point();
        assert!(at.false_alarms == 0.25 && (at.misses - 4.0 / 6.0).abs() < 1e-12, "{at:?}");
        // pairs in which the faulty signal is higher: .3 2, 3 4, .8 3, .9 3, 9 4, .1 half a one
        assert!((curves.area() - (2.0 + 4.0 + 3.0 + 3.0 + 4.0 + 0.5) / 24.0).abs() < 1e-12);
        let delays = curves.delays(&[1.0, 0.85, 0.25]);
        assert_eq!((delays[0].found, delays[0].median_bursts), (2.0 / 3.0, Some(1.0)));
        assert_eq!((delays[1].found, delays[1].median_bursts), (1.0, Some(1.0)));
        assert_eq!(delays[2].median_bursts, Some(0.0));
        let last = *curves.operating().last().unwrap();
        assert_eq!((last.false_alarms, last.misses), (1.0, 0.0));
    }

    #[test]
    fn nine_of_ten_faults_are_found_where_one_of_ten_is_not() {
        let mut curves = Curves::default();
        (0..10)
            .for_each(|channel| curves.add(if channel == 0 { 0.5 } else { 2.0 }, event(channel)));
        let at = curves.delays(&[1.0])[0];
        assert_eq!((at.median_bursts, at.most_bursts), (Some(0.0), Some(0.0)));
    }

    #[test]
    fn a_signal_at_a_threshold_is_not_flagged_and_edges_lie_in_the_bin_below() {
        let mut curves = Curves::default();
        curves.add(1.0, None);
        curves.add(1.0, event(1));
        let at = curves.working_point();
        assert_eq!((at.false_alarms, at.misses), (0.0, 1.0));
        assert!((1..BINS).all(|at| bin(factor(at)) == at - 1 && above(factor(at)) == at));
    }

    #[test]
    fn the_most_certain_are_kept_first_and_points_are_thinned() {
        let mut curves = Curves::default();
        for (certainty, right) in [(0.95, true), (0.9, true), (0.6, false), (0.5, true)] {
            curves.add_certainty(certainty, right);
        }
        let risk = curves.risk();
        let expected = [(0.25, 0.0), (0.5, 0.0), (0.75, 1.0 / 3.0), (1.0, 0.25)];
        for (is, by_hand) in risk.iter().zip(expected) {
            assert!(
                (is.0 - by_hand.0).abs() < 1e-12 && (is.1 - by_hand.1).abs() < 1e-12,
                "{risk:?}"
            );
        }
        (0..10_000).for_each(|k| curves.add_severity("BN", f64::from(k), 1.0));
        let (_, kept) = curves.severities().next().unwrap();
        assert!((MOST_POINTS / 2..=MOST_POINTS).contains(&kept.len()));
        assert!(kept.last().unwrap().0 > 9_900.0, "the last ones, too");
    }

    #[test]
    fn wilson_is_the_published_interval() {
        // Newcombe 1998, table I: 81 of 263, 15 of 148, 0 of 20
        for (hits, n, low, high) in
            [(81.0, 263.0, 0.2553, 0.3662), (15.0, 148.0, 0.0624, 0.1605), (0.0, 20.0, 0.0, 0.1611)]
        {
            let [a, b] = wilson(hits, n);
            assert!((a - low).abs() < 1e-4 && (b - high).abs() < 1e-4, "{hits}/{n}: {a} {b}");
        }
    }
}
