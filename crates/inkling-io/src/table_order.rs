//! The order in which tables are taken that were named on a command line.
//!
//! In: their paths, as a shell lists them. Out: the same in the order of the numbers in their names.

use std::path::{Path, PathBuf};

/// Puts tables whose names are in the order of letters, as a shell lists them (1, 10, 2), into that of the numbers in
/// their names. Gives whether it is another order; any order that is not that of letters was meant.
pub fn in_order_of_numbers(tables: &mut [PathBuf]) -> bool {
    // many a shell passes over signs and the case of letters
    let letters = |path: &PathBuf| -> String {
        let name = path.to_string_lossy().to_lowercase();
        name.chars().filter(|c| c.is_alphanumeric()).collect()
    };
    let is_of_letters = tables.is_sorted() || tables.is_sorted_by_key(letters);
    let is_other = is_of_letters && !tables.is_sorted_by_key(|path| parts(path));
    if is_other {
        tables.sort_by_cached_key(|path| parts(path));
    }
    is_other
}

/// The texts and the numbers that a name consists of, and those of its ending: `run.csv` stands before `run2.csv`.
fn parts(path: &Path) -> [Vec<(String, Option<u128>)>; 2] {
    let ending = path.extension().unwrap_or_default().to_string_lossy();
    [path.with_extension("").to_string_lossy(), ending].map(|name| {
        let name: Vec<char> = name.chars().collect();
        let parts = name.chunk_by(|a, b| a.is_ascii_digit() == b.is_ascii_digit());
        let parts = parts.map(|part| part.iter().collect::<String>());
        parts.map(|part| part.parse().map_or((part, None), |n| (String::new(), Some(n)))).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_in_the_order_of_a_shell_are_taken_in_that_of_their_numbers() {
        let paths = |names: &[&str]| names.iter().map(PathBuf::from).collect::<Vec<_>>();
        for (given, taken) in [
            (["s_1.csv", "s_10.csv", "s_2.csv"], Some(["s_1.csv", "s_2.csv", "s_10.csv"])),
            (["s_10.csv", "s_1.csv", "s_2.csv"], Some(["s_1.csv", "s_2.csv", "s_10.csv"])),
            (["s_2.csv", "s_10.csv", "s_1.csv"], None),
            (["run.csv", "run2.csv", "run3.csv"], None),
            (["run.csv", "run10.csv", "run2.csv"], Some(["run.csv", "run2.csv", "run10.csv"])),
            (["log.1", "log.10", "log.2"], Some(["log.1", "log.2", "log.10"])),
            (["s_08.csv", "s_09.csv", "s_10.csv"], None),
        ] {
            let mut tables = paths(&given);
            assert_eq!(in_order_of_numbers(&mut tables), taken.is_some(), "{given:?}");
            assert_eq!(tables, paths(&taken.unwrap_or(given)));
        }
    }
}
