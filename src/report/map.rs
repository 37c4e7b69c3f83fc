//! A printhead as a picture: channels across, time down. `survey` fills the map while verdicts are
//! read, and `maps` draws it.
//!
//! In: a code of each verdict, in any order ([`class`]). Out: a [`HeadMap`], and of it a
//! [`Picture`]; the size of both is bounded, however long the recordings are.
//!
//! The steps: bursts fall into rows, bins of time whose width doubles when there would be too many
//! (`TimeBins`). A cell pools the verdicts of one channel in one row and keeps the largest
//! code, so that a single bad burst stays visible however much is pooled. `HeadMap::picture`
//! puts channels in order, pools neighbouring channels where there are too many columns, and shows
//! longer times without bursts as a pause.

use super::bins::{Pooled, TimeBins};
use super::night::{Span, whole};
use serde::{Deserialize, Serialize};

/// Most rows of a map; where bursts would need more, rows become twice as long ([`TimeBins`]).
const MOST_ROWS: usize = 360;
/// Most cells of a map, which bounds its memory: each cell takes one byte.
const MOST_CELLS: usize = 1 << 20;
/// Most columns of a picture; a printhead with more channels has several channels in each column.
const MOST_COLUMNS: usize = 1200;

/// Codes of a cell, of which the larger one of two is shown. Categories have their
/// codes in the order in which the survey lists them: a larger one is not worse.
pub mod class {
    pub const GAP: u8 = 0;
    pub const HEALTHY: u8 = 1;
    pub const REJECTED: u8 = 2;
    /// Flagged, without a category that is certain.
    pub const FLAGGED: u8 = 3;
    /// Code of the first category of the survey's list; those of the others follow in its order.
    pub const CATEGORY: u8 = 4;
    /// Number of codes for categories; the last one stands for all further categories.
    pub const CATEGORIES: u8 = 8;
}

/// A row of a map: the cells of one bin of time, by the index of the channel in the survey's list.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cells {
    /// Times of the first and the last burst in the row.
    span: Option<Span>,
    /// The code of each channel.
    #[serde(with = "runs")]
    shown: Vec<u8>,
}

/// Codes as runs of equal ones, since most channels are healthy: `[[code, how many], ...]`.
mod runs {
    use super::MOST_CELLS;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(codes: &[u8], to: S) -> Result<S::Ok, S::Error> {
        let runs = codes.chunk_by(|a, b| a == b).map(|run| (run[0], run.len()));
        runs.collect::<Vec<_>>().serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<u8>, D::Error> {
        let runs = Vec::<(u8, usize)>::deserialize(from)?;
        let codes = runs.iter().flat_map(|&(code, n)| std::iter::repeat_n(code, n));
        Ok(codes.take(MOST_CELLS).collect())
    }
}

impl Pooled for Cells {
    const MOST_BINS: usize = MOST_ROWS;
    const FINEST_NS: i64 = 1_000_000;

    fn pool(&mut self, other: Cells) {
        self.span = whole(self.span.into_iter().chain(other.span));
        for (place, code) in other.shown.into_iter().enumerate() {
            self.mark(place, code);
        }
    }
}

impl Cells {
    /// The cells of another list of channels and categories. `places`: the index there of each channel here; `codes`:
    /// the code there of each category here.
    pub fn placed(self, places: &[Option<usize>], codes: &[u8]) -> Cells {
        let mut there = Cells { span: self.span, shown: Vec::new() };
        for (code, place) in self.shown.into_iter().zip(places) {
            let category = code.checked_sub(class::CATEGORY).map(usize::from);
            let code = category.and_then(|of| codes.get(of)).copied().unwrap_or(code);
            place.iter().for_each(|place| there.mark(*place, code));
        }
        there
    }

    /// Puts a verdict's code into the cell of the channel with the index `place`, unless a larger one is
    /// there.
    pub fn mark(&mut self, place: usize, code: u8) {
        if place >= self.shown.len() {
            self.shown.resize(place + 1, class::GAP);
        }
        self.shown[place] = self.shown[place].max(code);
    }
}

/// The cells of one printhead, in rows of time that hold at least one burst.
pub type HeadMap = TimeBins<Cells>;

/// A map as it is drawn.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Its rows: the times of the first and the last burst, ns. `None`: a pause, one line whatever it lasts.
    pub lines: Vec<Option<Span>>,
    /// The lowest channel of each column.
    pub columns: Vec<u32>,
    /// Number of channels in each column; the last one may have fewer.
    pub channels_per_column: usize,
    /// Codes of the cells, `lines.len()` x `columns.len()`, row by row.
    pub pixels: Vec<u8>,
}

impl HeadMap {
    /// The row for a burst at a time, which is added if it is new; then other rows may be pooled.
    pub fn row(&mut self, t_ns: i64) -> &mut Cells {
        let cells = self.at(t_ns);
        cells.span = whole(cells.span.into_iter().chain([(t_ns, t_ns)]));
        cells
    }

    /// Bounds the number of rows of a printhead with this many channels, so that there are at most `MOST_CELLS`
    /// cells. It has to be called for each new channel, before its verdicts are marked.
    pub fn make_room(&mut self, channels: usize) {
        self.limit((MOST_CELLS / channels.max(1)).clamp(16, MOST_ROWS));
    }

    /// The map as it is drawn. `channels`: the channel number that belongs to each index of [`Cells::mark`].
    /// A pixel is the largest code of the channels in its column.
    pub fn picture(&self, channels: &[u32]) -> Picture {
        let mut order: Vec<usize> = (0..channels.len()).collect();
        order.sort_by_key(|&place| channels[place]);
        let per = channels.len().div_ceil(MOST_COLUMNS).max(1);
        let columns: Vec<u32> = order.chunks(per).map(|of| channels[of[0]]).collect();
        let lines = self.lines();

        // The pixels: each line of bursts takes the next row, and pauses stay gaps.
        let mut rows = self.values();
        let mut pixels = Vec::with_capacity(lines.len() * columns.len());
        for line in &lines {
            let cells = line.and_then(|_| rows.next());
            let of = cells.map_or(&[][..], |cells| &cells.shown);
            let worst = |places: &[usize]| {
                let codes = places.iter().filter_map(|&place| of.get(place));
                codes.max().copied().unwrap_or(class::GAP)
            };
            pixels.extend(order.chunks(per).map(worst));
        }
        Picture { lines, columns, channels_per_column: per, pixels }
    }

    /// One line for each row, and a pause between two rows where the time from the last burst of the one to
    /// the first of the other is more than [`PAUSE`] times the usual one: the lower median over all rows, or
    /// the width of a row if that is more.
    fn lines(&self) -> Vec<Option<Span>> {
        let rows: Vec<Span> = self.values().filter_map(|cells| cells.span).collect();
        let mut steps: Vec<i64> = rows.windows(2).map(|w| w[1].0.saturating_sub(w[0].1)).collect();
        steps.sort_unstable();
        let middle = steps.len().saturating_sub(1) / 2;
        let usual = steps.get(middle).copied().unwrap_or(0).max(self.width_ns);

        let mut lines = Vec::new();
        for (k, &(from, to)) in rows.iter().enumerate() {
            if k > 0 && from.saturating_sub(rows[k - 1].1) > usual.saturating_mul(PAUSE) {
                lines.push(None);
            }
            lines.push(Some((from, to)));
        }
        lines
    }
}

/// A time between two rows that is longer than this multiple of the usual one is shown as a pause.
const PAUSE: i64 = 4;

impl Picture {
    /// Index of the line of bursts that shows a time, else of the next one, else of the last one.
    pub fn line_of(&self, t_ns: i64) -> usize {
        let each = self.lines.iter().enumerate();
        let mut bursts = each.filter_map(|(k, line)| Some((k, line.as_ref()?.1)));
        let shows = bursts.clone().find(|(_, to)| *to >= t_ns);
        shows.or(bursts.next_back()).map_or(0, |(k, _)| k)
    }

    /// Index of the column that shows a channel, which must be one of the map's.
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
                row.mark(channel, class);
            }
        }
        let channels = [10, 11, 12, 13, 14, 15, 16, 17];
        let picture = map.picture(&channels);
        assert_eq!(picture.pixels.iter().filter(|p| **p == class::FLAGGED).count(), 1);
        assert_eq!(picture.lines.iter().filter(|l| l.is_none()).count(), 1);
        assert!((180..=361).contains(&picture.lines.len()), "{}", picture.lines.len());
        let at = picture.line_of(1234 * 1_000_000_000) * 8 + picture.column_of(13);
        assert_eq!(picture.pixels[at], class::FLAGGED);
        assert_eq!(picture.pixels.iter().filter(|p| **p == class::GAP).count(), 8, "the pause");
    }

    #[test]
    fn a_channel_that_was_not_measured_is_a_gap() {
        let mut map = HeadMap::default();
        map.row(0).mark(0, class::HEALTHY);
        map.row(5_000_000_000).mark(1, class::REJECTED);
        let picture = map.picture(&[5, 2]);
        assert_eq!(picture.columns, [2, 5]);
        assert_eq!(picture.pixels, [class::GAP, class::HEALTHY, class::REJECTED, class::GAP]);
    }
}
