//! A tile: [`LANES`] signals transposed to sample-major order, so that a SIMD vector holds one sample of many
//! signals, one signal in each *lane*; and the instruction sets that work on it.
//!
//! In: signals of one or several bursts (a *row* is one channel of a burst), in any layout and sample format.
//! Out: their deviations from the expected signal, sample by sample, lane by lane. What is computed from
//! deviations stands in [`super::kernel`]. Intrinsics are written out only here and in
//! [`super::row_projection`]; elsewhere unsafe code merely calls, by what the processor has, one of several
//! compilations of a plain loop.

use crate::burst::{Burst, Format, Layout};

/// Signals of a tile: two AVX-512 vectors.
pub const LANES: usize = 32;

/// One sample of every lane.
pub type Sample = [f32; LANES];

/// Partial sums of a sum over samples: sample k is added to number k mod 16.
pub const PHASES: usize = 16;
/// One number for each of sixteen consecutive samples.
pub type Phases = [f32; PHASES];

/// A signal where it lies in its burst.
#[derive(Clone, Copy, Debug)]
struct Row<'a> {
    samples: &'a [u8],
    /// First sample and distance between samples, in samples.
    start: usize,
    stride: usize,
    format: Format,
}

/// Signals that wait to be transposed: of one length and one expected shape.
#[derive(Debug)]
pub struct Gather<'a> {
    rows: Vec<Row<'a>>,
    drive: [f32; LANES],
    warmer: [f32; LANES],
}

impl Default for Gather<'_> {
    fn default() -> Self {
        Gather { rows: Vec::with_capacity(LANES), drive: [0.0; LANES], warmer: [0.0; LANES] }
    }
}

impl<'a> Gather<'a> {
    /// Adds row `row` of a burst. `drive`: drive voltage over the reference, the scale of the expected signal;
    /// `warmer`: K above the reference temperature. Must not be full.
    pub fn push(&mut self, burst: &'a Burst, row: usize, drive: f64, warmer: f64) {
        let lane = self.rows.len();
        let (channels, n) = (burst.channels as usize, burst.samples_per_channel as usize);
        let (start, stride) = match burst.layout {
            Layout::ChannelMajor => (row * n, 1),
            Layout::SampleMajor => (row, channels),
        };
        self.rows.push(Row { samples: &burst.samples, start, stride, format: burst.format });
        self.drive[lane] = drive as f32;
        self.warmer[lane] = warmer as f32;
    }

    pub fn len(&self) -> usize {
        self.rows.len()
    }

    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    pub fn is_full(&self) -> bool {
        self.rows.len() == LANES
    }
}

/// Up to [`LANES`] signals, sample by sample. The values of lanes without a signal are unspecified.
#[derive(Debug)]
pub struct Tile {
    values: Vec<Sample>,
    lanes: usize,
    drive: [f32; LANES],
    warmer: [f32; LANES],
    square_sum: Sample,
}

impl Default for Tile {
    fn default() -> Tile {
        let zero = [0.0; LANES];
        Tile { values: Vec::new(), lanes: 0, drive: zero, warmer: zero, square_sum: zero }
    }
}

impl Tile {
    /// Transposes the gathered signals, `n` samples each, to counts, and empties `gather`.
    pub fn fill(&mut self, gather: &mut Gather, n: usize, instructions: Instructions) {
        self.values.resize(n, [0.0; LANES]);
        self.lanes = gather.rows.len();
        (self.drive, self.warmer) = (gather.drive, gather.warmer);
        // empty lanes get the first one's conditions, so that equal conditions stay equal
        self.drive[self.lanes..].fill(gather.drive[0]);
        self.warmer[self.lanes..].fill(gather.warmer[0]);
        let mut at = 0;
        while at < gather.rows.len() {
            let rows = &gather.rows[at..];
            at += match rows {
                [a, b, c, d, e, f, g, h, ..]
                    if instructions.turns_eight()
                        && [a, b, c, d, e, f, g, h]
                            .iter()
                            .all(|r| r.is_contiguous(Format::S16Le)) =>
                {
                    self.turn_eight([a, b, c, d, e, f, g, h], at, instructions);
                    8
                }
                [a, b, c, d, ..] if [a, b, c, d].iter().all(|r| r.is_contiguous(a.format)) => {
                    self.turn([a, b, c, d], at);
                    4
                }
                [first, ..] if first.stride > 1 => {
                    let run = 1 + rows.windows(2).take_while(|w| w[1].is_beside(&w[0])).count();
                    self.spread(first, run, at);
                    run
                }
                [first, ..] => {
                    self.spread(first, 1, at);
                    1
                }
                [] => break,
            };
        }
        gather.rows.clear();
    }

    /// Copies `run` neighbouring rows of a sample-major burst to the lanes from `lane` on.
    fn spread(&mut self, first: &Row, run: usize, lane: usize) {
        let bytes = first.format.bytes();
        for (k, sample) in self.values.iter_mut().enumerate() {
            let from = (first.start + k * first.stride) * bytes;
            let of = &first.samples[from..from + run * bytes];
            let lanes = &mut sample[lane..lane + run];
            match first.format {
                Format::S16Le => {
                    for (y, b) in lanes.iter_mut().zip(of.as_chunks::<2>().0) {
                        *y = f32::from(i16::from_le_bytes(*b));
                    }
                }
                Format::F32Le => {
                    for (y, b) in lanes.iter_mut().zip(of.as_chunks::<4>().0) {
                        *y = f32::from_le_bytes(*b);
                    }
                }
            }
        }
    }

    /// Transposes eight contiguous int16 rows to the lanes from `lane` on.
    fn turn_eight(&mut self, rows: [&Row; 8], lane: usize, instructions: Instructions) {
        let n = self.values.len();
        let of = rows.map(|r| r.samples[2 * r.start..][..2 * n].as_chunks::<32>());
        let (wholes, rests) = (of.map(|o| o.0), of.map(|o| o.1));
        instructions.turn(wholes, &mut self.values, lane);
        for (k, sample) in self.values[n - n % 16..].iter_mut().enumerate() {
            for (r, rest) in rests.iter().enumerate() {
                let b = [rest[2 * k], rest[2 * k + 1]];
                sample[lane + r] = f32::from(i16::from_le_bytes(b));
            }
        }
    }

    /// Transposes four contiguous rows to the lanes from `lane` on.
    fn turn(&mut self, rows: [&Row; 4], lane: usize) {
        let n = self.values.len();
        let of = rows.map(|r| &r.samples[r.start * r.format.bytes()..][..n * r.format.bytes()]);
        match rows[0].format {
            Format::S16Le => {
                let of = of.map(|b| b.as_chunks::<16>());
                let (wholes, rests) = (of.map(|o| o.0), of.map(|o| o.1));
                for (i, eight) in self.values.chunks_exact_mut(8).enumerate() {
                    turned::eight_int16([0, 1, 2, 3].map(|r| &wholes[r][i]), eight, lane);
                }
                let from = n - n % 8;
                for (k, sample) in self.values[from..].iter_mut().enumerate() {
                    for (r, rest) in rests.iter().enumerate() {
                        let b = [rest[2 * k], rest[2 * k + 1]];
                        sample[lane + r] = f32::from(i16::from_le_bytes(b));
                    }
                }
            }
            Format::F32Le => {
                let of = of.map(|b| b.as_chunks::<4>().0);
                for (k, sample) in self.values.iter_mut().enumerate() {
                    for (r, of) in of.iter().enumerate() {
                        sample[lane + r] = f32::from_le_bytes(of[k]);
                    }
                }
            }
        }
    }

    /// Counts to deviations: subtracts drive (expected + warmer response), and stores the deviations' square
    /// norms. `expected`: counts; `response`: counts/K.
    pub fn subtract(&mut self, expected: &[f32], response: &[f32], instructions: Instructions) {
        instructions.subtract(self, expected, response);
    }

    pub fn lanes(&self) -> usize {
        self.lanes
    }

    pub fn deviations(&self) -> &[Sample] {
        &self.values
    }

    /// Square norm of a lane's deviation, counts².
    pub fn square_sum(&self, lane: usize) -> f32 {
        self.square_sum[lane]
    }

    /// A lane's relative drive, and its temperature in K above the reference.
    pub fn condition(&self, lane: usize) -> (f32, f32) {
        (self.drive[lane], self.warmer[lane])
    }

    fn is_uniform(&self) -> bool {
        let same = |of: &Sample| of.iter().all(|v| v.to_bits() == of[0].to_bits());
        same(&self.drive) && same(&self.warmer)
    }
}

impl Row<'_> {
    fn is_contiguous(&self, format: Format) -> bool {
        self.stride == 1 && self.format == format
    }

    /// Whether it is the channel after `before` in the same burst.
    fn is_beside(&self, before: &Row) -> bool {
        std::ptr::eq(self.samples, before.samples)
            && self.format == before.format
            && self.stride == before.stride
            && self.start == before.start + 1
    }
}

#[cfg(target_arch = "x86_64")]
mod turned {
    use super::Sample;
    use std::arch::x86_64::*;

    /// Eight samples of four int16 rows.
    #[inline]
    pub fn eight_int16(rows: [&[u8; 16]; 4], eight: &mut [Sample], lane: usize) {
        // SAFETY: SSE2 is part of x86-64
        unsafe { with_sse2(rows, eight, lane) }
    }

    #[inline]
    #[target_feature(enable = "sse2")]
    fn with_sse2(rows: [&[u8; 16]; 4], eight: &mut [Sample], lane: usize) {
        let mut r = [_mm_setzero_si128(); 4];
        for (r, row) in r.iter_mut().zip(rows) {
            // SAFETY: 16 bytes are read from 16 bytes; the load is unaligned
            *r = unsafe { _mm_loadu_si128(row.as_ptr().cast()) };
        }
        let [a, b, c, d] = r;
        // pairs of samples as 32-bit words, 4 x 4 words transposed
        let (ab_low, ab_high) = (_mm_unpacklo_epi32(a, b), _mm_unpackhi_epi32(a, b));
        let (cd_low, cd_high) = (_mm_unpacklo_epi32(c, d), _mm_unpackhi_epi32(c, d));
        let pairs = [
            _mm_unpacklo_epi64(ab_low, cd_low),
            _mm_unpackhi_epi64(ab_low, cd_low),
            _mm_unpacklo_epi64(ab_high, cd_high),
            _mm_unpackhi_epi64(ab_high, cd_high),
        ];
        for (pair, samples) in pairs.into_iter().zip(eight.as_chunks_mut::<2>().0) {
            let first = _mm_srai_epi32::<16>(_mm_slli_epi32::<16>(pair));
            let second = _mm_srai_epi32::<16>(pair);
            for (sample, value) in samples.iter_mut().zip([first, second]) {
                let lanes: &mut [f32] = &mut sample[lane..lane + 4];
                // SAFETY: 4 lanes of 4 bytes are written; the store is unaligned
                unsafe { _mm_storeu_ps(lanes.as_mut_ptr(), _mm_cvtepi32_ps(value)) };
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod turned_avx2 {
    use super::{LANES, Sample};
    use std::arch::x86_64::*;

    /// Sixteen samples at a time of eight int16 rows, into lanes from `lane` on.
    #[target_feature(enable = "avx2")]
    pub fn int16(rows: [&[[u8; 32]]; 8], values: &mut [Sample], lane: usize) {
        assert!(lane + 8 <= LANES);
        let blocks = rows.iter().map(|r| r.len()).min().unwrap_or(0).min(values.len() / 16);
        for (i, sixteen) in values.chunks_exact_mut(16).take(blocks).enumerate() {
            // loops, not `map`: what `map` calls cannot be inlined into it, having other features
            let mut r = [_mm256_setzero_si256(); 8];
            for (r, row) in r.iter_mut().zip(&rows) {
                // SAFETY: 32 bytes are read from 32 bytes; the load is unaligned
                *r = unsafe { _mm256_loadu_si256(row[i].as_ptr().cast()) };
            }
            // pairs of samples as 32-bit words, 8 x 8 words transposed: words, then pairs of words,
            // then halves
            let mut fours = [[r[0]; 4]; 2];
            for (half, four) in fours.iter_mut().enumerate() {
                let (a, b, c, d) = (r[4 * half], r[4 * half + 1], r[4 * half + 2], r[4 * half + 3]);
                let (ab_low, ab_high) = (_mm256_unpacklo_epi32(a, b), _mm256_unpackhi_epi32(a, b));
                let (cd_low, cd_high) = (_mm256_unpacklo_epi32(c, d), _mm256_unpackhi_epi32(c, d));
                *four = [
                    _mm256_unpacklo_epi64(ab_low, cd_low),
                    _mm256_unpackhi_epi64(ab_low, cd_low),
                    _mm256_unpacklo_epi64(ab_high, cd_high),
                    _mm256_unpackhi_epi64(ab_high, cd_high),
                ];
            }
            for (k, (upper, lower)) in fours[0].into_iter().zip(fours[1]).enumerate() {
                let low = _mm256_permute2x128_si256::<0x20>(upper, lower);
                let high = _mm256_permute2x128_si256::<0x31>(upper, lower);
                for (pair, at) in [(low, 2 * k), (high, 2 * k + 8)] {
                    let first = _mm256_srai_epi32::<16>(_mm256_slli_epi32::<16>(pair));
                    let second = _mm256_srai_epi32::<16>(pair);
                    for (value, at) in [(first, at), (second, at + 1)] {
                        let lanes: &mut [f32] = &mut sixteen[at][lane..lane + 8];
                        // SAFETY: 8 lanes of 4 bytes are written; the store is unaligned
                        unsafe { _mm256_storeu_ps(lanes.as_mut_ptr(), _mm256_cvtepi32_ps(value)) };
                    }
                }
            }
        }
    }
}

#[cfg(not(target_arch = "x86_64"))]
mod turned {
    use super::Sample;

    /// Eight samples of four int16 rows.
    pub fn eight_int16(rows: [&[u8; 16]; 4], eight: &mut [Sample], lane: usize) {
        for (k, sample) in eight.iter_mut().enumerate() {
            for (r, row) in rows.iter().enumerate() {
                sample[lane + r] = f32::from(i16::from_le_bytes([row[2 * k], row[2 * k + 1]]));
            }
        }
    }
}

/// An instruction set of the processor. Results do not depend on it, bit by bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Instructions(pub(super) Set);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Set {
    /// What every processor of the target has.
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Instructions {
    /// The sets that this processor has, the widest last.
    pub fn available() -> Vec<Instructions> {
        #[allow(unused_mut)] // on other targets
        let mut sets = vec![Instructions(Set::Portable)];
        #[cfg(target_arch = "x86_64")]
        {
            if std::is_x86_feature_detected!("avx2") {
                sets.push(Instructions(Set::Avx2));
            }
            if sets.len() > 1 && std::is_x86_feature_detected!("avx512f") {
                sets.push(Instructions(Set::Avx512));
            }
        }
        sets
    }

    pub fn best() -> Instructions {
        Instructions::available().pop().unwrap_or(Instructions(Set::Portable))
    }

    pub fn name(self) -> &'static str {
        match self.0 {
            Set::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => "AVX2",
            #[cfg(target_arch = "x86_64")]
            Set::Avx512 => "AVX-512",
        }
    }
}

impl Instructions {
    fn turns_eight(self) -> bool {
        self.0 != Set::Portable
    }

    /// Transposes eight int16 rows, sixteen samples at a time; only if `turns_eight`.
    #[allow(unused_variables)] // on other targets
    fn turn(self, rows: [&[[u8; 32]]; 8], values: &mut [Sample], lane: usize) {
        match self.0 {
            Set::Portable => {}
            // SAFETY: both sets are made only where the processor was found to have AVX2
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 | Set::Avx512 => unsafe { turned_avx2::int16(rows, values, lane) },
        }
    }
}

/// Calls `$function` of the module of a set.
macro_rules! with {
    ($set:expr, $function:ident $(::<$parameter:tt>)?, ($($argument:expr),*)) => {
        match $set {
            Set::Portable => portable::$function$(::<$parameter>)?($($argument),*),
            // SAFETY: `Instructions` are made only where the processor was found to have them
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => unsafe { avx2::$function$(::<$parameter>)?($($argument),*) },
            // SAFETY: as above
            #[cfg(target_arch = "x86_64")]
            Set::Avx512 => unsafe { avx512::$function$(::<$parameter>)?($($argument),*) },
        }
    };
}

impl Instructions {
    fn subtract(self, tile: &mut Tile, expected: &[f32], response: &[f32]) {
        if tile.is_uniform() {
            with!(self.0, subtract::<true>, (tile, expected, response));
        } else {
            with!(self.0, subtract::<false>, (tile, expected, response));
        }
    }

    /// Per lane the square sum of the deviation filtered by b/a from zero state; 1 to 8 poles.
    /// `b`: order + 1 coefficients, `a`: a_1 .. a_order.
    pub(super) fn energies(self, b: &[f32], a: &[f32], deviations: &[Sample], out: &mut Sample) {
        match a.len() {
            1 => with!(self.0, energies::<1>, (b, a, deviations, out)),
            2 => with!(self.0, energies::<2>, (b, a, deviations, out)),
            3 => with!(self.0, energies::<3>, (b, a, deviations, out)),
            4 => with!(self.0, energies::<4>, (b, a, deviations, out)),
            5 => with!(self.0, energies::<5>, (b, a, deviations, out)),
            6 => with!(self.0, energies::<6>, (b, a, deviations, out)),
            7 => with!(self.0, energies::<7>, (b, a, deviations, out)),
            8 => with!(self.0, energies::<8>, (b, a, deviations, out)),
            _ => out.fill(f32::NAN), // decides nothing: the reference judges
        }
    }

    /// Per lane the inner products of the deviation with the columns `p`; equal to `project_rows` bit by bit.
    pub(super) fn project<const M: usize>(
        self,
        p: &[[Phases; M]],
        deviations: &[Sample],
        out: &mut [Sample; M],
    ) {
        with!(self.0, project::<M>, (p, deviations, out));
    }
}

/// The arithmetic, once, for vectors `$V` of `$W` lanes. No operation fuses or reorders another.
macro_rules! arithmetic {
    (
        $name:ident, [$($feature:literal)?], $V:ty, $W:literal,
        $set:path, $load:path, $store:path, $add:path, $sub:path, $mul:path
    ) => {
        mod $name {
            use super::*;
            #[allow(unused_imports)] // the portable one needs none
            #[cfg(target_arch = "x86_64")]
            use std::arch::x86_64::*;

            /// Vectors worked on at a time, so that one's latency hides behind the other.
            const PAIR: usize = 2;

            #[inline]
            $(#[target_feature(enable = $feature)])?
            fn load(sample: &Sample, lane: usize) -> $V {
                let from: &[f32] = &sample[lane..lane + $W];
                // SAFETY: $W lanes are there; the load is unaligned
                #[allow(unused_unsafe)]
                unsafe { $load(from.as_ptr()) }
            }

            #[inline]
            $(#[target_feature(enable = $feature)])?
            fn store(sample: &mut Sample, lane: usize, v: $V) {
                let to: &mut [f32] = &mut sample[lane..lane + $W];
                // SAFETY: as above
                #[allow(unused_unsafe)]
                unsafe { $store(to.as_mut_ptr(), v) }
            }

            /// Of sixteen, in the order of `row_projection::tree`.
            #[inline]
            $(#[target_feature(enable = $feature)])?
            fn tree(mut of: [$V; PHASES]) -> $V {
                for half in [8, 4, 2, 1] {
                    for l in 0..half {
                        of[l] = $add(of[l], of[l + half]);
                    }
                }
                of[0]
            }

            $(#[target_feature(enable = $feature)])?
            pub(super) fn subtract<const UNIFORM: bool>(
                tile: &mut Tile,
                expected: &[f32],
                response: &[f32],
            ) {
                for lane in (0..LANES).step_by(PAIR * $W) {
                    let (mut drive, mut warmer) = ([$set(0.0); PAIR], [$set(0.0); PAIR]);
                    for p in 0..PAIR {
                        drive[p] = load(&tile.drive, lane + p * $W);
                        warmer[p] = load(&tile.warmer, lane + p * $W);
                    }
                    let mut square_sum = [[$set(0.0); PHASES]; PAIR];
                    let rows = tile.values.iter_mut().zip(expected.iter().zip(response));
                    for (k, (sample, (&e, &slope))) in rows.enumerate() {
                        // the same operations on the same numbers: the same bits either way
                        let shared = $set(tile.drive[0] * (e + tile.warmer[0] * slope));
                        for p in 0..PAIR {
                            let y_hat = if UNIFORM {
                                shared
                            } else {
                                $mul(drive[p], $add($set(e), $mul(warmer[p], $set(slope))))
                            };
                            let d = $sub(load(sample, lane + p * $W), y_hat);
                            let sum = &mut square_sum[p][k % PHASES];
                            *sum = $add(*sum, $mul(d, d));
                            store(sample, lane + p * $W, d);
                        }
                    }
                    for p in 0..PAIR {
                        store(&mut tile.square_sum, lane + p * $W, tree(square_sum[p]));
                    }
                }
            }

            /// Direct form II transposed, as `ResidualGenerator::run`.
            $(#[target_feature(enable = $feature)])?
            pub(super) fn energies<const ORDER: usize>(
                b: &[f32],
                a: &[f32],
                deviations: &[Sample],
                out: &mut Sample,
            ) {
                let b_0 = $set(b[0]);
                let (mut fed_by, mut back) = ([$set(0.0); ORDER], [$set(0.0); ORDER]);
                for k in 0..ORDER {
                    fed_by[k] = $set(b[k + 1]);
                    back[k] = $set(a[k]);
                }
                for lane in (0..LANES).step_by(PAIR * $W) {
                    let mut state = [[$set(0.0); ORDER]; PAIR];
                    let mut sum = [$set(0.0); PAIR];
                    for sample in deviations {
                        for p in 0..PAIR {
                            let d = load(sample, lane + p * $W);
                            let r = $add($mul(b_0, d), state[p][0]);
                            for k in 0..ORDER {
                                let fed = $mul(fed_by[k], d);
                                let moved =
                                    if k + 1 < ORDER { $add(state[p][k + 1], fed) } else { fed };
                                state[p][k] = $sub(moved, $mul(back[k], r));
                            }
                            sum[p] = $add(sum[p], $mul(r, r));
                        }
                    }
                    for p in 0..PAIR {
                        store(out, lane + p * $W, sum[p]);
                    }
                }
            }

            $(#[target_feature(enable = $feature)])?
            pub(super) fn project<const M: usize>(
                projections: &[[Phases; M]],
                deviations: &[Sample],
                out: &mut [Sample; M],
            ) {
                for lane in (0..LANES).step_by(PAIR * $W) {
                    let mut sums = [[[$set(0.0); PHASES]; M]; PAIR];
                    for phase in 0..PHASES {
                        let mut c = [[$set(0.0); M]; PAIR];
                        let samples = deviations.iter().skip(phase).step_by(PHASES);
                        for (sample, row) in samples.zip(projections) {
                            for p in 0..PAIR {
                                let d = load(sample, lane + p * $W);
                                for j in 0..M {
                                    c[p][j] = $add(c[p][j], $mul($set(row[j][phase]), d));
                                }
                            }
                        }
                        for p in 0..PAIR {
                            for j in 0..M {
                                sums[p][j][phase] = c[p][j];
                            }
                        }
                    }
                    for p in 0..PAIR {
                        for j in 0..M {
                            store(&mut out[j], lane + p * $W, tree(sums[p][j]));
                        }
                    }
                }
            }
        }
    };
}

/// Four lanes in plain Rust; compilers make vectors of it.
pub(super) mod four {
    pub type V = [f32; 4];
    macro_rules! each {
        ($name:ident, $x:ident, $y:ident, $result:expr) => {
            #[inline(always)]
            pub fn $name(x: V, y: V) -> V {
                std::array::from_fn(|i| {
                    let ($x, $y) = (x[i], y[i]);
                    $result
                })
            }
        };
    }
    each!(add, x, y, x + y);
    each!(sub, x, y, x - y);
    each!(mul, x, y, x * y);

    #[inline(always)]
    pub fn set(x: f32) -> V {
        [x; 4]
    }

    /// # Safety
    /// Four lanes lie at `from`.
    #[inline(always)]
    pub unsafe fn load(from: *const f32) -> V {
        // SAFETY: the caller's promise; an array of f32 is aligned as f32
        unsafe { *from.cast() }
    }

    /// # Safety
    /// Four lanes lie at `to`.
    #[inline(always)]
    pub unsafe fn store(to: *mut f32, v: V) {
        // SAFETY: as above
        unsafe { *to.cast() = v }
    }
}

arithmetic!(
    portable,
    [],
    four::V,
    4,
    four::set,
    four::load,
    four::store,
    four::add,
    four::sub,
    four::mul
);
#[cfg(target_arch = "x86_64")]
arithmetic!(
    avx2,
    ["avx2"],
    __m256,
    8,
    _mm256_set1_ps,
    _mm256_loadu_ps,
    _mm256_storeu_ps,
    _mm256_add_ps,
    _mm256_sub_ps,
    _mm256_mul_ps
);
#[cfg(target_arch = "x86_64")]
arithmetic!(
    avx512,
    ["avx512f"],
    __m512,
    16,
    _mm512_set1_ps,
    _mm512_loadu_ps,
    _mm512_storeu_ps,
    _mm512_add_ps,
    _mm512_sub_ps,
    _mm512_mul_ps
);
