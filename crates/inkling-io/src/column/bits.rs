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

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn hand_numbers_are_those_of_the_formats_description() {
        let mut out = Vec::new();
        [0, 127, 128, 300].into_iter().for_each(|number| put_number(number, &mut out));
        assert_eq!(out, [0, 0x7f, 0x80, 1, 0xac, 2]);
        // the example of Parquet's `Encodings.md`
        let mut out = Vec::new();
        pack(0..8, 3, &mut out);
        assert_eq!(out, [0b1000_1000, 0b1100_0110, 0b1111_1010]);
    }

    #[test]
    fn property_bits_of_every_width_are_where_they_belong() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        for width in 0..=64u8 {
            let below =
                |number: u64| number & u64::MAX.checked_shr(64 - u32::from(width)).unwrap_or(0);
            let numbers: Vec<u64> = (0..37).map(|_| below(rng.random())).collect();
            let mut out = vec![0xff];
            pack(numbers.iter().copied(), width, &mut out);
            let width = usize::from(width);
            assert_eq!(out.len(), 1 + (numbers.len() * width).div_ceil(8));
            let bit = |at: usize| u64::from(out[1 + at / 8] >> (at % 8) & 1);
            for (nth, number) in numbers.iter().enumerate() {
                let found = (0..width).fold(0, |all, k| all | bit(nth * width + k) << k);
                assert_eq!(found, *number, "number {nth} of {width} bits");
            }
        }
    }
}
