//! One acquisition out of a table or an array, before it has a time and a printhead.

use super::Limits;
use super::dialect::value::Gathered;
use bytes::Bytes;
use inkling_core::burst::{Format, Layout};

/// channels x samples, in the bytes of a burst.
#[derive(Clone, Debug, Default)]
pub struct Matrix {
    pub channels: u32,
    pub samples_per_channel: u32,
    pub format: Format,
    pub layout: Layout,
    pub samples: Bytes,
    /// When it began, where the table says so: as written there.
    pub time: Option<f64>,
    /// Whose it is, where the table has a column of that.
    pub printhead: Option<String>,
    /// What else stands beside it, in the order in which it was asked for; NaN: nothing.
    pub beside: Vec<f64>,
}

impl Matrix {
    /// Of numbers, channel after channel: int16 where all are such. `None`: more than a burst may have.
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
