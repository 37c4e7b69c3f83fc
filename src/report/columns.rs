//! A table on a terminal. In: heads and rows. Out: a line each, in columns.

use std::io::{self, Write};

/// `heads`: each with its column's width, below 0 of what stands at the left of its column, 0 of what comes last. What
/// stands at the left is as far in as its head.
pub fn columns<const N: usize>(
    out: &mut impl Write,
    heads: [(&str, isize); N],
    rows: impl IntoIterator<Item = [String; N]>,
) -> io::Result<()> {
    let line = |cells: [&str; N]| {
        let padded = cells.into_iter().zip(heads).map(|(cell, (head, width))| {
            let (indent, wide) = (head.len() - head.trim_start().len(), width.unsigned_abs());
            match width > 0 {
                true => format!(" {cell:>wide$}"),
                false => format!(" {:indent$}{cell:<wide$}", ""),
            }
        });
        padded.collect::<String>()
    };
    let head = line(heads.map(|(head, width)| if width > 0 { head } else { head.trim_start() }));
    writeln!(out, " {}", head.trim_end())?;
    rows.into_iter().try_for_each(|row| writeln!(out, " {}", line(row.each_ref().map(|c| &**c))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stand_at_the_right_and_words_at_the_left() {
        let heads = [("n", 4), (" name", -6), ("what", 0)];
        let mut out = Vec::new();
        let row = |cells: [&str; 3]| cells.map(str::to_owned);
        columns(&mut out, heads, [row(["7", "a", "x y"]), row(["12345", "abcdefg", ""])]).unwrap();
        let said = String::from_utf8(out).unwrap();
        assert_eq!(said, "     n  name   what\n     7  a      x y\n  12345  abcdefg \n");
    }
}
