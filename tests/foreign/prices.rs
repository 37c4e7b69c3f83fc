//! What half and twice of each number of the critique do to how often it is right, on seeds of their own.

use super::effect::Effect;
use super::{judged, null, planted};
use crate::unnamed;
use inkling::critique::tuned::NUMBERS;
use inkling::numbers::with;
use inkling::score::blind::{Kind, Outcome};

/// What a choice of the numbers is worth, as cells of a row: of recordings with nothing, with an effect of the catalogue
/// and with one outside it, how many answers are right and how many names wrong; oscillators answered rightly.
fn price() -> String {
    let answers = |cases: &[_], kind| {
        let row = judged(cases).all.row(kind, 0..=u32::MAX);
        let right = row.count(Outcome::Right) + row.count(Outcome::HonestTie);
        match row.count(Outcome::Wrong) {
            0 => right.to_string(),
            wrong => format!("{right}, {wrong} wrong"),
        }
    };
    let nothing = answers(&null(2_600_000, 34, 1), Kind::Nothing);
    let effects = planted(&Effect::all(true), &[2.0, 4.0], 2_610_000, 42);
    let outside = planted(&Effect::all(false), &[4.0, 8.0], 2_620_000, 34);
    let (effects, outside) = (answers(&effects, Kind::One), answers(&outside, Kind::Outside));
    format!("{nothing} | {effects} | {outside} | {}", unnamed::right(9_600_000, 2))
}

/// `cargo test --release --features ablation -- --ignored --nocapture what_half_and_twice_do`, five minutes a row on one core.
/// `INKLING_NUMBERS="tie few"`: of these alone; `INKLING_TIMES="0.01 100"`: other multiples than half and twice.
#[test]
#[ignore = "hours: prints a row for each number and multiple"]
fn what_half_and_twice_do() {
    let words = |name: &str| std::env::var(name).ok();
    let times: Vec<f64> = words("INKLING_TIMES")
        .unwrap_or_else(|| "0.5 2".into())
        .split_whitespace()
        .map(|w| w.parse().expect("a multiple"))
        .collect();
    let only = words("INKLING_NUMBERS");
    let asked = |path: &&&str| {
        only.as_ref().is_none_or(|o| o.split_whitespace().any(|w| path.ends_with(w)))
    };
    let as_it_is = price();
    println!("ROW as it is | {as_it_is}");
    for name in NUMBERS.iter().filter(asked) {
        for &times in &times {
            let price = with(name, times, price);
            let same = if price == as_it_is { " (the same)" } else { "" };
            println!("ROW `{name}` x {times} | {price}{same}");
        }
    }
}
