//! Numbers that the options give beside the samples.

use inkling_io::matrix::Matrix;

/// A number that an option gives: the same for all bursts, or read from a column, which stands at that place among those
/// beside the samples.
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

    pub fn in_burst(self, matrix: &Matrix) -> f64 {
        match self {
            BurstValue::Constant(x) => x,
            BurstValue::Column(place) => matrix.beside.get(place).copied().unwrap_or(f64::NAN),
        }
    }
}

/// The values of `--period-s`, `--temperature` and `--voltage`; `None`: the option is not given.
#[derive(Debug)]
pub struct BurstValues {
    pub period_s: Option<BurstValue>,
    pub temperature: Option<BurstValue>,
    pub voltage: Option<BurstValue>,
    /// The columns that they name.
    pub columns: Vec<String>,
}
