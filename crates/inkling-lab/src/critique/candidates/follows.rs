//! Causes that act through a covariate: temperature, time, position, neighbours, idle time; and the
//! scan of every covariate on every parameter.
//!
//! In: a [`ScoreTests`], whose `score_one` calls the tests of causes; `adequacy` calls the scan.
//! Out: [`Scored`], with the value in the catalogue's unit; of the scan, a [`ParameterTest`] for
//! each pair.
//!
//! A cause moves a signal's parameters theta = (ln sigma, ln omega, a, b, c, ln lambda/sigma) by z
//! v, where z is the standardised covariate of the signal and v says how far each parameter moves.
//! The test is that of the direction v in the space where channels are scattered. What is special
//! here:
//!
//! - v of a change of losses or stiffness follows from the channel's equations, thesis (2-2), by
//!   numerical differentiation with the state at t_a held (`grown_rates`);
//! - that state may follow the covariate as well, in an unknown way, so the amplitudes are left
//!   free in addition (`covariate_free`);
//! - channels are few, so a trend along them is judged by Student's t (`against_rest`).

use super::{Applied, CLOCK, DAMPING, FREQUENCY, ScoreTests, Scored};
use crate::critique::catalogue::{CauseId, Per, Rates};
use crate::critique::chance::{HINT, ONCE_IN_100, surprise};
use crate::critique::covariates::{COVARIATES, Covariates, POSITION};
use crate::critique::objection::Objection;
use crate::critique::space::Direction;
use crate::critique::unmodelled::Interior;
use inkling_core::model::InkChannel;
use inkling_core::model::free_decay::ALL;
use nalgebra::{Complex, DVector};
use std::f64::consts::TAU;

/// Ways in which a covariate is tested on damping or frequency (`covariate_free`).
const WAYS: f64 = 3.0;

/// Test of one parameter against one covariate, by their indices: of `covariates.rs`; and of theta without
/// the real pole's rate, with the pair's amplitude and phase in place of its cosine and sine.
#[derive(Clone, Copy, Debug)]
pub struct ParameterTest {
    pub covariate: usize,
    pub parameter: usize,
    pub statistic: f64,
    pub surprise: f64,
}

impl ScoreTests<'_> {
    /// Tests a covariate that moves damping, frequency or all rates. The value is the relative
    /// change per unit of the covariate, or from its smallest to its largest value, as `per` says.
    pub(super) fn rates(
        &self,
        id: CauseId,
        covariate: usize,
        which: Rates,
        per: Per,
    ) -> Option<Scored> {
        let v = self.rates_direction(which);
        match per {
            Per::Unit => {
                self.covariate_free(id, covariate, v, 1.0 / self.data.beside.sd[covariate])
            }
            Per::Span => self.covariate_free(id, covariate, v, self.over(covariate)).map(relative),
        }
    }

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
        let degrees = both.len();
        let form = Applied::rigid(id, both, tested.coefficients);
        Some(Scored {
            degrees,
            surprise: surprise(tested.statistic, degrees, 1.0, self.dof(false)),
            value: share.norm(),
            sd: slope.dot(&(&tested.covariance * &slope)).sqrt(),
            ..Scored::plain(id, tested.statistic, Applied { shape: share.arg(), ..form })
        })
    }

    /// Tests the tail of the previous ring. The value is the share of the signal's own ring, later
    /// by the idle time, that is added to it.
    pub(super) fn previous_ring(&self, id: CauseId) -> Option<Scored> {
        let tail = vec![Direction::tail(self.samples)];
        let tested = self.nuisances.covariates.test(&tail)?;
        let (value, sd) = (tested.coefficients[0], tested.covariance[(0, 0)].sqrt());
        let form = Applied::rigid(id, tail, tested.coefficients);
        Some(Scored {
            surprise: surprise(tested.statistic, 1, 1.0, self.dof(false)),
            value: self.model.added.tail_gain + value,
            sd,
            ..Scored::plain(id, tested.statistic, form)
        })
    }

    /// A covariate's span in standard deviations.
    fn over(&self, which: usize) -> f64 {
        self.data.beside.span[which] / self.data.beside.sd[which]
    }

    /// Tests a covariate on the combination `v` of parameters. `unit` turns the coefficient, which
    /// is per standard deviation of the covariate, into the catalogue's unit. `None`: the covariate
    /// was not recorded or does not vary, or the nuisance holds the direction already.
    fn covariate(&self, id: CauseId, which: usize, v: [f64; ALL], unit: f64) -> Option<Scored> {
        if !self.data.beside.present[which] {
            return None;
        }
        let direction = Direction::covariate(self.samples, which, v);
        let tested = self.nuisances.covariates.test(std::slice::from_ref(&direction))?;
        let statistic = self.against_rest(which, tested.statistic);
        // the scatter that the test is made against still contains the effect itself, so the
        // interval would be too wide: shrink it as much as `against_rest` raises the statistic
        let narrower = (tested.statistic / statistic.max(1e-12)).sqrt().min(1.0);
        let sd = tested.covariance[(0, 0)].sqrt() * unit * narrower;
        let value = tested.coefficients[0] * unit;
        let form = Applied::rigid(id, vec![direction], tested.coefficients);
        let surprise = surprise(statistic, 1, 1.0, self.dof(which == POSITION));
        Some(Scored { surprise, value, sd, ..Scored::plain(id, statistic, form) })
    }

    /// The acquisition state may follow the covariate, too, as far as what came before t_a lets it.
    /// So the candidate is tested with the amplitudes of the decay unmoved, with the state of the
    /// interior unmoved, and with the amplitudes free. The most significant way counts, with its
    /// own degrees of freedom and at the price of three tries. The size is always estimated with
    /// the amplitudes free, and must be 2.576 standard errors from 0. `interior`: how theta moves
    /// if the interior's state does not.
    fn covariate_free(
        &self,
        id: CauseId,
        which: usize,
        interior: [f64; ALL],
        unit: f64,
    ) -> Option<Scored> {
        // rates alone, amplitudes unmoved; the frequency is among them, since losses move the frequency, too
        let plain = [interior[0], interior[1], 0.0, 0.0, 0.0, interior[5]];
        let mut best = self.covariate(id, which, plain, unit)?;
        if let Some(other) = self.covariate(id, which, interior, unit)
            && other.statistic > best.statistic
        {
            best = other;
        }
        let dof = self.dof(which == POSITION);
        best.tried = WAYS;
        best.surprise = surprise(best.statistic, best.degrees, WAYS, dof);

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
                // if the frequency alone follows the channel more surely, that counts, less the price of
                // having looked at each parameter
                let looks = self.on_each_parameter(which);
                let parameters = looks.len().max(1) as f64;
                if let Some(look) = looks.into_iter().find(|look| look.parameter == 1)
                    && look.surprise - parameters.ln() > best.surprise
                {
                    best.statistic = look.statistic;
                    best.tried = parameters;
                    best.surprise = look.surprise - parameters.ln();
                }
            } else if together > best.surprise {
                best.statistic = tested.statistic;
                best.degrees = directions.len();
                best.surprise = together;
            }
            // what moves the amplitudes, but hardly the rates, is the acquisition state
            if best.value.abs() < ONCE_IN_100 * best.sd {
                best.objection = Some(Objection::StateAlone);
            }
            best.sd *= from_few(dof);
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

    /// Change of theta where rates grow by a share while the acquisition state of the interior
    /// stays what it was: per relative change of the damping (all losses grow), of the frequency
    /// (both stiffnesses grow), or of the share itself (all rates grow; stiffnesses, which are
    /// squares of rates, by the share twice).
    fn rates_direction(&self, which: Rates) -> [f64; ALL] {
        // how often stiffnesses and losses are multiplied by 1 + share; the change without a known interior;
        // which parameter the result is relative to
        let (often, plain, per) = match which {
            Rates::Damping => ([0, 1], DAMPING, Some(0)),
            Rates::Stiffness => ([1, 0], FREQUENCY, Some(1)),
            Rates::All => ([2, 1], CLOCK, None),
        };
        self.grown_rates(often).map_or(plain, |v| v.map(|x| x / per.map_or(1.0, |j| v[j])))
    }

    /// Derivative of theta by the share, with the interior state (volume V, flows q_r and q_n)
    /// held; by central differences. The two arguments are how often the stiffnesses of thesis
    /// (2-2) (a = 1/(I_r B_t), b = 1/(I_n B_t)) and its losses (g = R_r/I_r, d = R_n/I_n) are
    /// multiplied by 1 + share. `None`: no ink channel, or the derivative does not exist.
    ///
    /// The poles of the changed channel give sigma, omega and lambda. Its amplitudes are those that
    /// have, at the first sample, the output and the first two derivatives that follow from the
    /// held state.
    fn grown_rates(&self, [stiffness, loss]: [usize; 2]) -> Option<[f64; ALL]> {
        let interior = self.interior?;
        let Interior { channel, state: [v, q_r, q_n], .. } = interior;
        let grown = |x: f64, h: f64, often: usize| (0..often).fold(x, |x, _| x * (1.0 + h));
        let at = |h: f64| -> Option<[f64; ALL]> {
            let c = InkChannel {
                a_per_s2: grown(channel.a_per_s2, h, stiffness),
                b_per_s2: grown(channel.b_per_s2, h, stiffness),
                g_per_s: grown(channel.g_per_s, h, loss),
                d_per_s: grown(channel.d_per_s, h, loss),
            };
            let p = c.poles()?;
            let (sigma, omega, lambda) = (p.damping_per_s, p.frequency_hz * TAU, p.lambda_per_s);
            let [a, b, g, d] = c.rates();
            // output and its first two derivatives at the first sample, from the state and the changed rates
            let y = q_r + q_n;
            let (dr, dn) = (-a * v - g * q_r, -b * v - d * q_n);
            let dy = dr + dn;
            let ddy = -(a + b) * y - g * dr - d * dn;
            let m = nalgebra::Matrix3::new(
                1.0,
                0.0,
                1.0, //
                -sigma,
                omega,
                -lambda, //
                sigma * sigma - omega * omega,
                -2.0 * sigma * omega,
                lambda * lambda,
            );
            let x = m.lu().solve(&nalgebra::Vector3::new(y, dy, ddy))?;
            Some([sigma.ln(), omega.ln(), x[0], x[1], x[2], (lambda / sigma).ln()])
        };
        let h = 1e-4;
        let (up, down) = (at(h)?, at(-h)?);
        let v: [f64; ALL] = std::array::from_fn(|j| (up[j] - down[j]) / (2.0 * h));
        v.iter().all(|x| x.is_finite()).then_some(v)
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
            let of = |statistic, surprise| ParameterTest {
                covariate: which,
                parameter: j,
                statistic,
                surprise,
            };
            let beside = together.as_ref().map_or(0.0, |t| {
                t.coefficients[j].powi(2) / t.covariance[(j, j)].max(f64::MIN_POSITIVE)
            });
            let tested = self.nuisances.covariates.test(std::slice::from_ref(direction))?;
            let statistic = self.against_rest(which, tested.statistic.max(beside));
            let plain = surprise(statistic, 1, 1.0, dof);
            if plain < HINT {
                return Some(of(statistic, plain));
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
            Some(of(statistic, surprise(statistic, 1, 1.0, dof.min(spread.dof))))
        };
        each.iter().enumerate().filter_map(look).collect()
    }
}

/// Factor by which the 95 % interval grows because the scatter was estimated with `dof` degrees of freedom:
/// Student's quantile over the normal one, to its first term in 1/dof.
fn from_few(dof: f64) -> f64 {
    1.0 + (1.96 * 1.96 + 1.0) / (4.0 * dof)
}

/// Turns a change of a logarithm, from first to last, into a relative change.
fn relative(scored: Scored) -> Scored {
    let grown = scored.value.exp();
    Scored { value: grown - 1.0, sd: scored.sd * grown, ..scored }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_from_few_are_as_wide_as_students() {
        // the quantiles of Student's t at 97.5 %
        for (dof, quantile) in [(9.0, 2.262), (20.0, 2.086), (100.0, 1.984)] {
            let own = 1.96 * from_few(dof);
            assert!((own / quantile - 1.0).abs() < 0.02, "{dof}: {own}");
        }
    }
}
