//! Which fields of a message are wanted, as a tree, so that one walk finds them all.

/// What a field becomes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slot {
    Samples,
    Channels,
    SamplesPerChannel,
    FirstChannel,
    Period,
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
    pub const COUNT: usize = 12 + super::settings::MOST_TEXTS;

    pub fn place(self) -> usize {
        match self {
            Slot::Samples => 0,
            Slot::Channels => 1,
            Slot::SamplesPerChannel => 2,
            Slot::FirstChannel => 3,
            Slot::Period => 4,
            Slot::Time => 5,
            Slot::Seconds => 6,
            Slot::Nanoseconds => 7,
            Slot::Temperature => 8,
            Slot::Voltage => 9,
            Slot::Idle => 10,
            Slot::Neighbours => 11,
            Slot::Text(n) => 12 + usize::from(n),
        }
    }
}

/// A step of a resolved path: `key` is what the encoding knows a field by.
#[derive(Clone, Debug, PartialEq)]
pub struct At<K> {
    pub key: K,
    pub index: Option<u32>,
}

/// Wanted fields of one message.
#[derive(Clone, Debug)]
pub struct Wanted<K> {
    pub fields: Vec<Field<K>>,
}

#[derive(Clone, Debug)]
pub struct Field<K> {
    pub at: At<K>,
    pub then: Then<K>,
}

#[derive(Clone, Debug)]
pub enum Then<K> {
    Take(Slot),
    Into(Wanted<K>),
}

impl<K: Clone + PartialEq> Wanted<K> {
    pub fn nothing() -> Wanted<K> {
        Wanted { fields: Vec::new() }
    }

    /// `path` has at least one step.
    pub fn want(&mut self, path: &[At<K>], slot: Slot) {
        let [at, rest @ ..] = path else { return };
        if rest.is_empty() {
            self.fields.push(Field { at: at.clone(), then: Then::Take(slot) });
            return;
        }
        for field in &mut self.fields {
            if let (true, Then::Into(inside)) = (field.at == *at, &mut field.then) {
                return inside.want(rest, slot);
            }
        }
        let mut inside = Wanted::nothing();
        inside.want(rest, slot);
        self.fields.push(Field { at: at.clone(), then: Then::Into(inside) });
    }

    /// A message of seconds and nanoseconds: `path` leads to it.
    pub fn want_time(&mut self, path: &[At<K>], [seconds, nanoseconds]: [K; 2]) {
        for (key, slot) in [(seconds, Slot::Seconds), (nanoseconds, Slot::Nanoseconds)] {
            self.want(&[path, &[At { key, index: None }]].concat(), slot);
        }
    }
}
