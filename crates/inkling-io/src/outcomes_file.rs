//! Writes the list of doubts and reads it back when somebody has filled it in: a CSV that `report
//! --doubts` writes with empty states, in which a person or a drop watcher enters what is true of
//! each doubtful channel, and that `train --outcomes` reads as labels.
//!
//! Its columns are those of labels (`labels_file.rs`), then `source` (who says so), `certainty` (of
//! that statement, 0 to 1; empty: 1) and `sentence` (why the channel is doubtful; not read). A row
//! whose state is empty has not been filled in.

use super::file_error::FileError;
use super::labels_file::{self, HEADER, States};
use super::{printable, regular_file, stored};
use inkling_core::labels::Label;
use std::collections::BTreeMap;
use std::path::Path;

/// The columns beside those of labels.
const MORE: [&str; 3] = ["source", "certainty", "sentence"];

/// A fault of a channel that could not be named, and the time of its last episode, ns since 1970.
/// `to_ns` is exclusive: of a fault that lasts, the end of the last recording; `None`: not known.
#[derive(Clone, Debug)]
pub struct Doubt {
    pub printhead: String,
    pub channel: u32,
    pub from_ns: i64,
    pub to_ns: Option<i64>,
    pub sentence: String,
}

#[derive(Clone, Debug, Default)]
pub struct Outcomes {
    pub labels: Vec<Label>,
    pub by_source: BTreeMap<String, usize>,
    pub not_looked_at: usize,
    /// How many rows are less certain than was asked for.
    pub uncertain: usize,
}

/// Refuses to overwrite a list into which somebody has written, or a file that is no such list.
pub fn check(path: &Path) -> Result<(), FileError> {
    if stored::exists(path) && !is_untouched(path).unwrap_or(false) {
        let what = "it is no list of doubts, or somebody has filled it in: give another name";
        return Err(FileError::mistaken(path, what));
    }
    Ok(())
}

/// Whether no row has anything in the columns that are to be filled in.
fn is_untouched(path: &Path) -> Result<bool, FileError> {
    let file = regular_file::open(path).map_err(FileError::unread(path))?;
    let mut untouched = true;
    labels_file::each_row(path, file, ["source", "certainty"], |fields, beside| {
        let [.., state, severity] = fields;
        untouched &= [state, severity].into_iter().chain(beside).all(str::is_empty);
        Ok(())
    })?;
    Ok(untouched)
}

pub fn write(path: &Path, doubts: &[Doubt]) -> Result<(), FileError> {
    check(path)?;
    let rows = doubts.iter().map(|doubt| {
        let [empty, severity, source, certainty] = [(); 4].map(|()| String::new());
        let from = labels_file::rfc_3339(doubt.from_ns);
        let to = doubt.to_ns.map_or(String::new(), labels_file::rfc_3339);
        let (printhead, channel) = (doubt.printhead.clone(), doubt.channel.to_string());
        [printhead, channel, from, to, empty, severity, source, certainty, doubt.sentence.clone()]
    });
    labels_file::write_rows(path, &[&HEADER[..], &MORE].concat(), rows)
}

/// Reads a list. `least`: the certainty that a row needs to become a label, 0 to 1. A state that
/// `states` does not allow is an error, as is a certainty outside 0 to 1.
pub fn read(path: &Path, least: f64, states: States) -> Result<Outcomes, FileError> {
    let file = regular_file::open(path).map_err(FileError::unread(path))?;
    let mut outcomes = Outcomes::default();
    labels_file::each_row(path, file, ["source", "certainty"], |fields, [source, certainty]| {
        if fields[4].is_empty() {
            outcomes.not_looked_at += 1;
            return Ok(());
        }
        let label = labels_file::parse(fields)?;
        states.check(&label.state)?;
        let certain: f64 = match certainty {
            "" => 1.0,
            text => text.parse().ok().filter(|c| (0.0..=1.0).contains(c)).ok_or_else(|| {
                format!("certainty \"{}\": give 0 to 1, or nothing", printable::cell(text))
            })?,
        };
        if certain < least {
            outcomes.uncertain += 1;
            return Ok(());
        }
        let source = if source.is_empty() { "nobody said who" } else { source };
        *outcomes.by_source.entry(source.into()).or_default() += 1;
        outcomes.labels.push(label);
        Ok(())
    })?;
    Ok(outcomes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{assert_refused, place};

    #[test]
    fn doubts_come_back_as_labels_once_somebody_has_looked() {
        let (_dir, path) = place("doubts.csv");
        let doubts = [3, 4, 5].map(|channel| Doubt {
            printhead: "cyan, 1".into(),
            channel,
            from_ns: 1_700_000_000_000_000_000,
            to_ns: Some(1_700_000_600_000_000_000),
            sentence: "rings \"unlike\" any".into(),
        });
        write(&path, &doubts).unwrap();
        let outcomes = read(&path, 0.8, States::Any).unwrap();
        assert_eq!((outcomes.labels.len(), outcomes.not_looked_at), (0, 3));
        // as long as nobody has, it may be written again
        write(&path, &doubts).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        // somebody who has written but a name has begun to look
        std::fs::write(&path, text.replacen(",,,,,", ",,,drop watcher,,", 1)).unwrap();
        assert_refused(write(&path, &doubts), &["filled it in"]);
        let filled = text.replacen(",,,,,", ",SDN,1.3,drop watcher,0.95,", 1);
        let filled = filled.replacen(",,,,,", ",BN,,drop watcher,.3,", 1);
        std::fs::write(&path, &filled).unwrap();
        let outcomes = read(&path, 0.8, States::Any).unwrap();
        let states: Vec<&str> = outcomes.labels.iter().map(|label| label.state.as_str()).collect();
        assert_eq!((states, outcomes.uncertain, outcomes.not_looked_at), (vec!["SDN"], 1, 1));
        assert_eq!(outcomes.by_source["drop watcher"], 1);
        let label = &outcomes.labels[0];
        assert_eq!((label.severity, &*label.printhead), (Some(1.3), "cyan, 1"));
        assert_eq!(label.from_ns, Some(1_700_000_000_000_000_000));
        assert_refused(write(&path, &doubts), &["filled it in"]);
        std::fs::write(&path, filled.replace(",.3,", ",much,")).unwrap();
        assert_refused(read(&path, 0.8, States::Any), &["certainty \"much\""]);
        std::fs::write(&path, "a letter").unwrap();
        assert!(write(&path, &[]).is_err());
    }
}
