//! Reads the records of a table that other programs wrote as text, with the numbers of their lines: tables of
//! signals (`csv_table.rs`) and labels (`labels_file.rs`).
//!
//! In: a file, or a text. Out: [`TextTable::next_record`], record by record. Cells are separated by comma, semicolon
//! or tab, or by what a first line `sep=;` says, which spreadsheets write. UTF-16 is read where its byte order
//! mark says so. Lines may end in LF, CR LF or CR; they count from 1, as editors count them.
//!
//! No record may be longer than `MOST_RECORD_BYTES`; a quote that is never closed would make one record of
//! the whole file.

use super::printable;
use super::regular_file::too_large;
use super::time_column::{TimeUnit, numbers_rows};
use csv::{ByteRecord, StringRecord};
use std::io::{self, BufRead, BufReader, Cursor, Read};

/// Most bytes of one record, with the comment lines before it.
const MOST_RECORD_BYTES: u64 = 4 << 20;
/// Most bytes of a text in UTF-16, which is held in memory as a whole.
const MOST_UTF16_BYTES: u64 = 64 << 20;
/// Bytes in which the begin of a table is looked for.
const HEAD_BYTES: u64 = 64 << 10;
/// So many rows of numbers below a line of names are the begin of a table.
const ROWS_OF_BEGIN: usize = 3;

/// How a text is read.
#[derive(Clone, Copy, Debug, Default)]
pub struct TextOptions {
    /// Lines that are passed over at the begin.
    pub skip_lines: u64,
    /// Whether lines that begin with `#` are comments.
    pub comments: bool,
    /// The most bytes that all records may have.
    pub most_bytes: u64,
}

pub struct TextTable {
    csv: csv::Reader<Bounded>,
    /// Lines before the first record that is looked for.
    passed: u64,
    pub delimiter: u8,
    /// The begin of the text.
    head: Vec<u8>,
    /// The line of the first record; 0 before it was read.
    first_line: u64,
}

/// Why a record cannot be read.
pub enum TextError {
    Io(io::Error),
    /// The line is not UTF-8 text.
    NoText {
        line: u64,
    },
}

impl TextTable {
    pub fn open(input: impl Read + 'static, options: TextOptions) -> io::Result<TextTable> {
        let TextOptions { skip_lines, comments, most_bytes } = options;
        let mut input = utf8(Box::new(input))?;
        let mut head = Vec::new();
        input.by_ref().take(HEAD_BYTES).read_to_end(&mut head)?;
        let all = Lines { input: Cursor::new(head.clone()).chain(input), last: b'\n' };
        let mut all = BufReader::with_capacity(1 << 16, all);
        let mut passed = 0;
        while passed < skip_lines && pass_line(&mut all)? > 0 {
            passed += 1;
        }
        let start = all.fill_buf()?;
        let says = start.split(|b| *b == b'\n').next().and_then(separator);
        let delimiter = says.unwrap_or_else(|| delimiter(start));
        if says.is_some() {
            pass_line(&mut all)?;
            passed += 1;
        }
        let csv = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .flexible(true)
            .has_headers(false)
            .delimiter(delimiter)
            .comment(comments.then_some(b'#'))
            .from_reader(Bounded { input: Box::new(all), of_record: 0, of_all: 0, most_bytes });
        Ok(TextTable { csv, passed, delimiter, head, first_line: 0 })
    }

    /// The next record, and its line, or the last of its lines; `None` at the end.
    pub fn next_record(&mut self) -> Result<Option<(u64, StringRecord)>, TextError> {
        match self.next_bytes()? {
            Some((line, record)) => {
                let text = StringRecord::from_byte_record(record);
                text.map(|text| Some((line, text))).map_err(|_| TextError::NoText { line })
            }
            None => Ok(None),
        }
    }

    /// The same for a record of names and units. Instruments write a micro sign of Latin-1 there, whose bytes
    /// are the numbers of their characters.
    pub fn next_names(&mut self) -> Result<Option<(u64, StringRecord)>, TextError> {
        let latin = |cell: &[u8]| cell.iter().map(|byte| char::from(*byte)).collect::<String>();
        Ok(self.next_bytes()?.map(|(line, record)| {
            let text = StringRecord::from_byte_record(record);
            (line, text.unwrap_or_else(|e| e.into_byte_record().iter().map(latin).collect()))
        }))
    }

    fn next_bytes(&mut self) -> Result<Option<(u64, ByteRecord)>, TextError> {
        let mut record = ByteRecord::new();
        let is_there =
            self.csv.read_byte_record(&mut record).map_err(|e| TextError::Io(e.into()))?;
        self.csv.get_mut().of_record = 0;
        // every line ends in LF, which has been read
        let line = self.passed + self.csv.position().line() - 1;
        self.first_line = if self.first_line == 0 { line } else { self.first_line };
        Ok(is_there.then_some((line, record)))
    }

    /// Where a table begins below the first record, in a sentence of what to do; `None`: nothing there looks
    /// like one.
    pub fn begins_below(&self) -> Option<String> {
        let head = String::from_utf8_lossy(&self.head);
        let lines: Vec<&str> = head.lines().collect();
        let first = (self.first_line as usize).saturating_sub(1);
        let at = [';', '\t', ','].into_iter().find_map(|d| begin(&lines, d, first))?;
        let names = printable::cell(lines[at]);
        let (line, passed) = (at as u64 + 1, at);
        (line > self.first_line).then(|| {
            format!("a table begins at line {line} ({names}): --skip-lines {passed} passes over what stands before it")
        })
    }
}

/// A text as UTF-8, without its byte order mark.
fn utf8(mut input: Box<dyn Read>) -> io::Result<Box<dyn Read>> {
    let mut mark = Vec::new();
    input.by_ref().take(3).read_to_end(&mut mark)?;
    let whole: fn([u8; 2]) -> u16 = match mark[..] {
        [0xff, 0xfe, ..] => u16::from_le_bytes,
        [0xfe, 0xff, ..] => u16::from_be_bytes,
        [0xef, 0xbb, 0xbf] => return Ok(input),
        _ => return Ok(Box::new(Cursor::new(mark).chain(input))),
    };
    let mut bytes = mark[2..].to_vec();
    input.take(MOST_UTF16_BYTES).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MOST_UTF16_BYTES {
        return Err(too_large(format!(
            "more than {MOST_UTF16_BYTES} bytes of UTF-16: save it as UTF-8"
        )));
    }
    let units: Vec<u16> = bytes.as_chunks::<2>().0.iter().map(|two| whole(*two)).collect();
    Ok(Box::new(Cursor::new(String::from_utf16_lossy(&units).into_bytes())))
}

/// Passes over a line; gives its bytes, 0 at the end.
fn pass_line(input: &mut impl BufRead) -> io::Result<usize> {
    input.take(MOST_RECORD_BYTES).read_until(b'\n', &mut Vec::new())
}

/// The separator that a line `sep=;` says.
fn separator(line: &[u8]) -> Option<u8> {
    let [says @ .., separator] = line else { return None };
    says.eq_ignore_ascii_case(b"sep=").then_some(*separator)
}

/// The byte that separates cells, told from the first line that is neither empty nor a comment: the semicolon
/// if that line has one, else the tab if it has one, else the comma.
fn delimiter(start: &[u8]) -> u8 {
    let mut lines = start.split(|b| *b == b'\n').filter(|line| !line.trim_ascii().is_empty());
    let header = lines.find(|line| !line.starts_with(b"#")).unwrap_or_default();
    [b';', b'\t'].into_iter().find(|d| header.contains(d)).unwrap_or(b',')
}

/// The index of the line of names with which a table begins: rows of numbers follow it, perhaps after a line
/// of units. `first`: the index of the first line that is read.
fn begin(lines: &[&str], delimiter: char, first: usize) -> Option<usize> {
    let cells = |line: &str| -> Vec<String> {
        let cell =
            |cell: &str| cell.trim().trim_matches('"').replace(',', ".").replace('\u{2212}', "-");
        line.split(delimiter).map(cell).filter(|cell| !cell.is_empty()).collect()
    };
    let is_number = |cell: &String| cell.parse::<f64>().is_ok();
    let is_row = |at: &usize| {
        let cells = cells(lines[*at]);
        cells.len() > 1 && cells.iter().all(is_number)
    };
    let begins_with_number = |at: &usize| cells(lines[*at]).first().is_some_and(is_number);
    // only in the line that stands first, and behind a name, columns may be called 1 and 2, but not -1.5 or 1.400,00
    let may_name = |at: usize| {
        let is_number = |cell: &String| {
            let digits = cell.trim_matches(|c: char| c.is_ascii_digit() || ".+-eE".contains(c));
            digits.is_empty() && (at > first || cell.contains(['.', '+', '-']))
        };
        !begins_with_number(&at) && !cells(lines[at]).iter().any(is_number)
    };
    let filled = |at: &usize| !lines[*at].trim().is_empty() && !lines[*at].starts_with('#');
    let there: Vec<usize> = (0..lines.len()).filter(filled).collect();
    // a line of units has one of time, or says that rows are numbered
    let are_units = |at: usize| {
        let first = cells(lines[at]).into_iter().next().unwrap_or_default();
        matches!(TimeUnit::in_text(&first), Ok(Some(_))) || numbers_rows(&first)
    };
    let begins = |below: &[usize]| {
        let names = cells(lines[below[0]]).len();
        let is_table = |rows: &[usize]| {
            // the first rows may lack a number, such as where an instrument was over its range
            let lacking = rows.iter().take_while(|at| begins_with_number(at) && !is_row(at));
            let rows = &rows[lacking.count()..];
            let rows = rows.get(..ROWS_OF_BEGIN).unwrap_or_default();
            !rows.is_empty() && rows.iter().all(|at| is_row(at) && cells(lines[*at]).len() <= names)
        };
        let has_units = || below.len() > 1 && are_units(below[1]) && is_table(&below[2..]);
        may_name(below[0]) && (is_table(&below[1..]) || has_units())
    };
    (0..there.len()).find(|at| begins(&there[*at..])).map(|at| there[at])
}

/// Ends every line with LF, also the last one.
struct Lines<R> {
    input: R,
    /// The last byte that was read, or put behind all.
    last: u8,
}

impl<R: Read> Read for Lines<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        loop {
            let n = self.input.read(buffer)?;
            if n == 0 {
                let is_open = !b"\r\n".contains(&self.last);
                let Some(first) = buffer.first_mut().filter(|_| is_open) else { return Ok(0) };
                (*first, self.last) = (b'\n', b'\n');
                return Ok(1);
            }
            let mut kept = 0;
            for at in 0..n {
                let byte = buffer[at];
                // the LF of a CR LF was written for the CR
                if (self.last, byte) != (b'\r', b'\n') {
                    buffer[kept] = if byte == b'\r' { b'\n' } else { byte };
                    kept += 1;
                }
                self.last = byte;
            }
            if kept > 0 {
                return Ok(kept);
            }
        }
    }
}

/// Reads bytes, and fails where one record, or all of them, are longer than allowed.
struct Bounded {
    input: Box<dyn Read>,
    /// Bytes read since the last record ended, and bytes read so far.
    of_record: u64,
    of_all: u64,
    most_bytes: u64,
}

impl Read for Bounded {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let n = self.input.read(buffer)?;
        self.of_record += n as u64;
        self.of_all += n as u64;
        if self.of_record > MOST_RECORD_BYTES {
            let what = format!(
                "a record of more than {MOST_RECORD_BYTES} bytes: no table, or a quote that is \
                 never closed"
            );
            return Err(too_large(what));
        }
        if self.of_all > self.most_bytes {
            let what = format!("more than {} bytes: cut it into several", self.most_bytes);
            return Err(too_large(what));
        }
        Ok(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(text: &[u8], options: TextOptions) -> (u8, Vec<(u64, Vec<String>)>) {
        let options = TextOptions { most_bytes: 1000, ..options };
        let mut table = TextTable::open(Cursor::new(text.to_vec()), options).unwrap();
        let mut found = Vec::new();
        while let Ok(Some((line, record))) = table.next_record() {
            found.push((line, record.iter().map(str::to_owned).collect()));
        }
        (table.delimiter, found)
    }

    #[test]
    fn lines_count_as_editors_count_them_however_they_end() {
        for end in ["\n", "\r\n", "\r"] {
            for last in ["", end] {
                let text = ["a,b", "", "1,2", "\"x", "y\",3", "4,5"].join(end) + last;
                let (_, found) = all(text.as_bytes(), TextOptions::default());
                let lines: Vec<u64> = found.iter().map(|(line, _)| *line).collect();
                assert_eq!(lines, [1, 3, 5, 6], "{text:?}");
            }
        }
    }

    #[test]
    fn separators_marks_and_utf_16_are_read() {
        let utf16 =
            |text: &str| text.encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<u8>>();
        let big = |text: &str| text.encode_utf16().flat_map(u16::to_be_bytes).collect::<Vec<u8>>();
        for (text, delimiter, line) in [
            (b"a;b\n1;2\n".to_vec(), b';', 2),
            (b"sep=;\r\na;b\r\n1;2".to_vec(), b';', 3),
            (b"SEP=|\na|b\n1|2".to_vec(), b'|', 3),
            (b"\xef\xbb\xbfsep=\t\na\tb\n1\t2\n".to_vec(), b'\t', 3),
            (utf16("\u{feff}a\tb\r\n1\t2\r\n"), b'\t', 2),
            (big("\u{feff}a,b\n1,2"), b',', 2),
        ] {
            let (found, records) = all(&text, TextOptions::default());
            assert_eq!(found, delimiter, "{text:?}");
            assert_eq!(records[1], (line, vec!["1".to_owned(), "2".to_owned()]), "{text:?}");
        }
    }

    #[test]
    fn where_a_table_begins_below_other_lines_is_told() {
        let rows = "0,1,\n1,2,\n2,3,\n";
        for (head, line) in [
            ("Model,X1\nRate,1e6\n\nTime,A\n", 4),
            ("Source,A\nSecond,Volt\n", 1),
            ("Time,A\n0,1.400,5\n", 1),
            ("t_us,U1\n-2,CLIPPED\n-1,CLIPPED\n", 1),
            ("Model,X1\nt_us,U1\n-1,CLIPPED\n", 2),
            ("Model,X1\nRate,1000000\n", 1),
            ("#note\n;Rate,5,,\nSample,V,\ns,V,\n\n", 3),
        ] {
            let text = format!("{head}{rows}");
            let options =
                TextOptions { comments: true, most_bytes: 1000, ..TextOptions::default() };
            let mut told = TextTable::open(Cursor::new(text.into_bytes()), options).unwrap();
            assert!(told.next_record().is_ok());
            let told = told.begins_below().unwrap_or_default();
            let says = format!("at line {line} ");
            assert!(line == 1 && told.is_empty() || told.contains(&says), "{head}: {told}");
        }
    }

    #[test]
    fn a_record_without_an_end_ends() {
        let opens = |most_bytes| TextOptions { most_bytes, ..TextOptions::default() };
        for (byte, most_bytes, says) in
            [(b'x', u64::MAX, "a record of"), (b'\n', 1000, "cut it into several")]
        {
            let mut table = TextTable::open(io::repeat(byte), opens(most_bytes)).unwrap();
            let Err(TextError::Io(e)) = table.next_record() else { panic!("read") };
            assert!(e.to_string().contains(says), "{e}");
        }
    }
}
