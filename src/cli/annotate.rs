//! `replay --annotate`: what was found, as messages on the recording's own time line. In: the
//! tables of a recording's verdicts and episodes, as a replay wrote them. Out: the file
//! `<stem>.annotations.mcap` beside the verdicts, for viewers such as Foxglove.
//!
//! It holds a log line when an episode is raised and one when it ends; for channels with episodes
//! one message per judged signal; and for each printhead a map of its channels over time, as a
//! series of images. The batch calls [`annotate`] once per recording, after its tables have their
//! names.

use crate::report::{Names, RecordingCounts, Survey, waterfalls};
use inkling_core::episodes::Episode;
use inkling_core::verdict::{Outcome, VerdictColumns};
use inkling_io::annotation_writer::{self, AnnotationWriter, ChannelState, Level};
use inkling_io::damage::RecordingError;
use inkling_io::episode_table;
use inkling_io::verdict_reader::VerdictReader;
use std::collections::HashSet;
use std::path::Path;
use std::sync::Arc;

/// Most channels that get a message per burst: those whose episodes come first.
const MOST_WATCHED: usize = 256;

/// Why a recording has no annotations.
pub enum NotAnnotated {
    /// One of its tables cannot be read or drawn, which concerns no other recording.
    Unreadable(String),
    /// The annotations cannot be written, which may concern all recordings.
    Unwritten(RecordingError),
}

impl From<RecordingError> for NotAnnotated {
    fn from(e: RecordingError) -> NotAnnotated {
        NotAnnotated::Unwritten(e)
    }
}

impl From<String> for NotAnnotated {
    fn from(why: String) -> NotAnnotated {
        NotAnnotated::Unreadable(why)
    }
}

/// Writes the annotations of a recording. `verdicts`: the path of its verdict table, beside which
/// the table of episodes lies and the annotations go.
pub fn annotate(verdicts: &Path) -> Result<(), NotAnnotated> {
    let episodes =
        episode_table::read(&episode_table::path_beside(verdicts)).map_err(|e| e.to_string())?;
    let mut writer = AnnotationWriter::create(&annotation_writer::path_beside(verdicts))?;
    episodes.iter().try_for_each(|e| log(&mut writer, e))?;

    // the channels that get messages burst by burst: the first in the order of the table of
    // episodes
    let mut watched = HashSet::new();
    for e in &episodes {
        if watched.len() < MOST_WATCHED {
            watched.insert((e.printhead.clone(), e.channel));
        }
    }

    // one pass over the verdicts gives the messages, and the counts, from which the maps are drawn
    let mut counts = RecordingCounts::new(&episodes);
    let mut survey = Survey::new(&[episodes]);
    let mut reader = VerdictReader::open(verdicts).map_err(|e| e.to_string())?;
    while let Some(columns) = reader.next() {
        let columns = columns.map_err(|e| e.to_string())?;
        let names = Names { classes: reader.classes(), categories: reader.categories() };
        counts.add(&columns, names);
        states(&mut writer, &columns, &watched, names)?;
    }
    survey.absorb(0, counts);
    for head in &survey.heads {
        waterfalls(head, |t_ns, png| Ok::<_, NotAnnotated>(writer.image(t_ns, &head.name, png)?))?;
    }
    Ok(writer.finish()?)
}

/// Log lines of an episode: one when it was raised, and one when it ended.
fn log(writer: &mut AnnotationWriter, e: &Episode) -> Result<(), RecordingError> {
    writer.log(e.raised_at_ns, Level::Warning, &e.printhead, &e.explanation)?;
    let Some(end) = e.ended_at_ns else { return Ok(()) };
    let healthy = format!("channel {}: healthy again", e.channel);
    writer.log(end, Level::Info, &e.printhead, &healthy)
}

/// Writes one message for each judged signal of the watched channels. `c`: a batch of verdict rows;
/// `names`: the classes and categories to which indices in `c` refer.
fn states(
    writer: &mut AnnotationWriter,
    c: &VerdictColumns,
    watched: &HashSet<(Arc<str>, u32)>,
    names: Names,
) -> Result<(), RecordingError> {
    for row in 0..c.len() {
        let printhead = &c.printheads[c.printhead[row] as usize];
        let is_judged = c.outcome[row] != Outcome::Rejected;
        if !is_judged || !watched.contains(&(printhead.clone(), c.channel[row])) {
            continue;
        }
        let class = c.fault[row].and_then(|k| names.classes.get(usize::from(k)));
        let category = c.category[row].and_then(|k| names.categories.get(usize::from(k)));
        let number = |value: Option<f32>| value.map_or(f64::NAN, f64::from);
        let state = ChannelState {
            timestamp: None,
            channel: c.channel[row],
            statistic_over_threshold: number(c.statistic[row]) / number(c.threshold[row]),
            flagged: c.outcome[row] != Outcome::Healthy,
            severity: c.severity[row].map(f64::from),
            certainty: c.certainty[row].map(f64::from),
            what: class.or(category).cloned().unwrap_or_default(),
        };
        writer.state(c.acquired_at_ns[row], printhead, state)?;
    }
    Ok(())
}
