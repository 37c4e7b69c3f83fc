//! Encodes column chunks of a Parquet file run by run instead of row by row.
//!
//! Nearly all signals are healthy, so most columns of a verdict table are long runs of the same
//! value or of equal steps. The parquet crate's own writer looks at every row; here a run of any
//! length costs about as much as one value.
//!
//! In: runs of rows, from `verdict_chunk.rs`, which chooses the kind of each column. Out:
//! `pages::ColumnPages`, the encoded chunk of one column in one row group, which the parquet
//! crate splices into the file. Pages are data pages of version 1 of the Parquet format, compressed
//! by zstd.
//!
//! ```text
//! runs     texts and numbers that are the same over many rows: keys into a dictionary
//! steps    whole numbers that go on by equal steps: times, channels
//! numbers  f32 that differ from row to row, or are null
//! hybrid   Parquet's code of run lengths and packed bits: for keys, and for which rows are null; the two codes below it
//! pages    compressed pages, and what the file's footer says of them
//! ```

mod hybrid;
mod numbers;
mod pages;
mod runs;
mod steps;

pub use numbers::NumberColumn;
pub use runs::{RunColumn, text};
pub use steps::StepColumn;

#[cfg(test)]
mod tests {
    use super::*;
    use arrow_array::cast::AsArray;
    use arrow_array::types::{Float32Type, Int32Type, Int64Type, UInt32Type};
    use arrow_array::{Array, ArrayRef, RecordBatch};
    use bytes::Bytes;
    use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
    use parquet::basic::Encoding;
    use parquet::errors::Result;
    use parquet::file::statistics::Statistics;
    use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
    use parquet::schema::parser::parse_message_type;
    use parquet::schema::types::ColumnDescPtr;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use std::sync::Arc;

    type Group<'a> = SerializedRowGroupWriter<'a, Vec<u8>>;

    /// A file of one column, as the parquet crate reads it.
    fn read_back(
        schema: &str,
        column: impl FnOnce(ColumnDescPtr, &mut Group) -> Result<()>,
    ) -> (Vec<ArrayRef>, Option<Statistics>) {
        let schema = Arc::new(parse_message_type(schema).unwrap());
        let mut file = SerializedFileWriter::new(Vec::new(), schema, Default::default()).unwrap();
        let of = file.schema_descr().column(0);
        let mut group = file.next_row_group().unwrap();
        column(of, &mut group).unwrap();
        group.close().unwrap();
        let bytes = Bytes::from(file.into_inner().unwrap());
        let reader = ParquetRecordBatchReaderBuilder::try_new(bytes).unwrap();
        let statistics = reader.metadata().row_group(0).column(0).statistics().cloned();
        let batches = reader.with_batch_size(1000).build().unwrap();
        let first = |batch: RecordBatch| batch.column(0).clone();
        (batches.map(|batch| first(batch.unwrap())).collect(), statistics)
    }

    #[test]
    fn property_steps_of_any_size_are_read_back() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        for round in 0..60 {
            let mut rows: Vec<(i64, i64, usize)> = Vec::new();
            for _ in 0..rng.random_range(1..40) {
                let start = match round % 3 {
                    0 => rng.random_range(0..1_000),
                    1 => 1_750_000_000_000_000_000 + rng.random_range(0..1_000_000_000),
                    _ => rng.random::<i64>(),
                };
                let longest = [1, 5, 200, 3000][round % 4];
                rows.push((start, rng.random_range(0..2), rng.random_range(1..=longest)));
            }
            let numbers = |&(start, step, n): &(i64, i64, usize)| {
                (0..n as i64).map(move |i| start.wrapping_add(i * step))
            };
            let expected: Vec<i64> = rows.iter().flat_map(numbers).collect();
            let (found, statistics) = read_back("message m { required int64 t; }", |of, group| {
                let mut column = StepColumn::new(of);
                rows.iter().for_each(|&(start, step, n)| column.push(start, step, n));
                column.close()?.append_to(group)
            });
            let found = found.iter().flat_map(|a| a.as_primitive::<Int64Type>().values().to_vec());
            assert_eq!(found.collect::<Vec<_>>(), expected, "round {round}");
            let Some(Statistics::Int64(of)) = statistics else { panic!("of another type") };
            assert_eq!(of.min_opt(), expected.iter().min());
            assert_eq!(of.max_opt(), expected.iter().max());
        }
    }

    #[test]
    fn property_channels_of_all_32_bits_are_read_back() {
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        for round in 0..40 {
            let mut expected: Vec<u32> = Vec::new();
            let schema = "message m { required int32 c (INTEGER(32,false)); }";
            let (found, statistics) = read_back(schema, |of, group| {
                let mut column = StepColumn::new(of);
                for _ in 0..rng.random_range(1..50) {
                    let n = rng.random_range(1..300u32);
                    let start = rng.random_range(0..=u32::MAX - n);
                    column.push(start.into(), 1, n as usize);
                    expected.extend(start..start + n);
                }
                column.close()?.append_to(group)
            });
            let found = found.iter().flat_map(|a| a.as_primitive::<UInt32Type>().values().to_vec());
            assert_eq!(found.collect::<Vec<_>>(), expected, "round {round}");
            let Some(Statistics::Int32(of)) = statistics else { panic!("of another type") };
            assert_eq!(of.min_opt().map(|v| *v as u32), expected.iter().min().copied());
            assert_eq!(of.max_opt().map(|v| *v as u32), expected.iter().max().copied());
        }
    }

    #[test]
    fn property_numbers_and_nulls_are_read_back_over_pages() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        for encoding in [Encoding::BYTE_STREAM_SPLIT, Encoding::PLAIN] {
            let mut expected: Vec<Option<f32>> = Vec::new();
            let (found, statistics) = read_back("message m { optional float x; }", |of, group| {
                let mut column = NumberColumn::new(of, encoding);
                while expected.len() < 200_000 {
                    let n = rng.random_range(1..5000);
                    if rng.random_bool(0.3) {
                        column.push_nulls(n)?;
                        expected.resize(expected.len() + n, None);
                        continue;
                    }
                    let number = |_| match rng.random_bool(0.1) {
                        true => f32::NAN,
                        false => rng.random_range(-3.0f32..1e6),
                    };
                    let numbers: Vec<f32> = (0..n).map(number).collect();
                    column.push(&numbers)?;
                    expected.extend(numbers.iter().map(|v| (!v.is_nan()).then_some(*v)));
                }
                column.close()?.append_to(group)
            });
            let found: Vec<Option<f32>> =
                found.iter().flat_map(|a| a.as_primitive::<Float32Type>().iter()).collect();
            assert_eq!(found, expected);
            let Some(Statistics::Float(of)) = statistics else { panic!("of another type") };
            let numbers = || expected.iter().flatten().copied();
            assert_eq!(of.min_opt().copied(), numbers().reduce(f32::min));
            assert_eq!(of.max_opt().copied(), numbers().reduce(f32::max));
            let nulls = expected.iter().filter(|v| v.is_none()).count() as u64;
            assert_eq!(of.null_count_opt(), Some(nulls));
        }
    }

    /// Dictionaries of 1 to 2^18 values, so keys of all widths up to 18 bits.
    #[test]
    fn property_runs_of_few_and_of_many_values_are_read_back() {
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        for round in 0..40 {
            let most = 1i32 << (round % 19);
            let longest = [1, 3, 9, 40, 5000][round % 5];
            let mut expected: Vec<Option<i32>> = Vec::new();
            let (found, _) = read_back("message m { optional int32 k; }", |of, group| {
                let values = (0..most).map(|value| value.to_le_bytes().to_vec());
                let mut column = RunColumn::new(of, values);
                for _ in 0..rng.random_range(1..60) {
                    let rows = rng.random_range(1..=longest);
                    let value = rng.random_range(0..most);
                    if rng.random_bool(0.3) {
                        let which: Vec<bool> = (0..rows).map(|_| rng.random_bool(0.4)).collect();
                        column.push_either([0, value as u32], &which)?;
                        expected.extend(which.iter().map(|&of| Some(value * i32::from(of))));
                        continue;
                    }
                    let value = Some(value).filter(|_| rng.random_bool(0.8));
                    column.push(value.map(|value| value as u32), rows)?;
                    expected.extend(std::iter::repeat_n(value, rows));
                }
                column.close(false)?.append_to(group)
            });
            let found: Vec<Option<i32>> =
                found.iter().flat_map(|a| a.as_primitive::<Int32Type>().iter()).collect();
            assert_eq!(found, expected, "round {round}");
        }
    }

    #[test]
    fn a_column_of_nulls_alone_has_no_least() {
        let (found, statistics) = read_back("message m { optional float x; }", |of, group| {
            let mut column = NumberColumn::new(of, Encoding::BYTE_STREAM_SPLIT);
            column.push_nulls(3)?;
            column.close()?.append_to(group)
        });
        assert_eq!(found[0].null_count(), 3);
        let Some(Statistics::Float(of)) = statistics else { panic!("of another type") };
        assert_eq!((of.min_opt(), of.null_count_opt()), (None, Some(3)));
    }
}
