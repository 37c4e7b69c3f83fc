//! Numbers that options give for bursts, beside the samples.

use inkling_io::matrix::Matrix;

/// A number that an option gives: a constant for all bursts, or the index of a column among those that are
/// read beside the samples.
#[derive(Clone, Copy, Debug)]
pub enum BurstValue {
    Constant(f64),
    Column(usize),
}

impl BurstValue {
    /// The value of an option; a column that it names is added to `columns`.
    pub fn of(text: &Option<String>, columns: &mut Vec<String>) -> Option<BurstValue> {
        let text = text.as_ref()?;
        Some(match text.parse() {
            Ok(x) => BurstValue::Constant(x),
            Err(_) => {
                columns.push(text.clone());
                BurstValue::Column(columns.len() - 1)
            }
        })
    }

    /// The number for one burst; NaN if its column has none.
    pub fn in_burst(self, matrix: &Matrix) -> f64 {
        match self {
            BurstValue::Constant(x) => x,
            BurstValue::Column(place) => matrix.beside.get(place).copied().unwrap_or(f64::NAN),
        }
    }
}

/// The values of `--period-s`, `--temperature` and `--voltage`; `None` if the option is not given.
#[derive(Debug)]
pub struct BurstValues {
    pub period_s: Option<BurstValue>,
    pub temperature: Option<BurstValue>,
    pub voltage: Option<BurstValue>,
    /// The columns that the options name.
    pub columns: Vec<String>,
}
