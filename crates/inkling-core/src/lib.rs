//! Everything that decides a verdict: from a burst and a design to what is said of each channel,
//! and how a design is learned. No file is opened here: `inkling-io` reads and writes, the pipeline
//! of the package `inkling` calls this crate from its threads. The map of all rooms stands in
//! `src/lib.rs` of that package; the thesis that is implemented is cited as `thesis (3-4)`.
//!
//! Rooms lie on floors, and a room imports only from floors below (a test checks it): the nouns and
//! small helpers; `model`, what the physics says; the steps of the method, which do not know each
//! other; and `design`, where the steps meet.

// floor 0: nouns, and helpers that know no physics
pub mod burst;
pub mod fault;
pub mod labels;
pub mod numbers;
pub mod processor;
pub mod promise;
pub mod ranges;
pub mod side_by_side;
pub mod verdict;
// floor 1: the physics of a channel, rings and their fits
pub mod model;
// floor 2: the steps of the method
pub mod detect;
pub mod episodes;
pub mod identify;
pub mod isolate;
pub mod state;
// floor 3: the offline artefact, and judging by it
pub mod design;
