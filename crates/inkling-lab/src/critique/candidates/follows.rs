//! Causes that act through a covariate: temperature, time, position, neighbours, idle time; and the
//! scan of every covariate on every parameter.
//!
//! In: a [`ScoreTests`], whose `score_one` calls the tests of causes; `adequacy` calls the scan.
//! Out: [`Scored`], with the value in the catalogue's unit; of the scan, a [`ParameterTest`] for
//! each pair.
//!
//! A cause moves a signal's parameters theta = (ln sigma, ln omega, a, b, c, ln lambda/sigma) by z
//! v, where z is the standardised covariate of the signal and v says how far each parameter moves.
//! The test is that of the direction v in the space where channels are scattered. What is special here:
//!
//! - the state at t_a may follow the covariate as well, in an unknown way, so the amplitudes are left
//!   free in addition (`on_rates`);
//! - channels are few, so a trend along them is judged by Student's t (`against_rest`).

use super::{ScoreTests, Scored};
use crate::critique::candidate::Objection;
use crate::critique::catalogue::CauseId;
use crate::critique::chance::{HINT, ONCE_IN_100, surprise};
use crate::critique::covariates::{COVARIATES, Covariates, POSITION};
use crate::critique::space::Direction;
use inkling_core::model::free_decay::{ALL, Theta};
use inkling_core::model::student::student_quantile;
use nalgebra::{Complex, DVector};

/// Ways in which a covariate is tested on damping or frequency (`on_rates`).
const WAYS: f64 = 2.0;

/// Test of one parameter against one covariate, by their indices: of `covariates.rs`; and of theta without
/// the real pole's rate, with the pair's amplitude and phase in place of its cosine and sine.
#[derive(Clone, Copy, Debug)]
pub struct ParameterTest {
    pub covariate: usize,
    pub parameter: usize,
    pub surprise: f64,
}

impl ScoreTests<'_> {
    /// Tests a ring that comes beside the own one, per unit of the covariate: along it and a quarter of a
    /// period behind, so at any phase. The value is its share of the own ring.
    pub(super) fn added_ring(&self, id: CauseId, covariate: usize) -> Option<Scored> {
        let [_, _, a, b, c, _]: [f64; ALL] = self.model.mean.into();
        let along = |v| Direction::covariate(self.samples, covariate, v);
        let both = vec![along([0.0, 0.0, a, b, c, 0.0]), along([0.0, 0.0, -b, a, 0.0, 0.0])];
        let tested = self.nuisances.covariates.test(&both)?;
        // The model's share k' is relative to a signal with the mean covariate m, the catalogue's k to one
        // where it is 0: k' = k / (1 + k m), so k = k' / (1 - k' m) and dk = dk' / (1 - k' m)².
        let Covariates { sd, mean, .. } = &self.data.beside;
        let of_sd = Complex::new(tested.coefficients[0], tested.coefficients[1]);
        let left = Complex::from(1.0) - of_sd * (mean[covariate] / sd[covariate]);
        let share = of_sd / left / sd[covariate];
        // by how much the size of the share grows with each of the two coefficients
        let outward = (share / share.norm()).conj() / (left * left) / sd[covariate];
        let slope = DVector::from(vec![outward.re, -outward.im]);
        let sd = slope.dot(&(&tested.covariance * &slope)).sqrt();
        let surprise = surprise(tested.statistic, both.len(), 1.0, self.dof(false));
        let mut scored = Scored::of(id, tested, both, 1.0);
        scored.form.shape = share.arg();
        Some(Scored { value: share.norm(), sd, surprise, ..scored })
    }

    /// Tests the tail of the previous ring. The value is the share of the signal's own ring, later
    /// by the idle time, that is added to it.
    pub(super) fn previous_ring(&self, id: CauseId) -> Option<Scored> {
        let scored = self.fixed(id, Direction::tail(self.samples))?;
        let surprise = surprise(scored.statistic, 1, 1.0, self.dof(false));
        let value = self.model.added.tail_gain + scored.value;
        Some(Scored { value, surprise, ..scored })
    }

    /// Tests a covariate that moves damping, frequency or all rates. The value is the relative change per `unit` of
    /// the standardised covariate.
    ///
    /// The acquisition state may follow the covariate, too, as far as what came before t_a lets it. So the
    /// candidate is tested with the amplitudes of the decay unmoved, and with the amplitudes free. The more
    /// significant way counts, with its own degrees of freedom and at the price of two tries. The size is always
    /// estimated with the amplitudes free, and must be 2.576 standard errors from 0. `unit` turns the coefficient,
    /// which is per standard deviation of the covariate, into the catalogue's unit. `None`: the covariate was not
    /// recorded or does not vary, or the nuisance holds the direction already.
    pub(super) fn on_rates(
        &self,
        id: CauseId,
        which: usize,
        moves: Theta,
        unit: f64,
    ) -> Option<Scored> {
        if !self.data.beside.present[which] {
            return None;
        }
        let plain: [f64; ALL] = moves.into();
        let alone = vec![Direction::covariate(self.samples, which, plain)];
        let tested = self.nuisances.covariates.test(&alone)?;
        let statistic = self.against_rest(which, tested.statistic);
        let dof = self.dof(which == POSITION);
        let (value, sd) = (tested.coefficients[0] * unit, tested.covariance[(0, 0)].sqrt() * unit);
        let surprised = surprise(statistic, 1, WAYS, dof);
        let tested = Scored::of(id, tested, alone, WAYS);
        let mut best = Scored { value, sd, statistic, surprise: surprised, ..tested };

        let amplitude = self.model.amplitude();
        let along = |v| Direction::covariate(self.samples, which, v);
        let free = |own| std::array::from_fn(|j| if j == own { amplitude } else { 0.0 });
        let ways = std::iter::once(plain).chain((2..5).map(free));
        let directions: Vec<Direction> = ways.map(along).collect();
        if let Some(tested) = self.nuisances.covariates.test(&directions) {
            best.value = tested.coefficients[0] * unit;
            best.sd = tested.covariance[(0, 0)].sqrt() * unit;
            let together = surprise(tested.statistic, directions.len(), WAYS, dof);
            if which == POSITION {
                // with few channels, four coefficients at once say nothing: judge that of the frequency alone
                let own = (best.value / best.sd).powi(2);
                best.statistic = self.against_rest(which, own);
                best.tried = 1.0;
                best.surprise = surprise(best.statistic, 1, 1.0, dof);
                best.sd *= (own / best.statistic.max(1e-12)).sqrt().min(1.0);
            } else if together > best.surprise {
                best.statistic = tested.statistic;
                best.degrees = directions.len();
                best.surprise = together;
            }
            // what moves the amplitudes, but hardly the rates, is the acquisition state
            if best.value.abs() < ONCE_IN_100 * best.sd {
                best.objection = Some(Objection::StateAlone);
            }
            // the scatter was estimated from few channels
            best.sd *= student_quantile(0.975, dof) / 1.96;
            best.form.coefficients = tested.coefficients;
            best.form.directions = directions;
        }
        Some(best)
    }

    /// Corrects a statistic for a scatter of few channels that was estimated with the effect of
    /// their position still in it. Of n channels the statistic is (n - 1) R², where R² is the share
    /// of the scatter that the position explains; it becomes t² = (n - 3) R²/(1 - R²), if that is
    /// more. Other covariates need no correction.
    fn against_rest(&self, which: usize, statistic: f64) -> f64 {
        // an effect that is in the model is no part of the scatter any more
        if which != POSITION || self.model.added.beta[POSITION].iter().any(|b| *b != 0.0) {
            return statistic;
        }
        let n = (self.data.units as f64 - 1.0).max(1.0);
        let explained = (statistic / n).min(0.999);
        (self.dof(true) * explained / (1.0 - explained)).max(statistic)
    }

    pub fn covariate_scan(&self) -> Vec<ParameterTest> {
        let present = (1..COVARIATES).filter(|which| self.data.beside.present[*which]);
        present.flat_map(|which| self.on_each_parameter(which)).collect()
    }

    /// Tests one covariate on each parameter but the real pole's rate, alone and beside the others; whichever
    /// says more counts. In place of the pair's cosine and sine stand its amplitude and its phase, along and
    /// across what both are in the mean. As for causes, the spread over bursts lowers what is of interest.
    fn on_each_parameter(&self, which: usize) -> Vec<ParameterTest> {
        let dof = self.dof(which == POSITION);
        let (a, b) = (self.model.mean[2], self.model.mean[3]);
        let (cos, sin) = (a / a.hypot(b), b / a.hypot(b));
        let alone = |j| {
            let mut v = [0.0; ALL];
            match j {
                2 => (v[2], v[3]) = (cos, sin),
                3 => (v[2], v[3]) = (-sin, cos),
                _ => v[j] = 1.0,
            }
            Direction::covariate(self.samples, which, v)
        };
        let each: Vec<Direction> = (0..ALL - 1).map(alone).collect();
        // with the others free as well: what moves two parameters together is in their common scatter
        let together = self.nuisances.covariates.test(&each);
        let look = |(j, direction): (usize, &Direction)| {
            let of = |surprise| ParameterTest { covariate: which, parameter: j, surprise };
            let beside = together.as_ref().map_or(0.0, |t| {
                t.coefficients[j].powi(2) / t.covariance[(j, j)].max(f64::MIN_POSITIVE)
            });
            let tested = self.nuisances.covariates.test(std::slice::from_ref(direction))?;
            let statistic = self.against_rest(which, tested.statistic.max(beside));
            let plain = surprise(statistic, 1, 1.0, dof);
            if plain < HINT {
                return Some(of(plain));
            }
            let efficient = match &together {
                // The direction of one coefficient beside the others: the combination of all
                // directions that estimates it has the weights of its column of the covariance.
                Some(t) if beside > tested.statistic => self
                    .nuisances
                    .covariates
                    .efficient(&each, t.covariance.column(j).into_owned().as_slice()),
                _ => self.nuisances.covariates.efficient(std::slice::from_ref(direction), &[1.0]),
            };
            let spread = self.clusters().spread(&efficient, false);
            let statistic = statistic * spread.statistic;
            Some(of(surprise(statistic, 1, 1.0, dof.min(spread.dof))))
        };
        each.iter().enumerate().filter_map(look).collect()
    }
}
