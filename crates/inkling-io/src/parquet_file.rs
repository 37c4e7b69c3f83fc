//! Opens a Parquet file that anybody may have written, so that the parquet crate can read it
//! safely.
//!
//! In, from `columnar.rs` and `verdict_reader.rs`: an open file. Out: the crate's reader, which
//! reads through [`ParquetFile`]. That reader skips a claimed length as if it were there, for hours
//! if the length is large (found by fuzzing; parquet 59). So the claims of the footer and of every
//! page's header are checked first (`parquet_claims.rs`), and reading at the end of the file is an
//! error instead of no bytes.

use super::parquet_claims;
use super::thrift::ThriftError;
use arrow_schema::{DataType, Schema};
use bytes::Bytes;
use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReaderBuilder,
};
use parquet::basic::Compression;
use parquet::errors::ParquetError;
use parquet::file::metadata::{ColumnChunkMetaData, RowGroupMetaData};
use parquet::file::reader::{ChunkReader, Length};
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::ops::Range;
use std::sync::Arc;

/// The last bytes of a file: the length of the metadata, and "PAR1".
const FOOTER_BYTES: u64 = 8;
/// Bytes of a page's header that are read at once; most headers are shorter.
const PAGE_HEADER_BYTES: usize = 256;

#[derive(Debug)]
pub struct ParquetFile(File);

impl ParquetFile {
    pub fn open(
        file: File,
        options: ArrowReaderOptions,
    ) -> Result<ParquetRecordBatchReaderBuilder<ParquetFile>, ParquetError> {
        let (file, metadata) = ParquetFile::checked(file, options)?;
        Ok(ParquetRecordBatchReaderBuilder::new_with_metadata(file, metadata))
    }

    /// Opens one whose texts are read as dictionaries, whatever its Arrow schema says: the few texts of a table's
    /// rows then stay the few that they are.
    pub fn open_with_dictionaries(
        file: File,
    ) -> Result<ParquetRecordBatchReaderBuilder<ParquetFile>, ParquetError> {
        // Parquet's own types are enough. The Arrow schema that tools put beside them may say more than can be
        // read (pandas: a dictionary of nulls), and then the reader panics.
        let options = ArrowReaderOptions::new().with_skip_arrow_metadata(true);
        let (file, metadata) = ParquetFile::checked(file, options.clone())?;
        let texts = || DataType::Dictionary(Box::new(DataType::Int32), Box::new(DataType::Utf8));
        let fields = metadata.schema().fields().iter().map(|of| match of.data_type() {
            DataType::Utf8 => Arc::new(of.as_ref().clone().with_data_type(texts())),
            _ => of.clone(),
        });
        let schema = Arc::new(Schema::new(fields.collect::<Vec<_>>()));
        let metadata =
            ArrowReaderMetadata::try_new(metadata.metadata().clone(), options.with_schema(schema))?;
        Ok(ParquetRecordBatchReaderBuilder::new_with_metadata(file, metadata))
    }

    fn checked(
        file: File,
        options: ArrowReaderOptions,
    ) -> Result<(ParquetFile, ArrowReaderMetadata), ParquetError> {
        let file = ParquetFile(file);
        file.check_footer()?;
        let metadata = ArrowReaderMetadata::load(&file, options)?;
        let groups = metadata.metadata().row_groups().iter();
        groups.flat_map(RowGroupMetaData::columns).try_for_each(|of| file.check_column(of))?;
        Ok((file, metadata))
    }

    /// If there is no footer, or it does not fit into the file, the parquet crate says so itself.
    fn check_footer(&self) -> io::Result<()> {
        let Some(Range { start, end }) = footer_of(&self.0)? else { return Ok(()) };
        let mut file = &self.0;
        file.seek(SeekFrom::Start(start))?;
        parquet_claims::footer(BufReader::new(file).take(end - start), end - start)
            .map_err(|_| io::Error::other("its footer contradicts itself"))
    }

    /// Pages must follow one another, and have together no more values than the footer says.
    fn check_column(&self, column: &ColumnChunkMetaData) -> io::Result<()> {
        let (start, bytes) = column.byte_range();
        let (mut at, end) = (start, start.saturating_add(bytes));
        let compressed = column.compression() != Compression::UNCOMPRESSED;
        let mut left = u64::try_from(column.num_values()).unwrap_or(0);
        while at < end {
            let wrong = |stop| {
                let what = match stop {
                    ThriftError::Malformed => "no page begins here",
                    ThriftError::ClaimsTooMuch => "a page claims more than it holds",
                };
                io::Error::other(format!("byte {at}: {what}"))
            };
            let mut file = &self.0;
            file.seek(SeekFrom::Start(at))?;
            let header = BufReader::with_capacity(PAGE_HEADER_BYTES, file).take(end - at);
            let page = parquet_claims::page(header, compressed).map_err(wrong)?;
            if !page.is_dictionary {
                left = left
                    .checked_sub(page.values)
                    .ok_or_else(|| wrong(ThriftError::ClaimsTooMuch))?;
            }
            at = at.saturating_add(page.header_bytes + page.stored_bytes);
        }
        Ok(())
    }
}

/// The footer of a Parquet file, which says where in it which values lie, and what they are of. Empty: the file has
/// none, or a larger one than is asked for.
pub fn footer(mut file: &File, most_bytes: u64) -> io::Result<Vec<u8>> {
    let is_small = |of: &Range<u64>| of.start >= 4 && of.end - of.start <= most_bytes;
    let Some(of) = footer_of(file)?.filter(is_small) else { return Ok(Vec::new()) };
    let mut footer = vec![0; (of.end - of.start) as usize];
    file.seek(SeekFrom::Start(of.start))?;
    file.read_exact(&mut footer)?;
    Ok(footer)
}

fn footer_of(mut file: &File) -> io::Result<Option<Range<u64>>> {
    let mut footer = [0; FOOTER_BYTES as usize];
    let Some(end) = file.len().checked_sub(FOOTER_BYTES) else { return Ok(None) };
    file.seek(SeekFrom::Start(end))?;
    file.read_exact(&mut footer)?;
    let [a, b, c, d, magic @ ..] = footer;
    let start = end.checked_sub(u32::from_le_bytes([a, b, c, d]).into());
    Ok(start.filter(|_| magic == *b"PAR1").map(|start| start..end))
}

/// An error in words: an error that this file made as it is, and one of the library as a sign of
/// damage.
pub fn words(error: &ParquetError) -> String {
    match error {
        ParquetError::External(own) => own.to_string(),
        of_library => match of_library.to_string().split_once("Disabled feature at compile time: ")
        {
            Some((_, codec)) => {
                format!(
                    "compressed by {codec}, which is not read here: write it with zstd, snappy or none"
                )
            }
            None => format!("cut short or damaged ({of_library})"),
        },
    }
}

impl Length for ParquetFile {
    fn len(&self) -> u64 {
        self.0.len()
    }
}

impl ChunkReader for ParquetFile {
    type T = StrictReader;

    fn get_read(&self, start: u64) -> Result<StrictReader, ParquetError> {
        self.0.get_read(start).map(StrictReader)
    }

    fn get_bytes(&self, start: u64, length: usize) -> Result<Bytes, ParquetError> {
        self.0.get_bytes(start, length)
    }
}

/// A plain file gives no bytes at its end, and the library goes on as if it had skipped what was claimed.
#[derive(Debug)]
pub struct StrictReader(BufReader<File>);

impl Read for StrictReader {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self.0.read(buffer)? {
            0 if !buffer.is_empty() => Err(io::ErrorKind::UnexpectedEof.into()),
            read => Ok(read),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_is_read_and_to_read_on_at_the_end_is_an_error() {
        let mut file = tempfile::tempfile().unwrap();
        io::Write::write_all(&mut file, b"PAR1 and so on").unwrap();
        let file = ParquetFile(file);
        assert_eq!(file.len(), 14);
        let mut text = String::new();
        file.get_read(5).unwrap().take(9).read_to_string(&mut text).unwrap();
        assert_eq!(text, "and so on");
        let error = file.get_read(5).unwrap().read_to_string(&mut text).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof);
    }
}
