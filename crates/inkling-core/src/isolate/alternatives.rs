//! What a flagged signal may be that is a fault of no class: another gain, a clock, a delay, rates that are all a little off,
//! a ring of any kind; and by name what else happens to channels (`Catalogue::contrasts`).
//!
//! In: how healthy channels differ, the healthy ring. Out: their densities beside the classes' in [`super::physics_density::FaultCurves`], and the
//! probability that a signal is of any class at all. The weights are a priori shares of what is flagged. What they were chosen
//! on, and what others do: `docs/names.md`.

use super::fault_curve::{HealthySpread, Node, noise_of_fit};
use super::posterior::ROUNDED_AWAY;
use super::tuned;
use crate::model::ring_fit::{Features, RingFitter};
use crate::verdict::Appearance;
use nalgebra::{Matrix4, SMatrix, Vector4};
use std::sync::Arc;

/// What no class stands for.
#[derive(Clone, Debug, PartialEq)]
pub enum Alternative {
    Gain,
    Clock,
    Delay,
    Rates,
    /// Of the catalogue, by its name.
    Contrast(Arc<str>),
}

impl Alternative {
    /// What a signal looks like by it. `x`: its features, relative to the healthy ring of `frequency_hz`. What the words of
    /// an alternative say must be so of the signal itself, or it is a ring that nobody knows.
    pub fn appearance(&self, x: &[f64], frequency_hz: f64) -> Appearance {
        let late_s = -x[3] / (std::f64::consts::TAU * frequency_hz);
        match self {
            Alternative::Gain => Appearance::OtherGain(x[0].exp()),
            Alternative::Clock if (x[1] - x[2]).abs() > 0.5 * x[2].abs() => Appearance::OtherRing,
            Alternative::Clock => Appearance::OtherClock(x[2].exp()),
            Alternative::Delay if late_s.abs() < LEAST_DELAY_S => Appearance::OtherRing,
            Alternative::Delay => Appearance::Late(late_s),
            Alternative::Rates => Appearance::AllOff,
            Alternative::Contrast(name) => Appearance::Like(name.clone()),
        }
    }
}

/// A shorter delay is told as none: words have a digit of microseconds.
const LEAST_DELAY_S: f64 = 0.5e-7;
/// Nodes of a line of such.
const NODES: usize = 40;

/// The ring that healthy channels have, as sampled.
pub(super) struct HealthyRing<'a> {
    pub fitter: &'a RingFitter,
    pub damping_per_s: f64,
    pub frequency_hz: f64,
    /// Of one sample, counts.
    pub noise: f64,
    pub dt_s: f64,
}

impl HealthyRing<'_> {
    /// The alternatives that no fault makes, each with its weight and nodes.
    pub fn broad(&self, healthy: &HealthySpread) -> Option<Vec<Broad>> {
        let beside = Matrix4::from_diagonal(&Vector4::from(tuned::beside()).map(|sd| sd * sd));
        let late = tuned::most_off()[2] * self.dt_s;
        let turn = std::f64::consts::TAU * self.frequency_hz * late;
        let line = |what, weight, to: [f64; 4]| {
            let to = Vector4::from(to);
            let between = to * to.transpose() / (NODES * NODES * 3) as f64;
            let at = (0..NODES).map(|i| to * ((2 * i + 1) as f64 / NODES as f64 - 1.0));
            let nodes = at.map(|at| self.node(at, beside + between, healthy));
            Some(Broad { what, weight, nodes: nodes.collect::<Option<_>>()? })
        };
        let rates = tuned::rates_off().map(|off| {
            let variances = [
                off * off,
                off * off,
                off * off,
                off * off,
                tuned::gain_beside() * tuned::gain_beside(),
            ];
            let of_rates = SMatrix::<f64, 5, 5>::from_diagonal(&variances.into());
            let belief = healthy.slope * of_rates * healthy.slope.transpose();
            self.node(Vector4::zeros(), belief, healthy)
        });
        let rates = rates.into_iter().collect::<Option<Vec<Node>>>()?;
        Some(vec![
            line(Alternative::Gain, tuned::gain(), [tuned::most_off()[0], 0.0, 0.0, 0.0])?,
            line(
                Alternative::Clock,
                tuned::clock(),
                [0.0, tuned::most_off()[1], tuned::most_off()[1], 0.0],
            )?,
            line(Alternative::Delay, tuned::delay(), [late * self.damping_per_s, 0.0, 0.0, -turn])?,
            Broad { what: Alternative::Rates, weight: tuned::rates(), nodes: rates },
        ])
    }

    fn node(
        &self,
        at: Vector4<f64>,
        belief: Matrix4<f64>,
        healthy: &HealthySpread,
    ) -> Option<Node> {
        let [ln_amplitude, ln_damping, ln_frequency, phase_rad] = at.into();
        let ring = Features { ln_amplitude, ln_damping, ln_frequency, phase_rad };
        Node::displaced(at, belief, noise_of_fit(self.fitter, &ring, self.noise)?, healthy)
    }
}

/// One of them, all of its nodes as likely.
pub(super) struct Broad {
    pub what: Alternative,
    pub weight: f64,
    pub nodes: Vec<Node>,
}

/// A signal among the classes and all else that it may be.
#[derive(Clone, Copy, Debug)]
pub struct Weighed {
    /// Probability that it is of any class.
    pub of_any: f64,
    /// The likeliest alternative by its number, and its probability; `None`: rather any ring at all.
    pub alternative: Option<(usize, f64)>,
}

/// `ln_densities`: of its features in each class; `priors`: of each class; `ln_alternatives`: its densities times their weights
/// ([`super::physics_density::Comparison`]), which with that of any ring add up to `of_no_class`.
pub fn weigh(
    features: &[f64],
    ln_densities: &[f64],
    priors: &[f64],
    (ln_alternatives, of_no_class): (&[f64], f64),
) -> Weighed {
    let all: f64 = priors.iter().sum();
    let known = ((1.0 - of_no_class) / all).ln();
    let any = tuned::any_ring().ln() + ln_density_of_any_ring(features);
    let most = ln_densities.iter().chain(ln_alternatives).copied().fold(any, f64::max);
    // most are so far off that they add nothing
    let density = |ln: f64| if ln > most - ROUNDED_AWAY { (ln - most).exp() } else { 0.0 };
    let of_classes = ln_densities.iter().zip(priors);
    let of_classes: f64 = of_classes.map(|(ln, prior)| prior * density(ln + known)).sum();
    let of_all =
        of_classes + ln_alternatives.iter().copied().map(density).sum::<f64>() + density(any);
    let likeliest = ln_alternatives.iter().enumerate();
    let likeliest = likeliest.reduce(|best, next| if next.1 > best.1 { next } else { best });
    let likeliest = likeliest.filter(|(_, ln)| **ln > any);
    Weighed {
        of_any: of_classes / of_all,
        alternative: likeliest.map(|(number, ln)| (number, density(*ln) / of_all)),
    }
}

/// Of a ring of which nothing is known; the phase anywhere.
fn ln_density_of_any_ring(features: &[f64]) -> f64 {
    /// ln of the density of Student's t with three degrees of freedom at 0.
    const AT_ZERO: f64 = -1.000_888_849_6;
    let along =
        |(x, scale): (&f64, f64)| AT_ZERO - scale.ln() - 2.0 * ((x / scale).powi(2) / 3.0).ln_1p();
    features.iter().zip(tuned::any()).map(along).sum::<f64>() - std::f64::consts::TAU.ln()
}
