//! Random numbers of the simulator. Each purpose (truth, noise, ...) in each part of a scenario (a set, a
//! printhead) has a stream of its own, a ChaCha stream number under the scenario's seed. So a change of one
//! purpose's draws leaves the numbers of all others as they were.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// What random numbers are drawn for. The numbers here decide what a seed gives, so they must never change.
#[derive(Clone, Copy)]
pub enum Purpose {
    /// Which signals or channels are faulty, and how.
    Truth = 1,
    /// How channels differ, or, in a `classes` scenario, how decays of a class differ.
    Spread = 2,
    /// How a channel's signals differ from burst to burst.
    Shot = 3,
    /// White noise of samples.
    Noise = 4,
    /// Phase of the temperature's sine, and errors of its measurement.
    Temperature = 5,
    /// Drive level of each burst; in hidden runs all conditions of a burst.
    Drive = 6,
    /// Number of neighbours that fire with a channel.
    Neighbours = 7,
    /// What is hidden, and the base of the run that it is hidden in.
    Hidden = 8,
}

/// The random numbers of one purpose in one part of a scenario (a set, or a printhead of a run).
pub fn stream(seed: u64, purpose: Purpose, part: u32) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(((purpose as u64) << 32) | u64::from(part));
    rng
}

/// A random number, uniform between 1 - `half_width` and 1 + `half_width`.
pub fn about_one(half_width: f64, rng: &mut ChaCha8Rng) -> f64 {
    1.0 + half_width * (2.0 * rng.random::<f64>() - 1.0)
}

/// Numbers of the parts, for [`stream`]. They decide what a seed gives, so they must never change.
pub mod part {
    /// The three sets.
    pub const TRAIN: u32 = 0;
    pub const TEST: u32 = 1;
    pub const CALIBRATION: u32 = 2;
    /// The first drying experiment; repeated ones count on from here. From the 13th on they share their
    /// streams with printheads of a print run of the same seed.
    pub const DRYING: u32 = 4;
    /// The first printhead of a print run; further ones count on from here.
    pub const PRINT_RUN: u32 = 16;
    /// Hidden effects; the printheads of a hidden run count on from the next number.
    pub const HIDDEN: u32 = 1 << 20;
}
