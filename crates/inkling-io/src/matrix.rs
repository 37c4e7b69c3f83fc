//! One acquisition out of a table, before it has a printhead and a time in ns: what the readers of
//! foreign tables hand to `inkling convert`, which makes a burst of it.

use super::Limits;
use super::dialect::value::Gathered;
use bytes::Bytes;
use inkling_core::burst::Format;

/// The samples of an acquisition, channels × samples, encoded as in a burst, channel after channel,
/// with what the table says beside them.
#[derive(Clone, Debug, Default)]
pub struct Matrix {
    pub channels: u32,
    pub samples_per_channel: u32,
    pub format: Format,
    pub samples: Bytes,
    /// When the acquisition began: the number in the table, in the table's own unit.
    pub time: Option<f64>,
    pub printhead: Option<String>,
    /// Values of the columns `Columns::beside`, in the order asked for; NaN: the cell has no value.
    pub beside: Vec<f64>,
}

impl Matrix {
    /// A matrix of numbers that come channel after channel: int16 if all of them are, else float32.
    /// `None`: more bytes than a burst may have.
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
