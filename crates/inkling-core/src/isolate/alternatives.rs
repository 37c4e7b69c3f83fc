//! What a flagged signal may be instead of a fault of a known class: a ring of another gain, clock
//! or delay, a channel whose rates are all a little off, a ring of any kind, or what else happens
//! to channels (*contrasts*, `Catalogue::contrasts`). Else the least unlike class would always win.
//!
//! `broad` gives for gain, clock, delay and rates the nodes (Gaussians in the features) whose mean
//! is the alternative's density; contrasts get fault curves. All stand behind the classes in
//! [`super::physics_density::FaultCurves`]. [`weigh`] is Bayes' rule for the features x:
//!
//! ```text
//! P(any class | x) = (1 - w) sum of prior_k p(x | class k) / all
//! all = that numerator + sum of weight_j p(x | alternative j) + no_class p(x | any ring)
//! w   = sum of weight_j + no_class: the weight of all that is no class
//! ```
//!
//! The weights are heuristic; `docs/design/isolation.md` tells on what they were chosen.

use super::fault_curve::{HealthySpread, Node};
use super::posterior::ROUNDED_AWAY;
use super::tuned;
use crate::model::ring_fit::{Features, RingFitter};
use crate::numbers::GUESSED_RATE;
use crate::verdict::Appearance;
use nalgebra::{Matrix4, SMatrix, Vector4};
use std::sync::Arc;

#[derive(Clone, Debug, PartialEq)]
pub enum Alternative {
    Gain,
    /// A healthy ring whose damping and frequency are changed by the same factor.
    Clock,
    Delay,
    /// A channel whose four rates are a little off, independently of each other.
    Rates,
    /// An effect of the catalogue that is no class, by its name.
    Contrast(Arc<str>),
}

impl Alternative {
    /// `x`: four features, relative to the healthy ring of `frequency_hz`. What the words say must
    /// hold of the signal itself; otherwise it is described as a ring that nobody knows.
    pub fn appearance(&self, x: &[f64], frequency_hz: f64) -> Appearance {
        // a phase behind the healthy one is a late ring
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

/// Delays below this, s, are not told: the words give tenths of a microsecond.
const LEAST_DELAY_S: f64 = 0.5e-7;
/// Number of nodes of a line of gains, clocks or delays.
const NODES: usize = 40;

/// The alternatives that are not of the catalogue, each with its equally likely nodes: gain, clock
/// and delay are lines through the healthy features, `most_off` to either side, and the rates a few
/// wide Gaussians. `noise`: standard deviation of one sample, counts; `healthy`: how channels
/// differ, which widens every node.
pub(super) fn broad(
    fitter: &RingFitter,
    noise: f64,
    healthy: &HealthySpread,
) -> Option<Vec<(Alternative, Vec<Node>)>> {
    let node = |at: Vector4<f64>, belief| {
        let noise = fitter.noise_covariance(&Features::from(at), noise)?;
        Node::displaced(at, belief, noise, healthy)
    };
    let beside = Matrix4::from_diagonal(&Vector4::from(tuned::OF_LAW).map(|sd| sd * sd));
    let late = tuned::MOST_OFF[2] * fitter.dt_s;
    // the phase by which the longest delay turns the ring
    let turn = std::f64::consts::TAU * fitter.ring.frequency_hz * late;

    // Nodes at equal distances from -`to` to `to`, each widened along the line by the variance of a
    // uniform density as long as the distance of two nodes, and in all features by `beside`.
    let line = |to: [f64; 4]| -> Option<Vec<Node>> {
        let to = Vector4::from(to);
        let between = to * to.transpose() / (NODES * NODES * 3) as f64;
        let at = (0..NODES).map(|i| to * ((2 * i + 1) as f64 / NODES as f64 - 1.0));
        at.map(|at| node(at, beside + between)).collect()
    };

    // Rates off by half of what a guessed rate is uncertain by, by as much, and by twice as much.
    let rates = [0.5, 1.0, 2.0].map(|times| {
        let square = (times * GUESSED_RATE).powi(2);
        let variances = [square, square, square, square, 0.0];
        let of_rates = SMatrix::<f64, 5, 5>::from_diagonal(&variances.into());
        node(Vector4::zeros(), healthy.slope * of_rates * healthy.slope.transpose())
    });

    let [gain, clock, _] = tuned::MOST_OFF;
    Some(vec![
        (Alternative::Gain, line([gain, 0.0, 0.0, 0.0])?),
        (Alternative::Clock, line([0.0, clock, clock, 0.0])?),
        (Alternative::Delay, line([late * fitter.ring.damping_per_s, 0.0, 0.0, -turn])?),
        (Alternative::Rates, rates.into_iter().collect::<Option<_>>()?),
    ])
}

#[derive(Clone, Copy, Debug)]
pub struct AlternativePosterior {
    pub of_any: f64,
    /// Number and probability of the likeliest; `None`: a ring of any kind is likelier.
    pub alternative: Option<(usize, f64)>,
}

/// `features`: relative to the healthy ring; `priors`: of each class, up to a factor;
/// `ln_alternatives`: ln of density times weight ([`super::physics_density::Comparison`]);
/// `of_no_class`: the weight of all alternatives and of any ring.
pub fn weigh(
    features: &[f64],
    ln_densities: &[f64],
    priors: &[f64],
    (ln_alternatives, of_no_class): (&[f64], f64),
) -> AlternativePosterior {
    let all: f64 = priors.iter().sum();
    let ln_share = ((1.0 - of_no_class) / all).ln();
    let any = tuned::NO_CLASS.ln() + ln_density_of_any_ring(features);
    let most = ln_densities.iter().chain(ln_alternatives).copied().fold(any, f64::max);

    // densities relative to the largest; most are so far off that they add nothing
    let density = |ln: f64| if ln > most - ROUNDED_AWAY { (ln - most).exp() } else { 0.0 };
    let of_classes = ln_densities.iter().zip(priors);
    let of_classes: f64 = of_classes.map(|(ln, prior)| prior * density(ln + ln_share)).sum();
    let of_all =
        of_classes + ln_alternatives.iter().copied().map(density).sum::<f64>() + density(any);

    // the likeliest alternative; of equals the first
    let likeliest = ln_alternatives.iter().enumerate();
    let likeliest = likeliest.reduce(|best, next| if next.1 > best.1 { next } else { best });
    let likeliest = likeliest.filter(|(_, ln)| **ln > any);
    AlternativePosterior {
        of_any: of_classes / of_all,
        alternative: likeliest.map(|(number, ln)| (number, density(*ln) / of_all)),
    }
}

/// ln density of a ring of which nothing is known: Student's t with three degrees of freedom in
/// each of its first three features, and a uniform phase.
fn ln_density_of_any_ring(features: &[f64]) -> f64 {
    /// ln of the density of Student's t with three degrees of freedom at 0.
    const AT_ZERO: f64 = -1.000_888_849_6;
    let along =
        |(x, scale): (&f64, f64)| AT_ZERO - scale.ln() - 2.0 * ((x / scale).powi(2) / 3.0).ln_1p();
    features.iter().zip(tuned::ANY).map(along).sum::<f64>() - std::f64::consts::TAU.ln()
}
