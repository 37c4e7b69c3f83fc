//! Pages of a column chunk, compressed, and what the file's footer says of them. The other files of this
//! directory encode the bytes, this one wraps them.

use bytes::Bytes;
use parquet::basic::{Compression, Encoding, PageType, ZstdLevel};
use parquet::column::page::{CompressedPage, Page, PageWriter};
use parquet::column::writer::ColumnCloseResult;
use parquet::errors::{ParquetError, Result};
use parquet::file::metadata::ColumnChunkMetaData;
use parquet::file::statistics::Statistics;
use parquet::file::writer::{SerializedPageWriter, SerializedRowGroupWriter, TrackedWrite};
use parquet::schema::types::ColumnDescPtr;
use std::cell::RefCell;
use std::io::Write;
use zstd::zstd_safe::{self, CCtx, CompressionLevel};

/// The fastest of zstd's usual levels.
const ZSTD_LEVEL: CompressionLevel = 1;
/// Bytes of a page's header, about.
const HEADER_BYTES: usize = 64;

/// A page that is complete and compressed.
#[derive(Debug)]
pub struct ClosedPage {
    /// The bytes as they are written, without their header.
    compressed: Bytes,
    /// Bytes before compression, which the header must say.
    raw_bytes: usize,
    values: u32,
}

/// Memory in which a thread makes its pages, one after the other. The tables of a compressor alone are larger
/// than most pages, so it is not made anew for each.
struct Room {
    raw: Vec<u8>,
    compressed: Vec<u8>,
    compressor: CCtx<'static>,
}

thread_local! {
    /// One room for each thread that encodes.
    static ROOM: RefCell<Room> = RefCell::new(Room {
        raw: Vec::new(),
        compressed: Vec::new(),
        compressor: CCtx::create(),
    });
}

impl ClosedPage {
    /// Encodes and compresses a page. `levels`: for a nullable column, which rows have a value, encoded;
    /// `None`: every row has one. `encode` appends the values. `values`: the number of rows, nulls included,
    /// or of values in a dictionary.
    pub fn new(
        levels: Option<Vec<u8>>,
        encode: impl FnOnce(&mut Vec<u8>),
        values: u32,
    ) -> Result<ClosedPage> {
        ROOM.with_borrow_mut(|Room { raw, compressed, compressor }| {
            raw.clear();
            // pages of version 1 have the levels first, behind their length
            if let Some(levels) = levels {
                raw.extend((levels.len() as u32).to_le_bytes());
                raw.extend(levels);
            }
            encode(raw);
            compressed.clear();
            compressed.reserve(zstd_safe::compress_bound(raw.len()));
            compressor.compress(compressed, raw, ZSTD_LEVEL).map_err(|code| {
                ParquetError::General(format!("zstd: {}", zstd_safe::get_error_name(code)))
            })?;
            let compressed = Bytes::copy_from_slice(compressed);
            Ok(ClosedPage { compressed, raw_bytes: raw.len(), values })
        })
    }

    /// Bytes held.
    pub fn memory(&self) -> usize {
        self.compressed.len()
    }
}

/// All pages of a column chunk.
pub struct ColumnPages {
    pub column: ColumnDescPtr,
    pub dictionary: Option<ClosedPage>,
    pub pages: Vec<ClosedPage>,
    /// Encoding of the data pages; a dictionary's is always PLAIN.
    pub encoding: Encoding,
    pub statistics: Option<Statistics>,
}

impl ColumnPages {
    /// Writes the pages and splices them into the row group as its next column.
    pub fn append_to<W: Write + Send>(
        self,
        group: &mut SerializedRowGroupWriter<'_, W>,
    ) -> Result<()> {
        let ColumnPages { column, dictionary, pages, encoding, statistics } = self;
        let bytes = dictionary.iter().chain(&pages).map(|page| page.memory() + HEADER_BYTES).sum();
        // the pages are written to memory first, because the file's writer takes a chunk as a whole
        let mut sink = TrackedWrite::new(Vec::with_capacity(bytes));
        let mut out = SerializedPageWriter::new(&mut sink);

        let dictionary = dictionary.map(|ClosedPage { compressed: buf, raw_bytes, values }| {
            let (num_values, encoding, is_sorted) = (values, Encoding::PLAIN, false);
            (Page::DictionaryPage { buf, num_values, encoding, is_sorted }, raw_bytes)
        });
        let data = pages.into_iter().map(|ClosedPage { compressed: buf, raw_bytes, values }| {
            let page = Page::DataPage {
                buf,
                num_values: values,
                encoding,
                def_level_encoding: Encoding::RLE,
                rep_level_encoding: Encoding::RLE,
                statistics: None,
            };
            (page, raw_bytes)
        });

        let mut encodings = vec![Encoding::RLE, encoding];
        let mut chunk = ColumnChunkMetaData::builder(column)
            .set_compression(Compression::ZSTD(ZstdLevel::try_new(ZSTD_LEVEL)?));
        let (mut compressed, mut raw, mut rows) = (0, 0, 0);
        let mut first_offset = None;
        for (page, raw_bytes) in dictionary.into_iter().chain(data) {
            // the footer needs the place of the dictionary and that of the first data page
            let at = out.write_page(CompressedPage::new(page, raw_bytes))?;
            if at.page_type == PageType::DICTIONARY_PAGE {
                encodings.push(Encoding::PLAIN);
                chunk = chunk.set_dictionary_page_offset(Some(at.offset as i64));
            } else {
                first_offset.get_or_insert(at.offset);
                rows += u64::from(at.num_values);
            }
            compressed += at.compressed_size;
            raw += at.uncompressed_size;
        }
        out.close()?;
        chunk = chunk
            .set_encodings(encodings)
            .set_num_values(rows as i64)
            .set_total_compressed_size(compressed as i64)
            .set_total_uncompressed_size(raw as i64)
            .set_data_page_offset(first_offset.unwrap_or_default() as i64);
        if let Some(statistics) = statistics {
            chunk = chunk.set_statistics(statistics);
        }

        let close = ColumnCloseResult {
            bytes_written: compressed as u64,
            rows_written: rows,
            metadata: chunk.build()?,
            bloom_filter: None,
            column_index: None,
            offset_index: None,
        };
        group.append_column(&Bytes::from(sink.into_inner()?), close)
    }
}
