//! The two lowest codes of Parquet's encodings: whole numbers of any length (ULEB128), and numbers
//! packed side by side in a fixed number of bits. `hybrid.rs` and `steps.rs` are built on them.

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
