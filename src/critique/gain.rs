//! What the extension buys, on signals that nothing was fitted to.

use super::covariates::Covariates;
use super::finding::{Energies, Gain, Misfit};
use super::model::Model;
use super::observations::Observations;

#[derive(Clone, Debug, Default)]
pub struct Measured {
    pub gain: Gain,
    pub misfit: Misfit,
    pub energies: Energies,
    pub auc_gain: f64,
}

pub fn measure(
    _before: &Model,
    _after: &Model,
    _data: &Observations,
    _beside: &Covariates,
) -> Measured {
    Measured::default()
}
