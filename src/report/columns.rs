//! A table on a terminal. In: heads and rows. Out: a line each, in columns.

use std::io::{self, Write};

/// `heads`: each with its column's width, below 0 of what stands at the left of its column.
pub fn columns<const N: usize>(
    out: &mut impl Write,
    heads: [(&str, isize); N],
    rows: impl IntoIterator<Item = [String; N]>,
) -> io::Result<()> {
    let line = |cells: [String; N]| {
        let padded = cells.iter().zip(heads).map(|(cell, (_, width))| match width {
            0.. => format!(" {cell:>width$}", width = width.unsigned_abs()),
            _ => format!(" {cell:<width$}", width = width.unsigned_abs()),
        });
        String::from(" ") + &padded.collect::<String>()
    };
    writeln!(out, "{}", line(heads.map(|(head, _)| head.to_owned())).trim_end())?;
    rows.into_iter().try_for_each(|row| writeln!(out, "{}", line(row)))
}
