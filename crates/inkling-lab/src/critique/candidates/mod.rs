//! Every cause of the catalogue that acts on the mean signal or through a covariate, as directions in
//! the space of linear extensions, and its likelihood-ratio test.
//!
//! In: the space, the model, what is in the model already. Out: [`Scored`], one per candidate: the best
//! over its shape parameter (frequency, rate, strength), with its value in the catalogue's units.
//! `shapes` and `lines` act on the mean signal, `follows` through a covariate; `rivals` have no name.

mod follows;
mod lines;
mod rivals;
mod shapes;

pub use lines::LEAST_PERIODS;

use super::candidate::{Candidate, Objection};
use super::catalogue::{Acts, CATALOGUE, CauseId, Needs, RIVALS, Shape};
use super::chance::{HINT, surprise};
use super::clusters::Clusters;
use super::model::{Model, RATIO_OF_RATES};
use super::nuisance::{Nuisance, Nuisances, Tested};
use super::observations::Observations;
use super::space::Direction;
use crate::critique::tuned::tie;
use inkling_core::model::free_decay::ALL;
use inkling_core::model::terms::{Interior, ObservedDecay};

/// What a relative change of damping, of frequency and of all rates changes in a [`Model`]'s parameters (the real pole
/// follows the damping by itself), where the interior is not known.
const DAMPING: [f64; ALL] = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
const FREQUENCY: [f64; ALL] = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0];
const CLOCK: [f64; ALL] = [1.0, 1.0, 0.0, 0.0, 0.0, 0.0];

/// A cause as it enters the model.
#[derive(Clone, Debug)]
pub struct Applied {
    pub id: CauseId,
    /// Frequency or rate per signal length, or strength; 0 where there is none.
    pub shape: f64,
    /// Damping of a line, per signal length; a rival's second number.
    pub damping: f64,
    pub coefficients: Vec<f64>,
    pub directions: Vec<Direction>,
    pub kind: Kind,
}

impl Applied {
    /// A cause whose directions are what they are, whatever its size.
    pub fn rigid(
        id: CauseId,
        directions: Vec<Direction>,
        coefficients: Vec<f64>,
        kind: Kind,
    ) -> Applied {
        Applied { id, shape: 0.0, damping: 0.0, coefficients, directions, kind }
    }
}

#[derive(Clone, Debug)]
pub enum Kind {
    /// What its directions add to the mean signal.
    Shapes,
    /// One change of the parameters per coefficient.
    Covariate {
        which: usize,
        v: Vec<[f64; ALL]>,
    },
    Tail,
}

/// A candidate as it would enter the model.
pub type Scored = Candidate<Applied>;

/// What signals are looked at for.
#[derive(Clone, Copy)]
pub struct Setting<'a> {
    pub data: &'a Observations,
    /// Frequencies that random tones have taken already, rad per signal length.
    pub avoid: &'a [f64],
}

/// Everything that a candidate is built from.
pub struct ScoreTests<'a> {
    pub model: &'a Model,
    pub data: &'a Observations,
    /// Frequencies (rad per signal length) that random tones have taken already.
    pub avoid: &'a [f64],
    /// Channels free: shapes.
    shapes: &'a Nuisance<'a>,
    /// Channels scattered: covariates.
    covariates: &'a Nuisance<'a>,
    samples: usize,
    seen: ObservedDecay,
    interior: Option<Interior>,
}

impl<'a> ScoreTests<'a> {
    pub fn new(
        model: &'a Model,
        Setting { data, avoid }: Setting<'a>,
        Nuisances { shapes, covariates }: &'a Nuisances<'a>,
    ) -> ScoreTests<'a> {
        let t = model.decay();
        let seen = ObservedDecay {
            sigma: t[0].exp(),
            omega: t[1].exp(),
            lambda: t[5].exp(),
            a: t[2],
            b: t[3],
            c: if model.real { t[4] } else { 0.0 },
        };
        let interior = match model.real {
            true => Interior::ink(&seen, RATIO_OF_RATES),
            false => Some(Interior::oscillator(&seen)),
        };
        let samples = data.samples;
        ScoreTests { model, data, avoid, shapes, covariates, samples, seen, interior }
    }

    /// All that can be tested; what lacks data is left out.
    pub fn score_all(&self) -> Vec<Scored> {
        let mut all = Vec::new();
        for entry in CATALOGUE.iter().chain(&RIVALS) {
            if entry.needs.lacking(self.data).is_some() && entry.needs != Needs::DriveScan {
                continue;
            }
            if let Some(mut scored) = self.score_one(entry.id, None) {
                if entry.needs == Needs::DriveScan
                    && !self.data.beside.drive_scan
                    && self.model.real
                {
                    scored.objection = Some(Objection::NoDriveScan);
                }
                all.push(scored);
            }
        }
        withhold_lines(&mut all);
        all
    }

    /// `near`: where its shape was before; without, all shapes are tried. What it says along the ring's parameters is
    /// judged by the spread over bursts, where these have more in common than their signals let expect.
    pub fn score_one(&self, id: CauseId, near: Option<&Applied>) -> Option<Scored> {
        let mut scored = self.as_if_independent(id, near)?;
        if scored.surprise < HINT {
            return Some(scored);
        }
        let Applied { kind, directions, coefficients, .. } = &scored.form;
        let nuisance = if matches!(kind, Kind::Shapes) { self.shapes } else { self.covariates };
        let direction = nuisance.efficient(directions, coefficients);
        let spread = self.clusters().spread(&direction, near.is_some());
        scored.statistic *= spread.statistic;
        scored.sd /= spread.information.sqrt();
        let Scored { statistic, degrees, tried, .. } = scored;
        scored.surprise = surprise(statistic, degrees, tried, spread.dof).min(scored.surprise);
        Some(scored)
    }

    /// The signals, burst by burst.
    fn clusters(&self) -> Clusters<'a> {
        Clusters { model: self.model, data: self.data }
    }

    fn as_if_independent(&self, id: CauseId, near: Option<&Applied>) -> Option<Scored> {
        match id.row().acts {
            Acts::Mean(shape) => self.on_the_mean(id, shape, near),
            Acts::Rates { covariate, which, per } => self.rates(id, covariate, which, per),
            Acts::Gain { covariate } => self.gain(id, covariate),
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
                let sigma = self.seen.sigma;
                self.line(id, 1, &[0.4 * sigma, sigma, 2.0 * sigma], near)
            }
            Shape::Motion(motion) => {
                self.best_of(id, near, |place| self.motion(id, motion, place, near))
            }
            Shape::Bent(bend) => self.best_of(id, near, |second| self.bent(id, bend, second, near)),
            Shape::Sways(what) => self.sways(id, what, near),
            Shape::SweptLine => self.swept_line(id, near),
            Shape::Own => self.own_shape(id, near),
        }
    }

    fn dof(&self, of_channels: bool) -> f64 {
        let n = if of_channels { self.data.units } else { self.data.len() };
        (n as f64 - 3.0).max(1.0)
    }

    fn fixed(&self, id: CauseId, direction: Direction) -> Option<Scored> {
        let directions = vec![direction];
        let tested = self.shapes.test(&directions)?;
        let (value, sd) = (tested.coefficients[0], tested.covariance[(0, 0)].sqrt());
        if !value.is_finite() || !tested.statistic.is_finite() {
            return None;
        }
        Some(Scored { value, sd, ..self.shaped(id, tested, directions, 0.0, 1.0) })
    }

    /// Of the best of so many independent shapes.
    fn shaped(
        &self,
        id: CauseId,
        tested: Tested,
        directions: Vec<Direction>,
        shape: f64,
        tried: f64,
    ) -> Scored {
        let degrees = directions.len();
        let rigid = Applied::rigid(id, directions, tested.coefficients, Kind::Shapes);
        Scored {
            surprise: surprise(tested.statistic, degrees, tried, f64::INFINITY),
            degrees,
            tried,
            ..Scored::plain(id, tested.statistic, Applied { shape, ..rigid })
        }
    }
}

/// Where the ring itself may be one of the two lines, steady or scaling with the drive, and that explains as much, the
/// other is no line either.
fn withhold_lines(all: &mut [Scored]) {
    let of = |id| all.iter().position(|s| s.id == id);
    let (Some(tone), Some(mode)) = (of(CauseId::Tone), of(CauseId::SecondMode)) else { return };
    for (one, other) in [(tone, mode), (mode, tone)] {
        let own = all[one].objection == Some(Objection::OwnLine);
        if own && all[one].statistic > all[other].statistic - tie() {
            all[other].objection = all[other].objection.or(Some(Objection::OwnLine));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_that_the_ring_explains_as_well_is_no_tone() {
        let line = |id, statistic: f64, objection| {
            let form = Applied::rigid(id, vec![], vec![], Kind::Shapes);
            Scored { degrees: 2, objection, ..Scored::plain(id, statistic, form) }
        };
        let named = |mode: f64, objection| {
            let tone = line(CauseId::Tone, 36.0, None);
            let mut all = [tone, line(CauseId::SecondMode, mode, objection)];
            withhold_lines(&mut all);
            all[0].able()
        };
        assert!(!named(38.0, Some(Objection::OwnLine)));
        assert!(named(28.0, Some(Objection::OwnLine)));
        assert!(named(46.0, None), "they compete");
    }
}
