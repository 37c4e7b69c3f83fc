//! Reads what the layout of a ROS array (`std_msgs/MultiArrayLayout`) says of its numbers: how many channels of
//! how many samples, in which order, and from which number on.
//!
//! In: a first message, and the path of an array in it. Out: [`Dimensions`], for proposals (`guess.rs`), and to
//! refuse a number of channels that they contradict ([`contradiction`]).

use super::first_message::FirstMessage;
use super::names::has_word;
use super::plan::Plan;
use super::settings::Source;
use bytes::Bytes;
use inkling_core::model::row_layout::RowLayout;

/// What the layout of a ROS array (`std_msgs/MultiArrayLayout`) says of its numbers.
pub struct Dimensions {
    /// The path of the layout.
    pub layout: String,
    /// The sizes of its two dimensions.
    pub sizes: [usize; 2],
    pub offset: usize,
    /// Whether the samples of one moment lie side by side.
    pub sample_major: bool,
    /// What a person should check.
    pub comment: &'static str,
}

/// The dimensions of the array at `data`; `None`: it has no layout beside it, or not of two dimensions that
/// have as many numbers as the array. Which dimension is that of the channels their labels say, or else the
/// numbers themselves.
pub fn dimensions(first: &FirstMessage, data: &str) -> Option<Dimensions> {
    let before = data.rsplit_once('.').map_or(String::new(), |(before, _)| format!("{before}."));
    let layout = format!("{before}layout");
    let sizes = [0, 1].map(|n| first.count(&format!("{layout}.dim[{n}].size")));
    let [Some(outer), Some(inner)] = sizes else { return None };
    let offset = first.count(&format!("{layout}.data_offset")).unwrap_or(0);
    let numbers = first.numbers(data)?;
    let numbers =
        numbers.get(offset..).filter(|rest| outer.checked_mul(inner) == Some(rest.len()))?;

    let is_called = |n: usize, words: &str| {
        let label = first.text(&format!("{layout}.dim[{n}].label"));
        label.is_some_and(|label| has_word(&label, words))
    };
    let [by_channel, by_sample] = [
        is_called(0, OF_CHANNELS) || is_called(1, OF_SAMPLES),
        is_called(1, OF_CHANNELS) || is_called(0, OF_SAMPLES),
    ];
    let (sample_major, comment) = match by_channel == by_sample {
        false => (by_sample, "as the labels of its dimensions say"),
        true => {
            let either = |n| n == outer || n == inner;
            let lie = RowLayout::likeliest(numbers, either);
            (lie.is_some_and(|lie| lie.sample_major), "? the labels of its dimensions do not say")
        }
    };
    let sizes = [outer, inner];
    Some(Dimensions { layout, sizes, offset, sample_major, comment })
}

/// Labels of dimensions.
const OF_CHANNELS: &str = "channel channels ch nozzle nozzles row rows height";
const OF_SAMPLES: &str = "sample samples time t column columns width";

/// Why the number of channels in the settings cannot be that of a message; `None`: it may be.
pub fn contradiction(plan: &Plan, message: &Bytes) -> Option<String> {
    let Source::Constant(channels) = plan.dialect.channels else { return None };
    let first = FirstMessage::of(&plan.reading, message).ok()?;
    let Dimensions { sizes: [outer, inner], layout, .. } =
        dimensions(&first, &plan.dialect.samples.to_string())?;
    let fits = [outer, inner].iter().any(|size| *size as f64 == channels);
    (!fits).then(|| {
        format!("channels = {channels}: {layout}.dim of the first message says {outer} x {inner}")
    })
}
