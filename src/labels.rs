//! What is known to be true of the channels, over time (contract, "In: labels").

use std::collections::HashMap;

/// One row of a labels file. The span is half-open; `None` is unbounded.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Label {
    pub printhead: String,
    /// `None` is `*`, every channel.
    pub channel: Option<u32>,
    pub from_ns: Option<i64>,
    pub to_ns: Option<i64>,
    /// `healthy` or a fault class.
    pub state: String,
    pub severity: Option<f64>,
}

impl Label {
    fn covers(&self, t_ns: i64) -> bool {
        self.from_ns.is_none_or(|from| from <= t_ns) && self.to_ns.is_none_or(|to| t_ns < to)
    }
}

/// Labels ready to be asked. A channel number beats `*`, then the later row beats the earlier.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
#[serde(from = "Vec<Label>", into = "Vec<Label>")]
pub struct Labels {
    rows: Vec<Label>,
    by_printhead: HashMap<String, HashMap<Option<u32>, Vec<usize>>>,
}

impl From<Vec<Label>> for Labels {
    fn from(rows: Vec<Label>) -> Labels {
        Labels::new(rows)
    }
}

impl From<Labels> for Vec<Label> {
    fn from(labels: Labels) -> Vec<Label> {
        labels.rows
    }
}

impl Labels {
    pub fn new(rows: Vec<Label>) -> Labels {
        let mut by_printhead: HashMap<String, HashMap<Option<u32>, Vec<usize>>> = HashMap::new();
        for (i, row) in rows.iter().enumerate() {
            let channels = by_printhead.entry(row.printhead.clone()).or_default();
            channels.entry(row.channel).or_default().push(i);
        }
        Labels { rows, by_printhead }
    }

    pub fn rows(&self) -> &[Label] {
        &self.rows
    }

    /// The label of a channel at a time; `None`: unknown.
    pub fn at(&self, printhead: &str, channel: u32, t_ns: i64) -> Option<&Label> {
        let channels = self.by_printhead.get(printhead)?;
        [Some(channel), None].iter().find_map(|key| {
            let rows = channels.get(key)?;
            rows.iter().rev().map(|&i| &self.rows[i]).find(|row| row.covers(t_ns))
        })
    }
}
