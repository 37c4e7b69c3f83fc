//! The physical parameters of a machine's channels, estimated with their covariance. They predict
//! faults of which no signal was labelled. thesis (2-2), §2-2.
//!
//! In: a guess of the rates a, b, g, d and of the actuation, the measured healthy ring, features of
//! healthy signals, labelled faulty signals. Out: [`FaultPhysics`], which a design stores: rates and
//! actuation with their covariance (`belief`), how channels differ (`spread`); and from these the
//! [`FaultPhysics::curves`] of all fault classes and alternatives.
//!
//! The estimate of the rates (maximum a posteriori):
//!
//! 1. Prior: Gaussian in ln a, ln b, ln g, ln d, ln pulse about the guess. Only ratios of rates are
//!    trusted (to `isolate.guess_sd`); common factors of a and b, and of g and d, are free.
//! 2. Damping and frequency of the healthy ring determine two combinations of the rates. The ratios
//!    a/b and g/d are not observable in healthy signals.
//! 3. A faulty signal of labelled severity observes these ratios: its features should be those of a
//!    simulated fault of that severity ([`super::fault_curve`]).
//! 4. Gauss-Newton: linearise all observations, add up information and gradient, and step. Faulty
//!    signals have the weights of Student's t, against wrong labels.

use super::alternatives::{Alternative, broad};
use super::channel_spread::{ChannelSpread, spread_of_channels};
use super::discrepancy::{self, Discrepancy, Shown};
use super::fault_curve::{HealthySpread, fault_curve};
use super::fault_simulator::{
    ActuatedChannel, CHANGES, Changes, FaultSimulator, Point, Slope, Square, of_change, wrapped,
};
use super::physics_density::{FaultCurves, Guess, LabelledSeverities, Member, uniform_in_range};
use super::tuned;
use crate::fault::Class;
use crate::model::faults::{Catalogue, Law};
use crate::model::ring::Ring;
use crate::model::ring_fit::{Features, RingFitter};
use crate::model::{Actuation, InkChannel};
use crate::numbers::GUESSED_RATE;
use crate::side_by_side::{cores, side_by_side};
use nalgebra::{DMatrix, DVector, Matrix2, Matrix4, SMatrix, Vector2, Vector4};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FaultPhysics {
    pub channel: InkChannel,
    /// The pulse is estimated with the rates; the delay is a guess that [`FaultSimulator`] adapts.
    pub actuation: Actuation,
    /// Posterior covariance of ln a, ln b, ln g, ln d, ln pulse.
    pub belief: [[f64; CHANGES]; CHANGES],
    pub ring: Ring,
    /// Standard deviation of one sample's noise, counts.
    pub noise: f64,
    pub spread: ChannelSpread,
    pub seen: BTreeMap<String, LabelledSeverities>,
    /// How far the laws lie off labelled sizes, by the name of one class of each kind.
    pub learned: BTreeMap<String, Discrepancy>,
    #[serde(default, skip_serializing_if = "Catalogue::is_empty")]
    pub laws: Catalogue,
}

#[derive(Clone, Debug)]
pub struct LabelledFault {
    pub class: String,
    /// The law in whose unit the severity is given.
    pub kind: String,
    /// NaN: the label gives none.
    pub severity: f64,
    pub features: Vector4<f64>,
    pub drive: f64,
    /// ln damping and ln frequency of the healthy ring then, relative to [`FaultPhysics::ring`].
    pub ring: [f64; 2],
    /// Printhead and number.
    pub channel: (Option<String>, u32),
    /// One over the number of labelled signals of its channel, which are not independent.
    pub weight: f64,
}

pub type Sampling = (f64, usize);

/// Number of Gauss-Newton steps; twice as many without labelled faults.
const ROUNDS: usize = 6;
const DEGREES: f64 = 3.0;
/// Standard deviation of the measured ln damping and ln frequency; its value does not matter.
const RING_SD: f64 = 1e-3;
/// Prior standard deviation of ln of a common factor of a and b (stiffness), and of one of g and d
/// (viscosity). It is large enough for its value not to matter.
const SCALE_SD: f64 = 1.0;

impl FaultPhysics {
    /// From the prior and the healthy ring. `guess_sd`: prior standard deviation of each ln rate
    /// beside the common factors; `noise`: of one sample, counts. `None`: no such channel rings.
    pub fn new(guess: ActuatedChannel, guess_sd: f64, ring: Ring, noise: f64) -> Option<Self> {
        let mut physics = FaultPhysics {
            channel: guess.channel,
            actuation: guess.actuation,
            belief: [[0.0; CHANGES]; CHANGES],
            ring,
            noise,
            spread: ChannelSpread::default(),
            seen: BTreeMap::new(),
            learned: BTreeMap::new(),
            laws: Catalogue::default(),
        };
        let prior = Prior::new(guess, guess_sd)?;
        for _ in 0..2 * ROUNDS {
            physics.step(&prior, Square::zeros(), Changes::zeros())?;
        }
        Some(physics)
    }

    fn fitter(&self, (dt_s, samples): Sampling) -> RingFitter {
        RingFitter::new(self.ring, dt_s, samples)
    }

    /// `None`: the healthy channel does not ring.
    fn simulator<'a>(&self, fitter: &'a RingFitter) -> Option<FaultSimulator<'a>> {
        let healthy = ActuatedChannel { channel: self.channel, actuation: self.actuation };
        FaultSimulator::new(fitter, healthy, self.noise)
    }

    /// `features`: of each healthy signal, the phase free; `noise`: their mean covariance by noise,
    /// 4 x 4; `channels`: their number. `None`: too few signals, or not finite; nothing is changed.
    pub fn learn_spread(
        &mut self,
        features: &[DVector<f64>],
        noise: &DMatrix<f64>,
        channels: usize,
        sampling: Sampling,
    ) -> Option<()> {
        let fitter = self.fitter(sampling);
        let simulator = self.simulator(&fitter)?;
        self.spread = spread_of_channels(&simulator.healthy_slope, features, noise, channels)?;
        Some(())
    }

    /// Corrects rates and pulse by labelled signals, but for those without severity, of unknown laws
    /// or of channels that would not ring. `None`: the corrected channel would not ring; some steps
    /// may have been taken by then, so the caller keeps a copy.
    pub fn learn_rates(
        &mut self,
        guess: ActuatedChannel,
        guess_sd: f64,
        labelled: &[LabelledFault],
        sampling: Sampling,
    ) -> Option<()> {
        let prior = Prior::new(guess, guess_sd)?;
        let fitter = self.fitter(sampling);
        for _ in 0..ROUNDS {
            let change = self.change()?;
            let mut simulator = self.simulator(&fitter)?;
            let (mut information, mut gradient) = (Square::zeros(), Changes::zeros());
            for signal in labelled.iter().filter(|signal| signal.severity.is_finite()) {
                let law = self.laws.law(&signal.kind).filter(|law| !law.changes_nothing());
                let look = law.and_then(|law| signal.look(law, &mut simulator, &change));
                let Some(Look { point, off: rest, noise }) = look else { continue };
                let scatter = self.scatter(&point.slope) + noise;
                let Some(inverse) = scatter.try_inverse() else { continue };

                // Student's t in four dimensions, against wrong labels
                let square = rest.dot(&(inverse * rest));
                let weight = signal.weight * (DEGREES + 4.0) / (DEGREES + square);
                information +=
                    point.belief_slope.transpose() * inverse * point.belief_slope * weight;
                gradient += point.belief_slope.transpose() * inverse * rest * weight;
            }
            self.step(&prior, information, gradient)?;
        }
        Some(())
    }

    /// Learns how far the laws lie off labelled signals with a severity; sizes of a user's own class that lie on
    /// no curve are forgotten. `None`: nothing rings.
    pub fn learn_discrepancies(
        &mut self,
        labelled: &[LabelledFault],
        sampling: Sampling,
    ) -> Option<()> {
        let fitter = self.fitter(sampling);
        let (mut simulator, change) = (self.simulator(&fitter)?, self.change()?);
        let sized = labelled.iter().filter(|signal| signal.severity.is_finite());
        let known = sized.filter_map(|signal| Some((signal, self.laws.law(&signal.kind)?)));
        // by channel and size: the mean over sizes of a channel that ran through all of them would be of none
        type Sizes = BTreeMap<u64, Vec<Look>>;
        let mut kinds: Vec<(&str, &Law, BTreeMap<_, Sizes>)> = Vec::new();
        for (signal, law) in known {
            let Some(look) = signal.look(law, &mut simulator, &change) else { continue };
            let place = kinds.iter().position(|(_, kind, _)| kind.is_kind_of(law));
            let place = place.unwrap_or_else(|| {
                kinds.push((&signal.kind, law, BTreeMap::new()));
                kinds.len() - 1
            });
            let sizes = kinds[place].2.entry(&signal.channel).or_default();
            sizes.entry(signal.severity.to_bits()).or_default().push(look);
        }
        let learn = |(name, law, channels): (&str, &Law, BTreeMap<_, Sizes>)| {
            let largest = self.laws.largest(law);
            let of_channel = |sizes: &Sizes| -> Vec<Shown> {
                let share = 1.0 / sizes.len() as f64;
                let shown = |looks: &Vec<Look>| self.shown(law, (largest, share), looks);
                sizes.values().map(shown).collect()
            };
            let shown: Vec<Shown> = channels.values().flat_map(of_channel).collect();
            (name.to_string(), Discrepancy::learn(law, &shown))
        };
        let learned: Vec<(String, Option<Discrepancy>)> = kinds.into_iter().map(learn).collect();
        for (name, of) in learned {
            match of {
                Some(of) => drop(self.learned.insert(name, of)),
                None => self.laws.forget(&name),
            }
        }
        Some(())
    }

    /// The mean of what one channel shows of a law at one size. `share`: one over the number of the channel's sizes.
    fn shown(&self, law: &Law, (largest, share): (f64, f64), looks: &[Look]) -> Shown {
        let n = looks.len() as f64;
        let slope = looks.iter().map(|look| look.point.slope).sum::<Slope>() / n;
        let believed = looks.iter().map(|look| look.point.belief_slope).sum::<Slope>() / n;
        let noise = looks.iter().map(|look| look.noise).sum::<Matrix4<f64>>() / (n * n);
        let rows = looks.iter().map(|look| discrepancy::rows(law, largest, &look.point));
        Shown {
            share,
            off: looks.iter().map(|look| look.off).sum::<Vector4<f64>>() / n,
            rows: rows.sum::<discrepancy::Rows>() / n,
            belief: believed * self.belief() * believed.transpose(),
            scatter: self.scatter(&slope) + noise,
        }
    }

    /// How far a law is known to lie off; where no label of its kind has a size, as probably at all
    /// as the other kinds' do.
    fn discrepancy(&self, law: &Law) -> (Discrepancy, Guess) {
        let is_of_kind = |name: &String| self.laws.law(name).is_some_and(|of| of.is_kind_of(law));
        let (own, others): (Vec<_>, Vec<_>) =
            self.learned.iter().partition(|(name, _)| is_of_kind(name));
        let (sum, n) = others.iter().fold((0.5, 1.0), |(sum, n), (_, of)| match of.holds() {
            Some(holds) => (sum + holds, n + 1.0),
            None => (sum, n),
        });
        let before = sum / n;
        match own.first() {
            Some((_, learned)) => (learned.given(before), Guess::default()),
            None => {
                // as uncertain as a guessed rate, but for as far as the laws of others hold
                let share = GUESSED_RATE * (2.0 * (1.0 - before)).min(1.0).sqrt();
                (Discrepancy::unknown(law).given(before), Guess { none: law.none(), share })
            }
        }
    }

    /// Derivative of (ln stiffness, ln viscosity) by (ln damping, ln frequency) of the healthy ring.
    fn change(&self) -> Option<Matrix2<f64>> {
        let stiffer = |by: f64| ln_ring(&self.channel.times([by.exp(), by.exp(), 1.0, 1.0]));
        let thicker = |by: f64| ln_ring(&self.channel.times([1.0, 1.0, by.exp(), by.exp()]));
        Matrix2::from_columns(&[derivative(stiffer, 1e-3)?, derivative(thicker, 1e-3)?])
            .try_inverse()
    }

    /// One Gauss-Newton step; the covariance before it becomes the `belief`. `information`,
    /// `gradient`: of the labelled signals. `None`: the channel would not ring; nothing is changed.
    fn step(&mut self, prior: &Prior, information: Square, gradient: Changes) -> Option<()> {
        const MOST: f64 = 0.3;
        let theta = logs(&self.channel, &self.actuation);
        let measured = Vector2::new(self.ring.damping_per_s.ln(), self.ring.frequency_hz.ln());
        let off = measured - ln_ring(&self.channel)?;

        let (mut total, mut slope) = (information + prior.information, gradient);
        slope += prior.information * (prior.mean - theta);

        // the ring observes ln damping and ln frequency, neither of which the pulse (row 4) changes
        let mut gradients = SMatrix::<f64, CHANGES, 2>::zeros();
        for j in 0..4 {
            let moved = |by: f64| {
                let mut t = theta;
                t[j] += by;
                ln_ring(&channel(&t))
            };
            gradients.set_row(j, &derivative(moved, 1e-4)?.transpose());
        }
        for (column, off) in gradients.column_iter().zip(off.iter()) {
            total += column * column.transpose() / (RING_SD * RING_SD);
            slope += column * (off / (RING_SD * RING_SD));
        }

        // long steps are cut, since the model is linear only near by
        let covariance = total.try_inverse()?;
        let step = (covariance * slope).map(|v| v.clamp(-MOST, MOST));
        let theta = theta + step;
        if !theta.iter().all(|v| v.is_finite()) {
            return None;
        }
        ln_ring(&channel(&theta))?;
        self.channel = channel(&theta);
        self.actuation.pulse_s = theta[4].exp();
        self.belief = std::array::from_fn(|i| std::array::from_fn(|j| covariance[(i, j)]));
        Some(())
    }

    fn belief(&self) -> Square {
        Square::from_fn(|i, j| self.belief[i][j])
    }

    /// Covariance of the features by which channels differ, where `slope` is their derivative.
    fn scatter(&self, slope: &Slope) -> Matrix4<f64> {
        let mut scatter = slope * self.channels() * slope.transpose();
        scatter[(3, 3)] += self.spread.phase.powi(2);
        scatter
    }

    /// Covariance of a channel's own changes, which are taken for independent of each other.
    fn channels(&self) -> Square {
        Square::from_diagonal(&Changes::from(self.spread.changes).map(|sd| sd * sd))
    }

    /// Behind those of `classes` come those of what is no class; none, where the healthy channel
    /// does not ring. This takes long (thousands of fits).
    pub fn curves(&self, classes: &[Class], dt_s: f64, samples: usize) -> FaultCurves {
        let fitter = self.fitter((dt_s, samples));
        let simulator = self.simulator(&fitter);
        let noise = fitter.noise_covariance(&Features::HEALTHY, self.noise);
        let healthy = HealthySpread {
            slope: simulator.as_ref().map_or(Slope::zeros(), |of| of.healthy_slope),
            channels: self.channels(),
            phase: self.spread.phase.powi(2),
            noise: noise.unwrap_or_else(Matrix4::identity),
            belief: self.belief(),
            change: self.change().unwrap_or_default(),
        };
        let mut curves = FaultCurves::new(classes.len(), healthy.clone());
        let Some(simulator) = simulator else { return curves };
        let curves_of = |laws: Vec<&Law>| {
            side_by_side(cores(), laws, |law| {
                let (most, (discrepancy, _)) = (self.laws.largest(law), self.discrepancy(law));
                fault_curve(&mut simulator.clone(), law, most, (&healthy, &discrepancy))
            })
        };

        // classes of one kind share a curve; `numbered`: the kinds that ring, with the curves
        let laws = |class: &'_ Class| -> Vec<&Law> {
            class.of.iter().filter_map(|name| self.laws.law(name)).collect()
        };
        let mut kinds: Vec<&Law> = Vec::new();
        for law in classes.iter().flat_map(laws) {
            if !kinds.iter().any(|known| known.is_kind_of(law)) {
                kinds.push(law);
            }
        }
        let of_kinds = kinds.iter().zip(curves_of(kinds.clone()));
        let numbered: Vec<(&Law, usize)> = of_kinds
            .filter_map(|(kind, curve)| Some((*kind, curves.add(curve?, self.discrepancy(kind).1))))
            .collect();
        let member = |law| {
            let (_, curve) = *numbered.iter().find(|(kind, _)| kind.is_kind_of(law))?;
            Some(Member { law, curve })
        };
        for (k, class) in classes.iter().enumerate() {
            let members: Vec<Member> = laws(class).into_iter().filter_map(member).collect();
            curves.set(k, &members, self.seen.get(&class.name));
        }

        // contrasts: severities are uniform in the range of the name
        let contrasts: Vec<(&str, &Law)> = self.laws.contrasts().collect();
        let of_contrasts = curves_of(contrasts.iter().map(|(_, law)| *law).collect());
        for ((name, law), curve) in contrasts.into_iter().zip(of_contrasts) {
            let Some(curve) = curve else { continue };
            let share = uniform_in_range(&curve, law);
            curves.add_alternative(Alternative::Contrast(name.into()), law.weight, curve, &share);
        }

        // all nodes of one broad alternative are equally likely
        for (what, nodes) in broad(&fitter, self.noise, &healthy).into_iter().flatten() {
            let share = vec![1.0; nodes.len()];
            curves.add_alternative(what, tuned::NO_CLASS, nodes, &share);
        }
        curves
    }

    /// What a fault of this severity adds to the healthy signal at the reference drive, N, counts.
    /// `class`: the name of a law. `None`: there is none, or a channel does not ring.
    pub fn deviation(&self, class: &str, severity: f64, sampling: Sampling) -> Option<Vec<f64>> {
        let fitter = self.fitter(sampling);
        let simulator = self.simulator(&fitter)?;
        let healthy = simulator.decay(&self.channel)?;
        let law = self.laws.law(class)?;
        let gain = law.gain(severity);
        let faulty = simulator.decay(&law.apply(severity, &self.channel)?)?;
        Some(faulty.iter().zip(&healthy).map(|(f, h)| gain * f - h).collect())
    }
}

/// A labelled signal beside what the physics expects of its severity.
struct Look {
    point: Point,
    off: Vector4<f64>,
    noise: Matrix4<f64>,
}

impl LabelledFault {
    /// `change`: [`FaultPhysics::change`]. `None`: the channel would not ring.
    fn look(
        &self,
        law: &Law,
        simulator: &mut FaultSimulator,
        change: &Matrix2<f64>,
    ) -> Option<Look> {
        let point = simulator.point(law, law.scale(self.severity))?;
        // the healthy ring had changed by then (ink temperature), and the faulty one with it
        let changed = change * Vector2::from(self.ring);
        let moved = of_change(&(point.slope - simulator.healthy_slope)) * changed;
        let off = wrapped(self.features - point.mean - moved);
        Some(Look { noise: point.noise / (self.drive * self.drive), off, point })
    }
}

struct Prior {
    mean: Changes,
    information: Square,
}

impl Prior {
    /// `guess_sd`: of each ln rate by itself. `None`: the covariance is singular.
    fn new(guess: ActuatedChannel, guess_sd: f64) -> Option<Prior> {
        // a factor that a and b have in common, and one of g and d, are hardly known: equal entries
        let mut covariance = Square::identity() * (guess_sd * guess_sd);
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1), (2, 2), (2, 3), (3, 2), (3, 3)] {
            covariance[(i, j)] += SCALE_SD * SCALE_SD;
        }
        covariance[(4, 4)] = tuned::PULSE_SD * tuned::PULSE_SD;
        let mean = logs(&guess.channel, &guess.actuation);
        Some(Prior { mean, information: covariance.try_inverse()? })
    }
}

/// ln a, ln b, ln g, ln d, ln pulse.
fn logs(channel: &InkChannel, actuation: &Actuation) -> Changes {
    let [a, b, g, d] = channel.rates();
    Changes::from([a, b, g, d, actuation.pulse_s]).map(f64::ln)
}

fn channel(theta: &Changes) -> InkChannel {
    InkChannel::of(std::array::from_fn(|j| theta[j].exp()))
}

fn ln_ring(channel: &InkChannel) -> Option<Vector2<f64>> {
    let poles = channel.poles()?;
    Some(Vector2::new(poles.damping_per_s.ln(), poles.frequency_hz.ln()))
}

fn derivative(of: impl Fn(f64) -> Option<Vector2<f64>>, step: f64) -> Option<Vector2<f64>> {
    Some((of(step)? - of(-step)?) / (2.0 * step))
}

#[cfg(test)]
mod tests;
