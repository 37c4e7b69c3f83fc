//! A table on a terminal. In: columns and rows. Out: a line for the heads and one for each row.

use std::io::{self, Write};

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

use Column::{Last, Number, Words};

/// Writes the table. Columns are separated by one space, and a column of words after a column of numbers by
/// two.
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
    fn numbers_stand_at_the_right_and_words_at_the_left() {
        let heads = [Number("n", 4), Words("name", 6), Last("what")];
        let mut out = Vec::new();
        let row = |cells: [&str; 3]| cells.map(str::to_owned);
        columns(&mut out, heads, [row(["7", "a", "x y"]), row(["12345", "abcdefg", ""])]).unwrap();
        let said = String::from_utf8(out).unwrap();
        assert_eq!(said, "     n  name   what\n     7  a      x y\n  12345  abcdefg \n");
    }
}
