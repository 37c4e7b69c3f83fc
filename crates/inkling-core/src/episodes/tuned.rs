//! The numbers of episodes that nobody derived: first those of the sequential test (`evidence`),
//! then those of the class filter (`classes`) and of the test for faults that come and go
//! (`intermittent`). What half and twice of each do is printed by `cargo test --release -p
//! inkling-core episodes::prices -- --nocapture --ignored`; `docs/episodes.md` has that table. Some
//! more stand in `evidence.rs`: `FLAGGED` and `NOT_FLAGGED`, the weights of the priors (`FIRST`,
//! `OWN`), `MOST_LOWER`, and the clamp of deviations to three standard deviations.

crate::numbers! {
    /// The shift to detect, in standard deviations of a look. Shifts below half of it give no
    /// evidence: healthy levels wander by as much. Chosen on print runs 5102 to 5126 of
    /// physics.toml, judged by a design: 1 gave six false episodes in eleven of them; 1.5 gave one,
    /// and found two fewer of 52 slightly dried nozzles.
    shift: f32 = 1.5;
    /// Largest shift that the return to healthy is tested against, in standard deviations of a
    /// look: what lies beyond half of it is faulty, however large the fault was. Chosen on faults
    /// that flicker (`prices.rs`).
    largest_shift: f32 = 6.0;
    /// Number of looks that a channel's level averages over.
    memory_looks: f32 = 100.0;
    /// Evidence (less than one flagged look's) from which on a channel is a *suspect channel*: its
    /// level and spread then stand still. (`Step::Suspect` is less: any evidence above 0.)
    suspicion: f32 = 4.0;
    /// Share of each weight that returns to the priors from one look to the next, since a fault may
    /// have become another one.
    changes = 0.02;
    /// So many looks at a fault tell as much of its class as one independent look does.
    looks_per_one = 2.0;
    /// The flags of a fault that comes and goes are compared with this many times the rate at which
    /// the other channels of its printhead are flagged.
    of_others = 2.0;
}
