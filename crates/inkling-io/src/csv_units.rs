//! A row of units, as instruments write it below the names of a table's columns.
//!
//! In, from `csv_table.rs`: the row below the names and the one after it. Out: [`Units`], if it is one of units; and
//! columns of which it says that they are no outputs are left out.

use super::csv_cells::{Cells, no_number};
use super::printable;
use super::table_columns::{ChosenColumns, Columns, of_one_unit};
use super::time_column::{TimeUnit, numbers_rows};
use csv::StringRecord;

/// What a row of units says.
pub(super) struct Units {
    /// `None`: nothing that matters.
    pub of_time: Option<TimeUnit>,
}

/// `below`: the next row. `None`: the row is one of numbers, or has a cell that is neither.
pub(super) fn read(
    row: &StringRecord,
    below: Option<&StringRecord>,
    chosen: &mut ChosenColumns,
    columns: &Columns,
    cells: Cells,
) -> Result<Option<Units>, String> {
    let Some(none) = no_outputs(row, below, chosen, cells) else { return Ok(None) };
    let of_time = match of_time(row, &none, chosen, columns) {
        Err(_) if columns.spare_times() => {
            chosen.leave_times_out();
            None
        }
        of_time => of_time?,
    };
    chosen.outputs.retain(|c| !none.contains(c));
    chosen.left_out.extend(none);
    let units = chosen.outputs.iter().filter_map(|c| Some((*c, row.get(*c)?.trim())));
    let units: Vec<(usize, &str)> = units.filter(|(_, unit)| !unit.is_empty()).collect();
    of_one_unit(units.iter().copied(), &chosen.names)?;
    // as if it stood in the name, by which tables are compared
    for (c, unit) in units {
        let unit = printable::cell(unit.trim_matches(|c: char| "()[]{}".contains(c)));
        chosen.names[c] = format!("{} ({unit})", chosen.names[c]);
    }
    Ok(Some(Units { of_time }))
}

/// The outputs of which a row of units says that they are none: numbers of rows, and what stands in this row alone.
fn no_outputs(
    row: &StringRecord,
    below: Option<&StringRecord>,
    chosen: &ChosenColumns,
    cells: Cells,
) -> Option<Vec<usize>> {
    let cell = |c: usize| row.get(c).unwrap_or_default();
    let is_text = |c: usize| cells.is_text(cell(c));
    let is_alone = |c: &usize| below.is_some_and(|of| of.get(*c).is_none_or(str::is_empty));
    let (texts, others): (Vec<usize>, Vec<usize>) =
        chosen.outputs.iter().partition(|c| is_text(**c));
    let are_units = chosen.time.is_none_or(is_text) && others.iter().all(is_alone);
    let is_one = are_units && !texts.is_empty();
    let counting = texts.into_iter().filter(|c| numbers_rows(cell(*c)));
    is_one.then(|| others.iter().copied().chain(counting).collect())
}

/// The unit of the times. An error if the row says none, and no option does.
fn of_time(
    row: &StringRecord,
    no_outputs: &[usize],
    chosen: &ChosenColumns,
    columns: &Columns,
) -> Result<Option<TimeUnit>, String> {
    let Some(time) = chosen.time.filter(|_| columns.unit.is_none()) else { return Ok(None) };
    let cell = row.get(time).unwrap_or_default();
    let said = printable::cell(cell);
    let what = match TimeUnit::in_text(cell) {
        Ok(Some(unit)) => {
            let named = TimeUnit::in_name(&chosen.names[time]).ok().flatten();
            let Some(named) = named.filter(|named| *named != unit) else { return Ok(Some(unit)) };
            let [named, unit] = [named, unit].map(|of| of.name);
            format!("its name says {named}, and {said:?} below it {unit}: --time-unit says which")
        }
        _ if numbers_rows(cell) => {
            let there = numbers_there(row, no_outputs, chosen);
            format!("{said:?} counts samples: --period-s says how far apart they are{there}")
        }
        _ => no_number(
            cell,
            "nor is it a unit of time that is known: --time-unit gives it, where the line is one of units",
        ),
    };
    Err(chosen.of_column(time, &what))
}

/// The numbers that stand in the row of units alone: one of them may be the sample period.
fn numbers_there(row: &StringRecord, no_outputs: &[usize], chosen: &ChosenColumns) -> String {
    let numbers = no_outputs.iter().filter_map(|&c| {
        let number = row.get(c).filter(|cell| cell.parse::<f64>().is_ok())?;
        Some(format!("{} {number}", chosen.names[c]))
    });
    let numbers: Vec<String> = numbers.collect();
    match numbers.is_empty() {
        true => String::new(),
        false => printable::line(&format!(" (there are {})", numbers.join(", ")), 200),
    }
}
