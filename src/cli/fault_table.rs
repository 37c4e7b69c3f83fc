//! Writes the faults of a report to the Parquet file `report.faults.parquet` (`schemas/faults.md`). In: the
//! report's faults, the most urgent first. Out: one row for each.

use crate::report::{self, Fault};
use inkling_io::column_types::TimestampUnit;
use inkling_io::row_table::{self, Column, Kind};
use inkling_io::verdict_table::TableError;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;

/// What a fault has in a column.
type Cell = fn(&Fault) -> Value;

/// The columns in the table's order.
static COLUMNS: [(Column, Cell); 16] = [
    (Column::required("printhead", Kind::Name), |f| json!(f.story.printhead)),
    (Column::required("channel", Kind::Count), |f| json!(f.story.channel)),
    (Column::nullable("category", Kind::Name), |f| json!(f.story.category)),
    (Column::nullable("fault", Kind::Name), |f| json!(f.story.fault)),
    (Column::required("began_at", Kind::Time), |f| json!(f.story.began_at_ns)),
    (Column::nullable("ended_at", Kind::Time), |f| json!(f.story.ended_at_ns)),
    (Column::required("recordings", Kind::Count), |f| json!(f.story.recordings)),
    (Column::required("episodes", Kind::Count), |f| json!(f.story.spells.len())),
    (Column::nullable("severity_first", Kind::Number), |f| json!(f.story.severity_first)),
    (Column::nullable("severity_last", Kind::Number), |f| json!(f.story.severity_last)),
    (Column::nullable("severity_per_day", Kind::Number), |f| json!(per_day(f))),
    (Column::nullable("certainty", Kind::Number), |f| json!(f.story.certainty)),
    (Column::nullable("reason", Kind::Name), |f| json!(f.story.reason())),
    (Column::required("urgency", Kind::Number), |f| json!(f.urgency)),
    (Column::required("action", Kind::Name), |f| json!(f.action)),
    (Column::required("sentence", Kind::Text), |f| json!(f.sentence)),
];

fn columns() -> [Column; 16] {
    COLUMNS.each_ref().map(|(column, _)| *column)
}

/// The trend of the severity, if it is certain. A trend of the distance from healthy is none.
fn per_day(fault: &Fault) -> Option<f64> {
    let is_sized = fault.story.severity_last.is_some();
    report::certain_trend(&fault.story).filter(|_| is_sized).map(|trend| trend.per_day)
}

/// Writes the table. The file gets its name once it is complete.
pub fn write(path: &Path, faults: &[Fault]) -> Result<(), TableError> {
    let (columns, unit) = (columns(), TimestampUnit::Ns);
    let row = |fault| COLUMNS.iter().map(|(column, of)| (column.name, of(fault))).collect();
    let rows: Vec<Value> = faults.iter().map(row).collect();
    let schema = Arc::new(row_table::schema(&columns, unit));
    let batch =
        row_table::batch(&columns, schema, unit, &rows).map_err(TableError::columns(path))?;
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
        is_documented(page, &row_table::schema(&columns(), TimestampUnit::Ns));
    }
}
