//! Ranges of settings: a value outside of its range is refused, in a text such as `mu = -1.0: give
//! more than 0 and less than 1000000`, to which the caller adds the name of the section.

use std::fmt::Debug;
use std::ops::{Bound, RangeBounds};

/// Refuses a value outside of its range. `key`: the setting; `give`: in words, what may be given.
pub fn check<T: Debug + PartialOrd>(
    key: &str,
    value: T,
    range: impl RangeBounds<T>,
    give: &str,
) -> Result<(), String> {
    let lies_within = range.contains(&value).then_some(());
    lies_within.ok_or_else(|| format!("{key} = {value:?}: give {give}"))
}

/// Refuses a number that does not lie strictly between two bounds; NaN is refused, too.
pub fn check_between(key: &str, value: f64, above: f64, below: f64) -> Result<(), String> {
    let range = (Bound::Excluded(above), Bound::Excluded(below));
    check(key, value, range, &format!("more than {above} and less than {below}"))
}
