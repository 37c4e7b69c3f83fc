//! One acquisition out of a table or an array, before it has a time and a printhead: what readers of foreign
//! tables hand to `inkling convert`.

use super::Limits;
use super::dialect::value::Gathered;
use bytes::Bytes;
use inkling_core::burst::{Format, Layout};

/// Channels × samples, in the bytes of a burst.
#[derive(Clone, Debug, Default)]
pub struct Matrix {
    pub channels: u32,
    pub samples_per_channel: u32,
    pub format: Format,
    pub layout: Layout,
    pub samples: Bytes,
    /// When it began, if the table says so: the number that stands there, in the table's unit.
    pub time: Option<f64>,
    /// The printhead it is of, if the table has a column for that.
    pub printhead: Option<String>,
    /// Values of the columns beside the samples, in the order in which they were asked for; NaN: there is
    /// none.
    pub beside: Vec<f64>,
}

impl Matrix {
    /// A matrix of numbers, channel after channel: int16 if all of them are, else float32. `None`: more than
    /// a burst may have.
    pub fn of(
        channels: usize,
        samples_per_channel: usize,
        numbers: impl Iterator<Item = f64>,
    ) -> Option<Matrix> {
        let mut all = Gathered::new(Limits::default().samples_bytes);
        numbers.for_each(|x| all.push(x));
        (!all.too_many).then(|| Matrix {
            channels: channels as u32,
            samples_per_channel: samples_per_channel as u32,
            format: all.format,
            samples: all.bytes.into(),
            ..Matrix::default()
        })
    }
}
