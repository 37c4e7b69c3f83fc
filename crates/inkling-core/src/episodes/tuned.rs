//! The numbers of episodes that nobody derived: of the sequential test (`evidence`), of the class
//! filter (`classes`) and of the test for faults that come and go (`intermittent`). `docs/design/numbers.md`
//! tells what half and twice of each do. Some more stand in `evidence.rs`.

/// The shift to detect, in standard deviations of a look: 1 gave six false episodes in eleven
/// print runs of physics.toml, 1.5 one, and found two fewer of 52 slightly dried nozzles.
pub const SHIFT: f32 = 1.5;
/// Largest shift that the return to healthy is tested against.
pub const LARGEST_SHIFT: f32 = 6.0;
/// Number of looks that a channel's level averages over.
pub const MEMORY_LOOKS: f32 = 100.0;
/// Evidence (less than one flagged look's) from which on a channel is a *suspect channel*: its
/// level and spread then stand still.
pub const SUSPICION: f32 = 4.0;
/// Share of each weight that returns to the priors from one look to the next.
pub const CHANGES: f64 = 0.02;
/// So many looks at a fault count as one independent look at its class.
pub const LOOKS_PER_ONE: f64 = 2.0;
/// The flags of a fault that comes and goes are compared with this many times the other
/// channels' rate.
pub const OF_OTHERS: f64 = 2.0;
