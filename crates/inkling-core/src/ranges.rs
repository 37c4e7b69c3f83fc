//! Ranges of settings: a value outside of its range is refused, by its key and with what may be given.

use std::fmt::Debug;
use std::ops::{Bound, RangeBounds};

/// Refuses a value outside of its range. `give`: in words, what may be given.
pub fn check<T: Debug + PartialOrd>(
    key: &str,
    value: T,
    range: impl RangeBounds<T>,
    give: &str,
) -> Result<(), String> {
    match range.contains(&value) {
        true => Ok(()),
        false => Err(format!("{key} = {value:?}: give {give}")),
    }
}

/// Refuses a number that does not lie strictly between two others; NaN does not.
pub fn check_between(key: &str, value: f64, above: f64, below: f64) -> Result<(), String> {
    let range = (Bound::Excluded(above), Bound::Excluded(below));
    check(key, value, range, &format!("more than {above} and less than {below}"))
}
