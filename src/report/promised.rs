//! The promise of a design, as a section of the evaluation's page (`html`) and as text on a
//! terminal (`print`, for `score` and `identify`).
//!
//! In: a [`Promise`], which the design computed from its own physics. Out: HTML or text: the
//! smallest fault of each class that is found, and the classes that are mistaken for each other.

use super::words::{Column, columns, counted};
use inkling_core::fault;
use inkling_core::promise::{Detectable, FOUND, Pair, Promise};
use inkling_lab::plot::page::{name, table};
use std::io::{self, Write};

/// Two classes count as told apart if they are mistaken in a smaller share of their flagged signals.
const APART: f64 = 0.01;
/// Most pairs that are listed one by one.
const MOST_PAIRS: usize = 20;

/// The range of a class's sizes, in the unit of the verdict table.
fn sizes(d: &Detectable) -> String {
    format!("{:.3} to {:.3}", d.range[0], d.range[1])
}

/// The share of a class's signals, over all its sizes, that is found.
fn found(d: &Detectable) -> String {
    format!("{:.1} %", 100.0 * d.found)
}

/// The smallest fault of a class that is found, in words.
fn smallest(d: &Detectable) -> String {
    match d.smallest {
        Some(smallest) if smallest <= d.range[0] => "all of its sizes".into(),
        Some(smallest) if smallest > d.range[1] => format!("{smallest:.3}, beyond it"),
        Some(smallest) => format!("{smallest:.3}"),
        None => "none of its sizes".into(),
    }
}

/// The pairs of classes that are mistaken for each other, and the number of all other pairs.
fn confused(promise: &Promise) -> (Vec<&Pair>, usize) {
    let confused: Vec<&Pair> = promise.pairs.iter().filter(|p| p.mistaken >= APART).collect();
    let apart = promise.pairs.len() - confused.len();
    (confused, apart)
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

/// The section of the evaluation's page: a table of the classes, and one of the confused pairs.
pub fn html(promise: &Promise) -> String {
    let mut text = format!(
        "<h2>What the design promises</h2>\n<p class=\"note\">{}</p>\n<h3>Detectability: the smallest fault \
         that is found in {:.0} % of its signals</h3>\n<div class=\"wide\">",
        basis(promise),
        100.0 * FOUND
    );
    let heads = [
        "class",
        "in words",
        "size is",
        ">sizes of the class",
        ">smallest found",
        ">signals found, all sizes",
    ];
    let of_class = promise.classes.iter().map(|d| {
        let [class, words, quantity] =
            [&*d.class, fault::in_words(&d.class), fault::quantity(&d.class)].map(name);
        [class, words, quantity, sizes(d), smallest(d), found(d)]
    });
    text += &table("", &heads, of_class);
    let (confused, apart) = confused(promise);
    text += &format!(
        "</div>\n<h3>Isolability: classes that are mistaken for each other</h3>\n<p class=\"note\">Of \
         the flagged signals of the one the share whose best class is the other, mean of both ways; classes \
         of one kind (blocked and partly blocked, the three degrees of drying) differ by size alone. The other \
         {} are told apart: mistaken in fewer than {:.0} %.</p>\n",
        counted(apart as u64, "pair"),
        100.0 * APART
    );
    if !confused.is_empty() {
        let of_pair = confused.iter().take(MOST_PAIRS).map(|pair| {
            let classes = pair.classes.each_ref().map(|class| name(class)).join(" and ");
            let mistaken = format!("{:.1} %", 100.0 * pair.mistaken);
            [classes, mistaken, format!("{:.0}°", pair.angle_degrees)]
        });
        text += &table("", &["classes", ">mistaken", ">angle between what they do"], of_pair);
    }
    text
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
    let of_class = promise.classes.iter().map(|d| {
        let quantity = printable(fault::quantity(&d.class), 64);
        [printable(&d.class, 24), sizes(d), smallest(d), found(d), quantity]
    });
    columns(out, heads, of_class)?;
    let (confused, apart) = confused(promise);
    for pair in confused.iter().take(MOST_PAIRS) {
        let [a, b] = pair.classes.each_ref().map(|class| printable(class, 24));
        writeln!(
            out,
            "  {a} and {b}: mistaken for each other in {:.1} %, {:.0}° between what they do",
            100.0 * pair.mistaken,
            pair.angle_degrees
        )?;
    }
    let apart = counted(apart as u64, "pair");
    writeln!(out, "  {apart} of classes are told apart (mistaken in fewer than 1 %)")
}
