//! Whether what is found is told by all signals, or by what few bursts have in common.
//!
//! In: a direction in the space of linear extensions, freed of the nuisance. Out: [`Spread`], the share of
//! the direction's statistic that is left where bursts have more in common than independent signals would
//! (cluster-robust variances, with bursts as clusters). How healthy bursts differ is not known, but it is the
//! ring's own parameters that differ. So the evidence is split: along the parameters of a signal, it is
//! judged by the spread over bursts; across them, there is noise alone, which no two signals share. What
//! follows a covariate lies along the parameters, a shape of the mean mostly across them.
//!
//! Steps: (1) `says`: score and information of the direction's size in each signal, in all and across; (2)
//! `add_channel`: subtract what the channel's own parameters may explain, and sum over bursts; (3) `spread`:
//! compare the scatter of the bursts' scores along the parameters with the information, which is their
//! variance if signals are independent. If the ratio, `excess`, is more than chance gives, the part along the
//! parameters weighs 1/excess only.

use super::covariates::COVARIATES;
use super::curvature::posterior_mean;
use super::matrices::{Matrix5, Vector5, free_part, inverse, inverse_or_zero, scaled, unscaled};
use super::model::{Additions, Linear, Model, free_products, powers};
use super::observations::Observations;
use super::space::Direction;
use inkling_core::model::free_decay::ALL;
use inkling_core::model::inner_product::dot;

const REAL_POLE: usize = 4;
/// Number of coefficients that bursts are judged about: the mean, and the direction's own.
const FITTED: f64 = 2.0;
/// The spread over bursts exceeds that of independent signals by so many standard deviations in one of twenty
/// recordings.
const MORE_THAN_CHANCE: f64 = 1.645;

#[derive(Clone, Copy)]
pub struct Clusters<'a> {
    pub model: &'a Model,
    pub data: &'a Observations,
}

/// What the spread over bursts leaves of a direction's test. The caller multiplies the statistic by
/// `statistic`, divides the standard error by the root of `information`, and takes Student's t with `dof`.
#[derive(Clone, Copy, Debug)]
pub struct Spread {
    pub statistic: f64,
    pub information: f64,
    /// Degrees of freedom of the variance that was estimated from bursts; infinite where it was not.
    pub dof: f64,
}

impl Spread {
    pub const NONE: Spread = Spread { statistic: 1.0, information: 1.0, dof: f64::INFINITY };
}

impl Additions {
    /// What these additions put into a signal, sample by sample, counts: first the shapes; then what the
    /// covariates `z` (to first order) and the previous ring add. `linear`: the model linearised about the
    /// signal.
    fn seen(&self, linear: &Linear, drive: f64, z: &[f64; COVARIATES]) -> [Vec<f64>; 2] {
        let powers = powers(drive);
        let by: [f64; ALL] =
            std::array::from_fn(|j| z.iter().zip(&self.beta).map(|(z, beta)| z * beta[j]).sum());
        let shape = |(k, count): (usize, &f64)| count * self.shape(&powers, k);
        let moved = |(k, tail): (usize, &f64)| -> f64 {
            let of_parameters = (0..ALL).map(|j| by[j] * linear.tangent.columns[j][k]);
            of_parameters.sum::<f64>() + self.tail_gain * tail
        };
        [
            linear.counts.iter().enumerate().map(shape).collect(),
            linear.tail.iter().enumerate().map(moved).collect(),
        ]
    }
}

/// The score's variance is the information, if signals are independent.
#[derive(Clone, Copy, Default)]
pub struct ScoreSum {
    pub score: f64,
    pub information: f64,
}

impl ScoreSum {
    fn add(&mut self, other: ScoreSum, share: f64) {
        self.score += share * other.score;
        self.information += share * other.information;
    }

    pub fn statistic(&self, present: bool) -> f64 {
        let score = if present { self.score + self.information } else { self.score };
        score * score / self.information
    }
}

#[derive(Clone, Copy, Default)]
pub struct Burst {
    along: ScoreSum,
    across: ScoreSum,
    /// About a size that this burst has alone: channels' own parameters are held, which it hardly moves.
    pub alone: ScoreSum,
    /// Number of signals, and the sum of the statistics of single ones.
    pub signals: f64,
    pub statistics: f64,
}

/// What one signal says of a direction u and of its channel's own parameters. u: what the direction looks
/// like in the signal, N samples; V: covariance of the signal about its channel; J: its tangent, with 0 in
/// the real pole's column.
struct SignalSums {
    burst: usize,
    /// All that it says of u's size, and the part of that across its parameters.
    all: ScoreSum,
    across: ScoreSum,
    /// Information J^T V^-1 J of the channel's parameters, and their score.
    information: Matrix5,
    score: Vector5,
    /// What u looks like in these parameters, J^T V^-1 u.
    looks_like: Vector5,
}

impl Clusters<'_> {
    /// `present`: the direction is in the model already, with size 1, so scores are about that size.
    pub fn spread(&self, direction: &Direction, present: bool) -> Spread {
        let mut bursts = self.bursts(direction);
        bursts.retain(|burst| burst.along.information > 0.0);
        spread(&bursts, present)
    }

    /// What each burst says of a direction, by `Row::burst`.
    pub fn bursts(&self, direction: &Direction) -> Vec<Burst> {
        let mut change = Additions::none(self.data.samples);
        direction.add_to(&mut change, 1.0);
        let mut bursts = vec![Burst::default(); self.data.bursts];
        let mut linear = Linear::default();
        for of_channel in self.data.channels() {
            let says = |i| self.says(i, &change, &mut linear);
            self.add_channel(&of_channel.map(says).collect::<Vec<_>>(), &mut bursts);
        }
        bursts
    }

    /// Adds a channel's signals to their bursts, less what the channel's own parameters may explain. With I
    /// and s the signals' `information` and `score`, and c their `looks_like`: the signals ask for a move of
    /// the channel's parameters by `off` = (sum I + between^-1)^-1 sum s, and u looks like a move by `own` =
    /// (sum I + between^-1)^-1 sum c. So r is replaced by r less J `off`, and u by u less J `own`.
    fn add_channel(&self, signals: &[SignalSums], bursts: &mut [Burst]) {
        let precision = inverse(&scaled(&self.model.between, &self.model.scale()));
        let information = signals.iter().map(|s| s.information).sum::<Matrix5>() + precision;
        let looks_like: Vector5 = signals.iter().map(|s| s.looks_like).sum();
        let inverse = inverse_or_zero(information);
        let own = inverse * looks_like;
        // `off` is not 0: because of the prior, and because the fit was not run to its very end
        let off = inverse * signals.iter().map(|s| s.score).sum::<Vector5>();
        for signal in signals {
            let burst = &mut bursts[signal.burst];
            burst.across.add(signal.across, 1.0);
            burst.along.add(signal.all, 1.0);
            burst.along.add(signal.across, -1.0);
            // what the channel's parameters take off lies along the parameters
            burst.along.score -= signal.looks_like.dot(&off);
            burst.along.score -= own.dot(&(signal.score - signal.information * off));
            burst.along.information +=
                own.dot(&(signal.information * own)) - 2.0 * own.dot(&signal.looks_like);
            let score = signal.all.score - signal.looks_like.dot(&off);
            let alone = ScoreSum { score, ..signal.all };
            burst.alone.add(alone, 1.0);
            burst.signals += 1.0;
            burst.statistics += alone.statistic(false);
        }
    }

    /// What signal i says of a direction, `change` being the direction as additions to the model.
    ///
    /// The score about u's size is u^T V^-1 r, the information u^T V^-1 u, with V^-1 = 1/v - J M J^T/v² and M
    /// = within (1 + J^T J within/v)^-1 (Woodbury). r is the residual about the channel: that about the
    /// signal's own parameters, plus J times the signal's own deviation `own`.
    fn says(&self, i: usize, change: &Additions, linear: &mut Linear) -> SignalSums {
        let Clusters { model, data } = *self;
        model.linearise(i, data, linear);
        let [shape, moved] = change.seen(linear, data.beside.drive[i], &data.beside.z[i]);
        let u: Vec<f64> = shape.iter().zip(&moved).map(|(shape, moved)| shape + moved).collect();

        // products of the tangent with itself, the residual and u; in units of `scale`
        let (v, scale) = (model.noise_var, model.scale());
        let (mut gram, mut of_residual) = free_products(linear, &scale);
        let mut own = free_part(&model.each[i], &scale);
        let mut of_u = scale.map_with_location(|j, _, s| s * dot(&linear.tangent.columns[j], &u));
        // The real pole hardly rings, so its amplitude is none of the parameters here: what is seen along it
        // is judged by the noise alone.
        gram.fill_row(REAL_POLE, 0.0);
        gram.fill_column(REAL_POLE, 0.0);
        (of_residual[REAL_POLE], own[REAL_POLE], of_u[REAL_POLE]) = (0.0, 0.0, 0.0);

        let within = scaled(&model.within, &scale);
        let inner = Matrix5::identity() + gram * within / v;
        let m = within * inverse_or_zero(inner);
        let of_r = of_residual + gram * own;
        let weigh = (Matrix5::identity() - gram * m / v) / v;

        let posterior = unscaled(&m, &scale);
        let theta = model.theta(i, data);
        let beyond = posterior_mean(&theta, linear, data.beside.drive[i], &posterior, v);
        let all = ScoreSum {
            score: (dot(&u, &linear.residual) + of_u.dot(&own) - dot(&shape, &beyond.expected)) / v
                - of_u.dot(&(m * of_r)) / (v * v),
            information: dot(&u, &u) / v - of_u.dot(&(m * of_u)) / (v * v),
        };

        let along = inverse(&gram) * of_u;
        let across = ScoreSum {
            score: (dot(&u, &linear.residual) - along.dot(&of_residual)) / v,
            information: (dot(&u, &u) - along.dot(&of_u)).max(0.0) / v,
        };
        SignalSums {
            burst: data.rows[i].burst,
            all,
            across,
            information: weigh * gram,
            score: weigh * of_r,
            looks_like: weigh * of_u,
        }
    }
}

fn spread(bursts: &[Burst], present: bool) -> Spread {
    let dof = bursts.len() as f64 - FITTED;
    let (mut along, mut across) = (ScoreSum::default(), ScoreSum::default());
    for burst in bursts {
        along.add(burst.along, 1.0);
        across.add(burst.across, 1.0);
    }
    let mut all = along;
    all.add(across, 1.0);
    if dof < 1.0 || along.information <= 0.0 {
        return Spread::NONE;
    }

    // mean square of the bursts' scores about the common size, over their variance if signals are
    // independent; corrected for the fitted coefficients
    let size = all.score / all.information;
    let off = |burst: &Burst| burst.along.score - size * burst.along.information;
    let squares: f64 = bursts.iter().map(|burst| off(burst).powi(2)).sum();
    let excess = squares / along.information * (dof + FITTED) / dof;
    if excess <= 1.0 + MORE_THAN_CHANCE * (2.0 / dof).sqrt() {
        return Spread::NONE;
    }

    // Weigh each part by its own variance. The share `estimated` of the sum rests on an estimate with `dof`
    // degrees of freedom, the rest on a known variance; so the whole has dof/estimated² (Welch and
    // Satterthwaite).
    let mut weighed = across;
    weighed.add(along, 1.0 / excess);
    let estimated = along.information / excess / weighed.information;
    Spread {
        statistic: (weighed.statistic(present) / all.statistic(present)).min(1.0),
        information: weighed.information / all.information,
        dof: dof / (estimated * estimated),
    }
}

#[cfg(test)]
mod tests {
    use super::super::covariates::TEMPERATURE;
    use super::super::generator::{Run, draw};
    use super::*;

    /// Spread of a gain that follows temperature. 16 channels are heard in 12 bursts, which have a
    /// temperature each, and whose amplitudes differ by the share `common`. The fitted damping and frequency
    /// of every second channel are moved by `moved` from where they are likeliest.
    fn along_temperature(common: f64, moved: [f64; 2]) -> Spread {
        const BURSTS: usize = 12;
        let mut data = draw(&Run { channels: 16, bursts: BURSTS, ..Run::default() }, 41);
        for (i, row) in data.rows.iter_mut().enumerate() {
            row.burst = i % BURSTS; // rows are sorted by channel and time
            row.beside.temperature_c = 20.0 + (row.burst * 7 % 11) as f64;
            // what is recorded of the drive is not the drive that there was
            row.beside.drive_v *= 1.0 + if row.burst * 5 % 7 < 3 { common } else { -common };
        }
        data.bursts = BURSTS;
        let data = data.standardised();
        let mut model = Model::fitted(&data, 2).unwrap();
        for of_channel in model.units.iter_mut().step_by(2) {
            of_channel[0] += moved[0];
            of_channel[1] += moved[1];
        }
        let mut v = [0.0; ALL];
        (v[2], v[3]) = (model.mean[2], model.mean[3]);
        let direction = Direction::covariate(data.samples, TEMPERATURE, v);
        Clusters { model: &model, data: &data }.spread(&direction, false)
    }

    /// Channels that are not fitted to the end are no spread of bursts.
    #[test]
    fn bursts_that_have_something_in_common_spread_more_than_their_signals() {
        let [alone, common] = [0.0, 0.02].map(|common| {
            let [there, off] =
                [[0.0; 2], [0.02, 0.002]].map(|moved| along_temperature(common, moved));
            assert!((off.statistic - there.statistic).abs() < 0.01, "{there:?} {off:?}");
            there
        });
        assert_eq!(alone.statistic, 1.0);
        assert!(common.statistic < 0.33 && (common.dof - 10.0).abs() < 0.1, "{common:?}");
    }
}
