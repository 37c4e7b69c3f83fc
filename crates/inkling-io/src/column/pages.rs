//! Compresses the pages of a column chunk, and writes them with what the file's footer says of
//! them.
//!
//! In: encoded bytes, from the columns of this directory (`numbers`, `runs`, `steps`). A page is
//! compressed as soon as it is complete ([`ClosedPage`]). Out: one column of a row group
//! ([`ColumnPages`]), which [`ColumnPages::append_to`] appends to the row group as a whole. So the
//! columns of a row group can be encoded side by side by several threads and still be appended in
//! order.

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

/// The fastest of zstd's levels but for the negative ones, which compress less.
const ZSTD_LEVEL: CompressionLevel = 1;
/// Bytes of a page's header, about; only memory is reserved by it.
const HEADER_BYTES: usize = 64;

#[derive(Debug)]
pub struct ClosedPage {
    /// The bytes as they are written, without their header.
    compressed: Bytes,
    /// Number of bytes before compression, which the header must say.
    raw_bytes: usize,
    /// Number of rows, nulls included; of a dictionary, number of its values.
    values: u32,
}

/// Memory in which a thread makes its pages, one page after the other. The tables of a zstd
/// compressor alone are larger than most pages, so the compressor is kept from page to page.
struct Scratch {
    raw: Vec<u8>,
    compressed: Vec<u8>,
    compressor: CCtx<'static>,
}

thread_local! {
    /// One for each thread that encodes.
    static SCRATCH: RefCell<Scratch> = RefCell::new(Scratch {
        raw: Vec::new(),
        compressed: Vec::new(),
        compressor: CCtx::create(),
    });
}

impl ClosedPage {
    /// Encodes and compresses a page. `levels`: the definition levels of a nullable column (1: the row has a
    /// value, 0: it is null), encoded by `hybrid.rs`; `None`: every row has a value. `encode` appends the
    /// values that are not null; it must not make a page itself, because the thread's scratch memory is in
    /// use. `values`: number of rows, nulls included; of a dictionary, number of its values.
    pub fn new(
        levels: Option<Vec<u8>>,
        encode: impl FnOnce(&mut Vec<u8>),
        values: u32,
    ) -> Result<ClosedPage> {
        SCRATCH.with_borrow_mut(|Scratch { raw, compressed, compressor }| {
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

    fn dictionary(self) -> CompressedPage {
        let ClosedPage { compressed: buf, raw_bytes, values: num_values } = self;
        let (encoding, is_sorted) = (Encoding::PLAIN, false);
        CompressedPage::new(
            Page::DictionaryPage { buf, num_values, encoding, is_sorted },
            raw_bytes,
        )
    }

    fn data(self, encoding: Encoding) -> CompressedPage {
        let page = Page::DataPage {
            buf: self.compressed,
            num_values: self.values,
            encoding,
            def_level_encoding: Encoding::RLE,
            rep_level_encoding: Encoding::RLE,
            statistics: None,
        };
        CompressedPage::new(page, self.raw_bytes)
    }

    pub fn memory(&self) -> usize {
        self.compressed.len()
    }
}

pub struct ColumnPages {
    pub column: ColumnDescPtr,
    pub dictionary: Option<ClosedPage>,
    pub pages: Vec<ClosedPage>,
    /// Encoding of the data pages; a dictionary's is always PLAIN.
    pub encoding: Encoding,
    /// What the footer says of the whole chunk; pages have no statistics of their own.
    pub statistics: Option<Statistics>,
}

impl ColumnPages {
    /// Writes the pages, each behind its header, and appends them to the row group as its next
    /// column.
    pub fn append_to<W: Write + Send>(
        self,
        group: &mut SerializedRowGroupWriter<'_, W>,
    ) -> Result<()> {
        let ColumnPages { column, dictionary, pages, encoding, statistics } = self;
        let bytes = dictionary.iter().chain(&pages).map(|page| page.memory() + HEADER_BYTES).sum();
        // The pages are written to memory first, because the file's writer takes a chunk as a whole. Offsets
        // are those in this memory; `append_column` changes them into those in the file.
        let mut sink = TrackedWrite::new(Vec::with_capacity(bytes));
        let mut out = SerializedPageWriter::new(&mut sink);

        // RLE is that of the levels; the parquet crate lists it of columns without levels, too
        let mut encodings = vec![Encoding::RLE, encoding];
        let mut chunk = ColumnChunkMetaData::builder(column)
            .set_compression(Compression::ZSTD(ZstdLevel::try_new(ZSTD_LEVEL)?));
        let (mut compressed, mut raw, mut rows) = (0, 0, 0);
        let mut first_offset = None;
        let dictionary = dictionary.map(ClosedPage::dictionary);
        let data = pages.into_iter().map(|page| page.data(encoding));
        for page in dictionary.into_iter().chain(data) {
            // the footer needs the place of the dictionary and that of the first data page
            let at = out.write_page(page)?;
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
