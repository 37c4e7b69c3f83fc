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
use super::time_column::{TimeUnit, has_word_for_time, is_time, numbers_rows};
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
/// Most lines of text between names and numbers: units, and what was done to measure.
const MOST_TEXTS: usize = 2;
/// Lines at the begin that are looked at for numbers to the right of text.
const LINES_BESIDE: usize = 20;

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

    /// Where a table begins below the first record, or what stands in the way of its begin, in a sentence of what to do;
    /// `None`: nothing there looks like one.
    pub fn begins_below(&self) -> Option<String> {
        let head = String::from_utf8_lossy(&self.head);
        let lines: Vec<&str> = head.lines().collect();
        let first = (self.first_line as usize).saturating_sub(1);
        let found = [';', '\t', ','].into_iter().find_map(|d| begin(&lines, d, first));
        let Some((at, texts)) = found else {
            return columns_beside(lines.get(first..)?, char::from(self.delimiter));
        };
        let below = match texts[..] {
            [from, .., to] => {
                format!("remove lines {} to {}, which hold no numbers", from + 1, to + 1)
            }
            _ => String::new(),
        };
        let names = printable::cell(&lines[at].replace('\t', " "));
        let begins = format!(
            "a table begins at line {} ({names}): --skip-lines {at} passes over what stands before it",
            at + 1
        );
        match (at > first, below.is_empty()) {
            (true, true) => Some(begins),
            (true, false) => Some(format!("{begins}; {below}")),
            (false, is_whole) => (!is_whole).then_some(below),
        }
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

/// What to do where lines of another kind stand to the left of the numbers, as some oscilloscopes write them; `None`:
/// they do not.
fn columns_beside(lines: &[&str], delimiter: char) -> Option<String> {
    let are_numbers = |line: &&str| -> Vec<bool> {
        line.split(delimiter).map(|cell| cell.trim().parse::<f64>().is_ok()).collect()
    };
    // a number, a date, a time or nothing stands in the first column of other tables
    let is_other = |c: char| c.is_ascii_digit() || "+-.".contains(c) || c == delimiter;
    let is_text = !lines.get(1)?.starts_with(is_other);
    let lines: Vec<Vec<bool>> = lines.iter().take(LINES_BESIDE).map(are_numbers).collect();
    let in_all = |c: &usize| lines.iter().all(|line| line.get(*c) == Some(&true));
    let columns: Vec<String> =
        (0..lines[0].len()).filter(in_all).map(|c| (c + 1).to_string()).collect();
    (is_text && columns.len() > 1).then(|| {
        format!(
            "text stands to the left of the numbers: cut them out (cut -d '{delimiter}' -f {}), and write a line of names \
             above them",
            columns.join(",")
        )
    })
}

/// The index of the line of names with which a table begins, and those of the lines between it and rows of numbers: one
/// of units, and another one. `first`: the index of the first line that is read.
fn begin(lines: &[&str], delimiter: char, first: usize) -> Option<(usize, Vec<usize>)> {
    let cells = |line: &str| -> Vec<String> {
        let cell =
            |cell: &str| cell.trim().trim_matches('"').replace(',', ".").replace('\u{2212}', "-");
        line.split(delimiter).map(cell).filter(|cell| !cell.is_empty()).collect()
    };
    // a number, or a time of day, perhaps behind a date
    let is_number = |cell: &String| {
        let is_time = || cell.starts_with(|c: char| c.is_ascii_digit()) && cell.contains(':');
        cell.parse::<f64>().is_ok() || is_time()
    };
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
    // one line of units, if it has one of time, or says that rows are numbered, or more below a name of times; what
    // begins with a digit is a value, as in a line of when something was measured
    let are_units = |names: usize, texts: &[usize]| {
        let [named, below] =
            [Some(&names), texts.first()].map(|at| at.map_or(Vec::new(), |at| cells(lines[*at])));
        let has_value = named.iter().any(|cell| cell.starts_with(|c: char| c.is_ascii_digit()));
        let is_of_time = || named.first().is_some_and(|name| is_time(name)) && !has_value;
        let unit = below.first().map_or("", |cell| &**cell);
        let is_unit = || {
            let is_of_time = matches!(TimeUnit::in_text(unit), Ok(Some(_)));
            is_of_time && !has_word_for_time(unit) || numbers_rows(unit)
        };
        match texts.len() {
            0 => true,
            1 => is_unit() || is_of_time(),
            n => n <= MOST_TEXTS && is_of_time(),
        }
    };
    let is_table = |names: usize, rows: &[usize]| {
        let columns = cells(lines[names]).len();
        // the first rows may lack a number, such as where an instrument was over its range
        let lacking = rows.iter().take_while(|at| begins_with_number(at) && !is_row(at)).count();
        let rows = rows[lacking..].get(..ROWS_OF_BEGIN).unwrap_or_default();
        !rows.is_empty() && rows.iter().all(|at| is_row(at) && cells(lines[*at]).len() <= columns)
    };
    there.iter().enumerate().find_map(|(n, &names)| {
        let below = &there[n + 1..];
        let texts = below.iter().take(MOST_TEXTS + 1).take_while(|at| !begins_with_number(at));
        let (texts, rows) = below.split_at(texts.count());
        (may_name(names) && are_units(names, texts) && is_table(names, rows))
            .then(|| (names, texts.to_vec()))
    })
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
    fn lines_of_text_below_names_or_to_the_left_of_numbers_are_told() {
        let rows = "1/11/2026 08:00:00.5,0,1\n".repeat(3);
        let units = "TIMESTAMP,N,V\nTS,RN,mV\n,,Smp\n";
        let beside: String = (1..26)
            .map(|k| format!("{},{},{k}e-6,{k},\n", ["Points", ""][k / 9 % 2], [500, 0][k / 5 % 2]))
            .collect();
        for (text, says) in [
            (
                format!("TOA5,CR1000,CR1000\n{units}{rows}"),
                "line 2 (TIMESTAMP,N,V): --skip-lines 1",
            ),
            (
                format!("TOA5,CR1000,CR1000\n{units}{rows}"),
                "it; remove lines 3 to 4, which hold no",
            ),
            (format!("{units}{rows}"), "remove lines 2 to 3, which"),
            (format!("Time,08:00:00.5,\nX,V,W\n{rows}"), "line 2 (X,V,W)"),
            (beside.replace(",0,", ",,"), "(cut -d ',' -f 3,4), and write a line of names"),
        ] {
            let options = TextOptions { most_bytes: 2000, ..TextOptions::default() };
            let mut told = TextTable::open(Cursor::new(text.into_bytes()), options).unwrap();
            assert!(told.next_record().is_ok());
            let told = told.begins_below().unwrap_or_default();
            assert!(told.contains(says), "{says}: {told}");
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
