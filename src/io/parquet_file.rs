//! A Parquet file that anybody may have written.
//!
//! In: an open file. Out: what the Parquet reader reads from, where to read on at the end is an error. The reader itself
//! skips what a damaged page header claims beyond the end as if it were there, for hours if it claims much (found by
//! fuzzing; parquet 59).

use bytes::Bytes;
use parquet::errors::ParquetError;
use parquet::file::reader::{ChunkReader, Length};
use std::fs::File;
use std::io::{self, BufReader, Read};

#[derive(Debug)]
pub struct ParquetFile(pub File);

impl Length for ParquetFile {
    fn len(&self) -> u64 {
        self.0.len()
    }
}

impl ChunkReader for ParquetFile {
    type T = Ending;

    fn get_read(&self, start: u64) -> Result<Ending, ParquetError> {
        self.0.get_read(start).map(Ending)
    }

    fn get_bytes(&self, start: u64, length: usize) -> Result<Bytes, ParquetError> {
        self.0.get_bytes(start, length)
    }
}

#[derive(Debug)]
pub struct Ending(BufReader<File>);

impl Read for Ending {
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
