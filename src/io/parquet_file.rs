//! A Parquet file that anybody may have written.
//!
//! In: an open file. Out: what the Parquet reader reads from. Where the file ends, to read on is an error, and so is a
//! header that claims more than there is: the reader itself skips what a damaged header claims as if it were there, for
//! hours if it claims much (found by fuzzing; parquet 59).

use super::thrift_claims;
use bytes::Bytes;
use parquet::errors::ParquetError;
use parquet::file::reader::{ChunkReader, Length};
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};

/// Elements in the lists of a page's header: there are none so far.
const MOST_OF_A_PAGE: u64 = 64;
/// Length of the metadata, and "PAR1".
const FOOTER_BYTES: u64 = 8;

#[derive(Debug)]
pub struct ParquetFile(File);

impl ParquetFile {
    /// What its footer claims must fit into it.
    pub fn new(mut file: File) -> io::Result<ParquetFile> {
        let mut footer = [0; FOOTER_BYTES as usize];
        let length = file.metadata()?.len();
        if length >= FOOTER_BYTES {
            file.seek(SeekFrom::End(-(FOOTER_BYTES as i64)))?;
            file.read_exact(&mut footer)?;
            let metadata =
                u64::from(u32::from_le_bytes([footer[0], footer[1], footer[2], footer[3]]));
            if let Some(start) = (length - FOOTER_BYTES).checked_sub(metadata) {
                file.seek(SeekFrom::Start(start))?;
                let bytes = BufReader::new(&file).take(metadata);
                if !thrift_claims::are_within(bytes, metadata) {
                    return Err(io::Error::other("damaged: its footer claims more than it holds"));
                }
            }
        }
        Ok(ParquetFile(file))
    }
}

impl Length for ParquetFile {
    fn len(&self) -> u64 {
        self.0.len()
    }
}

impl ChunkReader for ParquetFile {
    type T = Ending;

    /// Of a page from its header on, or of the footer.
    fn get_read(&self, start: u64) -> Result<Ending, ParquetError> {
        let is_footer = start.saturating_add(FOOTER_BYTES) >= self.len();
        let page = self.0.get_read(start)?;
        if !is_footer && !thrift_claims::are_within(page, MOST_OF_A_PAGE) {
            return Err(ParquetError::General("a page's header claims more than it holds".into()));
        }
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
        let file = ParquetFile::new(file).unwrap();
        assert_eq!(file.len(), 14);
        let mut text = String::new();
        file.get_read(5).unwrap().take(9).read_to_string(&mut text).unwrap();
        assert_eq!(text, "and so on");
        let error = file.get_read(5).unwrap().read_to_string(&mut text).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof);
    }
}
