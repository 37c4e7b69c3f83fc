//! Parquet's hybrid code of run lengths and packed bits (its encoding `RLE`), for definition levels
//! (whether a row has a value) and for keys into a dictionary. `numbers.rs` and `runs.rs` feed it.
//!
//! The code is a sequence of two kinds of pieces. A run of n equal values is the number 2n, then
//! the value once, in whole bytes. Values that change often are packed: g groups of eight values
//! are the number 2g + 1, then the values in `width` bits each. (These numbers are ULEB128, see
//! [`put_number`].) Only the very last group may be filled up with values that nobody pushed, because
//! readers know how many values there are.
//!
//! What the format puts before the code is added elsewhere: the code's length before levels
//! (`pages.rs`), the width before keys (`runs.rs`).

#[derive(Debug)]
pub struct Hybrid {
    /// Bits of a value, 32 at most.
    width: u8,
    out: Vec<u8>,
    /// The values after those of `out`, which wait to be packed.
    literals: Vec<u32>,
    /// The run under way, after the literals: its value and its length so far.
    run: (u32, u32),
}

impl Hybrid {
    /// When so many values wait, they are packed: 63 groups of eight are the most that a header of one byte
    /// can announce. The parquet crate's own writer packs as many.
    const MOST_LITERALS: usize = 63 * 8;

    pub fn new(width: u8) -> Hybrid {
        Hybrid { width, out: Vec::new(), literals: Vec::new(), run: (0, 0) }
    }

    /// Adds a value, which is below 2^`width`, `times` times.
    pub fn push(&mut self, value: u32, times: u32) {
        if value == self.run.0 {
            self.run.1 += times;
        } else {
            self.end_run();
            self.run = (value, times);
        }
    }

    /// Adds one value for each flag: `values[0]` where it is false, `values[1]` where it is true. All of them
    /// are packed, because two values that take turns have hardly a run that is worth looking for.
    pub fn push_either(&mut self, values: [u32; 2], which: &[bool]) {
        self.end_run();
        let mut left = which;
        while !left.is_empty() {
            let room = Self::MOST_LITERALS - self.literals.len();
            let (now, later) = left.split_at(room.min(left.len()));
            self.literals.extend(now.iter().map(|&second| values[usize::from(second)]));
            if self.literals.len() == Self::MOST_LITERALS {
                self.pack();
            }
            left = later;
        }
    }

    /// A long run is written as a run; the values of a short one join those that wait to be packed.
    fn end_run(&mut self) {
        let (value, mut times) = std::mem::take(&mut self.run);
        // Groups must be whole before a run is written. So a long run lends the values that the
        // last group lacks. A run is long if at least eight of its values are left after that.
        let missing = ((8 - self.literals.len() % 8) % 8) as u32;
        let literal = if times >= missing + 8 { missing } else { times };
        for _ in 0..literal {
            self.literals.push(value);
            if self.literals.len() == Self::MOST_LITERALS {
                self.pack();
            }
        }

        // the rest of a long run, now that all groups before it are whole
        times -= literal;
        if times > 0 {
            self.pack();
            put_number(u64::from(times) << 1, &mut self.out);
            let bytes = usize::from(self.width.div_ceil(8));
            self.out.extend(&value.to_le_bytes()[..bytes]);
        }
    }

    /// Writes the values that wait. The last group may be filled up with zeros only at the very end, so
    /// elsewhere this is called only when all groups are whole.
    fn pack(&mut self) {
        if self.literals.is_empty() {
            return;
        }
        let groups = self.literals.len().div_ceil(8);
        self.literals.resize(groups * 8, 0);
        put_number((groups as u64) << 1 | 1, &mut self.out);
        pack(self.literals.drain(..).map(u64::from), self.width, &mut self.out);
    }

    pub fn finish(mut self) -> Vec<u8> {
        self.end_run();
        self.pack();
        self.out
    }
}

/// Appends a number with seven bits in each byte, the lowest first; the eighth bit says that more follow
/// (ULEB128).
pub fn put_number(mut number: u64, out: &mut Vec<u8>) {
    while number >= 0x80 {
        out.push(number as u8 | 0x80);
        number >>= 7;
    }
    out.push(number as u8);
}

/// Appends numbers below 2^`width` (`width`: 0 to 64 bits), one after the other without gaps, the
/// lowest bits first. The last byte is filled up with zeros.
pub fn pack(numbers: impl Iterator<Item = u64>, width: u8, out: &mut Vec<u8>) {
    let width = u32::from(width);
    let (mut bits, mut held) = (0u64, 0);
    for number in numbers {
        // add the number above the bits that are held; what finds no room is shifted out
        bits |= number << held;
        held += width;
        if held >= u64::BITS {
            out.extend(bits.to_le_bytes());
            held -= u64::BITS;
            // the held bits that are new: those of the number that found no room
            bits = number.checked_shr(width - held).unwrap_or_default();
        }
    }
    out.extend(&bits.to_le_bytes()[..held.div_ceil(8) as usize]);
}
