//! Writes the faults of a report to the Parquet file `report.faults.parquet` (`schemas/faults.md`). In: the
//! report's faults, the most urgent first. Out: one row for each.

use crate::report::{self, Fault};
use inkling_io::column_types::TimestampUnit;
use inkling_io::row_table::{self, Cells, Column};
use inkling_io::verdict_table::TableError;
use std::path::Path;
use std::sync::Arc;

/// The columns in the table's order.
static COLUMNS: [Column<Fault>; 16] = [
    Column::required("printhead", Cells::Name(|f| Some(f.story.printhead.to_string()))),
    Column::required("channel", Cells::Count(|f| f.story.channel)),
    Column::nullable("category", Cells::Name(|f| f.story.category.clone())),
    Column::nullable("fault", Cells::Name(|f| f.story.fault.clone())),
    Column::required("began_at", Cells::Time(|f| Some(f.story.began_at_ns))),
    Column::nullable("ended_at", Cells::Time(|f| f.story.ended_at_ns)),
    Column::required("recordings", Cells::Count(|f| f.story.recordings)),
    Column::required("episodes", Cells::Count(|f| f.story.spells.len() as u32)),
    Column::nullable("severity_first", Cells::Number(|f| f.story.severity_first)),
    Column::nullable("severity_last", Cells::Number(|f| f.story.severity_last)),
    Column::nullable("severity_per_day", Cells::Number(per_day)),
    Column::nullable("certainty", Cells::Number(|f| f.story.certainty)),
    Column::nullable("reason", Cells::Name(|f| f.story.reason().map(str::to_owned))),
    Column::required("urgency", Cells::Number(|f| Some(f.urgency))),
    Column::required("action", Cells::Name(|f| Some(f.action.clone()))),
    Column::required("sentence", Cells::Text(|f| f.sentence.clone())),
];

/// The trend of the severity, if it is certain. A trend of the distance from healthy is none.
fn per_day(fault: &Fault) -> Option<f64> {
    let is_sized = fault.story.severity_last.is_some();
    report::certain_trend(&fault.story).filter(|_| is_sized).map(|trend| trend.per_day)
}

/// Writes the table. The file gets its name once it is complete.
pub fn write(path: &Path, faults: &[Fault]) -> Result<(), TableError> {
    let schema = Arc::new(row_table::schema(&COLUMNS, TimestampUnit::Ns));
    let batch = row_table::batch(&COLUMNS, schema, TimestampUnit::Ns, faults)
        .map_err(|source| TableError::Columns { path: path.to_path_buf(), source })?;
    row_table::write(path, &batch)
}

#[cfg(test)]
#[path = "../../crates/inkling-io/src/documented.rs"]
mod documented;

#[cfg(test)]
mod tests {
    use super::documented::is_documented;
    use super::*;

    #[test]
    fn schema_is_the_documented_one() {
        let page = include_str!("../../schemas/faults.md");
        is_documented(page, &row_table::schema(&COLUMNS, TimestampUnit::Ns));
    }
}
