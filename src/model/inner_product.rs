//! Products of a signal with a column, in lanes.
//!
//! In: a signal and a column. Out: their product. Lanes are added up in one order,
//! so that the sums are the same whatever vector instructions the processor has; nothing fuses.

/// Samples side by side.
const LANES: usize = 8;
type Lanes = [f64; LANES];

/// In a fixed order.
#[inline(always)] // compiled once per instruction set
fn sum(lanes: Lanes) -> f64 {
    let half: [f64; 4] = std::array::from_fn(|l| lanes[l] + lanes[l + 4]);
    (half[0] + half[2]) + (half[1] + half[3])
}

/// Inner product of vectors of one length, in lanes.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    #[cfg(target_arch = "x86_64")]
    {
        // SAFETY: the processor was found to have what is asked of it
        if std::is_x86_feature_detected!("avx512f") {
            return unsafe { x86::with_avx512(a, b) };
        }
        // SAFETY: as above
        if std::is_x86_feature_detected!("avx2") {
            return unsafe { x86::with_avx2(a, b) };
        }
    }
    portable(a, b)
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::portable;

    #[target_feature(enable = "avx512f")]
    pub fn with_avx512(a: &[f64], b: &[f64]) -> f64 {
        portable(a, b)
    }

    #[target_feature(enable = "avx2")]
    pub fn with_avx2(a: &[f64], b: &[f64]) -> f64 {
        portable(a, b)
    }
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
