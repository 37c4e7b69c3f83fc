//! What half and twice of each number of the critique do to how often it is right, on seeds of their own.

use super::effect::Effect;
use super::{judged, null, planted};
use crate::unnamed;
use inkling::critique::tuned::NUMBERS;
use inkling::numbers::with;
use inkling::score::blind::{Kind, Outcome, Row};

/// Right answers and wrong names.
#[derive(Clone, Copy, PartialEq)]
struct Answers {
    right: u32,
    wrong: u32,
}

impl Answers {
    fn of(row: &Row) -> Answers {
        let right = row.count(Outcome::Right) + row.count(Outcome::HonestTie);
        Answers { right, wrong: row.count(Outcome::Wrong) }
    }
}

impl std::fmt::Display for Answers {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let Answers { right, wrong } = self;
        if *wrong == 0 { write!(f, "{right}") } else { write!(f, "{right}, {wrong} wrong") }
    }
}

/// What a choice of the numbers is worth.
#[derive(PartialEq)]
struct Price {
    nothing: Answers,
    effects: Answers,
    outside: Answers,
    /// Oscillators answered rightly.
    oscillators: usize,
}

impl Price {
    fn measured() -> Price {
        let answers = |cases: &[_], kind| Answers::of(&judged(cases).all.row(kind, 0..=u32::MAX));
        Price {
            nothing: answers(&null(2_600_000, 34, 1), Kind::Nothing),
            effects: answers(&planted(&Effect::all(true), &[2.0, 4.0], 2_610_000, 42), Kind::One),
            outside: answers(
                &planted(&Effect::all(false), &[4.0, 8.0], 2_620_000, 34),
                Kind::Outside,
            ),
            oscillators: unnamed::right(9_600_000, 2),
        }
    }
}

impl std::fmt::Display for Price {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let Price { nothing, effects, outside, oscillators } = self;
        write!(f, "{nothing} | {effects} | {outside} | {oscillators}")
    }
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
    let as_it_is = Price::measured();
    println!("ROW as it is | {as_it_is}");
    for name in NUMBERS.iter().filter(asked) {
        for &times in &times {
            let price = with(name, times, Price::measured);
            let same = if price == as_it_is { " (the same)" } else { "" };
            println!("ROW `{name}` x {times} | {price}{same}");
        }
    }
}
