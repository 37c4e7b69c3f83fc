//! What no verdict hangs on: known truth is simulated, verdicts are scored, the model is criticised, the thesis's chapter
//! 4 is done again; and the figures of all that. The library `inkling` is the map (`src/lib.rs`).

// floor 1
pub mod plot;
pub mod score;
// floor 3
pub mod critique;
pub mod simulate;
// floor 4
pub mod thesis;
