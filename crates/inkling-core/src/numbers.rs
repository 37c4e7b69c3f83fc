//! Numbers that decide something, that nobody derived, and that several rooms use. Those of one room stand in a
//! table of the room (a file `tuned.rs`; of the state `process.rs`). `docs/design/numbers.md` tells what half and
//! twice of each do.

/// Fewest signals, channels or temperatures from which more than their mean is estimated; also
/// the weight of a more general value.
pub const FEW: usize = 8;
/// The share that counts as little of a whole, in thresholds, designs and the critique.
pub const LITTLE: f64 = 0.1;
/// Least probability that a look is not what it seems, and least rate of false alarms (thrice
/// the stated one) that the looks at a fault that comes and goes have to exceed.
pub const LEAST_RATE: f64 = 2e-3;
/// Standard deviation of a guessed ln rate. With twice that a design without labelled faults
/// names more on a head of another physics, but calls a stiffer actuator an air bubble in .24
/// instead of .01 of its signals (seeds 2 and 1 of `tests/outside`).
pub const GUESSED_RATE: f64 = 0.2;
