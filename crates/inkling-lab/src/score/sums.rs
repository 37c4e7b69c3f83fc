//! What all scores do with their sums. In: counts. Out: shares, and the sums of a name.

use std::collections::BTreeMap;

/// The value of a name, which is copied only where it is new.
pub fn named<'m, V: Default>(map: &'m mut BTreeMap<String, V>, name: &str) -> &'m mut V {
    if !map.contains_key(name) {
        map.insert(name.to_owned(), V::default());
    }
    map.get_mut(name).expect("it was put there")
}

/// A share; 0 of 0 is 0.
pub fn share(part: u64, whole: u64) -> f64 {
    part as f64 / whole.max(1) as f64
}
