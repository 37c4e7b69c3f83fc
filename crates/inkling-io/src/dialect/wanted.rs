//! Which fields of a message are wanted, as a tree, so that one walk finds them all.

use super::path::Step;

/// What a field becomes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Slot {
    Samples,
    Channels,
    SamplesPerChannel,
    FirstChannel,
    Period,
    Rate,
    /// A number: ns as integer, s as float.
    Time,
    Seconds,
    Nanoseconds,
    Temperature,
    Voltage,
    Idle,
    Neighbours,
    /// Part of the printhead's name.
    Text(u8),
}

impl Slot {
    /// A burst may be without it.
    pub fn is_optional(self) -> bool {
        matches!(self, Slot::Temperature | Slot::Voltage | Slot::Idle | Slot::Neighbours)
    }
}

/// Wanted fields of one message.
#[derive(Clone, Debug, Default)]
pub struct Wanted {
    pub fields: Vec<WantedField>,
}

#[derive(Clone, Debug)]
pub struct WantedField {
    pub at: Step,
    pub then: Then,
}

#[derive(Clone, Debug)]
pub enum Then {
    Take(Slot),
    Into(Wanted),
}

impl Wanted {
    /// `path` has at least one step.
    pub fn want(&mut self, path: &[Step], slot: Slot) {
        let [at, rest @ ..] = path else { return };
        if rest.is_empty() {
            self.fields.push(WantedField { at: at.clone(), then: Then::Take(slot) });
            return;
        }
        for field in &mut self.fields {
            if let (true, Then::Into(inside)) = (field.at == *at, &mut field.then) {
                return inside.want(rest, slot);
            }
        }
        let mut inside = Wanted::default();
        inside.want(rest, slot);
        self.fields.push(WantedField { at: at.clone(), then: Then::Into(inside) });
    }
}
