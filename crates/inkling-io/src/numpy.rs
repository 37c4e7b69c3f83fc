//! NumPy files (`.npy`, and `.npz`, several of them zipped) as bursts.
//!
//! In: an array of samples, of channels x samples, or of bursts x channels x samples. Out: one
//! [`Matrix`] after the other, so that memory holds one burst, whatever the array's size. No size is
//! trusted before as many bytes have been read.

use super::dialect::value::{Array, Element, Value};
use super::matrix::Matrix;
use super::table_file::TableError;
use super::{Limits, regular_file};
use inkling_core::burst::Layout;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use zip::ZipArchive;

/// Of the text that says what an array is.
const MOST_HEADER_BYTES: u64 = 1 << 20;
/// Numbers of an array of times.
const MOST_TIMES: usize = 1 << 22;
const MAGIC: &[u8] = b"\x93NUMPY";

/// What stands before an array's numbers.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Header {
    element: Element,
    big_endian: bool,
    fortran: bool,
    shape: Vec<usize>,
    /// Of dates: ns that a number stands for.
    unit_ns: Option<i64>,
}

/// The bursts of an array, one after the other.
pub struct Matrices {
    path: PathBuf,
    input: Box<dyn Read>,
    header: Header,
    limits: Limits,
    /// Bursts that are still to come.
    pub left: usize,
    channels: usize,
    samples: usize,
}

/// Opens the array of samples: of a `.npz` the one named, or the only one with numbers in rows.
/// `beside`: arrays that are something else.
pub fn open(path: &Path, name: Option<&str>, beside: &[&str]) -> Result<Matrices, TableError> {
    let failed = |what: String| TableError::wrong(path, what);
    let file = regular_file::open(path).map_err(|e| TableError::unread(path, e))?;
    let mut input: Box<dyn Read> = match is_zip(path)? {
        false if name.is_some() => {
            return Err(failed("one array: --outputs names arrays of a .npz".into()));
        }
        false => Box::new(BufReader::with_capacity(1 << 16, file)),
        true => match name {
            Some(name) => member(path, name)?,
            None => member(path, &only_one(path, beside)?)?,
        },
    };
    let header = Header::read(&mut input).map_err(failed)?;
    let (bursts, channels, samples) = match *header.shape.as_slice() {
        [samples] => (1, 1, samples),
        [channels, samples] => (1, channels, samples),
        [bursts, channels, samples] => (bursts, channels, samples),
        _ => {
            let what = format!(
                "an array of {} axes; samples, channels x samples or bursts x channels x samples \
                 become bursts",
                header.shape.len()
            );
            return Err(failed(what));
        }
    };
    let limits = Limits::default();
    if header.unit_ns.is_some() {
        return Err(failed("an array of dates, not of samples".into()));
    }
    if bursts == 0 || channels == 0 || samples == 0 {
        return Err(failed("an array without a number".into()));
    }
    if channels > limits.channels as usize || samples > limits.samples_per_channel as usize {
        return Err(failed(format!(
            "{channels} channels of {samples} samples: a burst has at most {} of {}; are the axes \
             bursts x channels x samples?",
            limits.channels, limits.samples_per_channel
        )));
    }
    if header.fortran && bursts > 1 {
        let what = "in column order, which scatters every burst over the file: save it with \
                    numpy.ascontiguousarray";
        return Err(failed(what.into()));
    }
    Ok(Matrices { path: path.into(), input, header, limits, left: bursts, channels, samples })
}

/// Of a `.npz`: the array that is not `beside` the others.
fn only_one(path: &Path, beside: &[&str]) -> Result<String, TableError> {
    let names = names(path)?;
    let mut others = names.iter().filter(|n| !beside.contains(&n.as_str()));
    if let (Some(only), None) = (others.next(), others.next()) {
        return Ok(only.clone());
    }
    let there = super::printable::line(&names.join(", "), 400);
    let what = format!("which array holds the samples? --outputs names it; there are {there}");
    Err(TableError::wrong(path, what))
}

impl Matrices {
    fn next_matrix(&mut self) -> Result<Matrix, String> {
        let Header { element, big_endian, fortran, .. } = self.header;
        let bytes = self.channels as u64 * self.samples as u64 * element.bytes() as u64;
        let most = self.limits.samples_bytes * 2; // numbers of eight bytes become four
        if bytes > most {
            return Err(format!("a burst of {bytes} bytes; at most {most} are read"));
        }
        let mut raw = Vec::new();
        self.input.by_ref().take(bytes).read_to_end(&mut raw).map_err(|e| e.to_string())?;
        if raw.len() as u64 != bytes {
            return Err(format!(
                "ends within its array: {} bursts that its header says are missing",
                self.left
            ));
        }
        self.left -= 1;
        if self.left == 0
            && self.input.by_ref().take(1).read(&mut [0]).map_err(|e| e.to_string())? > 0
        {
            return Err("goes on behind its array".into());
        }
        let value = Value::Array(Array { element, big_endian, bytes: raw.into() });
        let samples = value.samples(None, self.limits.samples_bytes);
        let samples = samples.filter(|s| !s.too_many).ok_or("a burst too large")?;
        Ok(Matrix {
            channels: self.channels as u32,
            samples_per_channel: self.samples as u32,
            format: samples.format,
            layout: if fortran { Layout::SampleMajor } else { Layout::ChannelMajor },
            samples: samples.bytes,
            ..Matrix::default()
        })
    }
}

impl Iterator for Matrices {
    type Item = Result<Matrix, TableError>;

    fn next(&mut self) -> Option<Result<Matrix, TableError>> {
        if self.left == 0 {
            return None;
        }
        let next = self.next_matrix();
        if next.is_err() {
            self.left = 0;
        }
        Some(next.map_err(|what| TableError::wrong(&self.path, what)))
    }
}

/// An array of a `.npz` as numbers in one row, with the ns that a date's number stands for.
pub fn numbers(path: &Path, name: &str) -> Result<(Vec<f64>, Option<i64>), TableError> {
    let failed = |what: String| TableError::wrong(path, what);
    if !is_zip(path)? {
        return Err(failed(format!("one array, without one named {name:?} beside it")));
    }
    let mut input = member(path, name)?;
    let header = Header::read(&mut input).map_err(failed)?;
    let n = header.shape.iter().try_fold(1usize, |n, of| n.checked_mul(*of));
    let n = n.filter(|n| *n <= MOST_TIMES && header.shape.len() <= 1);
    let n = n.ok_or_else(|| failed(format!("{name:?} is no row of numbers, one a burst")))?;
    let mut raw = Vec::new();
    let bytes = n as u64 * header.element.bytes() as u64;
    let read = input.take(bytes).read_to_end(&mut raw);
    read.map_err(|e| TableError::unread(path, e))?;
    let all: Vec<f64> = header.element.numbers(&raw, header.big_endian).collect();
    match all.len() == n {
        true => Ok((all, header.unit_ns)),
        false => Err(failed(format!("{name:?} ends before its numbers do"))),
    }
}

pub fn is_zip(path: &Path) -> Result<bool, TableError> {
    let start = regular_file::start(path, 4).map_err(|e| TableError::unread(path, e))?;
    Ok(start.starts_with(b"PK"))
}

fn archive(path: &Path) -> Result<ZipArchive<BufReader<File>>, TableError> {
    let file = regular_file::open(path).map_err(|e| TableError::unread(path, e))?;
    ZipArchive::new(BufReader::new(file))
        .map_err(|e| TableError::wrong(path, format!("no .npz: {e}")))
}

/// Of the arrays in it.
fn names(path: &Path) -> Result<Vec<String>, TableError> {
    let archive = archive(path)?;
    let names = archive.file_names().filter_map(Result::ok);
    let mut names: Vec<String> =
        names.filter_map(|name| name.strip_suffix(".npy").map(str::to_owned)).collect();
    names.sort_unstable();
    Ok(names)
}

/// One of them, from its first byte.
fn member(path: &Path, name: &str) -> Result<Box<dyn Read>, TableError> {
    let failed = |what: String| TableError::wrong(path, what);
    let mut archive = archive(path)?;
    let place = archive.index_for_name(&format!("{name}.npy"));
    let Some(place) = place else {
        let there = super::printable::line(&names(path)?.join(", "), 400);
        return Err(failed(format!("no array {name:?}; there are {there}")));
    };
    let e = |e: zip::result::ZipError| failed(format!("{name}: {e}"));
    let (stored, at, bytes) = {
        let member = archive.by_index(place).map_err(e)?;
        let stored = match member.compression() {
            zip::CompressionMethod::Stored => true,
            zip::CompressionMethod::Deflated => false,
            other => {
                return Err(failed(format!("{name}: compressed by {other}, which is not read")));
            }
        };
        (stored, member.data_start(), member.compressed_size())
    };
    let at = at.ok_or_else(|| failed(format!("{name}: where its data begin is not said")))?;
    let mut file = archive.into_inner();
    use std::io::{Seek, SeekFrom};
    file.seek(SeekFrom::Start(at)).map_err(|e| TableError::unread(path, e))?;
    let raw = file.take(bytes);
    Ok(match stored {
        true => Box::new(raw),
        false => Box::new(flate2::read::DeflateDecoder::new(raw)),
    })
}

impl Header {
    fn read(input: &mut impl Read) -> Result<Header, String> {
        let mut start = [0; 8];
        input.read_exact(&mut start).map_err(|_| "too short for a NumPy array")?;
        if !start.starts_with(MAGIC) {
            return Err("no NumPy array".into());
        }
        let mut length = [0; 4];
        let bytes = if start[6] == 1 { 2 } else { 4 };
        input.read_exact(&mut length[..bytes]).map_err(|_| "a header cut short")?;
        let length = u64::from(u32::from_le_bytes(length));
        if length > MOST_HEADER_BYTES {
            return Err(format!("a header of {length} bytes"));
        }
        let mut text = Vec::new();
        input.take(length).read_to_end(&mut text).map_err(|e| e.to_string())?;
        Header::parse(&String::from_utf8_lossy(&text))
    }

    /// `{'descr': '<i2', 'fortran_order': False, 'shape': (3, 4), }`
    fn parse(text: &str) -> Result<Header, String> {
        let short = || super::printable::cell(text.trim());
        let after = |key: &str| {
            let at = text.find(&format!("'{key}'"))?;
            Some(text[at..].split_once(':')?.1.trim_start())
        };
        let odd = || format!("a header that is not read: {}", short());
        let descr =
            after("descr").and_then(|t| t.strip_prefix('\'')).and_then(|t| t.split_once('\''));
        let (descr, _) = descr.ok_or_else(odd)?;
        let (element, unit_ns) = element(descr).ok_or_else(|| {
            format!("numbers of type {descr:?}; i1 to i8, u1 to u8, f4, f8 are read")
        })?;
        let shape = after("shape").and_then(|t| t.strip_prefix('(')?.split_once(')'));
        let (shape, _) = shape.ok_or_else(odd)?;
        let axes = shape.split(',').map(str::trim).filter(|axis| !axis.is_empty());
        let shape = axes.map(str::parse).collect::<Result<Vec<usize>, _>>().map_err(|_| odd())?;
        let fortran = after("fortran_order").ok_or_else(odd)?.starts_with("True");
        Ok(Header { element, big_endian: descr.starts_with('>'), fortran, shape, unit_ns })
    }
}

fn element(descr: &str) -> Option<(Element, Option<i64>)> {
    let kind = descr.trim_start_matches(['<', '>', '|', '=']);
    let dates = [("M8[ns]", 1), ("M8[us]", 1_000), ("M8[ms]", 1_000_000), ("M8[s]", 1_000_000_000)];
    if let Some((_, unit_ns)) = dates.iter().find(|(name, _)| *name == kind) {
        return Some((Element::I64, Some(*unit_ns)));
    }
    let element = match kind {
        "i1" => Element::I8,
        "u1" => Element::U8,
        "i2" => Element::I16,
        "u2" => Element::U16,
        "i4" => Element::I32,
        "u4" => Element::U32,
        "i8" => Element::I64,
        "u8" => Element::U64,
        "f4" => Element::F32,
        "f8" => Element::F64,
        _ => return None,
    };
    Some((element, None))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As numpy.save writes them.
    #[test]
    fn headers_are_read_and_odd_ones_refused() {
        let read = |text: &str| Header::parse(text);
        let header =
            read("{'descr': '<i2', 'fortran_order': False, 'shape': (3, 4), }  \n").unwrap();
        assert_eq!((header.element, header.shape.as_slice()), (Element::I16, &[3, 4][..]));
        assert!(!header.big_endian && !header.fortran);
        let header = read("{'descr': '>f8', 'fortran_order': True, 'shape': (5,), }").unwrap();
        assert!(header.big_endian && header.fortran && header.shape == [5]);
        let dates = read("{'descr': '<M8[us]', 'fortran_order': False, 'shape': (), }").unwrap();
        assert_eq!((dates.unit_ns, dates.shape.len()), (Some(1000), 0));
        for (text, says) in [
            ("", "not read"),
            ("{'descr': [('a', '<i2')], 'fortran_order': False, 'shape': (3,)}", "not read"),
            ("{'descr': '<c8', 'fortran_order': False, 'shape': (3,)}", "c8"),
            ("{'descr': '<i2', 'fortran_order': False, 'shape': (-3,)}", "not read"),
            ("{'descr': '<i2', 'shape': (99999999999999999999,)}", "not read"),
        ] {
            let e = read(text).unwrap_err();
            assert!(e.contains(says), "{text}: {e}");
        }
    }
}
