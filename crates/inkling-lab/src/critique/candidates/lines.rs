//! Causes whose spectrum is a line: a tone, a second mode, and the slow mode of a meniscus.
//!
//! In: a [`ScoreTests`]. Out: [`Scored`], with an objection where the line may be the ring's own doing.
//! Frequencies `omega` are in rad per signal length, dampings `gamma` in 1 per signal length.
//!
//! A tone or a mode is a pair of directions, e^{-gamma t} cos omega t and e^{-gamma t} sin omega t, times the
//! drive to the power 0 (a tone, gamma = 0) or 1 (a mode). All frequencies are scanned at a few dampings in
//! steps of a quarter of a period per signal length; the best pair is refined (`line`). The meniscus has one
//! parameter instead, the compliance ratio m, from which omega and gamma follow (`slow_mode`).

use super::{Asked, ScoreTests, Scored};
use crate::critique::candidate::Objection;
use crate::critique::chance::{maximum, width};
use crate::critique::space::Direction;
use crate::critique::tuned::{LEAST_MODE, MENISCUS, OTHER_LOSS, SHOWS_ITS_LOSS, SPLIT, TIE};
use crate::critique::unmodelled::Interior;
use inkling_core::model::InkChannel;
use inkling_core::model::waves::{swing, waves};
use inkling_core::numbers::LITTLE;
use std::f64::consts::{PI, TAU};

/// A line has at least so many periods in a signal.
pub const LEAST_PERIODS: f64 = 2.0;

/// Width of a line: one period per signal length.
const RESOLUTION: f64 = TAU;

/// Frequency and damping at which a line fits best; a frequency of 0 means that none fits.
#[derive(Clone, Copy)]
struct Scan {
    omega: f64,
    gamma: f64,
    /// The largest statistic at frequencies where a line may be none.
    own: f64,
}

/// Whether a wave cannot be told from any other slow shape.
fn is_slow(omega: f64) -> bool {
    omega < LEAST_PERIODS * TAU
}

impl ScoreTests<'_> {
    /// The value is the frequency in Hz. `pattern`: power of the drive; `dampings`: those that are scanned (a
    /// single 0: the line stays undamped). With `near`, that form is refined without a scan or an objection.
    pub(super) fn line(&self, asked: Asked, pattern: usize, dampings: &[f64]) -> Option<Scored> {
        let Asked { id, near } = asked;
        let test = |omega: f64, gamma: f64| self.line_statistic(pattern, omega, gamma);
        let scan = match near {
            Some(near) => Scan { omega: near.shape, gamma: near.damping, own: 0.0 },
            None => self.scan(pattern, dampings),
        };
        let Scan { mut omega, mut gamma, own } = scan;
        if omega == 0.0 {
            return None;
        }
        for _ in 0..2 {
            omega = maximum(|x| test(x, gamma), omega, 0.5);
            if gamma > 0.0 {
                gamma = maximum(|x| test(omega, x.exp()), gamma.ln(), 0.4)
                    .exp()
                    .max(0.1 * self.decay.sigma)
                    .min(6.0 * self.decay.sigma);
            }
        }
        let directions = self.waves(pattern, omega, gamma);
        let tested = self.nuisances.shapes.test(&directions)?;
        // the dampings are hardly independent tries, so only frequencies are counted
        let mut scored = Scored::of(id, tested, directions, self.samples as f64);
        (scored.form.shape, scored.form.damping) = (omega, gamma);
        scored.value = self.hz(omega);
        scored.sd = self.hz(width(|x| test(x, gamma), omega, 0.02));
        // the line that fits best may be too slow, or the ring's own, or what is one of these fits clearly better
        let is_own = || self.is_own(pattern, omega, gamma) || own > scored.statistic + TIE;
        scored.objection = match near {
            None if is_slow(omega) => Some(Objection::SlowLine),
            None if is_own() => Some(Objection::OwnLine),
            _ => None,
        };
        Some(scored)
    }

    pub(super) fn hz(&self, omega: f64) -> f64 {
        omega / TAU / self.data.length_s()
    }

    fn waves(&self, pattern: usize, omega: f64, gamma: f64) -> Vec<Direction> {
        let n = self.samples as f64;
        let both = waves(gamma / n, omega / n, self.samples);
        both.map(|wave| Direction::shape(pattern, wave)).into()
    }

    fn line_statistic(&self, pattern: usize, omega: f64, gamma: f64) -> f64 {
        self.nuisances.shapes.statistic(&self.waves(pattern, omega, gamma))
    }

    fn scan(&self, pattern: usize, dampings: &[f64]) -> Scan {
        let most = PI * self.samples as f64 * 0.97;
        let (mut best, mut scan) = (0.0, Scan { omega: 0.0, gamma: 0.0, own: 0.0 });
        for &gamma in dampings {
            // The scan begins below the slowest line: where some slow shape fits better, a line is none.
            let mut omega = 0.4 * LEAST_PERIODS * TAU;
            while omega < most {
                let statistic = self.line_statistic(pattern, omega, gamma);
                if self.is_own(pattern, omega, gamma) || is_slow(omega) {
                    scan.own = scan.own.max(statistic);
                } else if statistic > best {
                    best = statistic;
                    scan = Scan { omega, gamma, ..scan };
                }
                omega += 0.5 * PI;
            }
        }
        scan
    }

    fn is_own(&self, pattern: usize, omega: f64, gamma: f64) -> bool {
        let own = self.decay.omega;
        let within = |reach: f64, of: f64| (omega - of).abs() < reach;
        let near = |of: f64| within(RESOLUTION + 0.5 * gamma, of);
        let multiple = within(LITTLE * own, (omega / own).round().max(1.0) * own);
        // if every second sample had a gain of its own, the ring would have a mirror image
        let mirror = PI * self.samples as f64 - own;
        let slow = pattern == 1 && omega < LEAST_MODE * own;
        near(own) || near(mirror) || multiple || slow || self.avoid.iter().any(|w| near(*w))
    }

    /// Tests a meniscus: surface tension, B_t/B_m = m, makes a slow pair of the real pole and of the pole at
    /// 0, and this pair scales with the drive. How much of it is excited depends on what came before t_a, so
    /// its cosine and sine are both free. The value is m; the standard error of ln m includes that of the
    /// held ratio of rates. If the slow mode is strong, the factor `loss` on its damping is searched as well.
    pub(super) fn slow_mode(&self, Asked { id, near }: Asked) -> Option<Scored> {
        let Interior { channel, .. } = self.interior?;
        let n = self.samples;
        // `loss`: damping of the pair over the one that m predicts, while gamma² + w² stays the same
        let columns = |m: f64, loss: f64| {
            let (gamma, square) = slow_mode(&channel, m);
            let (gamma, square) = (loss * gamma, square + gamma * gamma * (1.0 - loss * loss));
            let wave = |which: usize| {
                let at = |t: f64| (-gamma * t).exp() * swing(square, t)[which];
                Direction::shape(1, (0..n).map(|k| at(k as f64 / n as f64)).collect())
            };
            [wave(0), wave(1)]
        };
        let (low, high) = MENISCUS;
        let search = |near: Option<f64>, loss: f64| {
            let grid = (0..24).map(|i| (low * (high / low).powf(f64::from(i) / 23.0)).ln());
            let shapes = |x: f64| columns(x.exp(), loss).to_vec();
            self.searched(id, 6.0, near, (grid, 0.26, [low.ln(), high.ln()]), shapes)
        };
        let test =
            |ln_m: f64, loss: f64| self.nuisances.shapes.statistic(&columns(ln_m.exp(), loss));
        let mut loss = near.map_or(1.0, |near| near.damping);
        let mut scored = search(near.map(|near| near.shape.ln()), loss)?;
        // a strong slow mode shows a damping of its own
        if scored.statistic > SHOWS_ITS_LOSS {
            for _ in 0..3 {
                let ln_loss = maximum(|x| test(scored.value, x.exp()), loss.ln(), 0.4);
                loss = ln_loss.exp().clamp(1.0 / OTHER_LOSS, OTHER_LOSS);
                scored = search(Some(scored.value), loss)?;
            }
        }
        let m = scored.value.exp();
        scored.sd = width(|x| test(x, loss), scored.value, 0.1).hypot(SPLIT) * m;
        (scored.value, scored.form.shape, scored.form.damping) = (m, m, loss);
        // the best of a range that ends there is no estimate
        let at_the_end = m < 1.01 * low || m > 0.99 * high;
        scored.objection = at_the_end.then_some(Objection::AtTheEnd);
        Some(scored)
    }
}

/// Damping gamma and squared frequency w² of the slow mode; w² is negative if the pair is two real poles.
///
/// With -b m V_n added to thesis (2-2), the poles are the roots of (s² + g s + a)(s² + d s + b (1 + m)) - a
/// b; the slow mode is the factor s² + 2 gamma s + gamma² + w² with the smaller roots. `channel` holds the
/// rates that were fitted without a meniscus: most of the pull goes with V and stiffens b, so b itself is
/// smaller than the one that is seen.
fn slow_mode(channel: &InkChannel, m: f64) -> (f64, f64) {
    let InkChannel { a_per_s2: a, b_per_s2: seen, g_per_s: g, d_per_s: d } = *channel;
    // b without the pull's stiffening, to first order
    let b = seen / (1.0 + m * seen / (a + seen));
    let [c3, c2, c1, c0] = [g + d, a + b * (1.0 + m) + g * d, g * b * (1.0 + m) + a * d, a * b * m];

    // the slow factor s² + u s + v beside s² + p s + q, by fixed-point iteration of the coefficients
    let (mut u, mut v) = (c1 / c2, c0 / c2);
    for _ in 0..60 {
        let p = c3 - u;
        let q = c2 - v - p * u;
        (u, v) = ((c1 - p * v) / q, c0 / q);
    }
    (0.5 * u, v - 0.25 * u * u)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A root of the slow factor must be a root of the whole polynomial.
    #[test]
    fn the_slow_mode_is_a_root_of_the_channel_with_a_meniscus() {
        let (a, g, d) = (5.6e10, 1.6e4, 8e4);
        for m in [0.01, 0.1, 0.5] {
            let b = 1.11e11;
            // by bisection, the b that is seen: the pull that goes with V stiffens it
            let (mut low, mut high) = (b, 3.0 * b);
            for _ in 0..100 {
                let seen = 0.5 * (low + high);
                let of = seen / (1.0 + m * seen / (a + seen));
                if of < b { low = seen } else { high = seen }
            }
            let channel = InkChannel { a_per_s2: a, b_per_s2: low, g_per_s: g, d_per_s: d };
            let (gamma, square) = slow_mode(&channel, m);
            let s = root_of(-gamma, square);
            let left = polynomial(s, [g + d, a + b * (1.0 + m) + g * d], g * b * (1.0 + m) + a * d);
            let value = (left.0 + a * b * m, left.1);
            let size = a * b * m;
            assert!(value.0.hypot(value.1) < 1e-6 * size, "{m}: {value:?}");
        }
    }

    fn root_of(re: f64, square: f64) -> (f64, f64) {
        if square > 0.0 { (re, square.sqrt()) } else { (re + (-square).sqrt(), 0.0) }
    }

    /// The polynomial s⁴ + c3 s³ + c2 s² + c1 s.
    fn polynomial(s: (f64, f64), [c3, c2]: [f64; 2], c1: f64) -> (f64, f64) {
        let times = |x: (f64, f64), y: (f64, f64)| (x.0 * y.0 - x.1 * y.1, x.0 * y.1 + x.1 * y.0);
        let plus = |x: (f64, f64), by: f64| (x.0 + by, x.1);
        let mut value = plus(s, c3);
        value = plus(times(value, s), c2);
        value = plus(times(value, s), c1);
        times(value, s)
    }
}
