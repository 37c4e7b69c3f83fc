//! Projections of channel-major int16 signals straight from the burst, without transposing them to a tile.
//!
//! In: consecutive int16 rows (one row is one channel's signal), the expected signal, columns. Out: per row the
//! inner products of its deviation with the columns, and its square norm. The arithmetic keeps the rules of
//! [`super::kernel`]: sample k is added to partial sum k mod 16, the sixteen partial sums are added in a fixed
//! order (`tree`), no multiplication is fused with an addition. So the bits depend neither on the instruction
//! set nor on whether a signal was transposed (`Instructions::project`).

use super::tile::{Instructions, LANES, PHASES, Phases, Sample, Set};

/// Splits numbers into groups of sixteen, padded with zeros.
pub fn in_phases(of: impl ExactSizeIterator<Item = f32>) -> Vec<Phases> {
    let mut phases = vec![[0.0; PHASES]; of.len().div_ceil(PHASES)];
    for (k, v) in of.enumerate() {
        phases[k / PHASES][k % PHASES] = v;
    }
    phases
}

/// The sum of the sixteen partial sums, in a fixed order.
#[inline(always)]
fn tree(of: &Phases) -> f32 {
    let eight: [f32; 8] = std::array::from_fn(|l| of[l] + of[l + 8]);
    let four: [f32; 4] = std::array::from_fn(|l| eight[l] + eight[l + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
}

/// Rows of a burst, and their expected signal.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    /// [`LANES`] rows of `n` little-endian int16.
    pub samples: &'a [u8],
    pub n: usize,
    /// y_hat, which all of them share, counts; in groups of sixteen samples.
    pub expected: &'a [Phases],
}

impl Instructions {
    /// Per row the inner products of its deviation with the columns `p`, and its square norm, counts².
    pub(super) fn project_rows<const M: usize>(
        self,
        rows: Rows,
        p: &[[Phases; M]],
        products: &mut [Sample; M],
        squares: &mut Sample,
    ) {
        match self.0 {
            Set::Portable => portable::rows(rows, p, products, squares),
            // SAFETY: `Instructions` are made only where the processor was found to have them
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => unsafe { avx2::rows(rows, p, products, squares) },
            // SAFETY: as above
            #[cfg(target_arch = "x86_64")]
            Set::Avx512 => unsafe { avx512::rows(rows, p, products, squares) },
        }
    }
}

/// The arithmetic, written once for vectors `$V` of `$W` numbers; `$SIDE` rows at a time, so that a load of the
/// expected signal or a column serves all of them.
macro_rules! arithmetic {
    (
        $name:ident, [$($feature:literal)?], $V:ty, $W:literal, $SIDE:literal,
        $set:path, $load:path, $store:path, $add:path, $sub:path, $mul:path, $int16:path
    ) => {
        mod $name {
            use super::*;
            #[allow(unused_imports)] // the portable one needs none
            #[cfg(target_arch = "x86_64")]
            use std::arch::x86_64::*;

            /// Vectors of the sixteen sums.
            const PARTS: usize = PHASES / $W;

            #[inline]
            $(#[target_feature(enable = $feature)])?
            fn load(of: &Phases, at: usize) -> $V {
                let from: &[f32] = &of[at..at + $W];
                // SAFETY: $W numbers are there; the load is unaligned
                #[allow(unused_unsafe)]
                unsafe { $load(from.as_ptr()) }
            }

            #[inline]
            $(#[target_feature(enable = $feature)])?
            fn int16(of: &[u8; 2 * PHASES], at: usize) -> $V {
                let from: &[u8] = &of[2 * at..2 * (at + $W)];
                // SAFETY: $W int16 are there; the load is unaligned
                #[allow(unused_unsafe)]
                unsafe { $int16(from.as_ptr()) }
            }

            #[inline]
            $(#[target_feature(enable = $feature)])?
            fn summed(of: [$V; PARTS]) -> f32 {
                let mut phases = [0.0; PHASES];
                for part in 0..PARTS {
                    let to: &mut [f32] = &mut phases[part * $W..(part + 1) * $W];
                    // SAFETY: as above
                    #[allow(unused_unsafe)]
                    unsafe { $store(to.as_mut_ptr(), of[part]) }
                }
                tree(&phases)
            }

            struct Sums<const M: usize> {
                squares: [[$V; PARTS]; $SIDE],
                products: [[[$V; PARTS]; M]; $SIDE],
            }

            /// Sixteen samples of each row.
            #[inline]
            $(#[target_feature(enable = $feature)])?
            fn add_sixteen<const M: usize>(
                samples: [&[u8; 2 * PHASES]; $SIDE],
                expected: &Phases,
                p: &[Phases; M],
                sums: &mut Sums<M>,
            ) {
                for part in 0..PARTS {
                    let at = part * $W;
                    let y_hat = load(expected, at);
                    for side in 0..$SIDE {
                        let d = $sub(int16(samples[side], at), y_hat);
                        let square = &mut sums.squares[side][part];
                        *square = $add(*square, $mul(d, d));
                        for j in 0..M {
                            let product = &mut sums.products[side][j][part];
                            *product = $add(*product, $mul(load(&p[j], at), d));
                        }
                    }
                }
            }

            $(#[target_feature(enable = $feature)])?
            pub(super) fn rows<const M: usize>(
                rows: Rows,
                p: &[[Phases; M]],
                products: &mut [Sample; M],
                squares: &mut Sample,
            ) {
                let Rows { samples, n, expected } = rows;
                for lane in (0..LANES).step_by($SIDE) {
                    let mut wholes: [&[[u8; 2 * PHASES]]; $SIDE] = [&[]; $SIDE];
                    let mut lasts = [[0; 2 * PHASES]; $SIDE];
                    for side in 0..$SIDE {
                        let row = &samples[2 * n * (lane + side)..][..2 * n];
                        let (whole, rest) = row.as_chunks();
                        wholes[side] = whole;
                        lasts[side][..rest.len()].copy_from_slice(rest);
                    }
                    let none = $set(0.0);
                    let mut sums = Sums {
                        squares: [[none; PARTS]; $SIDE],
                        products: [[[none; PARTS]; M]; $SIDE],
                    };
                    let pieces = n / PHASES;
                    for (i, (y_hat, p)) in expected.iter().zip(p).enumerate() {
                        let mut sixteen = [&lasts[0]; $SIDE];
                        for side in 0..$SIDE {
                            sixteen[side] =
                                if i < pieces { &wholes[side][i] } else { &lasts[side] };
                        }
                        add_sixteen(sixteen, y_hat, p, &mut sums);
                    }
                    for side in 0..$SIDE {
                        squares[lane + side] = summed(sums.squares[side]);
                        for j in 0..M {
                            products[j][lane + side] = summed(sums.products[side][j]);
                        }
                    }
                }
            }
        }
    };
}

/// Four numbers in plain Rust; compilers make vectors of it.
mod four {
    pub use super::super::tile::four::*;

    /// # Safety
    /// Four int16 lie at `from`.
    #[inline(always)]
    pub unsafe fn int16(from: *const u8) -> V {
        // SAFETY: the caller's promise; bytes have no alignment
        let of = unsafe { *from.cast::<[[u8; 2]; 4]>() };
        of.map(|b| f32::from(i16::from_le_bytes(b)))
    }
}

/// # Safety
/// Eight int16 lie at `from`.
#[cfg(target_arch = "x86_64")]
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn eight_int16(from: *const u8) -> std::arch::x86_64::__m256 {
    use std::arch::x86_64::*;
    // SAFETY: the caller's promise; the load is unaligned
    let of = unsafe { _mm_loadu_si128(from.cast()) };
    _mm256_cvtepi32_ps(_mm256_cvtepi16_epi32(of))
}

/// # Safety
/// Sixteen int16 lie at `from`.
#[cfg(target_arch = "x86_64")]
#[inline]
#[target_feature(enable = "avx512f")]
unsafe fn sixteen_int16(from: *const u8) -> std::arch::x86_64::__m512 {
    use std::arch::x86_64::*;
    // SAFETY: the caller's promise; the load is unaligned
    let of = unsafe { _mm256_loadu_si256(from.cast()) };
    _mm512_cvtepi32_ps(_mm512_cvtepi16_epi32(of))
}

arithmetic!(
    portable,
    [],
    four::V,
    4,
    1,
    four::set,
    four::load,
    four::store,
    four::add,
    four::sub,
    four::mul,
    four::int16
);
#[cfg(target_arch = "x86_64")]
arithmetic!(
    avx2,
    ["avx2"],
    __m256,
    8,
    1,
    _mm256_set1_ps,
    _mm256_loadu_ps,
    _mm256_storeu_ps,
    _mm256_add_ps,
    _mm256_sub_ps,
    _mm256_mul_ps,
    eight_int16
);
#[cfg(target_arch = "x86_64")]
arithmetic!(
    avx512,
    ["avx512f"],
    __m512,
    16,
    4,
    _mm512_set1_ps,
    _mm512_loadu_ps,
    _mm512_storeu_ps,
    _mm512_add_ps,
    _mm512_sub_ps,
    _mm512_mul_ps,
    sixteen_int16
);
