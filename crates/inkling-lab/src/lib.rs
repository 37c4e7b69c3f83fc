//! The parts on which no verdict depends: recordings with known truth are simulated (`simulate`),
//! verdicts are scored against labels (`score`), the model is criticised (`critique`), chapter 4 of
//! the thesis is done again (`thesis`), and figures are drawn (`plot`). The
//! library `inkling` has the map of the code (`src/lib.rs`) and explains the floors; its verbs call
//! these rooms.

// floor 1
pub mod plot;
pub mod score;
// floor 3
pub mod critique;
pub mod simulate;
// floor 4
pub mod thesis;
