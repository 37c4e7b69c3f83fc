//! Everything that decides a verdict: from a burst and a design to what is said of each channel, and how a
//! design is learned. No file is opened here. The library `inkling` has the map of all rooms (`src/lib.rs`).

// floor 0
pub mod burst;
pub mod fault;
pub mod labels;
pub mod numbers;
pub mod processor;
pub mod promise;
pub mod ranges;
pub mod side_by_side;
pub mod verdict;
// floor 1
pub mod model;
// floor 2
pub mod detect;
pub mod episodes;
pub mod identify;
pub mod isolate;
pub mod state;
// floor 3
pub mod design;
