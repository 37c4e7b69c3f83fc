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

use super::candidate::Candidate;
use super::catalogue::{Acts, CATALOGUE, CauseId, Entry, Needs, RIVALS, Shape};
use super::chance::{HINT, surprise};
use super::clusters::Clusters;
use super::model::{Model, RATIO_OF_RATES};
use super::nuisance::{Both, Nuisance, Tested};
use super::objection::Objection;
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
            let mut scored = self.score_one(e.id, None)?;
            if lacks(e) {
                scored.objection = Some(Objection::NoDriveScan);
            }
            Some(scored)
        };
        let all = CATALOGUE.iter().chain(&RIVALS);
        let testable = all.filter(|e| e.needs == Needs::DriveScan || !lacks(e));
        testable.filter_map(scored).collect()
    }

    /// `near`: the form that the cause has in the model, near which its shape is searched; without it all
    /// shapes are searched. Gives `None` if the cause cannot be tested here.
    pub fn score_one(&self, id: CauseId, near: Option<&Applied>) -> Option<Scored> {
        let mut scored = self.as_if_independent(id, near)?;
        if scored.surprise < HINT {
            return Some(scored);
        }

        // what the nuisance cannot stand in for, with its size, as one direction
        let Applied { directions, coefficients, .. } = &scored.form;
        let direction = self.nuisances.of(id).efficient(directions, coefficients);
        let spread = self.clusters().spread(&direction, near.is_some());
        scored.statistic *= spread.statistic;
        scored.sd /= spread.information.sqrt();
        let Scored { statistic, degrees, tried, .. } = scored;
        scored.surprise = surprise(statistic, degrees, tried, spread.dof).min(scored.surprise);
        Some(scored)
    }

    fn clusters(&self) -> Clusters<'a> {
        Clusters { model: self.model, data: self.data }
    }

    fn as_if_independent(&self, id: CauseId, near: Option<&Applied>) -> Option<Scored> {
        match id.row().acts {
            Acts::Mean(shape) => self.on_the_mean(id, shape, near),
            Acts::Rates { covariate, moves, per } => self.rates(id, covariate, moves, per),
            Acts::Ring { covariate } => self.added_ring(id, covariate),
            Acts::PreviousRing => self.previous_ring(id),
            Acts::Noise | Acts::Trigger | Acts::Codes => None,
        }
    }

    fn on_the_mean(&self, id: CauseId, shape: Shape, near: Option<&Applied>) -> Option<Scored> {
        match shape {
            Shape::Constant => self.fixed(id, Direction::shape(0, vec![1.0; self.samples])),
            Shape::Droop => self.droop(id, near),
            Shape::SlowMode => self.slow_mode(id, near),
            Shape::Transient => self.transient(id, near),
            Shape::Tone => self.line(id, 0, &[0.0], near),
            Shape::Mode => {
                let sigma = self.decay.sigma;
                self.line(id, 1, &[0.4 * sigma, sigma, 2.0 * sigma], near)
            }
            Shape::Motion(motion) => {
                self.best_of(id, near, |place| self.motion(id, motion, place, near))
            }
            Shape::Bent(power) => {
                self.best_of(id, near, |second| self.bent(id, power, second, near))
            }
            Shape::Sways => self.sways(id, near),
            Shape::Own => self.own_shape(id, near),
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
        Some(Scored { value, sd, ..self.shaped(id, tested, directions, 0.0, 1.0) })
    }

    /// A tested shape, the best of `tried` independent ones, as a candidate without a value;
    /// `shape`: its shape parameter.
    fn shaped(
        &self,
        id: CauseId,
        tested: Tested,
        directions: Vec<Direction>,
        shape: f64,
        tried: f64,
    ) -> Scored {
        let degrees = directions.len();
        let rigid = Applied::rigid(id, directions, tested.coefficients);
        Scored {
            surprise: surprise(tested.statistic, degrees, tried, f64::INFINITY),
            degrees,
            tried,
            ..Scored::plain(id, tested.statistic, Applied { shape, ..rigid })
        }
    }
}
