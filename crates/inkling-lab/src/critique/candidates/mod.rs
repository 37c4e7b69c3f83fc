//! Score tests: every cause of the catalogue that acts on the mean signal or through a covariate,
//! as directions in the space of linear extensions, with its likelihood-ratio test.
//!
//! In: a model, its signals, and the nuisances, i.e. what is allowed for before anything is tested:
//! the mean's parameters and the causes in the model. Out: [`Scored`], one per candidate: the best
//! over its shape parameter (frequency, rate, strength), with its value in the catalogue's units.
//!
//! A test has three steps: (1) write the cause as directions, i.e. as what it adds to the signals
//! or to their parameters per unit of its size; (2) compute the statistic g^T K^-1 g beside the
//! nuisance (`Nuisance::test`), at the shape parameter at which it is largest; (3) if the result is
//! of interest, lower the statistic where bursts have more in common than their signals let expect
//! (`clusters`). `shapes` and `lines` hold the causes that act on the mean signal, `follows` those
//! that act through a covariate, `rivals` those without a name. Time is in signal lengths.

mod follows;
mod lines;
mod rivals;
mod shapes;

pub use follows::ParameterTest;
pub use lines::LEAST_PERIODS;

use super::candidate::{Candidate, Objection};
use super::catalogue::{Acts, CATALOGUE, CauseId, Entry, Needs, Per, RIVALS, Shape};
use super::chance::{HINT, surprise};
use super::clusters::Clusters;
use super::covariates::Covariates;
use super::model::{Model, RATIO_OF_RATES};
use super::nuisance::{Both, Nuisance, Tested};
use super::observations::Observations;
use super::space::Direction;
use crate::critique::unmodelled::{Interior, ObservedDecay};

/// A cause as it enters the model: what it adds is the sum of `directions`, each times its
/// coefficient.
#[derive(Clone, Debug)]
pub struct Applied {
    pub id: CauseId,
    /// Its shape parameter: frequency (rad) or rate per signal length, or strength; of an added ring, its phase
    /// (rad) behind the own ring; 0 if none.
    pub shape: f64,
    /// A second one: the damping of a line, per signal length; of a meniscus, its damping over the
    /// predicted one; the second number of a rival. 0 if none.
    pub damping: f64,
    pub coefficients: Vec<f64>,
    pub directions: Vec<Direction>,
}

impl Applied {
    pub fn rigid(id: CauseId, directions: Vec<Direction>, coefficients: Vec<f64>) -> Applied {
        Applied { id, shape: 0.0, damping: 0.0, coefficients, directions }
    }
}

pub type Scored = Candidate<Applied>;

/// Which cause is asked for, and the form that it has in the model, near which its shape is searched; without one
/// all shapes are.
#[derive(Clone, Copy)]
pub struct Asked<'a> {
    pub id: CauseId,
    pub near: Option<&'a Applied>,
}

impl Asked<'_> {
    pub fn anew(id: CauseId) -> Asked<'static> {
        Asked { id, near: None }
    }
}

impl Scored {
    /// A tested shape, the best of `tried` independent ones, as a candidate without a value or a shape parameter.
    fn of(id: CauseId, tested: Tested, directions: Vec<Direction>, tried: f64) -> Scored {
        let degrees = directions.len();
        Scored {
            surprise: surprise(tested.statistic, degrees, tried, f64::INFINITY),
            degrees,
            tried,
            ..Scored::plain(
                id,
                tested.statistic,
                Applied::rigid(id, directions, tested.coefficients),
            )
        }
    }
}

/// The signals that causes are looked for in.
#[derive(Clone, Copy)]
pub struct Setting<'a> {
    pub data: &'a Observations,
    /// Frequencies (rad per signal length) of random tones; lines there are not tested.
    pub avoid: &'a [f64],
}

pub struct ScoreTests<'a> {
    pub model: &'a Model,
    pub data: &'a Observations,
    pub avoid: &'a [f64],
    nuisances: &'a Both<Nuisance<'a>>,
    /// Samples of a signal, N.
    samples: usize,
    /// The mean channel's decay, rates per signal length.
    decay: ObservedDecay,
    /// The ink channel with that output, and its volume and flows at t_a; `None`: there is none.
    interior: Option<Interior>,
}

impl<'a> ScoreTests<'a> {
    pub fn new(
        model: &'a Model,
        Setting { data, avoid }: Setting<'a>,
        nuisances: &'a Both<Nuisance<'a>>,
    ) -> ScoreTests<'a> {
        let t = model.decay();
        let decay = ObservedDecay {
            sigma: t[0].exp(),
            omega: t[1].exp(),
            lambda: t[5].exp(),
            a: t[2],
            b: t[3],
            c: t[4],
        };
        let interior = Interior::ink(&decay, RATIO_OF_RATES);
        let samples = data.samples;
        ScoreTests { model, data, avoid, nuisances, samples, decay, interior }
    }

    /// Tests all causes and rivals that the data can test, in the catalogue's order. An entry that
    /// needs a drive scan is tested without one, too, but then gets an objection.
    pub fn score_all(&self) -> Vec<Scored> {
        let lacks = |e: &Entry| e.needs.lacking(self.data).is_some();
        let scored = |e: &Entry| {
            let mut scored = self.score_one(Asked::anew(e.id))?;
            if lacks(e) {
                scored.objection = Some(Objection::NoDriveScan);
            }
            Some(scored)
        };
        let all = CATALOGUE.iter().chain(&RIVALS);
        let testable = all.filter(|e| e.needs == Needs::DriveScan || !lacks(e));
        testable.filter_map(scored).collect()
    }

    /// `None`: the cause cannot be tested here.
    pub fn score_one(&self, asked: Asked) -> Option<Scored> {
        let mut scored = self.as_if_independent(asked)?;
        if scored.surprise < HINT {
            return Some(scored);
        }

        // what the nuisance cannot stand in for, with its size, as one direction
        let Applied { directions, coefficients, .. } = &scored.form;
        let direction = self.nuisances.of(asked.id).efficient(directions, coefficients);
        let spread = self.clusters().spread(&direction, asked.near.is_some());
        scored.statistic *= spread.statistic;
        scored.sd /= spread.information.sqrt();
        let Scored { statistic, degrees, tried, .. } = scored;
        scored.surprise = surprise(statistic, degrees, tried, spread.dof).min(scored.surprise);
        Some(scored)
    }

    fn clusters(&self) -> Clusters<'a> {
        Clusters { model: self.model, data: self.data }
    }

    fn as_if_independent(&self, asked: Asked) -> Option<Scored> {
        let Covariates { sd, span, .. } = &self.data.beside;
        match asked.id.row().acts {
            Acts::Mean(shape) => self.on_the_mean(asked, shape),
            Acts::Rates { covariate, moves, per: Per::Unit } => {
                self.on_rates(asked.id, covariate, moves, 1.0 / sd[covariate])
            }
            Acts::Rates { covariate, moves, per: Per::Span } => {
                let span = span[covariate] / sd[covariate];
                self.on_rates(asked.id, covariate, moves, span).map(relative)
            }
            Acts::Ring { covariate } => self.added_ring(asked.id, covariate),
            Acts::PreviousRing => self.previous_ring(asked.id),
            Acts::Noise | Acts::Trigger | Acts::Codes => None,
        }
    }

    fn on_the_mean(&self, asked: Asked, shape: Shape) -> Option<Scored> {
        match shape {
            Shape::Constant => self.fixed(asked.id, Direction::shape(0, vec![1.0; self.samples])),
            Shape::Droop => self.droop(asked),
            Shape::SlowMode => self.slow_mode(asked),
            Shape::Transient => self.transient(asked),
            Shape::Tone => self.line(asked, 0, &[0.0]),
            Shape::Mode => {
                let sigma = self.decay.sigma;
                self.line(asked, 1, &[0.4 * sigma, sigma, 2.0 * sigma])
            }
            Shape::Motion(motion) => self.best_of(asked, |place| self.motion(asked, motion, place)),
            Shape::Bent(power) => self.best_of(asked, |second| self.bent(asked, power, second)),
            Shape::Sways => self.sways(asked),
            Shape::Own => self.own_shape(asked),
        }
    }

    fn dof(&self, of_channels: bool) -> f64 {
        let n = if of_channels { self.data.units } else { self.data.len() };
        (n as f64 - 3.0).max(1.0)
    }

    /// Tests one direction that has no shape parameter; the value is the coefficient.
    fn fixed(&self, id: CauseId, direction: Direction) -> Option<Scored> {
        let directions = vec![direction];
        let tested = self.nuisances.of(id).test(&directions)?;
        let (value, sd) = (tested.coefficients[0], tested.covariance[(0, 0)].sqrt());
        if !value.is_finite() || !tested.statistic.is_finite() {
            return None;
        }
        Some(Scored { value, sd, ..Scored::of(id, tested, directions, 1.0) })
    }
}

/// Turns a change of a logarithm, from first to last, into a relative change.
fn relative(scored: Scored) -> Scored {
    let grown = scored.value.exp();
    Scored { value: grown - 1.0, sd: scored.sd * grown, ..scored }
}
