//! What the names of a table's columns say: which column is that of time, in which unit it counts, and which
//! columns count rows or hold remarks, and so are no outputs.
//!
//! In: names as people and instruments write them (`Time (ms)`, `t/us`, `TIME_MS`, `Time in ms`). Out: a
//! [`TimeUnit`], or a sentence that refuses a unit that is not understood, because a guess would be wrong by
//! a factor of a thousand and more.

use super::printable;

/// A unit in which times are counted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeUnit {
    /// Its length, ns.
    pub ns: f64,
    /// Its name, in the plural.
    pub name: &'static str,
}

/// The length of each unit in ns, its name, and all words for it.
const UNITS: [(f64, &str, &str); 8] = [
    (1e-3, "picoseconds", "ps psec psecs picosec picosecond picoseconds"),
    (1.0, "nanoseconds", "ns nano nanos nsec nsecs nanosec nanosecond nanoseconds"),
    (1e3, "microseconds", "us micro micros usec usecs microsec microsecond microseconds"),
    (1e6, "milliseconds", "ms milli millis msec msecs millisec millisecond milliseconds"),
    (1e9, "seconds", "s sec secs second seconds"),
    (6e10, "minutes", "min mins minute minutes"),
    (3.6e12, "hours", "h hr hrs hour hours"),
    (8.64e13, "days", "d day days"),
];

/// What a unit may be enclosed by.
const BRACKETS: &str = "()[]{}<>\"'";
/// Words that stand where a unit may stand, and count something else than time.
const NO_UNITS: &str =
    "tick ticks sample samples count counts cycle cycles frame frames clock clocks pts";
/// What stands in brackets behind a name of times and says nothing of their unit.
const NO_MATTER: &str = "utc gmt local rel relative abs absolute time t x iso date";
const TIMES: &str = "time times timestamp timestamps datetime zeit elapsed";
/// Columns that number the rows, and columns of remarks, are no outputs.
const NUMBERS: [&str; 14] = [
    "", "#", "no", "no.", "nr", "nr.", "index", "idx", "row", "number", "sample", "samples",
    "point", "sequence",
];
/// `__index_level_0__` is where pandas keeps the numbers of rows in Parquet.
const REMARKS: [&str; 7] =
    ["", "comment", "comments", "note", "notes", "remark", "__index_level_0__"];

fn is_one_of(word: &str, words: &str) -> bool {
    words.split(' ').any(|of| of == word)
}

impl TimeUnit {
    pub const SECONDS: TimeUnit = TimeUnit { ns: 1e9, name: "seconds" };
    pub const DAYS: TimeUnit = TimeUnit { ns: 8.64e13, name: "days" };

    /// The unit that is so many ns long.
    pub(super) fn of_ns(ns: f64) -> Option<TimeUnit> {
        UNITS.iter().find(|(of, ..)| *of == ns).map(|&(ns, name, _)| TimeUnit { ns, name })
    }

    /// The unit that this word means. Micro may be any of `u` and the two signs of Unicode, and case does not
    /// matter: nobody counts in megaseconds.
    pub fn called(word: &str) -> Option<TimeUnit> {
        let word = word.to_lowercase().replace(['\u{b5}', '\u{3bc}'], "u");
        let unit = UNITS.iter().find(|(.., words)| is_one_of(&word, words));
        unit.map(|&(ns, name, _)| TimeUnit { ns, name })
    }

    /// The unit of a column of times, by the column's name; `None`: it says none. What stands where a unit is
    /// due and is none that is known is refused.
    pub fn in_name(column: &str) -> Result<Option<TimeUnit>, String> {
        let (name, marked) = apart(column);
        let mut units = Vec::new();
        for text in &marked {
            units.extend(TimeUnit::in_text(text).map_err(|()| unknown(column))?);
        }
        units.dedup();
        match units[..] {
            [unit] => return Ok(Some(unit)),
            [] => {}
            _ => return Err(unknown(column)),
        }
        let words = words(name);
        let (Some(first), Some(last)) = (words.first(), words.last()) else { return Ok(None) };
        let is_named = words.len() > 1 && words[words.len() - 2] == "in";
        let is_other = is_one_of(last, NO_UNITS) || is_multiple(last);
        if is_named && TimeUnit::called(last).is_none() || is_other {
            return Err(unknown(column));
        }
        // `ms_elapsed`; one letter, and `min`, may mean anything there
        let first = Some(first).filter(|word| word.chars().count() > 1 && *word != "min");
        let unit = TimeUnit::called(last);
        let name = name.trim_end_matches(|c: char| !c.is_alphanumeric());
        match unit.and_then(|_| name.chars().rev().nth(last.chars().count())) {
            Some(before) if is_lost(before) => Err(unknown(column)),
            _ => Ok(unit.or_else(|| TimeUnit::called(first?))),
        }
    }

    /// The unit that a text says that should say one; `None`: it says that it does not matter.
    pub(super) fn in_text(text: &str) -> Result<Option<TimeUnit>, ()> {
        let words = words(text);
        let units: Vec<TimeUnit> = words.iter().filter_map(|word| TimeUnit::called(word)).collect();
        let has_factor = words.iter().any(|word| word.starts_with(|c: char| c.is_ascii_digit()));
        let text = text.trim_matches(|c: char| c.is_whitespace() || BRACKETS.contains(c));
        let is_whole = text.starts_with(char::is_alphanumeric) && !text.contains(is_lost);
        match units[..] {
            [unit] if !has_factor && is_whole => Ok(Some(unit)),
            [] if words.iter().all(|word| is_one_of(word, NO_MATTER)) => Ok(None),
            _ => Err(()),
        }
    }
}

/// Whether a word is so many of a unit: `100ns`.
fn is_multiple(word: &str) -> bool {
    let unit = word.trim_start_matches(|c: char| c.is_ascii_digit());
    unit.len() < word.len() && TimeUnit::called(unit).is_some()
}

/// Whether a sign separates no words: it may be what is left of a micro sign, as in `?s`.
fn is_lost(sign: char) -> bool {
    !(sign.is_alphanumeric() || sign.is_whitespace() || "_-.,:;|/".contains(sign))
}

fn unknown(column: &str) -> String {
    let column = printable::cell(column);
    format!(
        "column {column:?}: not a unit of time that is known: --time-unit gives it (s, ms, us, ns, min, h, d)"
    )
}

/// A column's name without what is marked as its unit, and that: what stands in brackets or behind a slash.
fn apart(column: &str) -> (&str, Vec<&str>) {
    let open = ['(', '[', '{', '<'];
    let name_ends = column.find(|c| open.contains(&c) || c == '/').unwrap_or(column.len());
    let (name, behind) = column.split_at(name_ends);
    let marked = behind.split([')', ']', '}', '>', '(', '[', '{', '<', '/', ',']);
    (name, marked.map(str::trim).filter(|text| !text.is_empty()).collect())
}

/// The words of a name in small letters, up to `since` or `after`: `t_uS` has `t` and `us`, `timeMs` has
/// `time` and `ms`.
pub(super) fn words(name: &str) -> Vec<String> {
    let parts = name.split(|c: char| !c.is_alphanumeric()).filter(|part| !part.is_empty());
    let parts = parts.flat_map(|part| {
        // a capital letter behind a small one begins a word, but not within a unit
        let pairs = part.char_indices().zip(part.chars().skip(1));
        let begins = pairs.filter(|((_, a), b)| a.is_lowercase() && b.is_uppercase());
        let last = begins.map(|((at, a), _)| at + a.len_utf8()).last();
        match last.filter(|_| TimeUnit::called(part).is_none()) {
            Some(at) => vec![&part[..at], &part[at..]],
            None => vec![part],
        }
    });
    let words = parts.map(str::to_lowercase);
    words.take_while(|word| !["since", "after"].contains(&&**word)).collect()
}

/// Whether a column is called time.
pub(super) fn is_time(column: &str) -> bool {
    let is_unit = || matches!(TimeUnit::in_name(column), Ok(Some(_)));
    has_word_for_time(column) || words(column).len() == 1 && is_unit()
}

/// The same, but for a column that is called like a unit alone: D or S may be an output.
pub(super) fn has_word_for_time(column: &str) -> bool {
    let words = words(column);
    let has_unit = || matches!(TimeUnit::in_name(column), Ok(Some(_)));
    // where each output has times of its own, these are numbered
    let is_word =
        |word: &str| is_one_of(word.trim_end_matches(|c: char| c.is_ascii_digit()), TIMES);
    words.iter().any(|word| is_word(word))
        // a capital T is more often a temperature
        || words.first().is_some_and(|word| word == "t")
            && (column.trim() == "t" || has_unit() || words.last().is_some_and(|of| is_multiple(of)))
}

/// Whether a column numbers the rows, by its name.
pub(super) fn numbers_rows(column: &str) -> bool {
    let name = column.trim().to_lowercase();
    NUMBERS.contains(&&*name) || name.starts_with("unnamed: ")
}

/// What to do with a column that says, by its name, to which burst or channel the samples of a row belong.
pub(super) fn not_samples(column: &str) -> Option<String> {
    match &*column.trim().to_lowercase() {
        "burst" | "shot" | "segment" => Some(format!(
            "looks like the numbers of bursts: --burst {column} divides the table by it"
        )),
        "trigger" => Some(format!(
            "looks like no samples: if it marks an instant, leave it out by --outputs; if it numbers bursts, --burst \
             {column} divides the table by it"
        )),
        "head" | "printhead" | "head_id" | "printhead_id" => Some(format!(
            "looks like the names of printheads: --printhead {column} divides the table by it"
        )),
        "channel" | "ch" | "nozzle" | "sensor" | "channel_id" | "nozzle_id" | "sensor_id" => {
            Some("looks like the numbers of channels: give each channel a column of its own".into())
        }
        _ => None,
    }
}

/// Whether the name of a column is a setting with its value, such as `tInc = 1e-6`, which stands among the names because
/// there was no other place.
pub(super) fn holds_a_setting(column: &str) -> bool {
    column.split_once('=').is_some_and(|(_, value)| value.trim().parse::<f64>().is_ok())
}

/// Whether a column holds remarks, by its name.
pub(super) fn holds_remarks(column: &str) -> bool {
    REMARKS.contains(&&*column.trim().to_lowercase())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_read_in_all_the_ways_in_which_people_write_them() {
        for (names, unit) in [
            (
                "Time (ms)|Time [ms]|t/ms|TIME_MS|t_ms|Time ms|Time in ms|timeMs|time.ms|t (msec)|ms|millis",
                "milliseconds",
            ),
            (
                "Time (us)|t_uS|Time us|Time (\u{b5}s)|t / \u{3bc}s|TIME(uS)|x [microseconds]|t{us}|micros|TimeMicros|ts_micro|Time(us.)",
                "microseconds",
            ),
            ("Time(S)|Time (s)|time_s|Time, s|Time [Sec]|seconds|elapsed seconds|t<s>", "seconds"),
            (
                "Time(ns)|t_NS|nanos|nanoseconds since start|TimeInNs|Time (ns, relative)",
                "nanoseconds",
            ),
            ("Time (d)|Time / min|t_h", "days|minutes|hours"),
            ("time|t|x|Zeit|Time (UTC)|Date/Time|first", "-"),
            (
                "Time (10 us)|t/fortnight|Time [ticks]|time_samples|Time in jiffies|Time (h:min:s)|t (1e-6 s)|t_100ns|Time 10us",
                "?",
            ),
            (
                "Time (?s)|Time [\u{fffd}s]|t/?s|Time (_s)|Time (.s)|Time (\u{b7}s)|time_?s|Time ?s|Time (m?s)|(*s)",
                "?",
            ),
        ] {
            for (n, name) in names.split('|').enumerate() {
                let units: Vec<&str> = unit.split('|').collect();
                let found = TimeUnit::in_name(name).map(|unit| unit.map_or("-", |unit| unit.name));
                assert_eq!(found.unwrap_or("?"), units[n.min(units.len() - 1)], "{name}");
            }
        }
    }

    #[test]
    fn columns_are_called_time_or_not() {
        for name in [
            "time",
            "Time(S)",
            "t",
            "t_us",
            "T (ms)",
            "TIME",
            "Zeit [s]",
            "timestamp",
            "ms",
            "time_s",
        ] {
            assert!(is_time(name), "{name}");
        }
        for name in ["T", "x", "", "Sample", "CH1 (V)", "temp", "a", "T_ink", "x-axis", "thickness"]
        {
            assert!(!is_time(name), "{name}");
        }
    }

    #[test]
    fn a_further_column_is_of_time_by_a_word_for_it_and_not_by_a_unit_alone() {
        let [of_time, outputs] = [["t_s", "t", "Time2", "Zeit1 (ms)"], ["D", "S", "ms", "T"]];
        assert!(of_time.into_iter().all(has_word_for_time));
        assert!(!outputs.into_iter().any(has_word_for_time));
    }
}
