//! Times, numbers and counts as text for people, and tables of them on a terminal. The report's
//! files and most verbs use it, so that all of them write numbers alike.

use Column::{Last, Number, Words};
use chrono::{DateTime, SecondsFormat};
pub use inkling_lab::plot::page::first_of;
use std::collections::BTreeMap;
use std::io::{self, Write};

/// A time, ns since 1970, as `2025-01-09 08:00:10`, UTC.
pub fn clock(t_ns: i64) -> String {
    DateTime::from_timestamp_nanos(t_ns).format("%Y-%m-%d %H:%M:%S").to_string()
}

/// A time, ns since 1970, as RFC 3339, UTC, with as many decimals as it has.
pub fn rfc3339(t_ns: i64) -> String {
    DateTime::from_timestamp_nanos(t_ns).to_rfc3339_opts(SecondsFormat::AutoSi, true)
}

/// A number with its noun: `1 recording`, `2 recordings`. The plural is made with an s.
pub fn counted(n: u64, what: &str) -> String {
    format!("{} {what}{}", thousands(n), if n == 1 { "" } else { "s" })
}

/// The texts of those parts whose number is not 0.
pub fn of_some(parts: impl IntoIterator<Item = (u64, String)>) -> impl Iterator<Item = String> {
    parts.into_iter().filter(|(n, _)| *n > 0).map(|(_, text)| text)
}

/// The texts that are not empty, with `between` between two of them.
pub fn joined(parts: impl IntoIterator<Item = String>, between: &str) -> String {
    let parts = parts.into_iter().filter(|part| !part.is_empty());
    parts.collect::<Vec<_>>().join(between)
}

/// A number of times: the words of `once` for 1, else for example `3 times`.
pub fn counted_as(n: u64, once: &str, times: &str) -> String {
    if n == 1 { once.to_owned() } else { format!("{} {times}", thousands(n)) }
}

/// A number with its digits in groups of three, separated by a narrow space: `12 345`.
pub fn thousands(n: u64) -> String {
    grouped(n, '\u{202f}')
}

/// A number with its digits in groups of three.
pub fn grouped(n: u64, separator: char) -> String {
    match n {
        0..1000 => n.to_string(),
        _ => format!("{}{separator}{:03}", grouped(n / 1000, separator), n % 1000),
    }
}

/// A positive number with about three significant digits.
pub fn three_digits(x: f64) -> String {
    let decimals = (2 - x.log10().floor() as i32).clamp(0, 6) as usize;
    format!("{x:.decimals$}")
}

/// Number of decimals that show the first digit of an uncertainty, 0 to 6: .04 has 2.
pub fn digits_of(uncertainty: f64) -> usize {
    if !uncertainty.is_finite() || uncertainty >= 0.95 || uncertainty <= 0.0 {
        return 0;
    }
    (-uncertainty.log10()).ceil().clamp(0.0, 6.0) as usize
}

/// A number with its sign, with the typographic minus; without a sign if it rounds to 0.
pub fn signed(v: f64, digits: usize) -> String {
    let text = format!("{:.digits$}", v.abs());
    let is_zero = text.bytes().all(|b| matches!(b, b'0' | b'.'));
    match (is_zero, v < 0.0) {
        (true, _) => text,
        (false, true) => format!("−{text}"),
        (false, false) => format!("+{text}"),
    }
}

/// A share in percent, with more decimals the smaller it is; a dash if `of` is 0.
pub fn percent(part: u64, of: u64) -> String {
    if of == 0 {
        return "–".into();
    }
    let percent = 100.0 * part as f64 / of as f64;
    match percent {
        0.0 => "0 %".into(),
        p if p < 0.1 => format!("{p:.3} %"),
        p if p < 10.0 => format!("{p:.2} %"),
        p => format!("{p:.1} %"),
    }
}

/// Lines that say the same of several channels, each once and in the order in which they first came, after the channels
/// in words: what is wrong with a whole printhead is no list of all its channels.
pub fn alike<L: Ord + Clone>(lines: impl IntoIterator<Item = (u32, L)>) -> Vec<(String, L)> {
    let mut places: BTreeMap<L, usize> = BTreeMap::new();
    let mut all: Vec<(Vec<u32>, L)> = Vec::new();
    for (channel, line) in lines {
        let place = *places.entry(line).or_insert_with_key(|line| {
            all.push((Vec::new(), line.clone()));
            all.len() - 1
        });
        all[place].0.push(channel);
    }
    all.into_iter().map(|(channels, line)| (ranges(channels), line)).collect()
}

/// Channels as [`alike`] gives them, with their noun.
pub fn channels(numbers: &str) -> String {
    format!("channel{} {numbers}", if numbers.contains(' ') { "s" } else { "" })
}

/// The numbers of channels, with their noun.
pub fn numbered(these: &[u32]) -> String {
    channels(&ranges(these.to_vec()))
}

/// Most runs of channels that are named.
const MOST_RUNS: usize = 12;

/// Channel numbers in words: `7`, or `0 to 4, 7, 9`. The first [`MOST_RUNS`] are named.
fn ranges(mut channels: Vec<u32>) -> String {
    channels.sort_unstable();
    channels.dedup();
    let runs = channels.chunk_by(|a, b| a + 1 == *b).flat_map(|run| match run {
        [first, .., last] if last - first > 1 => vec![format!("{first} to {last}")],
        few => few.iter().map(u32::to_string).collect(),
    });
    first_of(&runs.collect::<Vec<_>>(), MOST_RUNS, ", ")
}

/// A column: its head, and its width in characters.
#[derive(Clone, Copy)]
pub enum Column<'a> {
    /// Numbers, aligned at the right.
    Number(&'a str, usize),
    /// Words, aligned at the left.
    Words(&'a str, usize),
    /// Words of any length, in the last column.
    Last(&'a str),
}

/// Writes a table: a line of heads, then the rows. Cells that are too wide are not cut.
pub fn columns<const N: usize>(
    out: &mut impl Write,
    columns: [Column; N],
    rows: impl IntoIterator<Item = [String; N]>,
) -> io::Result<()> {
    let line = |cells: [&str; N]| {
        let mut line = String::from(" ");
        let mut after_number = false;
        for (column, cell) in columns.into_iter().zip(cells) {
            line += if after_number && !matches!(column, Number(..)) { "  " } else { " " };
            line += &match column {
                Number(_, width) => format!("{cell:>width$}"),
                Words(_, width) => format!("{cell:<width$}"),
                Last(_) => cell.to_owned(),
            };
            after_number = matches!(column, Number(..));
        }
        line
    };
    let heads = columns.map(|column| match column {
        Number(head, _) | Words(head, _) | Last(head) => head,
    });
    writeln!(out, "{}", line(heads).trim_end())?;
    rows.into_iter().try_for_each(|row| writeln!(out, "{}", line(row.each_ref().map(|c| &**c))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_the_same_of_many_channels_is_said_once() {
        let lines = [(4, "a"), (9, "b"), (0, "a"), (1, "a"), (2, "a"), (5, "a")];
        assert_eq!(alike(lines), [("0 to 2, 4, 5".into(), "a"), ("9".into(), "b")]);
    }
}
