//! How the samples of a proposed dialect lie: their layout, the channels, and the samples of each.
//!
//! In: the samples of a first message, and its fields. Out: keys of the block. They come from fields whose number
//! divides that of the samples, checked or replaced by how the samples correlate ([`RowLayout`]); or from the layout of
//! a ROS array.

use super::{Guess, QUESTION, quoted};
use crate::dialect::dimensions::Dimensions;
use crate::dialect::fields::Slot;
use crate::dialect::first_message::FirstMessage;
use crate::dialect::names::{CHANNELS, COLUMNS, Names, find};
use inkling_core::model::row_layout::RowLayout;

/// Why so many channels.
const BY_SAMPLES: &str = "by the samples: so many signals ring alike";

/// A field whose whole number `n` divides the number of samples, so that `n` may be the channels or
/// the samples per channel.
struct Divisor {
    path: String,
    n: usize,
}

impl Guess<'_> {
    /// Writes layout, channels and samples per channel, with n numbers in the message: what fields
    /// say if their numbers divide n, else what the samples look like.
    pub(super) fn say_shape(&mut self) {
        let numbers = self.samples.numbers.len();
        if self.is_of_one_channel() {
            self.say("channels", "1", "? a message has one channel, whose number it says");
            return;
        }
        let rows = self.divisor(&CHANNELS, Slot::Channels);
        let (rows, columns) = match (rows, self.divisor(&COLUMNS, Slot::SamplesPerChannel)) {
            // `n` may be either
            (None, Some(n)) if self.counts_channels(&n) => (Some(n), None),
            known => known,
        };

        // 1. the number of channels by the fields, if any says it
        let by_columns = || columns.as_ref().map(|columns| numbers / columns.n);
        let named = rows.as_ref().map(|rows| rows.n).or_else(by_columns);
        // in a list of lists, the number of inner lists is either the channels or the samples per
        // channel
        let outer = self.samples.outer;
        let nested = |n: usize| outer.is_none_or(|outer| n == outer || n * outer == numbers);
        // 2. the likeliest layout among those that agree with the fields, or with the lists
        let agrees = |n: usize| named.map_or_else(|| nested(n), |named| n == named);
        let lie = RowLayout::likeliest(&self.samples.numbers, agrees);
        self.say_layout(lie);

        // 3. the channels: a field, else what the samples per channel leave, else the samples, else
        //    the lists, else a question
        let agrees = |n: usize| rows.as_ref().is_none_or(|rows| rows.n * n == numbers);
        let unknown = format!("? not in the message, which has {numbers} samples");
        let (value, comment) = match (&rows, named, lie, outer) {
            (Some(rows), ..) => {
                let is_sure = columns.as_ref().is_none_or(|columns| agrees(columns.n));
                let comment = if is_sure { "" } else { "? or is this samples per channel" };
                (quoted(&rows.path), comment)
            }
            (None, Some(n), ..) => {
                let comment = "? not in the message: numbers of the first, by samples_per_channel";
                (n.to_string(), comment)
            }
            (None, None, Some(lie), _) => (lie.channels.to_string(), BY_SAMPLES),
            (None, None, None, Some(outer)) => {
                (outer.to_string(), "? the lists in the first message")
            }
            (None, None, None, None) => (QUESTION.into(), &*unknown),
        };
        let shown = lie.filter(|_| rows.is_none()).map(|lie| lie.channels);
        if !shown.is_some_and(|n| self.say_counting_field(n)) {
            self.say("channels", &value, comment);
        }
        // 4. the samples per channel; a field that contradicts the channels is left out, and then
        //    the decoder divides the samples by the channels
        if let Some(columns) = columns.filter(|columns| agrees(columns.n)) {
            self.say("samples_per_channel", &quoted(&columns.path), "");
        }
    }

    /// Writes the shape that the layout of a ROS array says.
    pub(super) fn say_dimensions(&mut self, of: &Dimensions) {
        let [outer, inner] = [0, 1].map(|n| format!("{}.dim[{n}].size", of.layout));
        let (channels, samples, layout) = match of.sample_major {
            true => (inner, outer, "sample-major"),
            false => (outer, inner, "channel-major"),
        };
        if of.offset > 0 {
            self.say("offset", &quoted(&format!("{}.data_offset", of.layout)), "");
        }
        self.say("layout", &quoted(layout), of.comment);
        self.say("channels", &quoted(&channels), "");
        self.say("samples_per_channel", &quoted(&samples), "");
    }

    /// Writes the layout, with the correlation of the layout that was not taken for comparison.
    fn say_layout(&mut self, lie: Option<RowLayout>) {
        let major = |sample_major| if sample_major { "sample-major" } else { "channel-major" };
        let (sample_major, comment) = match lie {
            Some(RowLayout { channels, sample_major, neighbours, .. }) => {
                let other = RowLayout::of(&self.samples.numbers, channels, !sample_major);
                let (name, other) = (major(!sample_major), other.map_or(0.0, |of| of.neighbours));
                let comment = format!(
                    "by the samples: neighbours of a channel correlate ({neighbours:.2}; laid out as {name} {other:.2})"
                );
                (sample_major, comment)
            }
            None => (false, "? or \"sample-major\"".to_owned()),
        };
        self.say("layout", &quoted(major(sample_major)), &comment);
    }

    /// Whether a field's number is that of the channels rather than of the samples per channel: the
    /// likelier layout of these two by how the samples correlate.
    fn counts_channels(&self, of: &Divisor) -> bool {
        let either = [of.n, self.samples.numbers.len() / of.n];
        let lie = RowLayout::likeliest(&self.samples.numbers, |n| either.contains(&n));
        lie.is_some_and(|lie| lie.channels == of.n)
    }

    /// Whether a field that is called like the number of a channel holds how many rings there are.
    pub(super) fn counts_rings(&self, path: &str) -> bool {
        let lie = RowLayout::likeliest(&self.samples.numbers, |_| true);
        lie.is_some_and(|lie| self.holds(path, lie.channels))
    }

    /// Writes the field that holds the number of channels, `n` in the first message; gives whether there is one. A
    /// number would be that of one topic, and others may have other printheads.
    fn say_counting_field(&mut self, n: usize) -> bool {
        let fields = self.first.fields.iter().filter(|of| of.can_be(Slot::Channels).is_ok());
        let paths: Vec<&str> =
            fields.map(|of| &*of.path).filter(|path| self.holds(path, n)).collect();
        let [first, others @ ..] = &paths[..] else { return false };
        let comment = match others {
            [] => BY_SAMPLES.to_owned(),
            others => format!("? or {}; {BY_SAMPLES}", others.join(", ")),
        };
        let first = quoted(first);
        self.say("channels", &first, &comment);
        true
    }

    /// Whether a field holds `n` in the first message, and in each other one of another shape a number of signals that
    /// may ring alike there.
    fn holds(&self, path: &str, n: usize) -> bool {
        let mut shapes = vec![(n, self.samples.numbers.len())];
        let may_be = |of: &FirstMessage| {
            let (Some(n), Some(numbers)) = (of.count(path), of.numbers(self.path)) else {
                return false;
            };
            let shape = (n, numbers.len());
            let is_new = !shapes.contains(&shape);
            shapes.push(shape);
            let lie = || RowLayout::likeliest(&numbers, |_| true);
            !is_new || shape.1.is_multiple_of(n) && lie().is_none_or(|lie| lie.channels == n)
        };
        self.first.count(path) == Some(n) && self.others.iter().all(may_be)
    }

    fn divisor(&self, names: &Names, slot: Slot) -> Option<Divisor> {
        let path = find(&self.first.fields, names, slot)?;
        let n = self.first.count(&path)?;
        self.samples.numbers.len().is_multiple_of(n).then_some(Divisor { path, n })
    }
}
