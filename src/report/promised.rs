//! The promise of a design as text on a terminal, for `score`.
//!
//! In: a [`Promise`], which the design computed from its own physics. Out: the smallest fault of
//! each class that is found, and the classes that are mistaken for each other.

use super::words::{Column, columns, counted};
use inkling_core::fault;
use inkling_core::promise::{Detectable, FOUND, Pair, Promise};
use std::io::{self, Write};

/// Two classes count as told apart if they are mistaken in a smaller share of their flagged signals.
const APART: f64 = 0.01;
/// Most pairs that are listed one by one.
const MOST_PAIRS: usize = 20;

/// The smallest fault of a class that is found, in words.
fn smallest(d: &Detectable) -> String {
    match d.smallest {
        Some(smallest) if smallest <= d.range[0] => "all of its sizes".into(),
        Some(smallest) if smallest > d.range[1] => format!("{smallest:.3}, beyond it"),
        Some(smallest) => format!("{smallest:.3}"),
        None => "none of its sizes".into(),
    }
}

/// A row for each class: the class, its sizes in the unit of the verdict table, the smallest that is
/// found, the share of its signals that is found over all sizes, and what the sizes measure. `safe`:
/// makes a text safe for a terminal.
fn classes(promise: &Promise, safe: impl Fn(&str) -> String) -> Vec<[String; 5]> {
    let row = |d: &Detectable| {
        let [class, quantity] = [&*d.class, fault::quantity(&d.class)].map(&safe);
        let sizes = format!("{:.3} to {:.3}", d.range[0], d.range[1]);
        [class, sizes, smallest(d), format!("{:.1} %", 100.0 * d.found), quantity]
    };
    promise.classes.iter().map(row).collect()
}

/// A line for each pair of classes that is mistaken for each other, and one about all other pairs.
fn confused(promise: &Promise, safe: impl Fn(&str) -> String) -> (Vec<String>, String) {
    let (confused, apart): (Vec<&Pair>, Vec<&Pair>) =
        promise.pairs.iter().partition(|pair| pair.mistaken >= APART);
    let line = |pair: &&Pair| {
        let [a, b] = pair.classes.each_ref().map(|class| safe(class));
        let (mistaken, angle) = (100.0 * pair.mistaken, pair.angle_degrees);
        format!(
            "{a} and {b}: mistaken for each other in {mistaken:.1} %, {angle:.0}° between what they do"
        )
    };
    let pairs = counted(apart.len() as u64, "pair");
    let apart = format!(
        "{pairs} of classes are told apart (mistaken in fewer than {:.0} %)",
        100.0 * APART
    );
    (confused.iter().take(MOST_PAIRS).map(line).collect(), apart)
}

/// What the promise rests on, in sentences.
fn basis(promise: &Promise) -> String {
    let rate = promise.false_alarm_rate.map_or(String::new(), |rate| {
        format!(" at a threshold meant for {rate} of the healthy signals")
    });
    format!(
        "From the design alone, before any data are judged{rate}: signals drawn from its own physics, healthy \
         spread and noise ({} of each size) are judged as any signal is. It says what the design could do if \
         channels were as it believes.",
        promise.draws
    )
}

/// Writes the promise for a terminal. `printable`: makes a text safe and cuts it to a number of characters.
pub fn print(
    promise: &Promise,
    printable: impl Fn(&str, usize) -> String,
    out: &mut impl Write,
) -> io::Result<()> {
    writeln!(out, "what the design promises")?;
    writeln!(out, "  {}", basis(promise))?;
    let from = format!("{:.0} % found from", 100.0 * FOUND);
    let heads = [
        Column::Words("class", 8),
        Column::Number("sizes of it", 17),
        Column::Number(&from, 18),
        Column::Number("found of all", 14),
        Column::Last("size is"),
    ];
    columns(out, heads, classes(promise, |text| printable(text, 64)))?;
    let (pairs, apart) = confused(promise, |class| printable(class, 24));
    pairs.iter().chain([&apart]).try_for_each(|line| writeln!(out, "  {line}"))
}
