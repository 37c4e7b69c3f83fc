//! Reads NumPy files (`.npy`, and `.npz`, a zip of several `.npy`) as bursts, for `inkling
//! convert`.
//!
//! In: a file, and which arrays are what. The array of samples has the shape samples, channels ×
//! samples, or bursts × channels × samples, of any number type. Out: a [`Table`] whose bursts are
//! read one by one when they are asked for, so that memory holds one burst. No size is trusted
//! before as many bytes have been read.
//!
//! Steps: find the array (by name in a `.npz`); parse its header (type, order, shape); read the
//! arrays with one number for each burst (times, covariates) whole; then read the samples burst by
//! burst.

use super::dialect::value::{Array, Element, Value};
use super::file_error::FileError;
use super::matrix::Matrix;
use super::table_file::{Columns, Content, Table, unread};
use super::{Limits, regular_file};
use inkling_core::burst::Layout;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;
use zip::ZipArchive;

const MOST_HEADER_BYTES: u64 = 1 << 20;
/// Most numbers of an array that has one number for each burst.
const MOST_TIMES: usize = 1 << 22;
/// A `.npy` begins with these bytes, then two of the version.
const MAGIC: &[u8] = b"\x93NUMPY";

#[derive(Clone, Debug, PartialEq, Eq)]
struct Header {
    element: Element,
    big_endian: bool,
    /// Whether the numbers lie in column order: from one number to the next the index of the first
    /// axis changes, not that of the last.
    fortran: bool,
    shape: Vec<usize>,
    /// For an array of dates (`datetime64`): the unit of its times, as the ending (such as `_ns`)
    /// that stands for it in the name of a column; `None` for plain numbers.
    unit: Option<&'static str>,
}

struct Bursts {
    /// The file, at the first number of the burst that is read next.
    input: Box<dyn Read>,
    header: Header,
    number: usize,
    channels: usize,
    samples: usize,
}

/// Opens the array of samples, and reads the arrays of a `.npz` that stand beside it:
/// `columns.time` and `columns.beside`, with one number for each burst.
pub fn read(path: &Path, columns: &Columns) -> Result<Table, FileError> {
    let choice = |what: String| FileError::mistaken(path, what);
    let name = columns.outputs.as_ref().and_then(|names| names.first());
    let others: Vec<&String> = columns.beside.iter().chain(&columns.time).collect();
    // a .npy has one array without a name; in a .npz the samples must be named, or be the only array left
    let name = match (is_zip(path)?, name) {
        (false, Some(_)) => {
            return Err(choice("one array: --outputs names arrays of a .npz".into()));
        }
        (true, None) => Some(only_one(path, &others)?),
        (_, name) => name.cloned(),
    };
    let (header, input) = array(path, name.as_deref())?;
    let mut array = Bursts::of(header, input).map_err(|what| FileError::failed(path, what))?;
    let bursts = array.number;

    // an array beside the samples must have as many numbers as there are bursts
    let numbers = |name: &str, one_for_all: bool| {
        let (all, unit) = numbers(path, name)?;
        match all.len() {
            n if n == bursts || (n == 1 && one_for_all) => Ok((all, unit)),
            n => Err(choice(format!("array {name:?} has {n} numbers for {bursts} bursts"))),
        }
    };

    let beside = columns.beside.iter().map(|name| Ok(numbers(name, true)?.0));
    let beside = beside.collect::<Result<Vec<Vec<f64>>, FileError>>()?;

    let times = columns.time.as_ref().map(|name| {
        let (times, unit) = numbers(name, false)?;
        Ok((format!("{name}{}", unit.unwrap_or_default()), times))
    });
    let (time, times) = times.transpose()?.unzip();

    let first_time = times.as_ref().and_then(|times: &Vec<f64>| times.first().copied());
    let path = path.to_path_buf();
    let bursts = (0..bursts).map(move |i| {
        let matrix = array.burst(i).map_err(|what| FileError::failed(&path, what))?;
        // a single number stands for all bursts
        let beside = beside.iter().map(|column| *column.get(i).unwrap_or(&column[0])).collect();
        Ok(Matrix { time: times.as_ref().map(|times| times[i]), beside, ..matrix })
    });
    let (outputs, content) = (Vec::new(), Content::Bursts(Box::new(bursts)));
    Ok(Table { time, first_time, outputs, content })
}

/// Opens an array and reads its header; the reader that is returned stands at the array's first
/// number. `name`: the name of the array in a `.npz`; `None`: the file is a `.npy`.
fn array(path: &Path, name: Option<&str>) -> Result<(Header, Box<dyn Read>), FileError> {
    let mut input: Box<dyn Read> = match name {
        Some(name) => member(path, name)?,
        None => Box::new(BufReader::with_capacity(
            1 << 16,
            regular_file::open(path).map_err(unread(path))?,
        )),
    };
    let header = Header::read(&mut input).map_err(|what| FileError::failed(path, what))?;
    Ok((header, input))
}

/// The array of samples where the user does not name it: the only one that is not in `beside`.
fn only_one(path: &Path, beside: &[&String]) -> Result<String, FileError> {
    let names = names(path)?;
    let there = super::printable::line(&names.join(", "), 400);
    if let Some(wrong) = beside.iter().find(|name| !names.contains(name)) {
        let what = format!("no array is called {wrong:?}; there are {there}");
        return Err(FileError::mistaken(path, what));
    }
    let mut others = names.iter().filter(|name| !beside.contains(name));
    if let (Some(only), None) = (others.next(), others.next()) {
        return Ok(only.clone());
    }
    let what = format!("which array holds the samples? --outputs names it; there are {there}");
    Err(FileError::failed(path, what))
}

impl Bursts {
    /// Takes the axes of an array as bursts, channels and samples. An error says why it cannot be bursts.
    fn of(header: Header, input: Box<dyn Read>) -> Result<Bursts, String> {
        let (number, channels, samples) = match *header.shape.as_slice() {
            [samples] => (1, 1, samples),
            [channels, samples] => (1, channels, samples),
            [bursts, channels, samples] => (bursts, channels, samples),
            _ => {
                return Err(format!(
                    "an array of {} axes; samples, channels x samples or bursts x channels x samples \
                     become bursts",
                    header.shape.len()
                ));
            }
        };
        let limits = Limits::default();
        if header.unit.is_some() {
            return Err("an array of dates, not of samples".into());
        }
        if number == 0 || channels == 0 || samples == 0 {
            return Err("an array without a number".into());
        }
        if channels > limits.channels as usize || samples > limits.samples_per_channel as usize {
            return Err(format!(
                "{channels} channels of {samples} samples: a burst has at most {} of {}; are the axes \
                 bursts x channels x samples?",
                limits.channels, limits.samples_per_channel
            ));
        }
        if header.fortran && number > 1 {
            let what = "in column order, which scatters every burst over the file: save it with \
                        numpy.ascontiguousarray";
            return Err(what.into());
        }
        Ok(Bursts { input, header, number, channels, samples })
    }

    /// Reads the next burst. `i`: its number from 0, which is how many bursts were read before.
    fn burst(&mut self, i: usize) -> Result<Matrix, String> {
        let Header { element, big_endian, fortran, .. } = self.header;
        let most_bytes = Limits::default().samples_bytes;
        // The size comes from the header, so it is bounded before anything is read. Numbers of 8 bytes become
        // samples of 4 at most, so twice the bytes of a burst's samples may be read.
        let bytes = self.channels as u64 * self.samples as u64 * element.bytes() as u64;
        let most = most_bytes * 2;
        if bytes > most {
            return Err(format!("a burst of {bytes} bytes; at most {most} are read"));
        }

        let mut raw = Vec::new();
        self.input.by_ref().take(bytes).read_to_end(&mut raw).map_err(|e| e.to_string())?;
        let left = self.number - i;
        if raw.len() as u64 != bytes {
            return Err(format!(
                "ends within its array: {left} bursts that its header says are missing"
            ));
        }
        // nothing may follow the last burst, or the shape in the header is wrong
        if left == 1 && self.input.read(&mut [0]).map_err(|e| e.to_string())? > 0 {
            return Err("goes on behind its array".into());
        }

        let value = Value::Array(Array { element, big_endian, bytes: raw.into() });
        let samples = value.samples(None, most_bytes);
        let samples = samples.filter(|s| !s.too_many).ok_or("a burst too large")?;
        Ok(Matrix {
            channels: self.channels as u32,
            samples_per_channel: self.samples as u32,
            format: samples.format,
            // in column order the first axis changes fastest: in a single burst that of channels
            layout: if fortran { Layout::SampleMajor } else { Layout::ChannelMajor },
            samples: samples.bytes,
            ..Matrix::default()
        })
    }
}

/// The array has one axis or none; the unit ([`Header::unit`]) is given if it has dates.
fn numbers(path: &Path, name: &str) -> Result<(Vec<f64>, Option<&'static str>), FileError> {
    let choice = |what: String| FileError::mistaken(path, what);
    if !is_zip(path)? {
        return Err(choice(format!("one array, without one named {name:?} beside it")));
    }
    let (header, input) = array(path, Some(name))?;
    let n = header.shape.iter().try_fold(1usize, |n, of| n.checked_mul(*of));
    let n = n.filter(|n| *n <= MOST_TIMES && header.shape.len() <= 1);
    let n = n.ok_or_else(|| choice(format!("{name:?} is no row of numbers, one a burst")))?;
    let mut raw = Vec::new();
    let bytes = n as u64 * header.element.bytes() as u64;
    input.take(bytes).read_to_end(&mut raw).map_err(unread(path))?;
    let all: Vec<f64> = header.element.numbers(&raw, header.big_endian).collect();
    match all.len() == n {
        true => Ok((all, header.unit)),
        false => Err(FileError::failed(path, format!("{name:?} ends before its numbers do"))),
    }
}

fn is_zip(path: &Path) -> Result<bool, FileError> {
    let start = regular_file::start(path, 4).map_err(unread(path))?;
    Ok(start.starts_with(b"PK"))
}

fn archive(path: &Path) -> Result<ZipArchive<BufReader<File>>, FileError> {
    let file = regular_file::open(path).map_err(unread(path))?;
    ZipArchive::new(BufReader::with_capacity(1 << 16, file))
        .map_err(|e| FileError::failed(path, format!("no .npz: {e}")))
}

/// Names of the arrays in a `.npz`, sorted, without the ending `.npy`.
fn names(path: &Path) -> Result<Vec<String>, FileError> {
    let archive = archive(path)?;
    let names = archive.file_names().filter_map(Result::ok);
    let mut names: Vec<String> =
        names.filter_map(|name| name.strip_suffix(".npy").map(str::to_owned)).collect();
    names.sort_unstable();
    Ok(names)
}

/// Opens an array of a `.npz` at the first byte of its header. The array is decompressed as it is
/// read, so the size that the `.npz` claims for it is not used.
fn member(path: &Path, name: &str) -> Result<Box<dyn Read>, FileError> {
    let failed = |what: String| FileError::failed(path, what);
    let mut archive = archive(path)?;
    let Some(place) = archive.index_for_name(&format!("{name}.npy")) else {
        let there = super::printable::line(&names(path)?.join(", "), 400);
        let what = format!("no array {name:?}; there are {there}");
        return Err(FileError::mistaken(path, what));
    };
    let e = |e: zip::result::ZipError| failed(format!("{name}: {e}"));
    // the zip crate's own reader borrows the archive, so the member is read from the file itself
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
    // the compressed bytes of the member, and the decompressor in front of them
    let mut file = archive.into_inner();
    file.seek(SeekFrom::Start(at)).map_err(unread(path))?;
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

    /// Parses the text of a header, such as `{'descr': '<i2', 'fortran_order': False, 'shape': (3, 4), }`. It
    /// is a literal of Python; only the three keys are looked for.
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
        let (element, unit) = element(descr).ok_or_else(|| {
            format!("numbers of type {descr:?}; i1 to i8, u1 to u8, f4, f8 are read")
        })?;
        let shape = after("shape").and_then(|t| t.strip_prefix('(')?.split_once(')'));
        let (shape, _) = shape.ok_or_else(odd)?;
        let axes = shape.split(',').map(str::trim).filter(|axis| !axis.is_empty());
        let shape = axes.map(str::parse).collect::<Result<Vec<usize>, _>>().map_err(|_| odd())?;
        let fortran = after("fortran_order").ok_or_else(odd)?.starts_with("True");
        Ok(Header { element, big_endian: descr.starts_with('>'), fortran, shape, unit })
    }
}

/// The type of numbers that NumPy calls `descr`, and the unit ([`Header::unit`]) if they are dates,
/// which are whole numbers of 64 bits.
fn element(descr: &str) -> Option<(Element, Option<&'static str>)> {
    let kind = descr.trim_start_matches(['<', '>', '|', '=']);
    let dates = [("M8[ns]", "_ns"), ("M8[us]", "_us"), ("M8[ms]", "_ms"), ("M8[s]", "_s")];
    if let Some((_, unit)) = dates.iter().find(|(name, _)| *name == kind) {
        return Some((Element::I64, Some(*unit)));
    }
    Element::NAMED.iter().find(|(_, name, _)| *name == kind).map(|(element, ..)| (*element, None))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{assert_refused, place};
    use std::io::Write;

    /// The header claims 2^61 bursts, and the file holds one number.
    #[test]
    fn one_number_for_all_bursts_is_not_held_once_for_each() {
        let (_dir, path) = place("x.npz");
        let mut zip = zip::ZipWriter::new(File::create(&path).unwrap());
        for (name, shape, number) in [("y", "(2305843009213693952, 1, 1)", 7), ("temp", "()", 20)] {
            let text = format!("{{'descr': '<i2', 'fortran_order': False, 'shape': {shape}}}");
            let length = (text.len() as u16).to_le_bytes();
            let bytes = [MAGIC, &[1, 0], &length, text.as_bytes(), &[number, 0]].concat();
            zip.start_file(format!("{name}.npy"), zip::write::SimpleFileOptions::default())
                .unwrap();
            zip.write_all(&bytes).unwrap();
        }
        zip.finish().unwrap();
        let (outputs, beside) = (Some(vec!["y".into()]), vec!["temp".into()]);
        let table = read(&path, &Columns { outputs, beside, ..Columns::default() }).unwrap();
        let Content::Bursts(mut bursts) = table.content else { panic!("an array holds bursts") };
        assert_eq!(bursts.next().unwrap().unwrap().beside, [20.0]);
        assert_refused(bursts.next().unwrap(), &["ends within its array"]);
    }

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
        assert_eq!((dates.unit, dates.shape.len()), (Some("_us"), 0));
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
