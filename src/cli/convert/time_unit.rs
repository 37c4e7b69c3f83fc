//! The unit of the times in a table.

use inkling_io::table_file;

/// The unit of a time column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeUnit {
    /// The unit in ns.
    pub ns: f64,
    /// Name of the unit, if it was recognised by the size of the first time, and not by the column's name or
    /// type.
    pub by_size: Option<&'static str>,
}

impl TimeUnit {
    pub const SECONDS: TimeUnit = TimeUnit { ns: 1e9, by_size: None };

    /// The unit of a column of times: by the ending of the column's name, or else by the size of the first
    /// time if it counts from 1970. Times of 1979 to 2200 do not overlap in any two units. Smaller times are
    /// seconds.
    pub fn of(column: &str, first: Option<f64>) -> TimeUnit {
        if let Some(ns) = table_file::unit_ns(column) {
            return TimeUnit { ns, by_size: None };
        }
        match first.map_or(0.0, f64::abs) {
            t if t >= 3e17 => TimeUnit { ns: 1.0, by_size: Some("nanoseconds") },
            t if t >= 3e14 => TimeUnit { ns: 1e3, by_size: Some("microseconds") },
            t if t >= 3e11 => TimeUnit { ns: 1e6, by_size: Some("milliseconds") },
            t if t >= 3e8 => TimeUnit { ns: 1e9, by_size: Some("seconds") },
            _ => TimeUnit::SECONDS,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_read_off_the_column_name() {
        let ns = |column: &str, first: f64| TimeUnit::of(column, Some(first)).ns;
        assert_eq!(
            ["time", "time_s", "t_ms", "t_us", "t_ns"].map(|column| ns(column, 0.5)),
            [1e9, 1e9, 1e6, 1e3, 1.0]
        );
        // times of 2026; the ending of a name has precedence
        assert_eq!([1.77e9, 1.77e12, 1.77e15, 1.77e18].map(|t| ns("t", t)), [1e9, 1e6, 1e3, 1.0]);
        assert_eq!(ns("t_ms", 1.77e15), 1e6);
    }
}
