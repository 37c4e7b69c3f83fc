//! One acquisition out of a table or an array, before it has a time and a printhead.

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
