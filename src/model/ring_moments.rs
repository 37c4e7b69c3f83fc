//! The sums over a signal's samples that a ring fit rests on, eight samples at a time.
//!
//! In: a signal and a damped oscillation. Out: [`Moments`], the Gram matrix of the oscillation's
//! columns and of their slopes, and their products with the signal. Lanes are added up in one order,
//! so that the sums are the same whatever vector instructions the processor has; nothing fuses.

/// Samples side by side.
const LANES: usize = 8;
type Lanes = [f64; LANES];

/// Of the columns p (in phase, with the real pole's part), q (quadrature), t p' and t q (p' = p
/// without the real pole's part; t in samples).
#[derive(Clone, Copy, Debug, Default)]
pub struct Moments {
    /// Lower triangle of the columns' Gram matrix, row by row.
    pub gram: [f64; 10],
    /// Products of the columns with the signal.
    pub slope: [f64; 4],
}

/// A damped oscillation e^{-sigma t} (cos, sin)(omega t + phi), by its value at the first sample and
/// its ratio from sample to sample.
#[derive(Clone, Copy, Debug)]
pub struct Oscillation {
    pub first: (f64, f64),
    pub ratio: (f64, f64),
}

fn times(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

impl Oscillation {
    /// Re and im of the first samples, and the ratio over as many samples.
    fn lanes(self) -> ([Lanes; 2], (f64, f64)) {
        let (mut at, mut lanes) = (self.first, [[0.0; LANES]; 2]);
        let [re, im] = &mut lanes;
        for (re, im) in re.iter_mut().zip(im) {
            (*re, *im) = at;
            at = times(at, self.ratio);
        }
        let two = times(self.ratio, self.ratio);
        let four = times(two, two);
        (lanes, times(four, four))
    }
}

impl Moments {
    /// `y`: N, counts. `real`: N, the real pole's part of the first column.
    pub fn of(y: &[f64], real: &[f64], oscillation: Oscillation) -> Moments {
        #[cfg(target_arch = "x86_64")]
        {
            // SAFETY: the processor was found to have what is asked of it
            if std::is_x86_feature_detected!("avx512f") {
                return unsafe { x86::with_avx512(y, real, oscillation) };
            }
            // SAFETY: as above
            if std::is_x86_feature_detected!("avx2") {
                return unsafe { x86::with_avx2(y, real, oscillation) };
            }
        }
        portable(y, real, oscillation)
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Moments, Oscillation, portable};

    #[target_feature(enable = "avx512f")]
    pub fn with_avx512(y: &[f64], real: &[f64], oscillation: Oscillation) -> Moments {
        portable(y, real, oscillation)
    }

    #[target_feature(enable = "avx2")]
    pub fn with_avx2(y: &[f64], real: &[f64], oscillation: Oscillation) -> Moments {
        portable(y, real, oscillation)
    }
}

#[inline(always)] // compiled once per instruction set
fn portable(y: &[f64], real: &[f64], oscillation: Oscillation) -> Moments {
    let ([mut re, mut im], (c, s)) = oscillation.lanes();
    let mut t: Lanes = std::array::from_fn(|l| l as f64);
    let (mut gram, mut slope) = ([[0.0; LANES]; 10], [[0.0; LANES]; 4]);
    let mut add = |y: &Lanes, real: &Lanes, re: &Lanes, im: &Lanes, t: &Lanes| {
        for l in 0..LANES {
            let (p, q) = (re[l] + real[l], -im[l]);
            let (tp, tq) = (t[l] * re[l], t[l] * q);
            let columns = [p, q, tp, tq];
            slope[0][l] += p * y[l];
            slope[1][l] += q * y[l];
            slope[2][l] += tp * y[l];
            slope[3][l] += tq * y[l];
            gram[0][l] += columns[0] * columns[0];
            gram[1][l] += columns[1] * columns[0];
            gram[2][l] += columns[1] * columns[1];
            gram[3][l] += columns[2] * columns[0];
            gram[4][l] += columns[2] * columns[1];
            gram[5][l] += columns[2] * columns[2];
            gram[6][l] += columns[3] * columns[0];
            gram[7][l] += columns[3] * columns[1];
            gram[8][l] += columns[3] * columns[2];
            gram[9][l] += columns[3] * columns[3];
        }
    };
    let ((blocks, rest), (reals, real_rest)) = (y.as_chunks::<LANES>(), real.as_chunks::<LANES>());
    for (y, real) in blocks.iter().zip(reals) {
        add(y, real, &re, &im, &t);
        for l in 0..LANES {
            (re[l], im[l]) = (c * re[l] - s * im[l], s * re[l] + c * im[l]);
            t[l] += LANES as f64;
        }
    }
    if !rest.is_empty() {
        // lanes beyond the signal add nothing
        let (mut y, mut real) = ([0.0; LANES], [0.0; LANES]);
        y[..rest.len()].copy_from_slice(rest);
        let n = rest.len().min(real_rest.len());
        real[..n].copy_from_slice(&real_rest[..n]);
        re[rest.len()..].fill(0.0);
        im[rest.len()..].fill(0.0);
        add(&y, &real, &re, &im, &t);
    }
    Moments { gram: gram.map(sum), slope: slope.map(sum) }
}

/// In a fixed order.
fn sum(lanes: Lanes) -> f64 {
    let half: [f64; 4] = std::array::from_fn(|l| lanes[l] + lanes[l + 4]);
    (half[0] + half[2]) + (half[1] + half[3])
}

/// Inner product of vectors of one length, in lanes.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let mut sums = [0.0; LANES];
    for (a, b) in a.iter().zip(b) {
        for l in 0..LANES {
            sums[l] += a[l] * b[l];
        }
    }
    a_rest.iter().zip(b_rest).fold(sum(sums), |s, (a, b)| s + a * b)
}

/// Columns side by side.
const SIDE: usize = 64;

/// Many columns of one length, for products with a signal; in f32, in panels.
#[derive(Clone, Debug, Default)]
pub struct ColumnTable {
    panels: Vec<Vec<[f32; SIDE]>>,
}

impl ColumnTable {
    pub fn new(columns: &[Vec<f64>]) -> ColumnTable {
        let samples = columns.first().map_or(0, Vec::len);
        let panel = |of: &[Vec<f64>]| -> Vec<[f32; SIDE]> {
            let entry = |k: usize, j: usize| of.get(j).map_or(0.0, |column| column[k] as f32);
            (0..samples).map(|k| std::array::from_fn(|j| entry(k, j))).collect()
        };
        ColumnTable { panels: columns.chunks(SIDE).map(panel).collect() }
    }

    /// Products of every column with a signal, in their order; beyond the last column zeros.
    pub fn products(&self, y: &[f64], out: &mut Vec<f32>) {
        out.clear();
        for panel in &self.panels {
            out.extend(panel_products(y, panel));
        }
    }
}

fn panel_products(y: &[f64], panel: &[[f32; SIDE]]) -> [f32; SIDE] {
    #[cfg(target_arch = "x86_64")]
    {
        // SAFETY: the processor was found to have what is asked of it
        if std::is_x86_feature_detected!("avx512f") {
            return unsafe { panel_x86::with_avx512(y, panel) };
        }
        // SAFETY: as above
        if std::is_x86_feature_detected!("avx2") {
            return unsafe { panel_x86::with_avx2(y, panel) };
        }
    }
    panel_portable(y, panel)
}

#[cfg(target_arch = "x86_64")]
mod panel_x86 {
    use super::{SIDE, panel_portable};

    #[target_feature(enable = "avx512f")]
    pub fn with_avx512(y: &[f64], panel: &[[f32; SIDE]]) -> [f32; SIDE] {
        panel_portable(y, panel)
    }

    #[target_feature(enable = "avx2")]
    pub fn with_avx2(y: &[f64], panel: &[[f32; SIDE]]) -> [f32; SIDE] {
        panel_portable(y, panel)
    }
}

#[inline(always)] // compiled once per instruction set
fn panel_portable(y: &[f64], panel: &[[f32; SIDE]]) -> [f32; SIDE] {
    let mut sums = [0.0f32; SIDE];
    for (y, row) in y.iter().zip(panel) {
        let y = *y as f32;
        for l in 0..SIDE {
            sums[l] += y * row[l];
        }
    }
    sums
}
