//! Faults linked over recordings to a Parquet file: `report.faults.parquet` of the contract
//! (`schemas/faults.md`). In: the report's faults, most urgent first. Out: a row each.

use super::part_file::PartFile;
use super::verdict_table::TableError;
use crate::report::{self, Fault};
use arrow_array::builder::StringDictionaryBuilder;
use arrow_array::types::Int32Type;
use arrow_array::{
    ArrayRef, Float32Array, RecordBatch, StringArray, TimestampNanosecondArray, UInt32Array,
};
use arrow_schema::{DataType, Field, Schema, TimeUnit};
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, ZstdLevel};
use parquet::file::properties::WriterProperties;
use std::path::Path;
use std::sync::Arc;

/// The table's columns as Arrow sees them.
pub fn schema() -> Schema {
    let text = || DataType::Dictionary(Box::new(DataType::Int32), Box::new(DataType::Utf8));
    let time = || DataType::Timestamp(TimeUnit::Nanosecond, Some("UTC".into()));
    let required = |name, data_type| Field::new(name, data_type, false);
    let nullable = |name, data_type| Field::new(name, data_type, true);
    Schema::new(vec![
        required("printhead", text()),
        required("channel", DataType::UInt32),
        nullable("category", text()),
        nullable("fault", text()),
        required("began_at", time()),
        nullable("ended_at", time()),
        required("recordings", DataType::UInt32),
        required("episodes", DataType::UInt32),
        nullable("severity_first", DataType::Float32),
        nullable("severity_last", DataType::Float32),
        nullable("severity_per_day", DataType::Float32),
        nullable("certainty", DataType::Float32),
        required("urgency", DataType::Float32),
        required("action", text()),
        required("sentence", DataType::Utf8),
    ])
}

/// Writes all of them; the file has its name when it is whole.
pub fn write(path: &Path, faults: &[Fault]) -> Result<(), TableError> {
    let io_failed = |source| TableError::Io { path: path.to_path_buf(), source };
    let failed = |source| TableError::Parquet { path: path.to_path_buf(), source };
    let texts = |of: &dyn Fn(&Fault) -> Option<String>| -> ArrayRef {
        let mut builder = StringDictionaryBuilder::<Int32Type>::new();
        faults.iter().for_each(|f| builder.append_option(of(f)));
        Arc::new(builder.finish())
    };
    let times = |of: &dyn Fn(&Fault) -> Option<i64>| -> ArrayRef {
        let times: TimestampNanosecondArray = faults.iter().map(of).collect();
        Arc::new(times.with_timezone("UTC"))
    };
    let floats = |of: &dyn Fn(&Fault) -> Option<f64>| -> ArrayRef {
        Arc::new(faults.iter().map(|f| of(f).map(|v| v as f32)).collect::<Float32Array>())
    };
    let counts = |of: &dyn Fn(&Fault) -> u32| -> ArrayRef {
        Arc::new(UInt32Array::from_iter_values(faults.iter().map(of)))
    };
    let columns = vec![
        texts(&|f| Some(f.story.printhead.to_string())),
        counts(&|f| f.story.channel),
        texts(&|f| f.story.category.clone()),
        texts(&|f| f.story.fault.clone()),
        times(&|f| Some(f.story.began_at_ns)),
        times(&|f| f.story.ended_at_ns),
        counts(&|f| f.story.recordings),
        counts(&|f| f.story.spells.len() as u32),
        floats(&|f| f.story.severity_first),
        floats(&|f| f.story.severity_last),
        floats(&|f| report::certain_trend(&f.story).map(|t| t.per_day)),
        floats(&|f| f.story.certainty),
        floats(&|f| Some(f.urgency)),
        texts(&|f| Some(f.action.clone())),
        Arc::new(StringArray::from_iter_values(faults.iter().map(|f| &f.sentence))),
    ];
    let schema = Arc::new(schema());
    let batch = RecordBatch::try_new(schema.clone(), columns)
        .map_err(|source| TableError::Columns { path: path.to_path_buf(), source })?;
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::default()))
        .build();
    let (part, file) = PartFile::create(path).map_err(io_failed)?;
    let mut writer = ArrowWriter::try_new(file, schema, Some(properties)).map_err(failed)?;
    writer.write(&batch).map_err(failed)?;
    let file = writer.into_inner().map_err(failed)?;
    part.finish(&file).map_err(io_failed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schema_is_the_documented_one() {
        let documented: Vec<&str> = include_str!("../../schemas/faults.md")
            .lines()
            .filter_map(|line| line.strip_prefix("| `")?.split('`').next())
            .collect();
        let schema = schema();
        let names: Vec<&str> = schema.fields().iter().map(|f| f.name().as_str()).collect();
        assert_eq!(names, documented);
    }
}
