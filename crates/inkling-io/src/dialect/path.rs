//! A field path such as `wave.data` or `heads[0].id`, as settings have it: parsed from text and
//! checked by itself, without looking at a schema.
//!
//! Form: steps with dots between them; a step is a name, then perhaps an index in brackets, from 0.
//! `shape.rs` finds out where a path leads in a schema, `message.rs` what it finds in a message.

use serde::{Deserialize, Serialize};
use std::fmt;

/// At most so many steps of a path; nobody writes longer ones on purpose.
const MOST_STEPS: usize = 32;
const MOST_BYTES: usize = 512;

/// One step of a path: a field's name, and which of its elements is meant where it has several.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Step {
    pub name: String,
    pub index: Option<u32>,
}

/// A path from the message's root to a field, of at least one step.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct FieldPath(Vec<Step>);

impl FieldPath {
    pub fn steps(&self) -> &[Step] {
        &self.0
    }

    /// The path to the field of this name in the message to which this path leads.
    pub fn child(&self, name: &str) -> FieldPath {
        let step = Step { name: name.to_owned(), index: None };
        FieldPath(self.0.iter().cloned().chain([step]).collect())
    }
}

impl TryFrom<String> for FieldPath {
    type Error = String;

    fn try_from(text: String) -> Result<FieldPath, String> {
        let wrong = |what: &str| {
            let text = crate::printable::cell(&text);
            format!("\"{text}\" is no field path such as wave.data or heads[0].id: {what}")
        };
        // `inkling inspect` writes a question mark where only a person knows the answer
        if text == "?" {
            return Err("it is still a question: give a number or a field path".into());
        }
        if text.len() > MOST_BYTES {
            return Err(wrong("too long"));
        }
        let steps: Vec<Step> = text
            .split('.')
            .map(|step| Step::parse(step).ok_or_else(|| wrong("a name, then perhaps [number]")))
            .collect::<Result<_, _>>()?;
        match steps.len() <= MOST_STEPS {
            true => Ok(FieldPath(steps)),
            false => Err(wrong("too many steps")),
        }
    }
}

impl Step {
    /// Refuses an index at a field that has only one element.
    pub fn check_index(&self, several: bool) -> Result<(), String> {
        match self.index {
            Some(_) if !several => Err(format!("\"{}\" is only one: no [..]", self.name)),
            _ => Ok(()),
        }
    }

    /// Refuses a step in the middle of a path that the path cannot go on from: a field with several
    /// elements, and no index that says which.
    pub fn check_on_the_way(&self, several: bool) -> Result<(), String> {
        match self.index {
            None if several => Err(format!("\"{self}\" is several: say which, {self}[0]")),
            _ => self.check_index(several),
        }
    }

    fn parse(text: &str) -> Option<Step> {
        let (name, index) = match text.split_once('[') {
            None => (text, None),
            Some((name, index)) => (name, Some(index.strip_suffix(']')?.parse().ok()?)),
        };
        // these characters have a meaning in paths, patterns or messages
        let odd = |c: char| c.is_control() || "[]{}\"".contains(c);
        let good = !name.is_empty() && name.trim() == name && !name.contains(odd);
        good.then(|| Step { name: name.to_owned(), index })
    }
}

impl fmt::Display for Step {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.index {
            None => f.write_str(&self.name),
            Some(index) => write!(f, "{}[{index}]", self.name),
        }
    }
}

impl fmt::Display for FieldPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let steps: Vec<String> = self.0.iter().map(Step::to_string).collect();
        f.write_str(&steps.join("."))
    }
}

impl From<FieldPath> for String {
    fn from(path: FieldPath) -> String {
        path.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_names_and_indices_and_nothing_else() {
        for text in ["a", "wave.data", "heads[0].id", "a_b.c-d[12]"] {
            assert_eq!(FieldPath::try_from(text.to_owned()).unwrap().to_string(), text);
        }
        let long = ["a"; 40].join(".");
        for text in ["", ".", "a.", "a..b", "a[", "a[]", "a[-1]", "a[x]", "[0]", "a]", "{a}", &long]
        {
            let e = FieldPath::try_from(text.to_owned()).unwrap_err();
            assert!(e.contains("no field path"), "{text}: {e}");
        }
    }
}
