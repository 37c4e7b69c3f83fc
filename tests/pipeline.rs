//! What a recording is made of that no list of words describes: messages that are repeated.

use crate::house::House;
use crate::recipes::divided;
use crate::recorded::{bursts, sample, table_rows};

/// The first eight channels are in every other moment alone, and then twice: both times the level of their own
/// moment judges, whichever message of it comes first.
#[test]
fn a_message_that_is_repeated_is_judged_as_it_was_the_first_time() {
    let house = House::new();
    let original = bursts(&sample("print_run.mcap"));
    let rows_of = |name: &str, last_first: bool| {
        let mut written = Vec::new();
        for (i, burst) in original.iter().enumerate() {
            let mut moment = divided(burst, 8);
            match i % 2 {
                0 => drop(moment.remove(0)),
                _ => moment.insert(1, moment[0].clone()),
            }
            if last_first {
                moment.rotate_left(2);
            }
            written.extend(moment);
        }
        house.record(&format!("{name}.mcap"), &written);
        house.replay(&format!("{name}.mcap")).exits(0);
        let mut said = table_rows(&house.path(&format!("out/{name}.verdicts.parquet")));
        said.sort();
        said
    };
    let (first, last) = (rows_of("first", false), rows_of("last", true));
    assert!(first.len() > 8000 && first == last);
}
