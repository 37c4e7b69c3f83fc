//! How far healthy looks scatter about their own channels: noise, and what differs from drop to drop.
//!
//! In: square distances of healthy looks from the mean of their channel's earlier ones, from `head`. Out: the variance of
//! one look about its channel, and of channels about their head, by what a design says of both together.

use super::kind::{Features, at_least_as_wide};
use super::process;
use nalgebra::Matrix4;

/// How far healthy looks lie off their own channels, canonical: noise, and what differs from drop to
/// drop. A design does not know how much of healthy signals' differences lasts, so a head begins
/// with nothing lasting and learns by its looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Within {
    /// Mean square, as a matrix, of looks' distances from the mean of their channel's looks before.
    pub covariance: Matrix4<f64>,
    pub looks: f64,
}

impl Within {
    /// Of one look about its channel: between the design's noise and what healthy signals differ by.
    pub fn noise(&self, spread: &Features) -> Features {
        self.covariance.diagonal().zip_map(spread, |v, s2| v.clamp(1.0, 1.0 + s2))
    }

    pub fn of_look(&self, spread: &Features) -> Matrix4<f64> {
        // a variance that chance made negative has no root: its factor is 1
        let all = spread.add_scalar(1.0);
        let reduced =
            self.covariance.diagonal().zip_map(&all, |v, most| (most / v).sqrt().min(1.0));
        let reduced = Matrix4::from_diagonal(&reduced);
        at_least_as_wide(1.0, &(reduced * self.covariance * reduced))
    }

    pub fn lasting(&self, spread: &Features) -> Features {
        spread.add_scalar(1.0) - self.noise(spread)
    }

    /// `square`: unbiased measurement of the covariance; `weight`: probability of a healthy look.
    pub fn learn(&mut self, square: Matrix4<f64>, weight: f64) {
        self.looks = (self.looks + weight).min(process::MOST_WITHIN);
        self.covariance += (square - self.covariance) * (weight / self.looks);
    }
}
