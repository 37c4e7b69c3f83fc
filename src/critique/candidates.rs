//! Every cause of the catalogue that acts on the mean signal or through a covariate, as directions in
//! the space of linear extensions, and its likelihood-ratio test.
//!
//! In: the space, the model, what is in the model already. Out: [`Scored`], one per candidate: the best
//! over its shape parameter (frequency, rate, strength), with its value in the catalogue's units.

use super::catalogue::{CATALOGUE, Needs, lacking};
use super::covariates::{COVARIATES, Covariates, NEIGHBOURS, POSITION, TEMPERATURE, TIME};
use super::model::{Model, PATTERNS, RATIO_OF_RATES};
use super::ring::ALL;
use super::space::{Direction, Nuisance, Space, Tested};
use crate::model::terms::{Interior, Seen, Term};
use nalgebra::{Matrix4, Vector4};
use std::f64::consts::{PI, TAU};

/// Its own effect must show beside that of the state, in standard deviations.
const LEAST_OWN: f64 = 2.5;
/// d theta per relative change of damping (the real pole with it), and of frequency.
const DAMPING: [f64; ALL] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
const FREQUENCY: [f64; ALL] = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0];
const CLOCK: [f64; ALL] = [1.0, 1.0, 0.0, 0.0, 0.0, 1.0];
/// A line below this share of the model's own frequency is no mode, and below so many periods of the
/// signal it is no line.
const LEAST_MODE: f64 = 0.3;
pub const LEAST_PERIODS: f64 = 1.5;
/// A line so near a multiple of the ring's frequency is no line of its own, relative to that frequency.
const NEAR: f64 = 0.1;

/// A cause as it enters the model.
#[derive(Clone, Debug)]
pub struct Applied {
    pub id: &'static str,
    /// Frequency or rate per signal length, or strength; 0 where there is none.
    pub shape: f64,
    /// Damping of a line, per signal length.
    pub damping: f64,
    pub coefficients: Vec<f64>,
    pub directions: Vec<Direction>,
    /// What it does to the mean signal: per power of the drive, N each; none where it is a covariate's.
    pub kind: Kind,
}

#[derive(Clone, Debug)]
pub enum Kind {
    Shapes,
    /// One change of the parameters per coefficient.
    Covariate {
        which: usize,
        v: Vec<[f64; ALL]>,
    },
    Tail,
}

#[derive(Clone, Debug)]
pub struct Scored {
    pub applied: Applied,
    pub statistic: f64,
    /// Degrees of freedom, and how many independent shapes were tried.
    pub degrees: usize,
    pub tried: f64,
    /// -ln of the p-value, corrected for the shapes tried.
    pub surprise: f64,
    pub value: f64,
    pub sd: f64,
    /// Why it cannot be the cause although it fits; empty where it can.
    pub disqualified: String,
}

/// A space, and what is allowed for in it.
#[derive(Clone, Copy)]
pub struct View<'a> {
    pub space: &'a Space,
    pub nuisance: &'a Nuisance,
}

impl View<'_> {
    fn test(&self, directions: &[Direction]) -> Option<Tested> {
        self.nuisance.test(self.space, directions)
    }
}

/// Everything that a candidate is built from.
pub struct Bench<'a> {
    pub model: &'a Model,
    pub beside: &'a Covariates,
    /// Channels free: shapes.
    pub shapes: View<'a>,
    /// Channels scattered: covariates.
    pub covariates: View<'a>,
    samples: usize,
    pub seen: Seen,
    pub interior: Option<Interior>,
    /// Signal length, s.
    pub length_s: f64,
    pub integer: bool,
    /// Smallest and largest relative drive.
    pub drives: [f64; 2],
    /// Degrees of freedom of what is constant over a channel.
    pub units: usize,
    /// Frequencies (rad per signal length) that random tones have taken already.
    pub avoid: &'a [f64],
}

impl<'a> Bench<'a> {
    pub fn new(
        model: &'a Model,
        beside: &'a Covariates,
        shapes: View<'a>,
        covariates: View<'a>,
        (length_s, integer): (f64, bool),
        avoid: &'a [f64],
    ) -> Bench<'a> {
        let t = &model.mean;
        let seen = Seen {
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
        let low = beside.drive.iter().copied().fold(f64::INFINITY, f64::min);
        let high = beside.drive.iter().copied().fold(0.0, f64::max);
        let units = shapes.space.units;
        Bench {
            model,
            beside,
            shapes,
            covariates,
            samples: shapes.space.samples,
            seen,
            interior,
            length_s,
            integer,
            drives: [low, high],
            units,
            avoid,
        }
    }

    /// All that can be tested; what lacks data is left out.
    pub fn score_all(&self) -> Vec<Scored> {
        let mut all = Vec::new();
        for entry in &CATALOGUE {
            if lacking(entry.needs, self.beside, self.integer, self.units).is_some()
                && entry.needs != Needs::DriveScan
            {
                continue;
            }
            if let Some(mut scored) = self.score_one(entry.id, None) {
                if entry.needs == Needs::DriveScan && !self.beside.drive_scan && self.model.real {
                    scored.disqualified = "needs a drive scan".into();
                }
                all.push(scored);
            }
        }
        all
    }

    /// `near`: where its shape was before; without, all shapes are tried.
    pub fn score_one(&self, id: &'static str, near: Option<&Applied>) -> Option<Scored> {
        let n = self.samples;
        match id {
            "offset" => self.fixed(id, Direction::shape(0, vec![1.0; n]), 1.0),
            "droop" => {
                let shape = |w: f64| Some(self.pattern(1, self.droop(w)));
                self.grown(id, (0.05, 12.0), shape, |w| w / self.length_s, near).map(|s| {
                    match s.applied.coefficients[0] < 0.0 {
                        true => {
                            let why = "its coefficient has the unphysical sign".into();
                            Scored { disqualified: why, ..s }
                        }
                        false => s,
                    }
                })
            }
            "meniscus" => self.term(id, Term::Meniscus, (0.003, 0.5), 1, near),
            "quadratic_drag" => self.term(id, Term::QuadraticDrag, (0.01, 3.0), 2, near),
            "dry_friction" => self.term(id, Term::DryFriction, (0.01, 3.0), 0, near),
            "cubic_stiffness" => self.term(id, Term::CubicStiffness, (0.002, 0.4), 3, near),
            "fractional_damping" => self.term(id, Term::FractionalDamping, (0.02, 1.0), 1, near),
            "lowpass" => self.lowpass(near),
            "tone" => self.line(id, 0, &[0.0], near),
            "second_mode" => {
                let sigma = self.seen.sigma;
                self.line(id, 1, &[0.4 * sigma, sigma, 2.0 * sigma], near)
            }
            "temperature" => {
                let unit = 1.0 / self.beside.sd[TEMPERATURE];
                self.covariate_free(id, TEMPERATURE, DAMPING, self.damping_direction(), unit)
            }
            "ageing" => {
                let v = self.damping_direction();
                self.covariate_free(id, TIME, DAMPING, v, self.over(TIME)).map(relative)
            }
            "clock_drift" => {
                let v = self.clock_direction();
                self.covariate_free(id, TIME, CLOCK, v, self.over(TIME)).map(relative)
            }
            "position_gradient" => {
                let v = self.stiffness_direction();
                self.covariate_free(id, POSITION, FREQUENCY, v, self.over(POSITION)).map(relative)
            }
            "crosstalk" => {
                let t = &self.model.mean;
                let v = [0.0, 0.0, t[2], t[3], t[4], 0.0];
                let mut scored =
                    self.covariate(id, NEIGHBOURS, v, 1.0 / self.beside.sd[NEIGHBOURS])?;
                // relative to a channel without neighbours, not to the mean one
                let mean = self.beside.mean[NEIGHBOURS];
                let share = 1.0 - scored.value * mean;
                if share > 0.1 {
                    scored.sd /= share * share;
                    scored.value /= share;
                }
                Some(scored)
            }
            "previous_tail" => {
                let tested = self.covariates.test(&[Direction::tail(n)])?;
                let (value, sd) = (tested.coefficients[0], tested.covariance[(0, 0)].sqrt());
                Some(Scored {
                    applied: Applied {
                        id,
                        shape: 0.0,
                        damping: 0.0,
                        coefficients: tested.coefficients.clone(),
                        directions: vec![Direction::tail(n)],
                        kind: Kind::Tail,
                    },
                    statistic: tested.statistic,
                    degrees: 1,
                    tried: 1.0,
                    surprise: surprise(tested.statistic, 1, 1.0, self.dof(false)),
                    value: self.model.tail_gain + value,
                    sd,
                    disqualified: String::new(),
                })
            }
            _ => None,
        }
    }

    fn over(&self, which: usize) -> f64 {
        self.beside.span[which] / self.beside.sd[which]
    }

    fn dof(&self, of_channels: bool) -> f64 {
        let repeated = self.shapes.space.signals > self.units;
        let n = if of_channels || !repeated { self.units } else { self.shapes.space.signals };
        (n as f64 - 3.0).max(1.0)
    }

    /// A shape that scales as a power of the drive.
    fn pattern(&self, pattern: usize, shape: Vec<f64>) -> Direction {
        Direction::shape(pattern, shape)
    }

    fn fixed(&self, id: &'static str, direction: Direction, unit: f64) -> Option<Scored> {
        let tested = self.shapes.test(std::slice::from_ref(&direction))?;
        let value = tested.coefficients[0];
        if !value.is_finite() || !tested.statistic.is_finite() {
            return None;
        }
        Some(Scored {
            surprise: surprise(tested.statistic, 1, 1.0, f64::INFINITY),
            statistic: tested.statistic,
            degrees: 1,
            tried: 1.0,
            value: value * unit,
            sd: tested.covariance[(0, 0)].sqrt() * unit,
            disqualified: String::new(),
            applied: Applied {
                id,
                shape: 0.0,
                damping: 0.0,
                coefficients: tested.coefficients,
                directions: vec![direction],
                kind: Kind::Shapes,
            },
        })
    }

    /// A shape that depends on its own strength e: the likelihood profiled over e. With information i
    /// and score s along the secant D(e), adding e D(e) gains 2 e s - e² i.
    fn grown(
        &self,
        id: &'static str,
        (first, most): (f64, f64),
        shape: impl Fn(f64) -> Option<Direction>,
        value: impl Fn(f64) -> f64,
        near: Option<&Applied>,
    ) -> Option<Scored> {
        let gain = |e: f64| -> f64 {
            let tested = shape(e).and_then(|d| self.shapes.test(&[d]));
            tested.map_or(f64::NEG_INFINITY, |t| {
                let ratio = e / t.coefficients[0];
                t.statistic * (2.0 * ratio - ratio * ratio)
            })
        };
        let mut scored = self.fixed(id, shape(first)?, 1.0)?;
        let linear = scored.applied.coefficients[0];
        // what is hardly there is linear
        let mut strength = linear.clamp(-most, most);
        if scored.statistic > 4.0 || near.is_some() {
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
            let reach = if near.is_some() { 0.35 } else { 1.1 };
            let ln = maximum(|x| gain(sign * x.exp().min(most)), best.1.abs().ln(), reach);
            strength = sign * ln.exp().min(most);
            scored.statistic = gain(strength).max(0.0);
            scored.sd = width(gain, strength, 0.3 * scored.sd);
            scored.surprise = surprise(scored.statistic, 1, 1.0, f64::INFINITY);
            scored.applied.directions = vec![shape(strength)?];
            scored.applied.coefficients = vec![strength];
        }
        scored.applied.shape = strength;
        let h = 1e-3 * strength.abs().max(1e-12);
        scored.sd *= ((value(strength + h) - value(strength - h)) / (2.0 * h)).abs();
        scored.value = value(strength);
        Some(scored)
    }

    fn term(
        &self,
        id: &'static str,
        term: Term,
        (first, most): (f64, f64),
        power: i32,
        near: Option<&Applied>,
    ) -> Option<Scored> {
        let shape = |e: f64| self.term_direction(term, e, power);
        let [low, high] = self.drives;
        let value = |e: f64| -> f64 {
            match term {
                Term::CubicStiffness => e * high * high,
                // largest against smallest amplitude in the data
                Term::QuadraticDrag => {
                    let small = if high > 1.02 * low { low } else { 0.0 };
                    (1.0 + e * high) / (1.0 + e * small).max(0.05) - 1.0
                }
                Term::DryFriction => {
                    let small = if high > 1.02 * low { low } else { 0.1 * high };
                    (1.0 + e / high) / (1.0 + e / small).max(0.05) - 1.0
                }
                Term::Meniscus | Term::FractionalDamping => e,
            }
        };
        let mut scored = self.grown(id, (first, most), shape, value, near)?;
        if scored.applied.coefficients[0] < 0.0 && term != Term::CubicStiffness {
            scored.disqualified = "its coefficient has the unphysical sign".into();
        }
        Some(scored)
    }

    /// What a term of strength e adds, per unit e, as shapes times powers of the drive.
    fn term_direction(&self, term: Term, e: f64, power: i32) -> Option<Direction> {
        let n = self.samples;
        let interior = self.interior?;
        let added = |s: f64| -> Vec<f64> {
            let with = interior.decay(&self.seen, Some((term, e)), s, n);
            let without = interior.decay(&self.seen, None, s, n);
            with.iter().zip(without).map(|(w, o)| (w - o) / e).collect()
        };
        let finite =
            |d: Direction| d.0.iter().all(|(_, v)| v.iter().all(|x| x.is_finite())).then_some(d);
        let [low, high] = self.drives;
        if high < 1.02 * low {
            return finite(Direction::shape(power.clamp(0, 3) as usize, added(1.0)));
        }
        // interpolate between four drives
        let nodes: [f64; 4] = std::array::from_fn(|j| {
            let x = (PI * (j as f64 + 0.5) / 4.0).cos();
            0.5 * (low + high) + 0.5 * (high - low) * x
        });
        let at = nodes.map(added);
        let inverse = Matrix4::from_fn(|j, p| nodes[j].powi(p as i32)).try_inverse()?;
        let mut blocks = Vec::new();
        for p in 0..PATTERNS {
            let shape: Vec<f64> = (0..n)
                .map(|k| {
                    let values = Vector4::from_fn(|j, _| at[j][k]);
                    (inverse.row(p) * values)[0]
                })
                .collect();
            blocks.push((p * n, shape));
        }
        finite(Direction(blocks))
    }

    /// -int e^{-w(t-s)} y ds at unit drive (per unit w).
    fn droop(&self, w: f64) -> Vec<f64> {
        let n = self.samples;
        let y = self.ring();
        let h = 1.0 / n as f64;
        let fall = (-w * h).exp();
        let mut x = 0.0;
        (0..n)
            .map(|k| {
                if k > 0 {
                    // Simpson's weights of a smooth y, over the step that ends here
                    x = x * fall + h * 0.5 * (y[k] + fall * y[k - 1]);
                }
                -x
            })
            .collect()
    }

    /// The mean signal at unit drive.
    fn ring(&self) -> Vec<f64> {
        let mut y = vec![0.0; self.samples];
        super::ring::signal_into(&self.model.mean, self.model.real, 0.0, &mut y);
        y
    }

    fn lowpass(&self, near: Option<&Applied>) -> Option<Scored> {
        let n = self.samples as f64;
        let shape = |w: f64| {
            let y: Vec<f64> = (0..self.samples).map(|k| (-w * k as f64 / n).exp()).collect();
            self.pattern(1, y)
        };
        let test = |w: f64| -> f64 { self.shapes.test(&[shape(w)]).map_or(0.0, |t| t.statistic) };
        let (low, high) = ((4.0 * self.seen.sigma).max(6.0), 2.0 * n);
        let mut best = (0.0, low);
        let grid = (0..24).map(|i| low * (high / low).powf(f64::from(i) / 23.0));
        let grid: Vec<f64> = near.map_or_else(|| grid.collect(), |n| vec![n.shape]);
        for w in grid {
            let statistic = test(w);
            if statistic > best.0 {
                best = (statistic, w);
            }
        }
        let ln_w = maximum(|x| test(x.exp()), best.1.ln(), 0.12);
        let w = ln_w.exp();
        let direction = shape(w);
        let tested = self.shapes.test(std::slice::from_ref(&direction))?;
        let sd = width(|x| test(x.exp()), ln_w, 0.02) * w / self.length_s;
        Some(self.shaped("lowpass", tested, vec![direction], w, 3.0, w / self.length_s, sd))
    }

    #[allow(clippy::too_many_arguments)]
    fn shaped(
        &self,
        id: &'static str,
        tested: Tested,
        directions: Vec<Direction>,
        shape: f64,
        tried: f64,
        value: f64,
        sd: f64,
    ) -> Scored {
        let degrees = directions.len();
        Scored {
            surprise: surprise(tested.statistic, degrees, tried, f64::INFINITY),
            statistic: tested.statistic,
            degrees,
            tried,
            value,
            sd,
            disqualified: String::new(),
            applied: Applied {
                id,
                shape,
                damping: 0.0,
                coefficients: tested.coefficients,
                directions,
                kind: Kind::Shapes,
            },
        }
    }

    /// A line: cos and sin at the frequency that explains most, over some dampings.
    fn line(
        &self,
        id: &'static str,
        pattern: usize,
        dampings: &[f64],
        near: Option<&Applied>,
    ) -> Option<Scored> {
        let n = self.samples;
        let columns = |omega: f64, gamma: f64| {
            let column = |phase: f64| {
                let y = (0..n).map(|k| {
                    let t = k as f64 / n as f64;
                    (-gamma * t).exp() * (omega * t + phase).cos()
                });
                self.pattern(pattern, y.collect())
            };
            [column(0.0), column(-PI / 2.0)]
        };
        let test = |omega: f64, gamma: f64| {
            self.shapes.test(&columns(omega, gamma)).map_or(0.0, |t| t.statistic)
        };
        let (own, resolution) = (self.seen.omega, TAU);
        // near its own frequency a second mode is no second mode: the pair splits
        let banned = |omega: f64, gamma: f64| {
            let near = 1.2 * resolution + 1.5 * (self.seen.sigma + gamma);
            let mode = pattern == 1
                && (omega < LEAST_MODE * own
                    || (omega - own).abs() < near
                    || (2..=4).any(|m| (omega - f64::from(m) * own).abs() < 0.6 * resolution));
            // nor is every second sample's own gain, which mirrors the ring at half the sampling rate
            let mirror = PI * n as f64 - own;
            // what is at a multiple of its own frequency, or at its mirror, is the ring's own doing
            let order = (omega / own).round().max(1.0);
            let multiple = (omega - order * own).abs() < NEAR * own;
            let mirrored = (omega - mirror).abs() < near.min(NEAR * own).max(resolution);
            // so is a tone at its own frequency: anything that changes the ring looks like one
            let own = (omega - own).abs() < 1.2 * resolution;
            mode || own
                || multiple
                || mirrored
                || self.avoid.iter().any(|w| (omega - w).abs() < 1.5 * resolution)
        };
        let most = PI * n as f64 * 0.97;
        let (mut best, mut best_banned) = ((0.0, 0.0, 0.0), 0.0_f64);
        if let Some(near) = near {
            best = (0.0, near.shape, near.damping);
        }
        for &gamma in dampings.iter().filter(|_| near.is_none()) {
            let mut omega = LEAST_PERIODS * TAU;
            while omega < most {
                let statistic = test(omega, gamma);
                if banned(omega, gamma) {
                    best_banned = best_banned.max(statistic);
                } else if statistic > best.0 {
                    best = (statistic, omega, gamma);
                }
                omega += 0.5 * PI;
            }
        }
        let (_, mut omega, mut gamma) = best;
        if omega == 0.0 {
            return None;
        }
        for _ in 0..2 {
            omega = maximum(|x| test(x, gamma), omega, 0.5);
            if gamma > 0.0 {
                gamma = maximum(|x| test(omega, x.exp()), gamma.ln(), 0.4)
                    .exp()
                    .max(0.1 * self.seen.sigma)
                    .min(6.0 * self.seen.sigma);
            }
        }
        let directions = columns(omega, gamma);
        let tested = self.shapes.test(&directions)?;
        let sd = width(|x| test(x, gamma), omega, 0.02);
        let value = omega / TAU / self.length_s;
        let tried = n as f64 * dampings.len() as f64;
        let mut scored = self.shaped(
            id,
            tested,
            directions.to_vec(),
            omega,
            tried,
            value,
            sd / TAU / self.length_s,
        );
        scored.applied.damping = gamma;
        // so near to the ring a mode cannot be told from it; what fits as well as one is no tone
        let close = 1.2 * resolution + 3.0 * self.seen.sigma;
        if pattern == 0 && near.is_none() && (omega - own).abs() < close && self.beside.drive_scan {
            let as_mode = [0.4, 1.0, 2.0].map(|share| {
                let column = |phase: f64| {
                    let y = (0..n).map(|k| {
                        let t = k as f64 / n as f64;
                        (-share * self.seen.sigma * t).exp() * (omega * t + phase).cos()
                    });
                    self.pattern(1, y.collect())
                };
                let columns = [column(0.0), column(-PI / 2.0)];
                self.shapes.test(&columns).map_or(0.0, |t| t.statistic)
            });
            if as_mode.iter().any(|s| *s > scored.statistic - 3.0) {
                scored.disqualified = "it may be a mode near the ring's own".into();
            }
        }
        if near.is_none() && banned(omega, gamma) || best_banned > scored.statistic + 10.0 {
            scored.disqualified =
                "its line lies at the model's own frequency or a multiple of it".into();
        }
        Some(scored)
    }

    fn covariate(
        &self,
        id: &'static str,
        which: usize,
        v: [f64; ALL],
        unit: f64,
    ) -> Option<Scored> {
        if !self.beside.present[which] {
            return None;
        }
        let direction = Direction::covariate(self.samples, which, v);
        let tested = self.covariates.test(std::slice::from_ref(&direction))?;
        let statistic = self.against_rest(which, tested.statistic);
        // the scatter that the test is made against holds the effect itself
        let narrower = (tested.statistic / statistic.max(1e-12)).sqrt().min(1.0);
        let sd = tested.covariance[(0, 0)].sqrt() * unit * narrower;
        let value = tested.coefficients[0] * unit;
        Some(Scored {
            surprise: surprise(statistic, 1, 1.0, self.dof(which == POSITION)),
            statistic,
            degrees: 1,
            tried: 1.0,
            value,
            sd,
            disqualified: String::new(),
            applied: Applied {
                id,
                shape: 0.0,
                damping: 0.0,
                coefficients: tested.coefficients,
                directions: vec![direction],
                kind: Kind::Covariate { which, v: vec![v] },
            },
        })
    }

    /// A covariate on damping or frequency. The acquisition state may follow it, too: how much rests on
    /// what came before t_a. It is tested with the state unmoved and with the state of the interior
    /// unmoved, whichever fits; its size is estimated with the state left free.
    fn covariate_free(
        &self,
        id: &'static str,
        which: usize,
        plain: [f64; ALL],
        interior: [f64; ALL],
        unit: f64,
    ) -> Option<Scored> {
        let mut best = self.covariate(id, which, plain, unit)?;
        if let Some(other) = self.covariate(id, which, interior, unit)
            && other.statistic > best.statistic
        {
            best = other;
        }
        let amplitude = self.model.amplitude();
        let mut v = vec![plain];
        for j in 2..5 {
            let mut free = [0.0; ALL];
            free[j] = amplitude;
            v.push(free);
        }
        let n = self.samples;
        let directions: Vec<Direction> =
            v.iter().map(|v| Direction::covariate(n, which, *v)).collect();
        if let Some(tested) = self.covariates.test(&directions) {
            best.value = tested.coefficients[0] * unit;
            let dof = self.dof(which == POSITION);
            best.sd = tested.covariance[(0, 0)].sqrt() * unit;
            let together = surprise(tested.statistic, directions.len(), 2.0, dof);
            if which == POSITION {
                // of few channels, four coefficients at once say nothing: the frequency's alone
                let own = (best.value / best.sd).powi(2);
                best.statistic = self.against_rest(which, own);
                best.surprise = surprise(best.statistic, 1, 1.0, dof);
                best.sd *= (own / best.statistic.max(1e-12)).sqrt().min(1.0);
            } else if together > best.surprise {
                best.surprise = together;
                best.statistic = tested.statistic;
            }
            if best.value.abs() < LEAST_OWN * best.sd {
                best.disqualified = "what follows is the acquisition state alone".into();
            }
            best.degrees = directions.len();
            best.applied.coefficients = tested.coefficients;
            best.applied.directions = directions;
            best.applied.kind = Kind::Covariate { which, v };
        }
        Some(best)
    }

    /// The scatter of few channels was estimated with what follows their position still in it: of n
    /// channels the statistic is n R², which becomes t² = dof R²/(1 - R²).
    fn against_rest(&self, which: usize, statistic: f64) -> f64 {
        // in the model, it is no part of the scatter any more
        if which != POSITION || self.model.beta[POSITION].iter().any(|b| *b != 0.0) {
            return statistic;
        }
        let n = (self.units as f64 - 1.0).max(1.0);
        let explained = (statistic / n).min(0.999);
        (self.dof(true) * explained / (1.0 - explained)).max(statistic)
    }

    /// d theta where all losses grow by a share, the acquisition state being what it was.
    pub fn damping_direction(&self) -> [f64; ALL] {
        self.rates_direction(|c, h| {
            (c.g_per_s, c.d_per_s) = (c.g_per_s * (1.0 + h), c.d_per_s * (1.0 + h));
        })
        .map_or([1.0, 0.0, 0.0, 0.0, 0.0, 1.0], |v| {
            let by = v[0];
            v.map(|x| x / by)
        })
    }

    /// d theta where the stiffness grows, per relative change of the frequency.
    fn stiffness_direction(&self) -> [f64; ALL] {
        self.rates_direction(|c, h| {
            (c.a_per_s2, c.b_per_s2) = (c.a_per_s2 * (1.0 + h), c.b_per_s2 * (1.0 + h));
        })
        .map_or([0.0, 1.0, 0.0, 0.0, 0.0, 0.0], |v| {
            let by = v[1];
            v.map(|x| x / by)
        })
    }

    /// d theta where all rates grow by a share.
    fn clock_direction(&self) -> [f64; ALL] {
        self.rates_direction(|c, h| {
            let by = 1.0 + h;
            (c.a_per_s2, c.b_per_s2) = (c.a_per_s2 * by * by, c.b_per_s2 * by * by);
            (c.g_per_s, c.d_per_s) = (c.g_per_s * by, c.d_per_s * by);
        })
        .unwrap_or(CLOCK)
    }

    fn rates_direction(
        &self,
        change: impl Fn(&mut crate::model::InkChannel, f64),
    ) -> Option<[f64; ALL]> {
        let Some(Interior::Ink { channel, state: [v, q_r, q_n] }) = self.interior else {
            return None;
        };
        let at = |h: f64| -> Option<[f64; ALL]> {
            let mut c = channel;
            change(&mut c, h);
            let p = c.poles()?;
            let (sigma, omega, lambda) = (p.damping_per_s, p.frequency_hz * TAU, p.lambda_per_s);
            let (a, b, g, d) = (c.a_per_s2, c.b_per_s2, c.g_per_s, c.d_per_s);
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
            Some([sigma.ln(), omega.ln(), x[0], x[1], x[2], lambda.ln()])
        };
        let h = 1e-4;
        let (up, down) = (at(h)?, at(-h)?);
        let v: [f64; ALL] = std::array::from_fn(|j| (up[j] - down[j]) / (2.0 * h));
        v.iter().all(|x| x.is_finite()).then_some(v)
    }

    /// Every covariate on every parameter, one at a time: (covariate, parameter, surprise).
    pub fn covariate_scan(&self) -> Vec<(usize, usize, f64)> {
        let mut all = Vec::new();
        for which in 1..COVARIATES {
            if !self.beside.present[which] {
                continue;
            }
            let dof = self.dof(which == POSITION);
            let each: Vec<Direction> = (0..ALL - 1)
                .map(|j| {
                    let mut v = [0.0; ALL];
                    v[j] = 1.0;
                    Direction::covariate(self.samples, which, v)
                })
                .collect();
            // alone, and with the others free: what moves two together is in their common scatter
            let together = self.covariates.test(&each);
            for (j, direction) in each.into_iter().enumerate() {
                let beside = together.as_ref().map_or(0.0, |t| {
                    t.coefficients[j].powi(2) / t.covariance[(j, j)].max(f64::MIN_POSITIVE)
                });
                if let Some(tested) = self.covariates.test(&[direction]) {
                    let statistic = self.against_rest(which, tested.statistic.max(beside));
                    all.push((which, j, surprise(statistic, 1, 1.0, dof)));
                }
            }
        }
        all
    }

    /// Local misfit of the mean: windows of several lengths at several places, per power of the drive.
    pub fn local_scan(&self) -> (f64, f64) {
        let n = self.samples;
        let (mut best, mut tried) = (0.0_f64, 0.0);
        for pattern in 0..2 {
            let mut length = 4;
            while length <= n / 2 {
                for start in (0..=n - length).step_by(length / 2) {
                    let mut shape = vec![0.0; n];
                    for (k, y) in shape[start..start + length].iter_mut().enumerate() {
                        *y = (PI * (k as f64 + 0.5) / length as f64).sin();
                    }
                    let direction = self.pattern(pattern, shape);
                    if let Some(t) = self.shapes.test(&[direction]) {
                        best = best.max(surprise(t.statistic, 1, 1.0, f64::INFINITY));
                        tried += 1.0;
                    }
                }
                length *= 2;
            }
        }
        (best, tried)
    }
}

/// A change of a logarithm from first to last, as a relative change.
fn relative(scored: Scored) -> Scored {
    let grown = scored.value.exp();
    Scored { value: grown - 1.0, sd: scored.sd * grown, ..scored }
}

/// -ln p of a chi-squared statistic with 1 or 2 degrees, times the number of independent tries; by
/// Student's t where the scale was estimated from few.
pub fn surprise(statistic: f64, degrees: usize, tried: f64, dof: f64) -> f64 {
    let x = statistic.max(0.0);
    let x = if dof.is_finite() {
        // t² with dof degrees as the chi-squared of the same probability, Wallace 1959
        dof * (1.0 + x / dof).ln() * ((dof - 0.5) / dof).max(0.1)
    } else {
        x
    };
    let ln_p = match degrees {
        1 => ln_normal_tail(x.sqrt()) + 2f64.ln(),
        2 => -x / 2.0,
        // Wilson and Hilferty
        q => {
            let q = q as f64;
            let z = ((x / q).cbrt() - (1.0 - 2.0 / (9.0 * q))) / (2.0 / (9.0 * q)).sqrt();
            ln_normal_tail(z)
        }
    };
    (-ln_p - tried.ln()).max(0.0)
}

/// ln P(Z > z), by the continued fraction in the tail.
pub fn ln_normal_tail(z: f64) -> f64 {
    if z < 3.0 {
        let t = 1.0 / (1.0 + 0.231_641_9 * z.abs());
        let poly = t
            * (0.319_381_53
                + t * (-0.356_563_782
                    + t * (1.781_477_937 + t * (-1.821_255_978 + t * 1.330_274_429))));
        let tail = (-z * z / 2.0).exp() / TAU.sqrt() * poly;
        return if z >= 0.0 { tail.max(1e-300).ln() } else { (1.0 - tail).ln() };
    }
    let mut fraction = 0.0;
    for k in (1..=40).rev() {
        fraction = f64::from(k) / (z + fraction);
    }
    -z * z / 2.0 - (TAU.sqrt() * (z + fraction)).ln()
}

/// Where a function that is unimodal within `reach` of `near` is largest: golden section.
fn maximum(f: impl Fn(f64) -> f64, near: f64, reach: f64) -> f64 {
    let golden = 0.618_034;
    let (mut low, mut high) = (near - reach, near + reach);
    let (mut p, mut q) = (high - golden * (high - low), low + golden * (high - low));
    let (mut fp, mut fq) = (f(p), f(q));
    for _ in 0..18 {
        if fp > fq {
            (high, q, fq) = (q, p, fp);
            p = high - golden * (high - low);
            fp = f(p);
        } else {
            (low, p, fp) = (p, q, fq);
            q = low + golden * (high - low);
            fq = f(q);
        }
    }
    0.5 * (low + high)
}

/// Standard deviation of a parameter from the curvature of twice the log-likelihood.
fn width(f: impl Fn(f64) -> f64, at: f64, step: f64) -> f64 {
    let mut h = step;
    let top = f(at);
    for _ in 0..12 {
        let drop = top - 0.5 * (f(at - h) + f(at + h));
        if drop > 0.5 && drop < 4.0 {
            return h / drop.sqrt();
        }
        h *= if drop <= 0.5 { 1.7 } else { 0.5 };
    }
    h
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surprise_is_minus_the_logarithm_of_known_probabilities() {
        // two-sided normal: 1.96 -> .05, 3.29 -> .001; chi-squared with 2: exact
        assert!((surprise(1.96 * 1.96, 1, 1.0, f64::INFINITY) - (-(0.05_f64.ln()))).abs() < 1e-3);
        assert!(
            (surprise(3.2905_f64.powi(2), 1, 1.0, f64::INFINITY) + 0.001_f64.ln()).abs() < 2e-3
        );
        assert!((surprise(9.21, 2, 1.0, f64::INFINITY) + 0.01_f64.ln()).abs() < 1e-3);
        // Student: t = 2.086 with 20 degrees is .05, 3.850 is .001
        assert!((surprise(2.086 * 2.086, 1, 1.0, 20.0) + 0.05_f64.ln()).abs() < 0.05);
        assert!((surprise(3.850 * 3.850, 1, 1.0, 20.0) + 0.001_f64.ln()).abs() < 0.12);
    }
}
