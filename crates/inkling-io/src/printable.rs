//! Makes text from files safe for messages: names, cells, and what parsers say of them.
//!
//! In: any text. Out: its beginning, not longer than stated, in which each character that could
//! move a cursor, end a line or turn the direction of reading is replaced by U+FFFD, so that a
//! hostile name cannot forge a message. A text that was cut ends with `…`.

/// Most characters of a cell that a message repeats.
const MOST_OF_A_CELL: usize = 60;

const MOST_OF_A_PARSER: usize = 600;

/// The beginning of a name or a cell, for a message.
pub fn cell(text: &str) -> String {
    line(text, MOST_OF_A_CELL)
}

pub fn line(text: &str, most: usize) -> String {
    shown(text, most, moves)
}

/// The beginning of a text with its line breaks, at most `most` characters together (and `…` if it
/// was cut).
pub fn lines(text: &str, most: usize) -> String {
    shown(text, most, |c| c != '\n' && moves(c))
}

fn shown(text: &str, most: usize, is_odd: impl Fn(char) -> bool) -> String {
    let shown = |c: char| if is_odd(c) { '\u{fffd}' } else { c };
    let mut short: String = text.chars().take(most).map(shown).collect();
    if text.chars().nth(most).is_some() {
        short.push('…');
    }
    short
}

/// A parser's error, made printable: it may repeat all of the text that was parsed.
pub fn of_parser(error: &impl std::fmt::Display) -> String {
    lines(&error.to_string(), MOST_OF_A_PARSER)
}

/// Whether a character is a control character, separates lines, or overrides the direction of text.
fn moves(c: char) -> bool {
    let turns =
        matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    c.is_control() || turns || matches!(c, '\u{2028}' | '\u{2029}' | '\u{061c}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_moves_a_cursor_or_turns_the_text() {
        assert_eq!(cell("E\u{1b}[31mC"), "E\u{fffd}[31mC");
        assert_eq!(cell("a\u{202e}b\u{2069}\u{9b}c\nd"), "a\u{fffd}b\u{fffd}\u{fffd}c\u{fffd}d");
        assert_eq!(lines("a\nb\rc", 100), "a\nb\u{fffd}c");
        assert_eq!(cell("größer, 大"), "größer, 大");
    }

    #[test]
    fn only_the_beginning_is_repeated() {
        assert_eq!(cell(&"x".repeat(1000)).chars().count(), MOST_OF_A_CELL + 1);
        assert_eq!(lines(&"x".repeat(60), 60).chars().count(), 60);
    }
}
