//! Random numbers: each purpose has a stream of its own.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// What random numbers are drawn for. Each (purpose, part) is a stream of its own. The numbers of the
/// purposes decide what a seed gives, so they never change.
#[derive(Clone, Copy)]
pub enum Purpose {
    Truth = 1,
    Spread = 2,
    Shot = 3,
    Noise = 4,
    Temperature = 5,
    Drive = 6,
    Neighbours = 7,
    Hidden = 8,
}

/// The random numbers of one purpose in one part of a scenario (a set, or a printhead of a run).
pub fn stream(seed: u64, purpose: Purpose, part: u32) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(((purpose as u64) << 32) | u64::from(part));
    rng
}

/// A uniform number within `half_width` of 1.
pub fn about_one(half_width: f64, rng: &mut ChaCha8Rng) -> f64 {
    1.0 + half_width * (2.0 * rng.random::<f64>() - 1.0)
}

/// Parts for [`stream`]: the sets; the printheads of a print run count on from `PRINT_RUN`.
pub mod part {
    pub const TRAIN: u32 = 0;
    pub const TEST: u32 = 1;
    pub const CALIBRATION: u32 = 2;
    /// First part of the drying experiments; further experiments count on from here.
    pub const DRYING: u32 = 4;
    pub const PRINT_RUN: u32 = 16;
    /// Part of hidden effects; their printheads count on from the next one.
    pub const HIDDEN: u32 = 1 << 20;
}
