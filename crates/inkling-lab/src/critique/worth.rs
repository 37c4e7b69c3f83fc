//! What each cause that was found is worth: the gain in ln likelihood (nats) per held-out signal.
//!
//! In: the baseline, and all that was found. Out: [`LogLikelihood`]. Models are fitted to three of five
//! blocks of time and judged on the two blocks between, where each channel is known from the fitted blocks;
//! where every channel was heard once, they are fitted to every other channel and judged on the others. The
//! densities of signals come from `predictive.rs`. Which causes there are, rails, step and whitening were chosen
//! with all signals before. How the gain of a cause is measured depends on its kind:
//!
//! * a cause that moves what is expected of signals: the model with all such causes, against a refit without
//!   this one;
//! * clipping, a coarse step: what a baseline that knows the codes gains over one that does not, and the
//!   probabilities of clipped samples and of codes;
//! * correlation: whitened signals against the signals as they came;
//! * growing noise, a line of random phase, the trigger's jitter: added to the extended model one after the
//!   other, each with its size fitted to the training part.

use super::candidates::{Applied, Setting};
use super::catalogue::CauseId;
use super::chance::maximum;
use super::finding::{LogLikelihood, Worth};
use super::held_out::{
    Population, Signal, TrainTestSplit, baseline, by_channel, population, signals, with,
};
use super::leftovers::{Artefacts, accepted};
use super::model::{Codes, Model, Rail};
use super::observations::{Observations, Row};
use super::predictive::{Growth, Noise, by_shift, ln_densities_with_jitter};
use inkling_core::model::normal::ln_upper_tail;
use std::f64::consts::TAU;

/// How far from its first guess a size is searched for, in its logarithm.
const REACH: f64 = 3.0;

impl TrainTestSplit {
    /// The population from which a model fitted to `train` expects the signals of a channel. `place`: the
    /// channel's index in `train`; `None`: it was not fitted to.
    fn expected(&self, model: &Model, place: Option<usize>) -> Population {
        match place {
            Some(unit) => Population::of_channel(model, unit, self.counts[unit]),
            None => population(model, None),
        }
    }

    fn test(&self, model: &Model) -> Vec<Signal> {
        let of_unit = self.in_train.iter().map(|place| self.expected(model, *place)).collect();
        signals(model, &self.test, of_unit)
    }

    fn train(&self, model: &Model) -> Vec<Signal> {
        let of_unit = (0..self.counts.len()).map(|unit| self.expected(model, Some(unit))).collect();
        signals(model, &self.train, of_unit)
    }

    fn part<'a>(&'a self, avoid: &'a [f64]) -> Setting<'a> {
        Setting { data: &self.train, avoid }
    }
}

struct Measuring<'a> {
    /// The baseline, fitted to all signals. It knows the clipping and the step of the codes.
    before: &'a Model,
    causes: &'a [Applied],
    artefacts: &'a Artefacts,
    split: TrainTestSplit,
    /// The same parts before whitening.
    unwhitened: Option<TrainTestSplit>,
    /// Fitted to the training part: the baseline with no cause, and with all that move what is expected.
    plain: Model,
    extended: Model,
    avoid: &'a [f64],
}

/// A cause, and for each held-out signal its gain: ln p with the cause less ln p without it.
struct Step {
    id: CauseId,
    gains: Vec<f64>,
}

/// `before`, `causes`, `artefacts`: as of `Measuring`. `unwhitened`: the signals before correlated noise was
/// made white. `None`: nothing was found, there are too few signals, or nothing rings in the training part.
pub fn measure(
    before: &Model,
    causes: &[Applied],
    artefacts: &Artefacts,
    unwhitened: Option<&Observations>,
    Setting { data, avoid }: Setting,
) -> Option<LogLikelihood> {
    if causes.is_empty() && artefacts.accepted().next().is_none() {
        return None;
    }
    let split_of = |data: &Observations| {
        let by_time = data.len() > data.units;
        TrainTestSplit::of(data, !by_time, by_time)
    };
    let split = split_of(data)?;
    let unwhitened = unwhitened.and_then(split_of);
    let plain = baseline(Some(before), split.part(avoid))?;
    let extended = with(&plain, causes, split.part(avoid));
    let measuring =
        Measuring { before, causes, artefacts, split, unwhitened, plain, extended, avoid };
    Some(measuring.log_likelihood())
}

impl Measuring<'_> {
    fn log_likelihood(&self) -> LogLikelihood {
        let plain = self.split.test(&self.plain);
        let extended = self.split.test(&self.extended);
        let (ln_plain, ln_extended) =
            (ln(&plain, &Noise::default()), ln(&extended, &Noise::default()));
        let mut all = differences(&ln_extended, &ln_plain);
        let mut steps = self.left_out(&ln_extended);
        let mut beside = self.codes(&plain, &ln_plain);
        beside.extend(self.correlation(&ln_plain));
        beside.extend(self.noise(&extended, &ln_extended));
        // each gain in `beside` is measured on top of those before it
        for step in &beside {
            all.iter_mut().zip(&step.gains).for_each(|(sum, gain)| *sum += gain);
        }
        steps.extend(beside);
        let worth = |gains: &[f64]| worth(gains, &extended);
        let by_cause = steps.iter().map(|step| (step.id.name(), worth(&step.gains))).collect();
        LogLikelihood { all: worth(&all), by_cause }
    }

    /// `ln_extended`: ln p of each held-out signal with all causes that move what is expected.
    fn left_out(&self, ln_extended: &[f64]) -> Vec<Step> {
        let one = |index: usize| {
            let mut others = self.causes.to_vec();
            let id = others.remove(index).id;
            let without = with(&self.plain, &others, self.split.part(self.avoid));
            let without = self.split.test(&without);
            Step { id, gains: differences(ln_extended, &ln(&without, &Noise::default())) }
        };
        (0..self.causes.len()).map(one).collect()
    }

    /// Gains of clipping and of a coarse step, against a baseline that knows of neither, so is bent by clipped
    /// or rounded samples. `plain`, `ln_plain`: the held-out signals, and ln p of each, by the baseline that
    /// knows the codes. Whitened signals have no codes.
    fn codes(&self, plain: &[Signal], ln_plain: &[f64]) -> Vec<Step> {
        let Model { codes, noise_var, .. } = self.before;
        let is = |id| accepted(&self.artefacts.codes, id);
        let (clipping, coarse) = (is(CauseId::Clipping), is(CauseId::CoarseLsb));
        let bends = |codes: &Codes| !codes.rails.is_empty() || codes.lattice.is_some();
        if self.unwhitened.is_some() || !codes.iter().any(bends) {
            return Vec::new();
        }
        let naive = baseline(None, self.split.part(self.avoid));
        let Some(naive) = naive else { return Vec::new() };
        let naive = ln(&self.split.test(&naive), &Noise::default());
        let sd = noise_var.sqrt();
        let known = plain.iter().zip(&self.split.test.rows);
        let of_head = known.map(|(signal, row)| (signal, codes.get(row.printhead)));
        let clipped =
            of_head.map(|(signal, of)| of.map_or(0.0, |of| signal.ln_clipped(&of.rails, sd)));
        let clipped: Vec<f64> = clipped.collect();
        let model = differences(ln_plain, &naive);
        let sum = |of: &[f64]| model.iter().zip(of).map(|(p, q)| p + q).collect::<Vec<f64>>();
        let mut steps = Vec::new();
        if clipping.is_some() {
            steps.push(Step { id: CauseId::Clipping, gains: sum(&clipped) });
        }
        if coarse.is_some() && codes.iter().any(|codes| codes.lattice.is_some()) {
            let stepped = self.ln_codes(plain);
            // the gain of the fit is common to both causes, and told once, with clipping
            let gains = if clipping.is_some() { stepped } else { sum(&stepped) };
            steps.push(Step { id: CauseId::CoarseLsb, gains });
        }
        steps
    }

    /// What knowing the coarse step of each printhead adds to ln p of its held-out signals. If a share e of codes
    /// lies off the lattice, a code on it is step (1 - e) times as probable as without that knowledge, and any
    /// other step e / (step - 1) times. Samples that may be clipped (`plain`: `counts` 0) are left out: their
    /// probability is that of all values beyond the rail (`ln_clipped`).
    fn ln_codes(&self, plain: &[Signal]) -> Vec<f64> {
        let lattice = |row: &Row| self.before.codes.get(row.printhead)?.lattice;
        let off = |y: f32, [step, first]: [f64; 2]| (f64::from(y) - first).rem_euclid(step) != 0.0;
        let TrainTestSplit { train, test, .. } = &self.split;
        // the counts start at 1 of 2, so that neither logarithm is infinite
        let (mut elsewhere, mut count) = (1.0, 2.0);
        for (i, row) in train.rows.iter().enumerate() {
            let Some(lattice) = lattice(row) else { continue };
            count += train.samples as f64;
            elsewhere += train.signal(i).iter().filter(|y| off(**y, lattice)).count() as f64;
        }
        let elsewhere = elsewhere / count;
        let of_signal = |(i, row): (usize, &Row)| {
            let Some(lattice @ [step, _]) = lattice(row) else { return 0.0 };
            let ln = [(step * (1.0 - elsewhere)).ln(), (step / (step - 1.0) * elsewhere).ln()];
            let counted = test.signal(i).iter().zip(&plain[i].counts);
            let counted = counted.filter(|(_, counts)| **counts != 0.0);
            counted.map(|(y, _)| ln[usize::from(off(*y, lattice))]).sum()
        };
        test.rows.iter().enumerate().map(of_signal).collect()
    }

    /// Gain of knowing the correlation of the noise: ln p of the whitened held-out signals (`ln_plain`), less
    /// that of the same signals as they came in white noise, given their first sample, which whitening loses.
    fn correlation(&self, ln_plain: &[f64]) -> Option<Step> {
        accepted(&self.artefacts.noise, CauseId::CorrelatedNoise)?;
        let split = self.unwhitened.as_ref()?;
        let naive = baseline(None, split.part(&[]))?;
        let naive: Vec<f64> =
            split.test(&naive).iter().map(Signal::ln_density_after_first).collect();
        Some(Step { id: CauseId::CorrelatedNoise, gains: differences(ln_plain, &naive) })
    }

    /// Gains of growing noise, of a line of random phase and of the trigger's jitter, in this order, each on top
    /// of those before. `ln_extended`: ln p of each held-out signal by the extended model in white noise.
    fn noise(&self, test: &[Signal], ln_extended: &[f64]) -> Vec<Step> {
        let is = |id| accepted(&self.artefacts.noise, id);
        let (growth, tone) = (is(CauseId::HeteroscedasticNoise), is(CauseId::RandomTone));
        let jitter = is(CauseId::TriggerJitter);
        if growth.is_none() && tone.is_none() && jitter.is_none() {
            return Vec::new();
        }
        let train = self.split.train(&self.extended);
        // the growth is relative to the largest expected sample
        let squares: Vec<f64> =
            train.iter().flat_map(|signal| signal.expected.iter().map(|f| f * f)).collect();
        let top = squares.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let mean = squares.iter().sum::<f64>() / squares.len().max(1) as f64;
        let (mut noise, mut before, mut steps) =
            (Noise::default(), ln_extended.to_vec(), Vec::new());
        let sum = |ln: Vec<f64>| ln.into_iter().filter(|v| v.is_finite()).sum::<f64>();
        let fitted = |near: f64, of: &dyn Fn(f64) -> Vec<f64>| {
            maximum(|x| sum(of(x.exp())), near.max(1e-12).ln(), REACH).exp()
        };
        let mut add = |id, ln: Vec<f64>| {
            steps.push(Step { id, gains: differences(&ln, &before) });
            before = ln;
        };
        if let Some(h) = growth {
            let with = |h: f64| Noise { growth: Some(Growth { h, top, mean }), ..noise };
            noise = with(fitted(h, &|h| ln(&train, &with(h))));
            add(CauseId::HeteroscedasticNoise, ln(test, &noise));
        }
        if let (Some(_), Some(omega)) = (tone, self.avoid.first()) {
            let with = |var: f64| Noise { tone: Some([*omega, var]), ..noise };
            noise = with(fitted(0.05 * self.extended.noise_var, &|var| ln(&train, &with(var))));
            add(CauseId::RandomTone, ln(test, &noise));
        }
        if let Some(sd) = jitter {
            let data = &self.split.train;
            let guess = (sd / (data.length_s())).powi(2);
            let shift = by_shift(&self.extended);
            let with = |all: &[Signal], var| ln_densities_with_jitter(all, &noise, &shift, var);
            let variance = fitted(guess, &|var| with(&train, var));
            add(CauseId::TriggerJitter, with(test, variance));
        }
        steps
    }
}

fn ln(all: &[Signal], noise: &Noise) -> Vec<f64> {
    all.iter().map(|signal| signal.ln_density(noise)).collect()
}

fn differences(with: &[f64], without: &[f64]) -> Vec<f64> {
    with.iter().zip(without).map(|(with, without)| with - without).collect()
}

impl Signal {
    /// ln p of the samples that may be clipped. `sd`: of the noise, counts. A sample at the rail has the
    /// probability of all values from half a count before it on; any other has the normal density.
    fn ln_clipped(&self, rails: &[Rail], sd: f64) -> f64 {
        let each = self.counts.iter().zip(self.y.iter().zip(&self.expected));
        each.filter(|(counts, _)| **counts == 0.0)
            .map(|(_, (y, f))| match rails.iter().find(|r| r.side * (y - r.level) >= 0.0) {
                Some(Rail { side, level, .. }) => ln_upper_tail((side * (level - f) - 0.5) / sd),
                None => -0.5 * (((y - f) / sd).powi(2) + (TAU * sd * sd).ln()),
            })
            .sum()
    }
}

/// Of gains that are finite.
fn worth(gains: &[f64], of: &[Signal]) -> Worth {
    let known = gains.iter().zip(of).filter(|(gain, _)| gain.is_finite());
    let (gains, units): (Vec<f64>, Vec<usize>) =
        known.map(|(gain, signal)| (*gain, signal.unit)).unzip();
    Worth::of(&gains, &by_channel(units.into_iter()))
}

#[cfg(test)]
mod tests {
    use super::super::generator::{Run, criticised, draw};
    use super::CauseId::*;

    /// For each kind of cause whose gain is measured in a way of its own, one cause that is clearly there.
    #[test]
    fn what_is_clearly_there_is_worth_modelling_of_whatever_kind() {
        let planted = [
            (Offset, 0.4),
            (Temperature, 0.02),
            (CorrelatedNoise, 0.15),
            (HeteroscedasticNoise, 2.0),
            (RandomTone, 1.0),
            (Clipping, 110.0),
            (CoarseLsb, 4.0),
        ];
        for (seed, (id, size)) in planted.into_iter().enumerate() {
            let run = Run { channels: 12, bursts: 16, effect: Some(id), size, ..Run::default() };
            let critique = criticised(&draw(&run, 9000 + seed as u64));
            let named: Vec<_> = critique.causes.iter().map(|c| c.id).collect();
            assert_eq!(named, [id]);
            let (value, of_size) = (critique.causes[0].value, !matches!(id, RandomTone));
            assert!(!of_size || (value / size - 1.0).abs() < 0.4, "{id}: {value}");
            let worth = critique.gain.worth(id);
            assert!(worth.is_some_and(|worth| worth.is_sure()), "{id}: {named:?} {worth:?}");
        }
    }
}
