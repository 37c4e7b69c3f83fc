//! Which fields of a message are wanted, as a tree: one walk over the message finds them all.
//!
//! `shape.rs` (and `plan.rs` for JSON) adds the paths of a dialect; the walks of `protobuf.rs`,
//! `ros.rs` and `json.rs` read the tree. A path is a way from the root to a leaf. A leaf has a
//! [`Slot`]: the part of a burst that the field becomes.

use super::path::Step;

/// The part of a burst that a field becomes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Slot {
    Samples,
    Channels,
    SamplesPerChannel,
    FirstChannel,
    Period,
    Rate,
    /// A time as one number or text.
    Time,
    /// Whole seconds of a message of seconds and nanoseconds; the next slot has the nanoseconds.
    Seconds,
    Nanoseconds,
    Temperature,
    Voltage,
    /// s since the previous actuation.
    Idle,
    /// How many neighbours were actuated with it.
    Neighbours,
    /// A piece of the printhead's name: the n-th path in its pattern, from 0.
    Text(u8),
}

impl Slot {
    /// Whether a JSON message may lack it.
    pub fn is_optional(self) -> bool {
        matches!(self, Slot::Temperature | Slot::Voltage | Slot::Idle | Slot::Neighbours)
    }
}

/// Fields that are wanted of one message; the same field may stand here twice.
#[derive(Clone, Debug, Default)]
pub struct Wanted {
    pub fields: Vec<WantedField>,
}

#[derive(Clone, Debug)]
pub struct WantedField {
    pub at: Step,
    pub then: Then,
}

/// What is done with a field that is met.
#[derive(Clone, Debug)]
pub enum Then {
    /// The slot gets its value.
    Take(Slot),
    /// It is a message, in which more is wanted.
    Into(Wanted),
}

impl Wanted {
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
