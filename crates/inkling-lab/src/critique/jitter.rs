//! Tests `trigger_jitter`: a shift in time that is common to all channels of a burst, which share the
//! trigger. In: signals about a fitted model that holds the causes found so far. Out: one [`Candidate`].
//!
//! How the acquisition states of healthy signals scatter is not known, so a shift of one signal alone is
//! healthy scatter, and bursts may have something in common without a jitter (for example a drive that
//! varies), in any direction of the state. So two questions are asked:
//!
//! 1. Do bursts vary along the shift at all, beyond the scatter of single signals? (likelihood ratio
//!    `Excess::statistic`, which must pass the threshold of all causes)
//! 2. Is their variance along the shift clearly larger than that across the shift, in amplitude? (likelihood
//!    ratio `Excess::ratio`, which must be a hint). Variances are compared in radians of the ring, or in
//!    multiples of single signals' scatter, whichever asks for more (`Contrasts::within`).
//!
//! Both are asked of the scores of bursts (`clusters.rs`), which are free of what channels' own parameters
//! explain, and weigh each signal by its scatter and its noise. With the information I of a burst, its score s
//! has the variance I own + I² common; so s/sqrt(I), a [`Contrast`], has own + I common. What bursts follow of
//! what was recorded is taken out before, where it is more than chance: each costs a contrast, and few contrasts
//! tell little of a variance.

use super::candidate::{Candidate, Objection};
use super::catalogue::CauseId;
use super::chance::{HINT, ONCE_IN_100, maximum, surprise};
use super::clusters::{Burst, Clusters};
use super::covariates::{COVARIATES, DRIVE, ONE};
use super::matrices::means_of_groups;
use super::model::Model;
use super::observations::Observations;
use super::space::Direction;
use super::tuned::FEWEST_CONTRASTS;
use inkling_core::numbers::LITTLE;
use nalgebra::{DMatrix, Matrix2, SVector};

/// What is recorded beside a burst: the means of its signals' covariates, with the square of the drive in place of
/// the constant.
type Recorded = SVector<f64, COVARIATES>;

/// The candidate's value is the standard deviation of the shift in s. It is `untested` where bursts hold one
/// channel, signals do not ring, or too few contrasts are left.
pub fn jitter(model: &Model, data: &Observations) -> Candidate {
    let lack = |why| Candidate::untested(CauseId::TriggerJitter, why);
    if !data.beside.shared_bursts {
        return lack("bursts of several channels");
    }
    let turn = shift_and_growth(model);
    let Some(back) = turn.try_inverse() else { return lack("signals that ring") };
    let recorded = recorded(data);
    let clusters = Clusters { model, data };
    let of = |j: usize| {
        let v = [0.0, 0.0, turn[(0, j)], turn[(1, j)], 0.0, 0.0];
        let bursts = clusters.bursts(&Direction::covariate(data.samples, ONE, v));
        Contrasts::of(&bursts, &recorded, data.units)
    };
    let (Some(along), Some(across)) = (of(0), of(1)) else { return lack("more bursts") };
    // healthy bursts are granted the ratio that single signals have
    let scatter = back * own_scatter(model) * back.transpose();
    let ratio = along.within(scatter[(0, 0)]) / across.within(scatter[(1, 1)]);
    let excess = Excess::of(&along, &across, ratio.max(1.0));

    // from radians of the ring to s; the error of a root is that of the variance over twice the root
    let to_s = data.length_s() / model.mean[1].exp();
    let sd = excess.along.max(1e-16).sqrt();
    let error_s = excess.along_sd / (2.0 * sd) * to_s;
    let plain = Candidate::plain(CauseId::TriggerJitter, excess.statistic, ());
    let mut found = Candidate { value: sd * to_s, sd: error_s, ..plain };
    if found.accepted() && !excess.beyond_any_direction() {
        found.objection = Some(Objection::AnyDirection);
    }
    found
}

/// Derivatives of the amplitudes (a, b) of the mean pair by a shift of the time of acquisition, per radian of the
/// ring, and by a relative growth. Later by t, the pair is e^{-sigma t} times (a, b) turned by omega t.
fn shift_and_growth(model: &Model) -> Matrix2<f64> {
    let (a, b) = (model.mean[2], model.mean[3]);
    let r = (model.mean[0] - model.mean[1]).exp();
    Matrix2::new(b - r * a, a, -(a + r * b), b)
}

/// Covariance of a signal's amplitudes (a, b) from burst to burst, beside what follows its damping and its
/// frequency: a signal that rings faster arrives at t_a with another phase.
fn own_scatter(model: &Model) -> Matrix2<f64> {
    let block = |i, j| model.within.fixed_view::<2, 2>(i, j).into_owned();
    let rates = block(0, 0).try_inverse().unwrap_or_default();
    block(2, 2) - block(2, 0) * rates * block(0, 2)
}

fn recorded(data: &Observations) -> Vec<Recorded> {
    let of_signal = |(row, z): (&super::observations::Row, &[f64; COVARIATES])| {
        let mut of = *z;
        of[ONE] = z[DRIVE] * z[DRIVE];
        (row.burst, of.into())
    };
    means_of_groups(data.bursts, data.rows.iter().zip(&data.beside.z).map(of_signal))
}

/// One for each burst, of variance `own + weight * common`.
struct Contrasts {
    each: Vec<Contrast>,
    /// Variance of signals within bursts, over that which the model expects of them.
    own: f64,
    /// What it expects: the variance of a single signal, its noise included.
    expected: f64,
    signals: f64,
}

struct Contrast {
    value: f64,
    /// The burst's information.
    weight: f64,
}

impl Contrasts {
    /// `channels`: number of those whose own parameters were taken out. `None`: too few contrasts are left.
    fn of(bursts: &[Burst], recorded: &[Recorded], channels: usize) -> Option<Contrasts> {
        let all = bursts.iter().zip(recorded);
        let all: Vec<_> = all.filter(|(burst, _)| burst.alone.information > 0.0).collect();
        let root = |k: usize| all[k].0.alone.information.sqrt();
        // the constant, what was recorded, and the scores, all weighed by the roots of the information
        let mut m = DMatrix::from_fn(all.len(), COVARIATES + 2, |k, j| match j {
            0 => root(k),
            _ if j <= COVARIATES => root(k) * all[k].1[j - 1],
            _ => all[k].0.alone.score / root(k),
        });
        let scores = m.column(COVARIATES + 1).into_owned();
        let left = all.len().checked_sub(take_out_what_is_followed(&mut m))?;
        let signals: f64 = all.iter().map(|(burst, _)| burst.signals).sum();
        let statistics: f64 = all.iter().map(|(burst, _)| burst.statistics).sum();
        let information: f64 = all.iter().map(|(burst, _)| burst.alone.information).sum();
        let free = signals - (all.len() + channels) as f64;
        if left < FEWEST_CONTRASTS || free < FEWEST_CONTRASTS as f64 {
            return None;
        }
        let own = (statistics - scores.norm_squared()).max(1e-300) / free;
        let wider = (all.len() as f64 / left as f64).sqrt();
        let contrast = |(burst, value): (&(&Burst, &Recorded), &f64)| Contrast {
            value: wider * value,
            weight: burst.0.alone.information,
        };
        let each = all.iter().zip(m.column(COVARIATES + 1).iter()).map(contrast).collect();
        Some(Contrasts { each, own, expected: signals / information, signals })
    }

    /// Variance that signals have within bursts beyond their noise, but at least its standard error: a smaller one
    /// cannot be told from none. `scatter`: that of the model, which holds what bursts have in common, too.
    fn within(&self, scatter: f64) -> f64 {
        let error = (2.0 / self.signals).sqrt() * self.own * self.expected;
        (scatter - (1.0 - self.own) * self.expected).max(error)
    }

    fn deviance(&self, common: f64) -> f64 {
        let of = |c: &Contrast| {
            let var = self.own + c.weight * common;
            var.ln() + c.value * c.value / var
        };
        self.each.iter().map(of).sum()
    }

    fn information(&self, common: f64) -> f64 {
        let of = |c: &Contrast| 0.5 * (c.weight / (self.own + c.weight * common)).powi(2);
        self.each.iter().map(of).sum()
    }
}

/// Projects the first column, the constant, out of all others, and then one after the other those between it and
/// the last one that the last one follows by more than chance (forward selection by Student's t). Returns how
/// many were taken out.
fn take_out_what_is_followed(m: &mut DMatrix<f64>) -> usize {
    let last = m.ncols() - 1;
    let squares: Vec<f64> = m.column_iter().map(|column| column.norm_squared()).collect();
    let mut next = Some(0);
    let mut taken = 0;
    while let Some(column) = next {
        let unit = m.column(column).normalize();
        *m -= &unit * unit.tr_mul(m);
        taken += 1;
        // of a column that those before have taken nearly all of nothing is told
        let told = (1..last).filter(|j| m.column(*j).norm_squared() > LITTLE * squares[*j]);
        let whole = m.column(last).norm_squared();
        let explained = |j: usize| m.column(j).normalize().dot(&m.column(last)).powi(2);
        let left = (m.nrows() as f64 - 1.0 - taken as f64).max(1.0);
        let is_followed = |of: &(usize, f64)| of.1 > ONCE_IN_100.powi(2) * (whole - of.1) / left;
        let most = told.map(|j| (j, explained(j))).max_by(|p, q| p.1.total_cmp(&q.1));
        next = most.filter(is_followed).map(|(j, _)| j);
    }
    taken
}

/// The variance of bursts along the shift, compared with none and with that across it.
struct Excess {
    statistic: f64,
    /// Likelihood-ratio statistic of two free variances against two whose ratio is at most that of healthy
    /// bursts.
    ratio: f64,
    /// Most likely variance along the shift, rad².
    along: f64,
    along_sd: f64,
}

impl Excess {
    /// `most`: the ratio of both variances that healthy bursts may have.
    fn of(along: &Contrasts, across: &Contrasts, most: f64) -> Excess {
        let best = least(|v| along.deviance(v));
        let best_across = least(|v| across.deviance(v));
        let free = along.deviance(best) + across.deviance(best_across);
        // the ratio at its healthy bound, with one free variance
        let ratio = match best <= most * best_across {
            true => 0.0,
            false => {
                let tied = least(|v| along.deviance(v) + across.deviance(v / most));
                along.deviance(tied) + across.deviance(tied / most) - free
            }
        };
        Excess {
            statistic: along.deviance(0.0) - along.deviance(best),
            ratio: ratio.max(0.0),
            along: best,
            along_sd: 1.0 / along.information(best).max(1e-300).sqrt(),
        }
    }

    /// Question 2 of the module's doc.
    fn beyond_any_direction(&self) -> bool {
        surprise(self.ratio, 1, 1.0, f64::INFINITY) > HINT
    }
}

/// The variance at which a deviance is least: 0, or the best power of e from -30 to 2, refined by golden
/// section.
fn least(deviance: impl Fn(f64) -> f64) -> f64 {
    let at = |ln: f64| deviance(ln.exp());
    let middle = (-30..=2).map(f64::from).min_by(|p, q| at(*p).total_cmp(&at(*q))).unwrap_or(0.0);
    let found = maximum(|ln| -at(ln), middle, 1.0).exp();
    if deviance(0.0) <= deviance(found) { 0.0 } else { found }
}

#[cfg(test)]
mod tests {
    use super::super::observations::Sampler;
    use super::*;
    use inkling_core::burst::Beside;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};
    use std::f64::consts::TAU;

    const PERIOD_S: f64 = 1e-6;
    const SAMPLES: usize = 96;
    /// Turns of the ring in a signal.
    const TURNS: f64 = 6.4;

    /// Standard deviations, along the shift (rad) and across it, of single signals and of what bursts have in
    /// common; and the shift of a burst per relative change of the drive.
    #[derive(Clone, Copy, Default)]
    struct Spread {
        own: [f64; 2],
        common: [f64; 2],
        follows: f64,
    }

    /// 24 bursts of 8 of the 16 channels each, with a temperature and a drive each.
    fn drawn(spread: Spread, seed: u64) -> Observations {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let lasting: Vec<[f64; 2]> = (0..16).map(|_| [0.0; 2].map(|_| 0.02 * normal())).collect();
        let mut sampler = Sampler::new(PERIOD_S, usize::MAX);
        for burst in 0..24_u32 {
            let mut common = spread.common.map(|sd| sd * normal());
            let drive = 0.67 + 0.165 * f64::from(burst % 5);
            common[0] += spread.follows * (drive - 1.0);
            for channel in (0..8).map(|slot| burst % 2 * 8 + slot) {
                let own = lasting[channel as usize];
                let [late, larger] = [0, 1].map(|j| own[j] + common[j] + spread.own[j] * normal());
                let faster = 1.0 + 0.002 * normal();
                let y = (0..SAMPLES).map(|k| {
                    let t = k as f64 / SAMPLES as f64;
                    let ring = (-2.9 * t).exp() * (TAU * TURNS * faster * t + late + 0.4).cos();
                    100.0 * drive * (1.0 + larger) * ring + 2.0 * normal()
                });
                let beside = Beside {
                    drive_v: 20.0 * drive,
                    temperature_c: 25.0 + (0.6 * f64::from(burst)).sin(),
                    ..Beside::alone(channel, i64::from(burst) * 1_000_000)
                };
                sampler.offer("p", beside, &y.collect::<Vec<f64>>());
            }
        }
        sampler.finish()
    }

    fn tested(spread: Spread, seed: u64) -> Candidate {
        let data = drawn(spread, seed);
        jitter(&Model::fitted(&data, 2).unwrap(), &data)
    }

    fn found_in(spread: Spread, runs: u64) -> usize {
        (0..runs).filter(|seed| tested(spread, *seed).accepted()).count()
    }

    #[test]
    fn a_shift_of_whole_bursts_is_found_and_measured() {
        let spread = Spread { own: [0.01; 2], common: [0.02, 0.0], ..Spread::default() };
        let all: Vec<Candidate> = (0..8).map(|seed| tested(spread, seed)).collect();
        assert!(all.iter().all(Candidate::accepted), "{all:?}");
        let to_rad = TAU * TURNS / (SAMPLES as f64 * PERIOD_S);
        let size = all.iter().map(|f| f.value * to_rad).sum::<f64>() / 8.0;
        assert!((size - 0.02).abs() < 0.003, "{size}");
    }

    /// However single signals scatter, and whatever the channels of a burst have in common in all directions, or
    /// follow, no jitter may be found.
    #[test]
    fn healthy_scatter_is_no_jitter() {
        for own in [[0.01, 0.01], [0.03, 0.001], [0.001, 0.03]] {
            for common in [[0.0, 0.0], [0.0, 0.03], [0.02, 0.02]] {
                let found = found_in(Spread { own, common, ..Spread::default() }, 6);
                assert!(found <= 1, "{own:?} {common:?}: {found} of 6");
            }
        }
        for follows in [0.02, 0.1] {
            let found = found_in(Spread { own: [0.01; 2], follows, ..Spread::default() }, 8);
            assert!(found <= 1, "{follows}: {found} of 8");
        }
    }
}
