//! The numbers behind the report's pictures.

use super::covariates::Covariates;
use super::finding::{Energies, Figures};
use super::model::Model;
use super::observations::Observations;

pub fn draw(
    _before: &Model,
    _after: &Model,
    _data: &Observations,
    _beside: &Covariates,
    energies: &Energies,
) -> Figures {
    Figures { energies: energies.clone(), ..Figures::default() }
}
