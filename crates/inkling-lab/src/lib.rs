//! The parts on which no verdict depends: recordings with known truth are simulated, verdicts are scored, the
//! model is criticised, chapter 4 of the thesis is done again, and figures of all that are drawn. The library
//! `inkling` has the map of the code (`src/lib.rs`).

// floor 1
pub mod plot;
pub mod score;
// floor 3
pub mod critique;
pub mod simulate;
// floor 4
pub mod thesis;
