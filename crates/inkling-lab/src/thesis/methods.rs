//! What chapter 4 tries, thesis §4-2 and §4-3: the training sizes, the methods of isolation that the
//! thesis compares, and the rows of `tables.toml`.
//!
//! Out: their names, by which `measure` files figures and `tables` and `published.toml` refer to them (`figure`), and their settings. Nothing is trained here.

use inkling_core::design::{DetectSettings, IsolateSettings};
use inkling_core::isolate::{IsolateMethod, IsolateSignal};
use serde::Deserialize;
use std::sync::LazyLock;

/// How many of the faulty training signals are learned from, as in thesis Tables 4-6 and 4-7.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    pub name: &'static str,
    divisor: usize,
}

impl Size {
    pub const ALL: Size = Size { name: "all", divisor: 1 };
    /// All sizes, the largest first.
    pub const EACH: [Size; 3] =
        [Size::ALL, Size { name: "half", divisor: 2 }, Size { name: "tenth", divisor: 10 }];

    /// Number of faulty signals to learn from, if there are `faulty` ones.
    pub fn of(self, faulty: usize) -> usize {
        faulty.div_ceil(self.divisor)
    }
}

/// A method of isolation that the thesis compares, on the residual r or the deviation y - y_hat (its y).
pub struct Compared {
    pub name: &'static str,
    pub method: IsolateMethod,
    pub signal: IsolateSignal,
}

/// The methods that the thesis compares: linear regression (LR), and the nearest neighbour (1-NN).
pub const COMPARED: [Compared; 4] = {
    use IsolateMethod::{Neighbours, ResidualMatching};
    use IsolateSignal::{Deviation, Residual};
    [
        Compared { name: "LR on r", method: ResidualMatching, signal: Residual },
        Compared { name: "LR on y", method: ResidualMatching, signal: Deviation },
        Compared { name: "1-NN on r", method: Neighbours, signal: Residual },
        Compared { name: "1-NN on y", method: Neighbours, signal: Deviation },
    ]
};

/// Name of a figure of a method of isolation, `method, size/what`.
pub fn figure(method: &str, size: Size, what: &str) -> String {
    format!("{method}, {}/{what}", size.name)
}

/// What `tables.toml` holds, in the order in which the tables show it.
#[derive(Deserialize)]
pub struct Rows {
    pub detections: Vec<Detection>,
    pub beside: Vec<Beside>,
}

/// A row of the table of detection: the name of its figures, a description, and its settings.
#[derive(Deserialize)]
pub struct Detection {
    pub name: String,
    pub words: String,
    pub settings: DetectSettings,
}

/// A figure that is shown beside the tables.
#[derive(Deserialize)]
pub struct Beside {
    pub figure: String,
    pub words: String,
}

/// The contents of `tables.toml`, which is compiled in.
pub static ROWS: LazyLock<Rows> = LazyLock::new(|| {
    toml::from_str(include_str!("tables.toml")).expect("a test has read the same text")
});

/// The settings that reproduce the thesis's figures: the first row. `mu`: the factor of (3-4).
pub fn thesis_detect(mu: f64) -> DetectSettings {
    DetectSettings { mu, ..ROWS.detections[0].settings.clone() }
}

/// Residual matching on r, as thesis §3-3-2 has it.
pub fn own_isolation() -> IsolateSettings {
    isolation(IsolateMethod::ResidualMatching, IsolateSignal::Residual)
}

/// Settings of isolation of every signal, also of those that detection passes (`gate` is false).
pub fn isolation(method: IsolateMethod, signal: IsolateSignal) -> IsolateSettings {
    IsolateSettings { method, signal, gate: false, ..IsolateSettings::default() }
}
