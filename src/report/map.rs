//! A printhead as a picture: channels across, time down. In: verdicts, in any order. Out: a [`HeadMap`]. Each
//! cell holds the worst of its verdicts, so that a single bad burst stays visible however much is pooled.

use super::bins::{Pooled, TimeBins};
use super::night::{Span, whole};

/// Most rows of a map.
const MOST_ROWS: usize = 360;
/// Most cells of a map, which bounds its memory: each cell takes two bytes.
const MOST_CELLS: usize = 1 << 20;
/// Most columns of a picture; a printhead with more channels has several channels in each column.
const MOST_COLUMNS: usize = 1200;

/// Codes of a cell in the map of classes. Worse ones are larger, so that the maximum of two is the worse.
pub mod class {
    pub const GAP: u8 = 0;
    pub const HEALTHY: u8 = 1;
    pub const REJECTED: u8 = 2;
    pub const FLAGGED: u8 = 3;
    /// Code of the first category; those of the others follow.
    pub const CATEGORY: u8 = 4;
    /// Number of codes for categories; the last one stands for all further categories.
    pub const CATEGORIES: u8 = 8;
}

/// Lower limits of the levels of statistic over threshold. A cell below the first limit has been judged, too,
/// and has the code [`ratio::LOWEST`].
pub const LEVELS: [f32; 9] = [0.25, 0.5, 0.75, 1.0, 1.5, 2.5, 5.0, 10.0, 30.0];

/// Codes of a cell in the map of statistics; the levels above the first limit follow [`ratio::LOWEST`].
pub mod ratio {
    pub const GAP: u8 = 0;
    pub const REJECTED: u8 = 1;
    pub const LOWEST: u8 = 2;
}

/// The code of a statistic over its threshold.
pub fn level(ratio: f32) -> u8 {
    ratio::LOWEST + LEVELS.iter().map(|from| u8::from(ratio >= *from)).sum::<u8>()
}

/// A row of a map: the cells of one bin of time, by the channel's index.
#[derive(Clone, Debug, Default)]
pub struct Cells {
    span: Option<Span>,
    /// What each picture shows, by [`Shows`]; a gap is 0 in both.
    shown: Vec<[u8; 2]>,
}

impl Pooled for Cells {
    const MOST_BINS: usize = MOST_ROWS;

    fn pool(&mut self, other: Cells) {
        self.span = whole(self.span.into_iter().chain(other.span));
        for (place, [class, ratio]) in other.shown.into_iter().enumerate() {
            self.mark(place, class, ratio);
        }
    }
}

impl Cells {
    /// Puts a verdict into the cell of a channel, unless a worse one is there.
    pub fn mark(&mut self, place: usize, class: u8, ratio: u8) {
        if place >= self.shown.len() {
            self.shown.resize(place + 1, [class::GAP, ratio::GAP]);
        }
        let [was_class, was_ratio] = self.shown[place];
        self.shown[place] = [was_class.max(class), was_ratio.max(ratio)];
    }
}

/// The cells of one printhead, binned in time.
#[derive(Clone, Debug, Default)]
pub struct HeadMap {
    rows: TimeBins<Cells>,
}

/// What a picture shows: classes, or the statistic over its threshold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shows {
    Class,
    Ratio,
}

/// One row of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// Bursts in this time span, ns.
    Bursts(i64, i64),
    /// A time without bursts.
    Pause,
}

/// A map as it is drawn.
#[derive(Clone, Debug)]
pub struct Picture {
    pub lines: Vec<Line>,
    /// The lowest channel of each column.
    pub columns: Vec<u32>,
    /// Number of channels in each column; the last one may have fewer.
    pub channels_per_column: usize,
    /// Codes of the cells, `lines.len()` x `columns.len()`, row by row.
    pub pixels: Vec<u8>,
}

impl HeadMap {
    /// The row that holds a time.
    pub fn row(&mut self, t_ns: i64) -> &mut Cells {
        let cells = self.rows.at(t_ns);
        cells.span = whole(cells.span.into_iter().chain([(t_ns, t_ns)]));
        cells
    }

    /// Lowers the number of rows for a printhead with this many channels, so that the memory stays bounded.
    pub fn make_room(&mut self, channels: usize) {
        self.rows.limit((MOST_CELLS / channels.max(1)).clamp(16, MOST_ROWS));
    }

    /// The map as it is drawn. `channels`: channel number of each index. Columns are in the order of channel
    /// numbers.
    pub fn picture(&self, channels: &[u32], shows: Shows) -> Picture {
        let mut order: Vec<usize> = (0..channels.len()).collect();
        order.sort_by_key(|&place| channels[place]);
        let per = channels.len().div_ceil(MOST_COLUMNS).max(1);
        let columns: Vec<u32> = order.chunks(per).map(|of| channels[of[0]]).collect();
        let lines = self.lines();
        // each line of bursts takes the next row; pauses stay gaps
        let mut rows = self.rows.values();
        let mut pixels = Vec::with_capacity(lines.len() * columns.len());
        for line in &lines {
            let cells = match line {
                Line::Pause => None,
                Line::Bursts(..) => rows.next(),
            };
            let of = cells.map_or(&[][..], |cells| &cells.shown);
            let worst = |places: &[usize]| {
                let codes = places.iter().filter_map(|&p| Some(of.get(p)?[shows as usize]));
                codes.max().unwrap_or(0)
            };
            pixels.extend(order.chunks(per).map(worst));
        }
        Picture { lines, columns, channels_per_column: per, pixels }
    }

    /// One line for each row, and a pause where the time between two rows is more than [`PAUSE`] times the
    /// median.
    fn lines(&self) -> Vec<Line> {
        let rows: Vec<Span> = self.rows.values().filter_map(|cells| cells.span).collect();
        let mut steps: Vec<i64> = rows.windows(2).map(|w| w[1].0.saturating_sub(w[0].1)).collect();
        steps.sort_unstable();
        let usual = steps.get(steps.len() / 2).copied().unwrap_or(0).max(self.rows.width_ns);
        let mut lines: Vec<Line> = Vec::new();
        for (k, &(from, to)) in rows.iter().enumerate() {
            if k > 0 && from.saturating_sub(rows[k - 1].1) > usual.saturating_mul(PAUSE) {
                lines.push(Line::Pause);
            }
            lines.push(Line::Bursts(from, to));
        }
        lines
    }
}

/// A time between rows that is longer than this multiple of the usual one is shown as a pause.
const PAUSE: i64 = 4;

impl Picture {
    /// The line that shows a time; the next line if no line shows it, and the last one if none follows.
    pub fn line_of(&self, t_ns: i64) -> usize {
        let mut bursts = self.lines.iter().enumerate().filter_map(|(k, line)| match line {
            Line::Bursts(_, to) => Some((k, *to)),
            Line::Pause => None,
        });
        let shows = bursts.clone().find(|(_, to)| *to >= t_ns);
        shows.or(bursts.next_back()).map_or(0, |(k, _)| k)
    }

    /// The column that shows a channel.
    pub fn column_of(&self, channel: u32) -> usize {
        self.columns.partition_point(|first| *first <= channel).saturating_sub(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_bad_burst_stays_visible_and_pauses_are_drawn_once() {
        let mut map = HeadMap::default();
        for burst in 0..5000i64 {
            let t = burst * 1_000_000_000 + if burst >= 2500 { 86_400_000_000_000 } else { 0 };
            let row = map.row(t);
            for channel in 0..8 {
                let bad = burst == 1234 && channel == 3;
                let class = if bad { class::FLAGGED } else { class::HEALTHY };
                row.mark(channel, class, level(if bad { 20.0 } else { 0.3 }));
            }
        }
        let channels = [10, 11, 12, 13, 14, 15, 16, 17];
        let picture = map.picture(&channels, Shows::Class);
        assert_eq!(picture.pixels.iter().filter(|p| **p == class::FLAGGED).count(), 1);
        assert_eq!(picture.lines.iter().filter(|l| **l == Line::Pause).count(), 1);
        assert!((180..=361).contains(&picture.lines.len()), "{}", picture.lines.len());
        let at = picture.line_of(1234 * 1_000_000_000) * 8 + picture.column_of(13);
        assert_eq!(picture.pixels[at], class::FLAGGED);
        let ratio = map.picture(&channels, Shows::Ratio);
        assert_eq!(ratio.pixels[at], level(20.0));
        assert_eq!(ratio.pixels.iter().filter(|p| **p == ratio::GAP).count(), 8, "the pause");
    }

    #[test]
    fn a_channel_that_was_not_measured_is_a_gap() {
        let mut map = HeadMap::default();
        map.row(0).mark(0, class::HEALTHY, level(0.1));
        map.row(5_000_000_000).mark(1, class::REJECTED, ratio::REJECTED);
        let picture = map.picture(&[5, 2], Shows::Class);
        assert_eq!(picture.columns, [2, 5]);
        assert_eq!(picture.pixels, [class::GAP, class::HEALTHY, class::REJECTED, class::GAP]);
    }
}
