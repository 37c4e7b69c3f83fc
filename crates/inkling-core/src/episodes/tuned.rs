//! The numbers of episodes that nobody derived: of the sequential test (`evidence`), of the class
//! filter (`classes`) and of the test for faults that come and go (`intermittent`). `docs/episodes.md`
//! tells what half and twice of each do, which `cargo test --release -p inkling-core episodes::prices
//! -- --nocapture --ignored` prints. Some more stand in `evidence.rs`.

crate::numbers! {
    /// The shift to detect, in standard deviations of a look: 1 gave six false episodes in eleven
    /// print runs of physics.toml, 1.5 one, and found two fewer of 52 slightly dried nozzles.
    shift: f32 = 1.5;
    /// Largest shift that the return to healthy is tested against.
    largest_shift: f32 = 6.0;
    /// Number of looks that a channel's level averages over.
    memory_looks: f32 = 100.0;
    /// Evidence (less than one flagged look's) from which on a channel is a *suspect channel*: its
    /// level and spread then stand still.
    suspicion: f32 = 4.0;
    /// Share of each weight that returns to the priors from one look to the next.
    changes = 0.02;
    /// So many looks at a fault count as one independent look at its class.
    looks_per_one = 2.0;
    /// The flags of a fault that comes and goes are compared with this many times the other
    /// channels' rate.
    of_others = 2.0;
}
