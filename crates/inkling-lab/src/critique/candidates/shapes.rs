//! Causes that add a shape, N samples, to the mean signal: terms in the equation of motion (`motion`), the
//! droop, the transient of a low-pass; and the scan for shapes that no cause of the catalogue has
//! (`own_shape`).
//!
//! In: a fitted model with its signals ([`ScoreTests`]). Out: [`Scored`]. Most of these causes add e D(e),
//! where the shape D(e) changes with their strength e; `grown` finds the likeliest e. A shape that depends on
//! the drive is decomposed into powers of the drive (`by_drive`), because the space of extensions has one
//! shape for each power. Time is in signal lengths; drives are relative to the mean drive of the recording.

use super::{Asked, ScoreTests, Scored};
use crate::critique::candidate::Objection;
use crate::critique::catalogue::{CauseId, Motion};
use crate::critique::chance::{maximum, surprise, width};
use crate::critique::model::PATTERNS;
use crate::critique::space::Direction;
use crate::critique::tuned::{ETA_FLOOR, INTERIOR};
use crate::critique::unmodelled::Term;
use inkling_core::model::free_decay;
use nalgebra::{Matrix4, Vector4};
use std::f64::consts::PI;

/// The catalogue's parameter of a cause in the equation of motion. `e`: the term's strength; `low`, `high`:
/// smallest and largest drive in the data.
fn value_of(id: CauseId, e: f64, [low, high]: [f64; 2]) -> f64 {
    match id {
        // the change of frequency at the largest amplitude in the data
        CauseId::CubicStiffness => e * high * high,
        // The damping at the largest amplitude in the data relative to that at the smallest, less 1. Over the
        // viscous one it is 1 + e s at the drive s with drag of strength e, and 1 + e/s with friction. Where
        // drives differ by less than 2 %, compare with no amplitude for drag, with a tenth for friction,
        // which at none would be infinite. Dampings below .05 count as .05, as a negative e may leave none to
        // divide by.
        CauseId::QuadraticDrag => {
            let small = if high > 1.02 * low { low } else { 0.0 };
            (1.0 + e * high) / (1.0 + e * small).max(0.05) - 1.0
        }
        CauseId::DryFriction => {
            let small = if high > 1.02 * low { low } else { 0.1 * high };
            (1.0 + e / high) / (1.0 + e / small).max(0.05) - 1.0
        }
        _ => e,
    }
}

impl ScoreTests<'_> {
    /// Tests an effect that is not proportional to its strength e: finds the e of the largest likelihood.
    ///
    /// `shape`: the secant D(e) = (y(e) - y(0)) / e, where y(e) is the mean signal with the effect. With the
    /// information i and the score s along D(e), adding e D(e) lowers -2 ln likelihood by 2 e s - e² i, which
    /// is compared over e. `first`: the strength whose secant the linear test takes, and the scale of the
    /// grid that is searched; `most`: the largest strength, of either sign. `value` turns a strength into the
    /// catalogue's parameter. `near`: the form that the cause had in the model, whose `near.shape` is e;
    /// strengths about it are tried instead of the grid.
    pub(super) fn grown(
        &self,
        Asked { id, near }: Asked,
        [first, most]: [f64; 2],
        shape: impl Fn(f64) -> Option<Direction>,
        value: impl Fn(f64) -> f64,
    ) -> Option<Scored> {
        // t.coefficients[0] is s/i and t.statistic s²/i, so this is 2 e s - e² i
        let gain = |e: f64| -> f64 {
            let tested = shape(e).and_then(|d| self.nuisances.shapes.test(&[d]));
            tested.map_or(f64::NEG_INFINITY, |t| {
                let ratio = e / t.coefficients[0];
                t.statistic * (2.0 * ratio - ratio * ratio)
            })
        };

        let mut scored = self.fixed(id, shape(first)?)?;
        let linear = scored.form.coefficients[0];
        // An effect within two standard errors of none is small enough to be linear.
        let mut strength = linear.clamp(-most, most);
        if scored.statistic > 4.0 || near.is_some() {
            // trials are a factor of 3 apart with the sign of the linear test, of 5 with the other one
            let mut trials: Vec<f64> = vec![strength];
            match near {
                Some(near) => trials.extend([near.shape, 0.7 * near.shape, 1.4 * near.shape]),
                None => {
                    trials.extend((0..7).map(|k| linear.signum() * first * 3f64.powi(k - 2)));
                    trials.extend((0..3).map(|k| -linear.signum() * first * 5f64.powi(k)));
                }
            }
            trials.retain(|e| e.abs() <= most && *e != 0.0);
            let best = trials
                .into_iter()
                .map(|e| (gain(e), e))
                .fold((f64::NEG_INFINITY, strength), |b, t| if t.0 > b.0 { t } else { b });
            if best.1 == 0.0 || !best.0.is_finite() {
                return None;
            }
            let sign = best.1.signum();
            // in ln e, a step of the trials either way: ln 1.4 or ln 3
            let reach = if near.is_some() { 0.35 } else { 1.1 };
            let ln = maximum(|x| gain(sign * x.exp().min(most)), best.1.abs().ln(), reach);
            strength = sign * ln.exp().min(most);
            scored.statistic = gain(strength).max(0.0);
            scored.sd = width(gain, strength, 0.3 * scored.sd);
            // strength and size are the same parameter: one degree of freedom, no further shapes tried
            scored.surprise = surprise(scored.statistic, 1, 1.0, f64::INFINITY);
            scored.form.directions = vec![shape(strength)?];
            scored.form.coefficients = vec![strength];
        }
        scored.form.shape = strength;

        // standard error in the catalogue's unit, by the slope of `value` (delta method)
        let h = 1e-3 * strength.abs().max(1e-12);
        scored.sd *= ((value(strength + h) - value(strength - h)) / (2.0 * h)).abs();
        scored.value = value(strength);
        Some(scored)
    }

    /// A strength is the relative change of frequency or damping that the term causes at unit drive, or what
    /// [`Term`] says of it. `place`: the displacement at which a stop begins, in amplitudes at unit drive.
    pub(super) fn motion(&self, asked: Asked, motion: Motion, place: f64) -> Option<Scored> {
        let (Motion { power, strengths }, id) = (motion, asked.id);
        // the secant at the strength e: the decay with the term less the decay without it, over e
        let inside = self.interior?;
        let decay = |with, s| inside.decay(with, s, self.samples);
        let without: Vec<Vec<f64>> = self.nodes().iter().map(|s| decay(None, *s)).collect();
        let shape = |e: f64| {
            self.by_drive(power, |node, s| {
                let with = decay(Some(Term { id, strength: e, place }), s);
                with.iter().zip(&without[node]).map(|(w, o)| (w - o) / e).collect()
            })
        };
        let drives = self.data.beside.drives();
        let value = |e: f64| value_of(id, e, drives);

        let mut scored = self.grown(asked, strengths, shape, value)?;
        // The scatter of the acquisition state alone may look like a half-order loss up to `eta_floor`. So
        // only the strength beyond that counts, and Student's t allows for that scatter being estimated.
        if id == CauseId::FractionalDamping && scored.value != 0.0 {
            let beyond = (scored.value.abs() - ETA_FLOOR).max(0.0) / scored.value.abs();
            scored.statistic *= beyond * beyond;
            // `dof(false)`: by the number of signals, not of channels
            scored.surprise = surprise(scored.statistic, 1, 1.0, self.dof(false));
            scored.sd = scored.sd.hypot(ETA_FLOOR / 2.0);
        }
        // springs harden or soften, rivals do anything; losses cannot be negative
        let either_sign = id == CauseId::CubicStiffness || !id.has_name();
        if scored.form.coefficients[0] < 0.0 && !either_sign {
            scored.objection = Some(Objection::UnphysicalSign);
        }
        // amplitudes inside an ink channel rest on a ratio of rates that is not known exactly
        if id.by_amplitude() {
            scored.sd = scored.sd.hypot(INTERIOR * scored.value);
        }
        Some(scored)
    }

    /// The relative drives at which shapes that depend on it are computed: four Chebyshev nodes, or the mean
    /// drive alone where drives differ by less than 2 %.
    fn nodes(&self) -> Vec<f64> {
        let [low, high] = self.data.beside.drives();
        if high < 1.02 * low {
            return vec![1.0];
        }
        let node = |j| {
            let x = (PI * (f64::from(j) + 0.5) / 4.0).cos();
            0.5 * (low + high) + 0.5 * (high - low) * x
        };
        (0..4).map(node).collect()
    }

    /// A shape decomposed into powers 0 to 3 of the drive. `added`: the shape at a relative drive, N samples,
    /// counts, by its place among [`Self::nodes`] and the drive itself. With the mean drive alone it is taken
    /// to scale as the drive to the power `power`. `None`: the shape is not finite.
    pub(super) fn by_drive(
        &self,
        power: i32,
        added: impl Fn(usize, f64) -> Vec<f64>,
    ) -> Option<Direction> {
        let n = self.samples;
        let finite =
            |d: Direction| d.0.iter().all(|(_, v)| v.iter().all(|x| x.is_finite())).then_some(d);
        let nodes = self.nodes();
        let at: Vec<Vec<f64>> = nodes.iter().enumerate().map(|(j, s)| added(j, *s)).collect();
        if let [at_mean] = &at[..] {
            return finite(Direction::shape(power.clamp(0, 3) as usize, at_mean.clone()));
        }
        // the coefficients of the cubic through the four nodes, sample by sample
        let inverse = Matrix4::from_fn(|j, p| nodes[j].powi(p as i32)).try_inverse()?;
        let of_power = |p: usize| {
            let coefficient = |k: usize| (inverse.row(p) * Vector4::from_fn(|j, _| at[j][k]))[0];
            (p * n, (0..n).map(coefficient).collect())
        };
        finite(Direction((0..PATTERNS).map(of_power).collect()))
    }

    /// Tests a droop: a charge amplifier that leaks, hence a first-order high-pass, which begins at t_a. Its
    /// strength is the rate of the leak per signal length, its value the same in 1/s. At the first rate 5 %
    /// leak off within a signal, so that the effect is nearly linear; at the largest all has leaked off long
    /// before the end (both somewhat arbitrary).
    pub(super) fn droop(&self, asked: Asked) -> Option<Scored> {
        let shape = |w: f64| Some(Direction::shape(1, self.leaked(w)));
        let mut scored = self.grown(asked, [0.05, 12.0], shape, |w| w / self.data.length_s())?;
        if scored.form.coefficients[0] < 0.0 {
            scored.objection = Some(Objection::UnphysicalSign);
        }
        Some(scored)
    }

    /// What a leak at the rate w adds to the mean signal y at unit drive, per unit of w:
    /// -int_0^t e^{-w(t-u)} y(u) du.
    fn leaked(&self, w: f64) -> Vec<f64> {
        let n = self.samples;
        let y = self.ring();
        let h = 1.0 / n as f64;
        let fall = (-w * h).exp();
        let mut x = 0.0;
        (0..n)
            .map(|k| {
                if k > 0 {
                    // the integral so far falls exactly; the trapezoidal rule adds the step that ends here
                    x = x * fall + h * 0.5 * (y[k] + fall * y[k - 1]);
                }
                -x
            })
            .collect()
    }

    fn ring(&self) -> Vec<f64> {
        let mut y = vec![0.0; self.samples];
        free_decay::add(&self.model.decay(), 0.0, 1.0, &mut y);
        y
    }

    /// Tests the transient of a low-pass: an exponential that begins with the signal, scales with the drive
    /// and decays at a rate w (per signal length; the value is w in 1/s). w is searched from four times the
    /// ring's damping, and at least 6, up to where the transient falls by e² from one sample to the next.
    pub(super) fn transient(&self, Asked { id, near }: Asked) -> Option<Scored> {
        let n = self.samples as f64;
        let shape = |w: f64| {
            let y: Vec<f64> = (0..self.samples).map(|k| (-w * k as f64 / n).exp()).collect();
            Direction::shape(1, y)
        };
        let (low, high) = ((4.0 * self.decay.sigma).max(6.0), 2.0 * n);
        let grid = (0..24).map(|i| (low * (high / low).powf(f64::from(i) / 23.0)).ln());
        let near = near.map(|near| near.shape.ln());
        // All is in ln w. The reach of .12 is more than half of a step of the grid up to 512 samples. Shapes
        // of close rates are alike, so three independent ones are paid for.
        let within = (grid, 0.12, [low.ln(), high.ln()]);
        let mut scored = self.searched(id, 3.0, near, within, |x| vec![shape(x.exp())])?;
        let w = scored.value.exp();
        (scored.value, scored.form.shape) = (w / self.data.length_s(), w);
        scored.sd = scored.sd * w / self.data.length_s();
        Some(scored)
    }

    /// The shape without a name that explains most of the mean misfit: a half-sine bump of 4, 8, 16, ..
    /// samples, up to half of the signal, at steps of half its length; or a step that lasts to the end, at
    /// every second sample but the first and the last sixteenth. Each is tried with the powers 0 and 1 of the
    /// drive and paid for as if all were independent. The value is the shape's size in counts. `near`: the
    /// shape that it holds is tested again without a search.
    pub fn own_shape(&self, Asked { id, near }: Asked) -> Option<Scored> {
        if let Some(near) = near {
            return self.fixed(id, near.directions[0].clone());
        }
        let n = self.samples;
        let (mut best, mut tried) = (None::<(f64, Direction)>, 0.0);
        let mut look = |pattern: usize, start: usize, shape: &dyn Fn(usize) -> f64, end: usize| {
            let mut y = vec![0.0; n];
            (start..end).for_each(|k| y[k] = shape(k - start));
            let direction = [Direction::shape(pattern, y)];
            let Some(t) = self.nuisances.shapes.test(&direction) else { return };
            tried += 1.0;
            if best.as_ref().is_none_or(|(most, _)| t.statistic > *most) {
                let [direction] = direction;
                best = Some((t.statistic, direction));
            }
        };
        for pattern in 0..2 {
            let mut length = 4;
            while length <= n / 2 {
                let bump = |k: usize| (PI * (k as f64 + 0.5) / length as f64).sin();
                for start in (0..=n - length).step_by(length / 2) {
                    look(pattern, start, &bump, start + length);
                }
                length *= 2;
            }
            for start in (n / 16..n - n / 16).step_by(2) {
                look(pattern, start, &|_| 1.0, n);
            }
        }
        let (_, direction) = best?;
        let scored = self.fixed(id, direction)?;
        let surprise = surprise(scored.statistic, 1, tried, f64::INFINITY);
        Some(Scored { tried, surprise, ..scored })
    }
}
