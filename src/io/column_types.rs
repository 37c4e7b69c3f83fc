//! Types that columns of several tables have.

use arrow_schema::{DataType, TimeUnit};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimestampUnit {
    Ns,
    /// For readers without nanoseconds (Spark); its vectorised reader does not know the float
    /// encoding of the other either, so floats are plain then.
    Us,
}

/// UTC.
pub fn time(unit: TimestampUnit) -> DataType {
    let unit = match unit {
        TimestampUnit::Ns => TimeUnit::Nanosecond,
        TimestampUnit::Us => TimeUnit::Microsecond,
    };
    DataType::Timestamp(unit, Some("UTC".into()))
}

/// A text of which there are few different ones.
pub fn text() -> DataType {
    DataType::Dictionary(Box::new(DataType::Int32), Box::new(DataType::Utf8))
}
