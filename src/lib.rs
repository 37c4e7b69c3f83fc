//! **inkling** tells, from what a printhead's piezos sense after each drop, which ink channels are
//! faulty, what is wrong with them and how badly.
//!
//! > Offline, training makes a [`design::Design`]. Online, every signal of a burst is judged by the design,
//! > and gives one verdict.
//!
//! # The crates
//!
//! ```text
//! crate              directory            rooms
//! inkling-printhead  src                  main cli settings report pipeline    the program
//! inkling-io         crates/inkling-io    io                                   recordings in, tables out
//! inkling-lab        crates/inkling-lab   critique simulate thesis score plot  known truth, scores, critique
//! inkling-core       crates/inkling-core  all other rooms                      verdicts; opens no file
//! ```
//!
//! The program stands on the three others, and io and lab stand on core and not on each other: cargo refuses
//! anything else. So each crate can be read, compiled and tested with little else in mind
//! (`cargo test --release -p inkling-core`). At the top of the tree lies what a stranger looks for: what is
//! built (`Cargo.toml`), the program (`src`), what its files hold (`schemas`), its tests, a sample to try it
//! on (`sample_logs`) and all of its settings (`pipeline.toml`). `crates` lies beside them, for whoever goes
//! deeper. This library exports the rooms of all four crates: `inkling::design` is there, whichever crate
//! `design` lies in.
//!
//! # The rooms, and the floors they are on (imports go down only; `tests/floors.rs` checks)
//!
//! ```text
//! 5  main  cli  settings             words, bars, exit codes | pipeline.toml
//! 4  pipeline  thesis  io            threads and bounded channels | chapter 4 again | bytes
//! 3  design  critique  simulate      the offline artefact | what the model gets wrong | known truth
//! 2  identify  detect  isolate       thesis 3-1 | 3-2 | 3-3; they meet only in design
//! 3  report                          what a person looks at: stories, maps, trends, the page
//! 2  episodes                        evidence over time, from verdicts alone
//! 2  state                           what is known of a head and of each of its channels now
//! 1  model  score  plot              what the physics says | thesis chapter 4 numbers | figures, pages
//! 0  burst  fault  verdict  labels   what flows
//! 0  promise                         what a design says of itself
//! 0  processor  side_by_side         one function for every set of vector instructions | several threads
//! 0  ranges                          a setting outside of its range is refused by its key
//! 0  numbers                         what nobody derived and several rooms use
//! ```
//!
//! `docs/design/README.md` explains the words that the field does not have.
//!
//! # The walk
//!
//! A recording is read block by block ([`io::recording`]), and its bursts are decoded without copying the
//! samples ([`io::burst_codec`]). A [`burst::SignalBatch`] crosses bounded queues from stage to stage
//! ([`pipeline`]). A healthy window gives a model ([`identify`]), and a model gives a filter
//! ([`detect::null_space`], [`detect::residual_generator`]). The residual's energy, by default a weighted one
//! ([`detect::sensitivity`]), is compared with its threshold ([`detect::threshold`]). What exceeds it is
//! named ([`isolate::residual_matching`]), and every signal becomes one row ([`verdict`],
//! [`io::verdict_table`]).
//!
//! Of a batch of recordings, [`io::job`] says what is to be done with each ([`pipeline::resume`] decides), and
//! [`io::journal`] remembers what became of it.

// the rooms of the other crates
pub use inkling_core::{burst, fault, labels, processor, verdict};
pub use inkling_core::{design, detect, episodes, identify, isolate, model, state};
pub use inkling_io as io;
pub use inkling_lab::{critique, plot, score, simulate, thesis};
// floor 3
pub mod report;
// floor 4
pub mod pipeline;
// floor 5
pub mod cli;
pub mod settings;
