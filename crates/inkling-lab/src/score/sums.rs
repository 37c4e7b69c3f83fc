//! What all scores do with their sums: find the sums of a name, and divide counts.

use std::collections::BTreeMap;

/// The value of a name, which is a default if the name is new. The name is copied only then.
pub fn named<'m, V: Default>(map: &'m mut BTreeMap<String, V>, name: &str) -> &'m mut V {
    if !map.contains_key(name) {
        map.insert(name.to_owned(), V::default());
    }
    map.get_mut(name).expect("it was put there")
}

/// A share from 0 to 1; that of no signals is 0.
pub fn share(part: u64, whole: u64) -> f64 {
    part as f64 / whole.max(1) as f64
}
