//! Finds the size of an effect that has a given strength in detection limits (DL). In: a run (`Base`), an
//! effect, a strength. Out: [`Strength`], the size and the strength that was reached, and the contract's
//! parameter of that size.
//!
//! A detection limit is the size at which the likelihood-ratio test of one degree of freedom against the
//! refitted baseline has noncentrality 20.9 (significance level 1e-3, power 90 %). An effect of s detection
//! limits has the noncentrality 20.9 s². How the noncentrality follows from the size depends on the effect:
//!
//! * on the mean of the signals: it is the chi-squared that the refitted [`Baseline`] leaves of what the
//!   effect changes. The size is searched ([`Yardstick::size`]); for a clipping level by bisection;
//! * on variance or correlation of the noise, a random tone, the trigger: it is the Fisher information times
//!   the square of what the effect adds to the variance or correlation, so the size is in closed form;
//! * `coarse_lsb` has no detection limit: its step is 1 count more than its strength, and `COARSEST_STEP` at
//!   most.

use super::baseline::{Baseline, Change, Freedom};
use super::effect::{Acts, Conditions, Effect};
use super::plant::State;
use super::run::{Acquisitions, Base, RunChannel};
use crate::simulate::sensor::NOMINAL_DRIVE_V;
use inkling_core::model::bisection::bisected;
use nalgebra::DVector;
use std::collections::{BTreeMap, BTreeSet};

pub const NONCENTRALITY: f64 = 20.9;
/// Strengths that effects are hidden with, in detection limits, in ascending order.
pub const STRENGTHS_DL: [f64; 5] = [1.0, 2.0, 4.0, 8.0, 30.0];
/// Of more signals than this only about so many are simulated to find a size, evenly over the run.
const MANY_SIGNALS: usize = 1024;
/// At least so many acquisitions of each printhead are simulated, to see what changes along the run.
const FEWEST_STEPS: usize = 4;
/// Coarsest step of codes that is hidden, counts.
const COARSEST_STEP: f64 = 12.0;
/// Largest factor from one trial size to the next, so that the refit can follow.
const LONGEST_STEP: f64 = 1.6;
const MOST_TRIALS: usize = 40;
/// Nodes (in standard deviations) and weights of Gauss-Hermite quadrature, for means over normal noise.
const NODES: [(f64, f64); 7] = [
    (0.0, 0.457_142_857_142_857),
    (1.154_405_394_739_968, 0.240_123_178_605_013),
    (-1.154_405_394_739_968, 0.240_123_178_605_013),
    (2.366_759_410_734_541, 0.030_757_123_967_586),
    (-2.366_759_410_734_541, 0.030_757_123_967_586),
    (3.750_439_717_725_742, 0.000_548_268_855_973),
    (-3.750_439_717_725_742, 0.000_548_268_855_973),
];

/// A healthy signal of the run without scatter and noise, and what it was simulated from.
struct SimulatedSignal {
    made: RunChannel,
    /// Number of the channel, counted over all printheads.
    channel: usize,
    conditions: Conditions,
    /// Its samples without effect and without noise, counts.
    plain: Vec<f64>,
}

#[derive(Clone, Copy, Debug)]
pub struct Strength {
    pub size: f64,
    pub strength_dl: f64,
}

/// The baseline and signals of one run, with which strengths are measured.
pub struct Yardstick {
    base: Base,
    baseline: Baseline,
    /// The simulated signals, channel by channel.
    signals: Vec<SimulatedSignal>,
    /// Freedoms of each channel, by its number over all printheads.
    own: Vec<Freedom>,
    /// All healthy signals of the run over the simulated ones, by which noncentralities are multiplied.
    share: f64,
}

impl Yardstick {
    /// Simulates healthy signals of a run, and makes its baseline; `None`: a channel does not ring.
    pub fn new(base: &Base) -> Option<Yardstick> {
        let run = &base.run;
        let mut acquisitions = Acquisitions::new(base.clone(), Vec::new());
        let mut signals = Vec::new();
        // choose the steps that are simulated: the middles of equal stretches of the run
        let all_steps = run.bursts_per_channel;
        let steps = MANY_SIGNALS.div_ceil(run.printheads * run.channels).max(FEWEST_STEPS);
        let steps = steps.min(all_steps);
        let simulated: BTreeSet<usize> =
            (0..steps).map(|i| (2 * i + 1) * all_steps / (2 * steps)).collect();
        for (step, head) in (0..all_steps).flat_map(|k| (0..run.printheads).map(move |h| (k, h))) {
            // drawn for every step, since the random numbers come in order
            let conditions = acquisitions.conditions(head, step);
            let channels = (head * run.channels..).zip(&base.heads[head]).zip(conditions);
            let wanted = simulated.contains(&step);
            for ((channel, &made), conditions) in
                channels.filter(|((_, made), _)| wanted && !made.faulty)
            {
                // the healthy scatter is in the baseline's covariance instead
                let conditions = Conditions { shot: [0.0; 7], ..conditions };
                let plain = base.clean(&made, &conditions, &[]);
                signals.push(SimulatedSignal { made, channel, conditions, plain });
            }
        }
        let share = all_steps as f64 / steps as f64;
        // the baseline asks for the signals of a channel one after another
        signals.sort_by_key(|s| s.channel);
        let baseline = Baseline::new(base)?;
        let mut own = Vec::new();
        for made in base.heads.iter().flatten() {
            let mut of = baseline.frame.freedom(base, &made.rates)?;
            of[0] += made.gain.ln();
            own.push(of);
        }
        Some(Yardstick { base: base.clone(), baseline, signals, own, share })
    }

    /// The size at which `effect` has `strength_dl` detection limits. If its physical range does not allow
    /// that, the next smaller one of [`STRENGTHS_DL`] is tried, and so on. `effect`: with its shape; its size
    /// is where the search starts.
    pub fn size(&self, effect: &Effect, strength_dl: f64) -> Strength {
        let lower = STRENGTHS_DL.iter().rev().copied().filter(|s| *s < strength_dl);
        let mut reached = Strength { size: effect.size, strength_dl };
        for asked in std::iter::once(strength_dl).chain(lower) {
            reached = self.size_within(effect, asked);
            if reached.strength_dl >= asked {
                break;
            }
        }
        reached
    }

    /// The size for one strength (the cases of the file's doc), with the strength that was reached.
    fn size_within(&self, effect: &Effect, strength_dl: f64) -> Strength {
        let samples = self.base.physics.acquisition.samples as f64;
        let signals = self.signals.len() as f64 * self.share;
        let size = match (effect.acts, effect.id) {
            // the Fisher information of rho at 0 is 1 per sample
            (Acts::Correlation, _) => strength_dl * (NONCENTRALITY / (signals * samples)).sqrt(),
            // the variance is v (1 + h u) with u = (y/largest)²
            (Acts::NoiseGrowth, _) => {
                let largest = self.base.largest_counts();
                let grown =
                    || self.signals.iter().flat_map(|s| &s.plain).map(|y| (y / largest).powi(2));
                let n = self.signals.len() as f64 * samples;
                let mean = grown().sum::<f64>() / n;
                // The information of h at 0 is half the sum of the squares of u about its mean, as v is fitted,
                // too.
                let squares = grown().map(|u| (u - mean).powi(2)).sum::<f64>();
                strength_dl * (2.0 * NONCENTRALITY / (squares * self.share)).sqrt()
            }
            // the effect is a variance, size², so the size grows with the root of the strength
            (Acts::Trigger, _) => {
                let information = self.trigger_information();
                strength_dl.sqrt() * (NONCENTRALITY / information).powf(0.25)
            }
            // A tone of amplitude A and random phase adds the share A² N / 4 s² to the energies of cosine and
            // sine, s² being the noise's variance; the information of that share at 0 is 1 per signal, if
            // each has a phase of its own. `limit` is twice the share at the detection limit.
            (_, "random_tone") => {
                let limit = 2.0 * (NONCENTRALITY / signals).sqrt();
                strength_dl.sqrt() * (2.0 * self.baseline.noise_var * limit / samples).sqrt()
            }
            (Acts::Code(_), "coarse_lsb") => {
                let strength_dl = strength_dl.min(COARSEST_STEP - 1.0);
                return Strength { size: 1.0 + strength_dl, strength_dl };
            }
            (Acts::Code(_), _) => self.level(effect, strength_dl),
            _ => return self.sought(effect, strength_dl),
        };
        Strength { size, strength_dl }
    }

    /// Searches the size that leaves as much misfit as is wanted, from the size in the catalogue on, by steps
    /// of bounded length that assume misfit ~ size^power. The search may end before: at the largest size that
    /// is physical, or where a larger effect leaves less misfit. A strength of 0 in the result: the misfit is
    /// no positive number, or `MOST_TRIALS` trials did not find the size.
    fn sought(&self, effect: &Effect, strength_dl: f64) -> Strength {
        let wanted = NONCENTRALITY * strength_dl * strength_dl;
        let largest = effect.largest();
        // each refit starts where the one before has ended
        let mut moved = Vec::new();
        let mut size = effect.size;
        // size and misfit of the trial before
        let mut before: Option<(f64, f64)> = None;
        for _ in 0..MOST_TRIALS {
            let own = self.misfit(&effect.of_size(size), &mut moved);
            if own.is_nan() || own <= 0.0 {
                return Strength { size, strength_dl: 0.0 };
            }
            let reached = Strength { size, strength_dl: strength_dl * (own / wanted).sqrt() };
            if (reached.strength_dl / strength_dl - 1.0).abs() < 2e-3 {
                return Strength { size, strength_dl };
            }
            // The misfit of a small effect grows with the square of its size; then by the power seen last.
            let mut power = 2.0;
            if let Some((smaller, of_smaller)) = before {
                let grown = (size / smaller).ln();
                if grown > 0.0 && own < 0.98 * of_smaller {
                    return reached; // larger, and easier to explain: it reaches no more
                }
                power = ((own / of_smaller).ln() / grown).clamp(1.0, 8.0);
            }
            if own < wanted && size.abs() >= largest {
                return reached;
            }
            // the next trial; downwards it may be farther away, since a refit to a smaller effect is easier
            before = Some((size, own));
            let ratio = (wanted / own).powf(1.0 / power);
            size *= ratio.clamp(1.0 / LONGEST_STEP.powi(4), LONGEST_STEP);
            size = size.clamp(-largest, largest);
        }
        Strength { size, strength_dl: 0.0 }
    }

    /// The clipping level of so many detection limits: the lower the level, the larger the misfit.
    fn level(&self, effect: &Effect, strength_dl: f64) -> f64 {
        let wanted = NONCENTRALITY * strength_dl * strength_dl;
        let is_below = |size: f64| self.noncentrality(&effect.of_size(size)) > wanted;
        let [low, high] = bisected(0.0, 1.5 * self.base.largest_counts(), 30, is_below);
        0.5 * (low + high)
    }

    /// What the effect adds to the N samples of a signal, in the mean over noise, counts.
    fn changed(&self, signal: &SimulatedSignal, effect: &Effect) -> DVector<f64> {
        let plain = DVector::from_column_slice(&signal.plain);
        if let Acts::Code(act) = effect.acts {
            // Codes act after noise: take the mean, over the noise, of what they change in each sample.
            let sd = self.baseline.noise_var.sqrt();
            let mean = |y: f64| -> f64 {
                let of = |(z, w): &(f64, f64)| w * (act(effect, y + sd * z) - (y + sd * z));
                NODES.iter().map(of).sum()
            };
            return plain.map(mean);
        }
        DVector::from_vec(self.base.clean(&signal.made, &signal.conditions, &[*effect])) - plain
    }

    /// Noncentrality of the likelihood-ratio test of an effect on the mean against the refitted baseline.
    pub fn noncentrality(&self, effect: &Effect) -> f64 {
        self.misfit(effect, &mut Vec::new())
    }

    /// Chi-squared that the refitted baseline leaves of the effect, scaled to all signals of the run.
    /// `moved`: as in [`Baseline::misfit`].
    fn misfit(&self, effect: &Effect, moved: &mut Vec<Freedom>) -> f64 {
        let changes: Vec<Change> = self
            .signals
            .iter()
            .map(|signal| Change {
                channel: signal.channel,
                drive: signal.conditions.drive_v / NOMINAL_DRIVE_V,
                own: &self.own[signal.channel],
                samples: self.changed(signal, effect),
            })
            .collect();
        self.baseline.misfit(&changes, moved) * self.share
    }

    /// Fisher information (1/s⁴) of the variance of a shift of t_a that a burst's channels share, where
    /// bursts may also share a healthy variance that is the same along the shift and across it. What tells
    /// the jitter is then the difference of the two variances. Each of them has the information sum over
    /// bursts of (sum over the burst's signals of x' W x)²/2, with x its direction in the freedoms; and a
    /// difference of two independent estimates has the information I1 I2 / (I1 + I2).
    fn trigger_information(&self) -> f64 {
        // The shift per 10 ns, so that the numbers are moderate; the factor 1e32 takes that back. Across it:
        // the same length in ln A and phi, turned by a right angle.
        let later = self.baseline.frame.later(&self.baseline.nominal) * 1e-8;
        let mut across = Freedom::zeros();
        (across[0], across[1]) = (-later[1], later[0]);
        // sums of x' W x over the signals of each burst, along and across
        let mut sums = BTreeMap::<(usize, usize), [f64; 2]>::new();
        for signal in &self.signals {
            let drive = signal.conditions.drive_v / NOMINAL_DRIVE_V;
            let weight = self.baseline.information(drive);
            let sum = sums
                .entry((signal.channel / self.base.run.channels, signal.conditions.burst))
                .or_default();
            for (sum, x) in sum.iter_mut().zip([later, across]) {
                *sum += x.dot(&(weight * x));
            }
        }
        let of =
            |k: usize| sums.values().map(|s| 0.5 * s[k] * s[k]).sum::<f64>() * self.share * 1e32;
        of(0) * of(1) / (of(0) + of(1))
    }

    /// The contract's `parameter` for an effect of this size: the frequency of a line; the rate of the
    /// low-pass; for a term of the equation of motion, how much frequency or damping at the largest drive
    /// differ from those at no or the smallest amplitude (by the term's first harmonic); or the size itself.
    pub fn parameter(&self, effect: &Effect) -> f64 {
        match effect.id {
            "lowpass" | "second_mode" | "tone" | "random_tone" => effect.shape,
            // the size is relative to the middle of the head, the parameter to the first channel
            "position_gradient" => (1.0 + 0.5 * effect.size) / (1.0 - 0.5 * effect.size) - 1.0,
            "cubic_stiffness" => {
                // first harmonic of V (1 + k3 V²): stiffness grows by 3/4 k3 V0²
                let highest_v = self.base.drive_range_v()[1];
                let volume = self.oscillation(highest_v, |state| state.x[0] + state.x[1]);
                (1.0 + 0.75 * effect.size * volume * volume).max(0.0).sqrt() - 1.0
            }
            "quadratic_drag" | "dry_friction" => {
                // damping with the term replaced by a linear loss of the same first harmonic
                let damping = |drive_v: f64| {
                    let flow = self.oscillation(drive_v, |state| state.x[3]);
                    // first harmonics of |q| q and of sign q
                    let extra = match effect.id {
                        "quadratic_drag" => 8.0 / (3.0 * std::f64::consts::PI) * effect.size * flow,
                        _ => 4.0 / std::f64::consts::PI * effect.size / flow,
                    };
                    let mut rates = self.base.rates;
                    rates.d_per_s += extra;
                    rates.poles().map_or(f64::NAN, |p| p.damping_per_s)
                };
                let [lowest, highest] = self.base.drive_range_v().map(damping);
                highest / lowest - 1.0
            }
            _ => effect.size,
        }
    }

    /// Amplitude at t_a of the oscillating part of what `of` makes of the nominal channel's states.
    fn oscillation(&self, drive_v: f64, of: fn(&State) -> f64) -> f64 {
        let y = self.base.course(drive_v, of);
        let fitted = self.baseline.frame.amplitudes(&y, &self.baseline.nominal);
        fitted.map_or(f64::NAN, |[a, b, _]| a.hypot(b))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::score::truth::Circumstance;
    use crate::simulate::fixtures::{HIDDEN, HIDDEN_PLAIN, physics, replaced};
    use crate::simulate::hidden::effect;

    fn base(text: &str, circumstances: &[Circumstance], seed: u64) -> Base {
        let physics = physics(text);
        let (run, hidden) = (physics.print_run.clone().unwrap(), physics.hidden.clone().unwrap());
        Base::new(&physics, &run, &hidden, circumstances, seed)
    }

    fn yardstick(text: &str) -> Yardstick {
        Yardstick::new(&base(text, &[], 5)).unwrap()
    }

    fn shaped(id: &str) -> Effect {
        let effect = effect::CATALOGUE.into_iter().find(|e| e.id == id).unwrap();
        Effect { shape: if id == "lowpass" { 6e5 } else { 101e3 }, ..effect }
    }

    /// Ranges that a study of 192 signals published, found by other code: the same limits within a
    /// factor of 2. What acts through a covariate depends on the healthy scatter (here narrower than the
    /// study's) and on how far the covariate goes; meniscus hardly leaves a misfit once rates and a
    /// second slow pole's amplitude are refitted (the study's number is of the tangents).
    #[test]
    fn detection_limits_are_those_of_the_study() {
        let yardstick = yardstick(HIDDEN);
        let expected = [
            ("offset", 0.07, 0.11),
            ("droop", 800.0, 1500.0),
            ("lowpass", 0.012, 0.018),
            ("second_mode", 0.2, 0.3),
            ("tone", 0.08, 0.09),
            ("random_tone", 0.21, 0.21),
            ("correlated_noise", 0.03, 0.03),
            // per count in the study, of a ring of 100 counts
            ("quadratic_drag", 1.1e-2, 1.7e-2),
            ("cubic_stiffness", 1.1e-3, 1.9e-3),
            // the study's limit, for the 12 channels of a burst
            ("trigger_jitter", 27e-9 / 12f64.sqrt(), 27e-9 / 12f64.sqrt()),
            ("position_gradient", 0.0048, 0.0048),
        ];
        let mut off = Vec::new();
        for effect in &effect::CATALOGUE {
            let effect = shaped(effect.id);
            let Strength { size, .. } = yardstick.size(&effect, 1.0);
            let parameter = yardstick.parameter(&effect.of_size(size));
            if let Some((_, low, high)) = expected.iter().find(|(id, ..)| *id == effect.id)
                && !(low / 2.0..high * 2.0).contains(
                    match effect.is_line() || effect.id == "lowpass" {
                        true => &size,
                        false => &parameter,
                    },
                )
            {
                off.push(format!("{} {size} {parameter}", effect.id));
            }
        }
        assert!(off.is_empty(), "{off:?}");
    }

    /// Of a run four times as long, of which only some signals are simulated, an effect along the run leaves
    /// four times the misfit.
    #[test]
    fn what_grows_along_a_long_run_is_measured_along_all_of_it() {
        let size = |bursts: usize| {
            let bursts = format!("bursts_per_channel = {bursts}");
            let text = replaced(HIDDEN, &[("bursts_per_channel = 16", &bursts)]);
            yardstick(&text).size(&shaped("ageing"), 1.0).size
        };
        let ratio = size(80) / size(320);
        assert!((1.8..2.2).contains(&ratio), "{ratio}");
    }

    #[test]
    fn the_coarsest_step_has_its_own_strength() {
        let coarse = yardstick(HIDDEN).size(&shaped("coarse_lsb"), 30.0);
        assert_eq!((coarse.size, coarse.strength_dl), (9.0, 8.0));
    }

    /// Reaches the same number by another route: fits everything by least squares, with the change as one
    /// column.
    #[test]
    fn without_scatter_it_is_the_drop_in_chi_squared() {
        let without_scatter = [
            ("gain = 0.01\nstate = 0.01", "gain = 0.0\nstate = 0.0"),
            ("frequency_sd = 0.002", "frequency_sd = 0.0"),
            ("damping_sd = 0.01", "damping_sd = 0.0"),
            (
                "a = 0.004\nb = 0.004\ng = 0.03\nd = 0.03\ngain = 0.025",
                "a = 0.5\nb = 0.5\ng = 0.5\nd = 0.5\ngain = 0.5",
            ),
        ];
        let mut base = base(&replaced(HIDDEN_PLAIN, &without_scatter), &[], 5);
        // all channels are alike, though the base lets them scatter widely, so each has six freedoms of its
        // own
        let made = RunChannel { rates: base.rates, gain: 1.0, faulty: false };
        base.heads.iter_mut().flatten().for_each(|channel| *channel = made);
        let yardstick = Yardstick::new(&base).unwrap();
        let offset = effect::CATALOGUE[0].of_size(1e-3);
        let ones = DVector::from_element(128, 1e-3);
        let (_, freedoms) = yardstick.baseline.frame.decay(&yardstick.baseline.nominal);
        let weight = 192.0 / yardstick.baseline.noise_var;
        // the prior of the real pole's place has the variance of a logistic variable
        let mut gram = freedoms.tr_mul(&freedoms) * weight;
        gram[(5, 5)] += 3.0 / std::f64::consts::PI.powi(2);
        let x = gram.lu().solve(&(freedoms.tr_mul(&ones) * weight)).unwrap();
        let expected = weight * ones.dot(&(&ones - &freedoms * x));
        let own = yardstick.noncentrality(&offset);
        assert!((own / expected - 1.0).abs() < 0.05, "{own} {expected}");
    }

    /// A change of rates and state alone is inside the baseline, however large it is.
    #[test]
    fn a_change_of_rates_is_no_misfit() {
        let yardstick = yardstick(HIDDEN_PLAIN);
        for by in [0.001, 0.03, 0.1] {
            let stiffer = Effect {
                acts: Acts::Plant(|e, _, q| {
                    let by = 1.0 + e.size;
                    q.rates = q.rates.times([by, by, 1.0, by]);
                }),
                ..shaped("offset")
            };
            let own = yardstick.noncentrality(&stiffer.of_size(by));
            assert!(own < 0.2, "{by}: {own}");
        }
    }
}
