//! Products of a signal with columns, in lanes.
//!
//! In: a signal, one column or a table of them. Out: their products. Lanes are added up in one order,
//! so that the sums are the same whatever vector instructions the processor has; nothing fuses.

/// Samples side by side.
const LANES: usize = 8;
type Lanes = [f64; LANES];

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
