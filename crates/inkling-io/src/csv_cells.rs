//! Reads cells of CSV as people and instruments write them: numbers, missing ones, and times.
//!
//! In: a cell, and whether commas may stand before decimals ([`Cells`]). Out: a number or a [`Moment`], or what is
//! wrong with the cell and what to do about it. [`Grouped`] looks at all cells together.

use super::printable;
use super::table_file::Moment;
use chrono::{DateTime, NaiveDateTime};
use inkling_core::verdict::NO_VALUE;

/// What people and instruments write where there is no sample.
const MISSING: &str = "nan na n/a null none nodata ol over ovl ovld overflow overload overrange underflow underrange \
    max min \u{221e} #n/a #num! #div/0! #value!";
/// How dates are written without a zone; they are taken as UTC.
const DATES: [&str; 4] =
    ["%Y-%m-%d %H:%M:%S%.f", "%Y-%m-%dT%H:%M:%S%.f", "%Y%m%dT%H%M%S%.f", "%d.%m.%Y %H:%M:%S%.f"];

/// How the cells of a table are written.
#[derive(Clone, Copy)]
pub(super) struct Cells {
    /// Whether a comma may stand before decimals, as where something else separates cells.
    pub decimal_comma: bool,
}

impl Cells {
    /// A cell as a number; NaN where it is empty or says that nothing was measured. `None`: it is neither.
    pub fn number(self, cell: &str) -> Option<f64> {
        let cell = unquoted(cell);
        let word = cell.trim_start_matches(['+', '-', '<', '>']).to_lowercase().replace(' ', "");
        let is_missing = MISSING.split(' ').any(|missing| missing == word)
            // the words of a C library for what is no number, and cells that are filled with one sign
            || word.starts_with("1.#")
            || cell.chars().all(|sign| "-*#?".contains(sign));
        if is_missing {
            return Some(f64::NAN);
        }
        let x: f64 = self.with_point(cell).parse().ok()?;
        Some(if x.abs() < NO_VALUE { x } else { f64::NAN })
    }

    /// A cell as a time in units of so many ns: a number, or a date.
    pub fn moment(self, cell: &str, unit_ns: f64) -> Option<Moment> {
        let date = || Some(Moment::of_ns(date_in(cell)?, unit_ns));
        let number = || self.number(cell).map(Moment::from);
        Moment::written(&self.with_point(unquoted(cell))).or_else(date).or_else(number)
    }

    /// Whether a cell is neither a number nor a date.
    pub fn is_text(self, cell: &str) -> bool {
        self.number(cell).is_none() && date_in(cell).is_none()
    }

    /// A number with a point before its decimals, where a comma may stand, and with the minus of a keyboard.
    fn with_point(self, cell: &str) -> String {
        let cell = cell.replace('\u{2212}', "-");
        match self.decimal_comma && !cell.contains('.') {
            true => cell.replacen(',', ".", 1),
            false => cell,
        }
    }
}

/// A cell without quotes. The csv crate takes quotes that follow a blank for a part of the cell.
pub(super) fn unquoted(cell: &str) -> &str {
    cell.strip_prefix('"').and_then(|cell| cell.strip_suffix('"')).unwrap_or(cell)
}

/// Parses a time such as 2026-11-01T08:00:00.5Z, or 1.11.2026 8:00:00.5, to ns since 1970. A blank may stand instead of
/// the T. `None`: the cell is no such time.
fn date_in(cell: &str) -> Option<i64> {
    let cell = unquoted(cell);
    let plain = |format| Some(NaiveDateTime::parse_from_str(cell, format).ok()?.and_utc());
    let zoned = DateTime::parse_from_rfc3339(cell).ok().map(|time| time.to_utc());
    zoned.or_else(|| DATES.into_iter().find_map(plain))?.timestamp_nanos_opt()
}

/// Says that a cell is no number, and what to do about it; `otherwise`: if nothing in the cell says more.
pub(super) fn no_number(cell: &str, otherwise: &str) -> String {
    let cell = unquoted(cell);
    let has_digit = cell.contains(|c: char| c.is_ascii_digit());
    let known = ADVICE.iter().find(|(is_cause, _)| has_digit && is_cause(cell));
    let advice = known.map_or(otherwise, |(_, advice)| advice);
    format!("{:?} is no number: {advice}", printable::cell(cell))
}

/// Whether it is the cause, and what to do about it.
type Cause = (fn(&str) -> bool, &'static str);

/// Why a cell that has a digit is no number, the likeliest cause first, and what to do about it.
const ADVICE: [Cause; 7] = [
    (
        |cell| [':', '/'].into_iter().any(|sign| cell.matches(sign).count() >= 2),
        "write times as 2026-11-01T08:00:00.5, or as seconds",
    ),
    (
        |cell| cell.contains(':') && cell.chars().all(|c| is_of_number(c) || ":,".contains(c)),
        "it may be minutes and seconds, as spreadsheets show times: write seconds, with all their digits",
    ),
    (
        |cell| {
            cell.replace(',', ".")
                .replace(['D', 'd'], "e")
                .parse::<f64>()
                .is_ok_and(|_| cell.contains(['D', 'd']))
        },
        "its exponent is one of Fortran: write e instead of D",
    ),
    (|cell| cell.starts_with("0x") || cell.starts_with("0X"), "write whole numbers to base 10"),
    (
        |cell| {
            let is_around = |c: char| !(c.is_alphanumeric() || ".,% ".contains(c));
            let (number, signed) =
                (cell.trim_matches(is_around), cell.trim_start_matches(['+', '-']));
            number != signed && number.replace(',', ".").parse::<f64>().is_ok()
        },
        "write numbers alone, as -0.5: no brackets, quotes or = around them, no sign behind them",
    ),
    (
        |cell| cell.chars().all(|c| is_of_number(c) || c.is_whitespace() || ",'_’".contains(c)),
        "write a point before decimals, and nothing between thousands",
    ),
    (
        |cell| {
            let is_digit = |c: char| c.is_ascii_digit();
            let begins = cell.trim_start_matches(['+', '-']).starts_with(is_digit);
            begins && !cell.trim_matches(is_of_number).contains(is_digit)
        },
        "write the unit into the column's name",
    ),
];

fn is_of_number(c: char) -> bool {
    c.is_ascii_digit() || "+-.eE".contains(c)
}

/// Whether points or commas stand between thousands in a column, where either may stand before decimals: each number
/// with one has three digits behind it, and whole numbers below a thousand have none, or decimals have the other one.
#[derive(Default)]
pub(super) struct Grouped {
    /// The first number with a point or comma, and its line.
    first: Option<(u64, String)>,
    /// The first number whose point or comma can only stand before decimals.
    decimal: Option<String>,
    has_small: bool,
    has_large: bool,
}

impl Grouped {
    pub fn add(&mut self, cell: &str, line: u64) {
        let cell = unquoted(cell);
        let digits = cell.trim_start_matches(['+', '-']);
        let is_digits = |of: &str| !of.is_empty() && of.bytes().all(|c| c.is_ascii_digit());
        match digits.split_once(['.', ',']) {
            Some((whole, rest)) => {
                let are_digits = is_digits(whole) && is_digits(rest);
                if !(are_digits && whole.len() <= 3 && rest.len() == 3 && !whole.starts_with('0')) {
                    self.decimal.get_or_insert_with(|| cell.to_owned());
                }
                self.first.get_or_insert_with(|| (line, cell.to_owned()));
            }
            None if is_digits(digits) => {
                self.has_small = true;
                self.has_large |= digits.len() > 3;
            }
            None => {}
        }
    }

    /// The line of the first such number among all columns, and what is wrong with it.
    pub fn mistake(all: &[&Grouped]) -> Option<(u64, String)> {
        let decimal = all.iter().find_map(|of| of.decimal.as_ref());
        all.iter().filter(|of| of.decimal.is_none() && !of.has_large).find_map(|of| {
            let (line, cell) = of.first.as_ref()?;
            let other = decimal.filter(|of| of.contains(',') != cell.contains(','));
            let why = match other {
                Some(of) => format!("and {:?} the other one before decimals", printable::cell(of)),
                None if of.has_small => {
                    "as all of its column that are no whole ones below 1000".to_owned()
                }
                None => return None,
            };
            let what = format!(
                "{:?} has three digits behind a point or comma, {why}: write nothing between thousands, or all decimals \
                 of all numbers",
                printable::cell(cell)
            );
            Some((*line, what))
        })
    }
}
