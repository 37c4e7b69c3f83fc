//! Inner products whose bits do not depend on the processor's vector instructions.
//!
//! Eight partial sums are kept side by side, one per SIMD lane, and added up in a fixed order, then
//! the products that fill no whole group of eight. No product is fused with a sum. So the result,
//! and with it every verdict, has the same bits on every processor.

use crate::processor::for_processor;

const LANES: usize = 8;
type Lanes = [f64; LANES];

#[inline(always)] // compiled once per instruction set
fn sum(lanes: Lanes) -> f64 {
    let half: [f64; 4] = std::array::from_fn(|l| lanes[l] + lanes[l + 4]);
    (half[0] + half[2]) + (half[1] + half[3])
}

for_processor! {
    /// Inner product of two vectors of equal length. That the lengths are equal is not checked.
    pub fn dot(a: &[f64], b: &[f64]) -> f64 { portable }
}

#[inline(always)] // compiled once per instruction set
fn portable(a: &[f64], b: &[f64]) -> f64 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let mut sums = [0.0; LANES];
    for (a, b) in a.iter().zip(b) {
        for l in 0..LANES {
            sums[l] += a[l] * b[l];
        }
    }
    a_rest.iter().zip(b_rest).fold(sum(sums), |s, (a, b)| s + a * b)
}
