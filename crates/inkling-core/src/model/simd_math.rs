//! Exponential, logarithm, sine and cosine without branches, which compilers turn into SIMD code,
//! for inner loops.
//!
//! Each function reduces its argument to a small interval, sums a series there, and undoes the
//! reduction by writing bits. It consists of sums, products, divisions and integer arithmetic only,
//! and nothing is fused, so the bits depend neither on the processor nor on the C library. Errors
//! are a few units in the last place (`tests`). Arguments beyond the stated ranges give wrong
//! numbers without a warning.

/// Added to a number below 2^51, 1.5 x 2^52 leaves the rounded number in the low bits of the sum.
const TO_INTEGER: f64 = 6_755_399_441_055_744.0;
/// ln 2 in two parts, the first with so few digits that its product with k is exact.
const LN_2: [f64; 2] = [0.693_147_180_369_123_8, 1.908_214_929_270_587_7e-10];

/// e^x for x in -700 .. 700: e^x = 2^k e^r with a whole k and |r| <= ln 2 / 2. e^r is its Taylor
/// series to order 13, summed in pairs (Estrin) so that additions need not wait for one another.
#[inline(always)] // compiled once per instruction set
pub fn exp(x: f64) -> f64 {
    let shifted = x * std::f64::consts::LOG2_E + TO_INTEGER;
    let k = shifted - TO_INTEGER;
    let r = (x - k * LN_2[0]) - k * LN_2[1];

    let (r2, r4) = (r * r, (r * r) * (r * r));
    let pair = |n: usize| INVERSE_FACTORIALS[n] + INVERSE_FACTORIALS[n + 1] * r;
    let four = |n: usize| pair(n) + pair(n + 2) * r2;
    let above = four(4) + (four(8) + pair(12) * r4) * r4;

    // the largest terms last; 2^k is written into the bits of the exponent
    let rest = r2 * (INVERSE_FACTORIALS[2] + INVERSE_FACTORIALS[3] * r) + above * r4;
    (1.0 + (r + rest)) * f64::from_bits(shifted.to_bits().wrapping_add(1023) << 52)
}

/// e^x in single precision for x in -80 .. 80, as `exp`, to order 6.
#[inline(always)] // compiled once per instruction set
pub fn exp_single(x: f32) -> f32 {
    /// 1.5 2^23, as [`TO_INTEGER`].
    const TO_INTEGER: f32 = 12_582_912.0;
    const LN_2: [f32; 2] = [0.693_359_4, -2.121_944_4e-4];
    let shifted = x * std::f32::consts::LOG2_E + TO_INTEGER;
    let k = shifted - TO_INTEGER;
    let r = (x - k * LN_2[0]) - k * LN_2[1];
    let of = |n: usize| INVERSE_FACTORIALS[n] as f32;
    let above = (of(3) + of(4) * r) + (of(5) + of(6) * r) * (r * r);
    (1.0 + (r + (r * r) * (of(2) + above * r)))
        * f32::from_bits(shifted.to_bits().wrapping_add(127) << 23)
}

const INVERSE_FACTORIALS: [f64; 17] = {
    let (mut of, mut factorial, mut n) = ([1.0; 17], 1.0, 1);
    while n < of.len() {
        factorial *= n as f64;
        of[n] = 1.0 / factorial;
        n += 1;
    }
    of
};

/// ln x for positive normal x: x = 2^k m with m in sqrt(1/2) .. sqrt(2), and ln m = 2 artanh s with
/// s = (m - 1) / (m + 1), |s| <= .1716; the series ends at s^21.
#[inline(always)] // compiled once per instruction set
pub fn ln(x: f64) -> f64 {
    const ROOT_HALF: u64 = 0x3fe6_a09e_667f_3bcd;
    const MANTISSA: u64 = (1 << 52) - 1;
    // less the bits of sqrt(1/2): the exponent is now k, and below are the bits of m less these
    let above = x.to_bits().wrapping_sub(ROOT_HALF);
    // k as a floating-point number: k + 1024 in the mantissa of 2^52, less 2^52 + 1024
    let biased = (above.wrapping_add(1024 << 52)) >> 52;
    let k = f64::from_bits(biased | 0x4330_0000_0000_0000) - (4_503_599_627_370_496.0 + 1024.0);
    let m = f64::from_bits((above & MANTISSA).wrapping_add(ROOT_HALF));

    let s = (m - 1.0) / (m + 1.0);
    let square = s * s;
    let mut sum = 1.0 / 21.0;
    for n in (1..10).rev() {
        sum = sum * square + 1.0 / (2 * n + 1) as f64;
    }
    let rest = 2.0 * s * square * sum;
    k * LN_2[0] + (2.0 * s + (rest + k * LN_2[1]))
}

/// Sine and cosine for |x| < 10^5: x = k pi/2 + r with |r| <= pi/4, and the Taylor series at r.
#[inline(always)] // compiled once per instruction set
pub fn sin_cos(x: f64) -> (f64, f64) {
    /// pi/2 in two parts, as [`LN_2`].
    const QUARTER: [f64; 2] = [1.570_796_326_734_125_6, 6.077_100_506_506_192e-11];
    let shifted = x * std::f64::consts::FRAC_2_PI + TO_INTEGER;
    let (k, quarters) = (shifted - TO_INTEGER, shifted.to_bits());
    let r = (x - k * QUARTER[0]) - k * QUARTER[1];

    // both series by Horner's rule, to r^15 and r^16; their signs alternate
    let by = -(r * r);
    let (mut sin, mut cos) = (INVERSE_FACTORIALS[15], INVERSE_FACTORIALS[16]);
    for n in (0..7).rev() {
        sin = sin * by + INVERSE_FACTORIALS[2 * n + 1];
    }
    for n in (0..8).rev() {
        cos = cos * by + INVERSE_FACTORIALS[2 * n];
    }
    sin *= r;

    let odd = quarters & 1 == 1;
    let (s, c) = (if odd { cos } else { sin }, if odd { sin } else { cos });
    // In odd quarters sine and cosine change places; signs by quarter: 0 ++, 1 +-, 2 --, 3 -+.
    let sign = |bit: u64| (bit & 2) << 62;
    let signed = |v: f64, bit: u64| f64::from_bits(v.to_bits() ^ sign(bit));
    (signed(s, quarters), signed(c, quarters.wrapping_add(1)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponential_is_the_exponential() {
        for i in -700_000..700_000 {
            let x = f64::from(i) / 1000.0;
            assert!((exp(x) / x.exp() - 1.0).abs() < 1e-15, "{x}");
        }
        assert_eq!(exp(0.0), 1.0);
    }

    #[test]
    fn in_single_precision_it_is_so_to_single_precision() {
        for i in -80_000..80_000 {
            let x = i as f32 / 1000.0;
            let want = f64::from(x).exp();
            assert!((f64::from(exp_single(x)) / want - 1.0).abs() < 4e-7, "{x}");
        }
        assert_eq!(exp_single(0.0), 1.0);
    }

    #[test]
    fn logarithm_is_the_logarithm() {
        let near_one = (-20_000..20_000).map(|i| 1.0 + f64::from(i) * 2e-5);
        let all = (-300_000..300_000).map(|i| 10f64.powf(f64::from(i) / 1000.0));
        for x in near_one.chain(all) {
            let error = (ln(x) - x.ln()).abs();
            assert!(error <= 1e-15 * x.ln().abs() + 1e-17, "{x}: {} {}", ln(x), x.ln());
        }
        assert_eq!(ln(1.0), 0.0);
    }

    #[test]
    fn sine_and_cosine_are_what_they_are() {
        for i in -400_000..400_000 {
            let x = f64::from(i) * 1.7e-4;
            let (sin, cos) = sin_cos(x);
            assert!((sin - x.sin()).abs() < 4e-16, "{x}");
            assert!((cos - x.cos()).abs() < 4e-16, "{x}");
        }
        assert_eq!(sin_cos(0.0), (0.0, 1.0));
    }
}
