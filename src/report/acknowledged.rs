//! What people have acknowledged: damage that is known, channels and printheads that were replaced, faults that are
//! known. It is kept in `acknowledged.csv` beside the results (`schemas/acknowledged.md`), a line each.
//!
//! In: the cells of each line, from `cli/acknowledge.rs`. Out: answers to whoever tells what is new
//! ([`Acknowledged::knows_recording`], [`Acknowledged::knows`]), and to whoever follows channels
//! ([`Acknowledged::replaced_ns`]). A line that cannot be understood is told, and changes nothing else.

use super::story::Story;
use chrono::{DateTime, NaiveDate, NaiveDateTime};
use inkling_core::state::Replaced;

/// The columns of the table, in its order.
pub const COLUMNS: [&str; 7] =
    ["what", "recording", "printhead", "channel", "from", "until", "note"];

/// What is acknowledged in a directory of results.
#[derive(Clone, Debug, Default)]
pub struct Acknowledged {
    damage: Vec<KnownRecording>,
    known: Vec<KnownFault>,
    /// By ascending time.
    pub replaced: Vec<Replaced>,
    /// What is wrong with lines that cannot be understood, a sentence each.
    pub mistakes: Vec<String>,
    /// When the lines were read, ns since 1970; `None`: unknown.
    pub read_at_ns: Option<i64>,
}

/// A recording whose damage is known, whatever it is.
#[derive(Clone, Debug)]
struct KnownRecording {
    /// Its path or the end of it, without `.mcap`.
    path: Vec<String>,
    note: String,
}

/// Faults of a channel that began from `from_ns` until before `until_ns`.
#[derive(Clone, Debug)]
struct KnownFault {
    printhead: String,
    channel: u32,
    from_ns: i64,
    until_ns: i64,
    note: String,
}

impl Acknowledged {
    /// Nothing, as read at a time (ns since 1970).
    pub fn read_at(read_at_ns: Option<i64>) -> Acknowledged {
        Acknowledged { read_at_ns, ..Acknowledged::default() }
    }

    /// Takes a line with the cells of [`COLUMNS`]; the error says what is wrong with it and what to do.
    pub fn add(&mut self, cells: [&str; 7]) -> Result<(), String> {
        let [what, recording, printhead, channel, from, until, note] = cells;
        let note = note.to_owned();
        let (from_ns, until_ns) = (time("from", from)?, time("until", until)?);
        let needs = |column: &str, cell: &str| match cell.is_empty() {
            true => Err(format!("{what} needs a {column}: write it into that column")),
            false => Ok(()),
        };
        let number = || {
            let number = channel.parse::<u32>();
            number.map_err(|_| format!("channel \"{channel}\": write its number"))
        };
        match what {
            "damage" => {
                let path = parts(recording);
                needs("recording", path.last().map_or("", |name| name))?;
                self.damage.push(KnownRecording { path, note });
            }
            "replaced" => {
                needs("printhead", printhead)?;
                needs("from", from)?;
                let channel = (!channel.is_empty()).then(number).transpose()?;
                let from_ns = from_ns.unwrap_or_default();
                self.replaced.push(Replaced { printhead: printhead.into(), channel, from_ns });
                self.replaced.sort_by_key(|of| of.from_ns);
            }
            "known" => {
                needs("printhead", printhead)?;
                let (printhead, channel) = (printhead.to_owned(), number()?);
                let (from_ns, until_ns) =
                    (from_ns.unwrap_or(i64::MIN), until_ns.unwrap_or(i64::MAX));
                if until_ns < from_ns {
                    return Err(format!("until {until} is before from {from}: turn them round"));
                }
                self.known.push(KnownFault { printhead, channel, from_ns, until_ns, note });
            }
            _ => return Err(format!("what \"{what}\": write damage, replaced or known")),
        }
        Ok(())
    }

    /// Adds what is acknowledged in another directory.
    pub fn absorb(&mut self, mut other: Acknowledged) {
        self.damage.append(&mut other.damage);
        self.known.append(&mut other.known);
        self.replaced.append(&mut other.replaced);
        self.replaced.sort_by_key(|of| of.from_ns);
        self.mistakes.append(&mut other.mistakes);
        self.read_at_ns = self.read_at_ns.max(other.read_at_ns);
    }

    /// The note on a recording whose damage is known. `path`: as much of its path as the caller knows; one of the two
    /// paths has to end with the other.
    pub fn knows_recording(&self, path: &str) -> Option<&str> {
        let path = parts(path);
        let is_it = |of: &&KnownRecording| path.ends_with(&of.path) || of.path.ends_with(&path);
        let mut of_it = self.damage.iter().filter(|_| !path.is_empty());
        of_it.find(is_it).map(|of| of.note.as_str())
    }

    /// Whether a printhead was replaced after it was heard last.
    pub fn is_gone(&self, printhead: &str, last_ns: i64) -> bool {
        let is_it = |of: &Replaced| of.printhead == printhead && of.channel.is_none();
        self.replaced.iter().any(|of| is_it(of) && of.from_ns > last_ns)
    }

    /// The note on a fault that is known.
    pub fn knows(&self, story: &Story) -> Option<&str> {
        let is_it = |of: &&KnownFault| {
            (of.printhead.as_str(), of.channel) == (&*story.printhead, story.channel)
                && of.from_ns <= story.began_at_ns
                // one that was cured and is back later is news
                && story.last_began_at_ns.max(story.began_at_ns) < of.until_ns
        };
        self.known.iter().find(is_it).map(|of| of.note.as_str())
    }

    /// When a channel was replaced, or its whole printhead; ascending. A replacement that is still to come, because
    /// its year is mistyped, say, changes nothing yet. `heard_ns`: when the printhead was heard last.
    pub fn replaced_ns(&self, printhead: &str, channel: u32, heard_ns: i64) -> Vec<i64> {
        let has_happened =
            |of: &Replaced| self.read_at_ns.is_none_or(|now| of.from_ns <= now.max(heard_ns));
        let is_it = |of: &&Replaced| {
            of.printhead == printhead
                && of.channel.is_none_or(|number| number == channel)
                && has_happened(of)
        };
        self.replaced.iter().filter(is_it).map(|of| of.from_ns).collect()
    }
}

/// The parts of a recording's path; its name without the ending, which a report's names do not have.
fn parts(path: &str) -> Vec<String> {
    let path = path.strip_suffix(".mcap").unwrap_or(path).replace('\\', "/");
    path.split('/').filter(|part| !part.is_empty() && *part != ".").map(str::to_owned).collect()
}

/// A time as people write it, ns since 1970: RFC 3339; a day, or a day and a time as reports write them, in UTC; or
/// nanoseconds. `None`: the cell is empty.
pub fn time(column: &str, text: &str) -> Result<Option<i64>, String> {
    if text.is_empty() {
        return Ok(None);
    }
    let rfc_3339 = || DateTime::parse_from_rfc3339(text).ok()?.timestamp_nanos_opt();
    let clock = || {
        let formats = ["%Y-%m-%d %H:%M:%S", "%Y-%m-%d %H:%M"].into_iter();
        let day = || NaiveDate::parse_from_str(text, "%Y-%m-%d").ok()?.and_hms_opt(0, 0, 0);
        let mut times =
            formats.filter_map(|format| NaiveDateTime::parse_from_str(text, format).ok());
        times.next().or_else(day)?.and_utc().timestamp_nanos_opt()
    };
    let ns = text.parse().ok().or_else(rfc_3339).or_else(clock);
    let write = "write 2026-01-31, 2026-01-31 12:00 (UTC) or 2026-01-31T12:00:00Z";
    ns.map(Some).ok_or_else(|| format!("{column} \"{text}\": {write}"))
}

/// How a note is told behind what it is about.
pub fn in_words(note: &str) -> String {
    if note.is_empty() { "acknowledged".into() } else { format!("acknowledged ({note})") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(lines: &[[&str; 7]]) -> Acknowledged {
        let mut acknowledged = Acknowledged::default();
        lines.iter().for_each(|line| acknowledged.add(*line).unwrap());
        acknowledged
    }

    #[test]
    fn a_recording_is_known_by_its_path_or_the_end_of_it() {
        let damage = |name| of(&[["damage", name, "", "", "", "", "cut by hand"]]);
        for (written, met, is_known) in [
            ("n12.mcap", "/srv/logs/7/n12.mcap", true),
            ("7/n12.mcap", "/srv/logs/7/n12.mcap", true),
            ("8/n12.mcap", "/srv/logs/7/n12.mcap", false),
            ("2.mcap", "/srv/logs/7/n12.mcap", false),
            ("n12", "7/n12", true),
            ("/srv/logs/7/n12.mcap", "7/n12", true),
        ] {
            let known = damage(written).knows_recording(met).is_some();
            assert_eq!(known, is_known, "{written} is {met}");
        }
    }

    #[test]
    fn a_replacement_that_is_still_to_come_changes_nothing_yet() {
        let of = of(&[["replaced", "", "p", "3", "2031-01-01", "", ""]]);
        let at_ns = time("from", "2031-01-01").unwrap().unwrap();
        let read = |read_at_ns| Acknowledged { read_at_ns, ..of.clone() };
        assert_eq!(read(None).replaced_ns("p", 3, 0), [at_ns]);
        assert_eq!(read(Some(at_ns - 1)).replaced_ns("p", 3, 0), [0; 0]);
        assert_eq!(read(Some(at_ns - 1)).replaced_ns("p", 3, at_ns), [at_ns], "clocks differ");
        assert_eq!(read(Some(at_ns)).replaced_ns("p", 3, 0), [at_ns]);
    }

    #[test]
    fn times_are_as_people_write_them() {
        let times = ["2026-01-31", "2026-01-31 00:00", "2026-01-31T01:00:00+01:00"];
        let ns = times.map(|text| time("from", text).unwrap().unwrap());
        assert_eq!(ns, [1_769_817_600_000_000_000; 3]);
    }
}
