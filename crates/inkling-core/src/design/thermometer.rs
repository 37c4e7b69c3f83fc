//! Recorded temperatures that are not those of the ink, found by the rings of healthy channels.
//!
//! In, from who trains: a [`TrainingSet`] with the temperatures as they were recorded. Out: the same with temperatures
//! that may be learned from, and warnings. Sensors say 0.0 for a fault, lag, or say nothing; ink as cold as that rings
//! otherwise. One burst in twenty with a wrong temperature would make three times as wide what healthy channels differ
//! by, and faults would hide in it.
//!
//! All healthy channels of a burst share its ink. What they ring like beside what each rings like otherwise is a point
//! over the recorded temperature, one for each burst, and most of the points lie on a line. A burst whose point lies
//! far off takes the temperature at which its rings lie on the line, and so does one without a recorded temperature.

use super::{DetectSettings, HealthyModel, LearnSettings, TrainingSet, tuned};
use crate::detect::{Denominator, DetectMethod};
use crate::identify::{GreyBoxSettings, SignalSet};
use crate::model::median::{median_of, robust_sd};
use crate::model::ring_fit::Features;
use crate::numbers::FEW;
use nalgebra::Vector2;
use std::collections::BTreeMap;

/// How often the line and the channels' levels are found in turn: where all channels are labelled in most bursts, the
/// second time changes nothing.
const ROUNDS: usize = 4;
/// Most points through whose pairs the line is sought.
const MOST_POINTS: usize = 256;

/// A ring of a healthy channel.
struct RingSeen {
    t_acq_ns: i64,
    channel: u32,
    /// K above the median temperature; NaN: not recorded.
    warmer: f64,
    /// ln damping and ln frequency, relative to the mean ring.
    x: Vector2<f64>,
}

/// A burst, as a point over its temperature.
struct Point {
    /// K above the median temperature; NaN: not recorded.
    warmer: f64,
    /// Mean of its rings beside their channels' levels.
    x: Vector2<f64>,
    rings: f64,
}

impl Point {
    fn add(&mut self, x: Vector2<f64>) {
        self.rings += 1.0;
        self.x += (x - self.x) / self.rings;
    }
}

/// What a kelvin does to ln damping and ln frequency, and by how much bursts lie off.
struct Line {
    per_k: Vector2<f64>,
    at_zero: Vector2<f64>,
    sd: Vector2<f64>,
}

/// What a burst's rings say of its temperature.
#[derive(Clone, Copy)]
struct Said {
    /// K above the median temperature, and its standard deviation.
    warmer: f64,
    sd: f64,
    /// How far from the line they lie at that, in standard deviations.
    rest: f64,
}

impl Line {
    /// Through the points with a temperature. Robust: the median over points of the median slope to all others
    /// (Siegel 1982), right while fewer than half of them are off. `None`: fewer than `FEW`.
    fn through(points: &BTreeMap<i64, Point>) -> Option<Line> {
        let points: Vec<&Point> = points.values().filter(|of| of.warmer.is_finite()).collect();
        if points.len() < FEW {
            return None;
        }
        let few: Vec<_> = points.iter().step_by(points.len().div_ceil(MOST_POINTS)).collect();
        let slope = |j: usize| {
            median_of(few.iter().map(|here| {
                let others = few.iter().filter(|of| of.warmer != here.warmer);
                median_of(others.map(|of| (of.x[j] - here.x[j]) / (of.warmer - here.warmer)))
            }))
        };
        let per_k = Vector2::from_fn(|j, _| slope(j));
        let off = |j: usize| points.iter().map(move |of| of.x[j] - of.warmer * per_k[j]);
        let at_zero = Vector2::from_fn(|j, _| median_of(off(j)));
        let sd = |j: usize, _| robust_sd(&off(j).collect::<Vec<_>>(), at_zero[j]);
        Some(Line { per_k, at_zero, sd: Vector2::from_fn(sd) })
    }

    fn says(&self, x: &Vector2<f64>) -> Said {
        let per_k = self.per_k.component_div(&self.sd);
        let off = (x - self.at_zero).component_div(&self.sd);
        let warmer = per_k.dot(&off) / per_k.norm_squared();
        Said { warmer, sd: per_k.norm().recip(), rest: (off - warmer * per_k).norm() }
    }
}

impl Said {
    /// Whether another temperature was recorded. Rings that no temperature explains say nothing.
    fn denies(&self, warmer: f64) -> bool {
        let off = (warmer - self.warmer).abs();
        self.rest < tuned::WRONG_SD && off > tuned::WRONG_K.max(tuned::WRONG_SD * self.sd)
    }
}

/// What became of the temperatures of a printhead's bursts.
#[derive(Default)]
struct Told {
    bursts: usize,
    not_recorded: usize,
    /// Those that were not believed, °C.
    not_believed: Vec<f64>,
}

impl Told {
    fn warning(&self, printhead: &str) -> Option<String> {
        let mut odd = Vec::new();
        if self.not_recorded > 0 {
            odd.push(format!("of {} none was recorded", self.not_recorded));
        }
        if !self.not_believed.is_empty() {
            let least = self.not_believed.iter().copied().fold(f64::INFINITY, f64::min);
            let most = self.not_believed.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let of = self.not_believed.len();
            odd.push(format!("of {of} it was not that of the ink ({least:.1} to {most:.1} °C)"));
        }
        let odd = odd.join(", and ");
        let taken = "it was taken from how the healthy channels ring; look at the sensor";
        (!odd.is_empty()).then(|| {
            format!("printhead {printhead}: temperature of {} bursts: {odd}: {taken}", self.bursts)
        })
    }
}

impl TrainingSet {
    /// Puts the temperatures right, of the faulty signals of a burst, too. A printhead whose temperatures do not vary,
    /// or whose rings cannot be fitted, keeps what was recorded.
    pub fn check_temperatures(&mut self, grey_box: &GreyBoxSettings) -> Vec<String> {
        let period_s = self.sample_period_s;
        let mut warnings = Vec::new();
        for (name, healthy) in &mut self.healthy {
            let Some(thermometer) = Thermometer::of(healthy, grey_box, period_s) else { continue };
            let (right, told) = thermometer.right();
            let faulty = self.faulty.values_mut().filter_map(|sets| sets.get_mut(name));
            for set in std::iter::once(healthy).chain(faulty) {
                for (recorded, burst) in set.temperature_c.iter_mut().zip(&set.t_acq_ns) {
                    *recorded = right.get(burst).copied().unwrap_or(*recorded);
                }
            }
            warnings.extend(told.warning(name));
        }
        warnings
    }
}

/// The rings of a printhead's healthy channels.
struct Thermometer {
    rings: Vec<RingSeen>,
    /// Median of the recorded temperatures, °C.
    middle_c: f64,
}

impl Thermometer {
    /// `None`: there is nothing to put right, or nothing to do it by.
    fn of(set: &SignalSet, grey_box: &GreyBoxSettings, period_s: f64) -> Option<Thermometer> {
        let recorded = set.temperature_c.iter().copied().filter(|t| t.is_finite());
        let middle_c = median_of(recorded.clone());
        let vary = recorded.clone().any(|t| (t - middle_c).abs() > tuned::WRONG_K);
        if recorded.count() == 0 || !vary {
            return None;
        }

        // rings relative to the mean one, as of signals whose temperatures nobody knows
        let detect = DetectSettings {
            method: DetectMethod::ResidualEnergy,
            denominator: Denominator::Resonance,
            ..DetectSettings::default()
        };
        let settings = LearnSettings {
            grey_box,
            detect: &detect,
            least_agreeing: None,
            sample_period_s: period_s,
            filter: None,
        };
        let unknown = SignalSet { temperature_c: vec![f64::NAN; set.len()], ..set.clone() };
        let model = HealthyModel::learn(&unknown, None, None, settings).ok()?;
        let (fitter, all) = (model.fitter().ok()?, (0..set.len()).collect::<Vec<_>>());
        let mut rings = Vec::with_capacity(set.len());
        let start = (&fitter, Some(Features::HEALTHY));
        model.each_own_ring(start, (&unknown, &all), |i, _, fit| {
            let x = fit.map(|fit| fit.features.coordinates().fixed_rows::<2>(1).into_owned());
            let (t_acq_ns, channel) = (set.t_acq_ns[i], set.channel[i]);
            let warmer = set.temperature_c[i] - middle_c;
            rings.extend(x.map(|x| RingSeen { t_acq_ns, channel, warmer, x }));
        });
        Some(Thermometer { rings, middle_c })
    }

    /// The temperatures, °C, of bursts of which another one was recorded, or none, by time; NaN: unknown.
    fn right(&self) -> (BTreeMap<i64, f64>, Told) {
        let (bursts, line) = self.bursts_and_line();
        let mut told = Told { bursts: bursts.len(), ..Told::default() };
        let mut right = BTreeMap::new();
        for (t_acq_ns, Point { warmer, x, .. }) in bursts {
            let said = line.as_ref().map(|line| line.says(&x));
            let known = said.filter(|said| said.sd < tuned::WRONG_K);
            let is_wrong = known.is_some_and(|said| said.denies(warmer));
            if warmer.abs() <= tuned::REACH_K && !is_wrong {
                continue;
            }
            match warmer.is_finite() {
                true => told.not_believed.push(self.middle_c + warmer),
                false => told.not_recorded += 1,
            }
            right.insert(t_acq_ns, known.map_or(f64::NAN, |said| self.middle_c + said.warmer));
        }
        (right, told)
    }

    /// Each channel's level is the median of its rings at the median temperature, for which the line has to be known.
    fn bursts_and_line(&self) -> (BTreeMap<i64, Point>, Option<Line>) {
        let mut per_k = Vector2::zeros();
        let mut found = (BTreeMap::new(), None);
        for _ in 0..ROUNDS {
            let mut of_channel: BTreeMap<u32, Vec<Vector2<f64>>> = BTreeMap::new();
            for ring in self.rings.iter().filter(|ring| ring.warmer.abs() <= tuned::REACH_K) {
                of_channel.entry(ring.channel).or_default().push(ring.x - ring.warmer * per_k);
            }
            let middle =
                |xs: Vec<Vector2<f64>>| Vector2::from_fn(|j, _| median_of(xs.iter().map(|x| x[j])));
            let levels: BTreeMap<u32, Vector2<f64>> =
                of_channel.into_iter().map(|(channel, xs)| (channel, middle(xs))).collect();

            let mut bursts: BTreeMap<i64, Point> = BTreeMap::new();
            for ring in &self.rings {
                let Some(level) = levels.get(&ring.channel) else { continue };
                let new = Point { warmer: ring.warmer, x: Vector2::zeros(), rings: 0.0 };
                bursts.entry(ring.t_acq_ns).or_insert(new).add(ring.x - level);
            }
            let line = Line::through(&bursts);
            per_k = line.as_ref().map_or(per_k, |line| line.per_k);
            found = (bursts, line);
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 40 bursts of 12 channels; `said`: what is recorded for one whose ink is so many K warmer than the middle;
    /// `beside`: what moves all rings of burst 20 beside that.
    fn bursts(said: impl Fn(i64, f64) -> f64, beside: Vector2<f64>) -> Thermometer {
        let mut rings = Vec::new();
        for t_acq_ns in 0..40 {
            let ink = 8.0 * (t_acq_ns as f64 / 5.0).sin();
            for channel in 0..12u32 {
                let wobble = (t_acq_ns as f64 * 7.3 + f64::from(channel) * 2.1).sin();
                let level = Vector2::new(0.03, 0.01) * f64::from(channel).cos();
                let of_ink = Vector2::new(-0.02, 0.0012) * ink + Vector2::new(3e-3, 4e-4) * wobble;
                let x = level + of_ink + if t_acq_ns == 20 { beside } else { Vector2::zeros() };
                rings.push(RingSeen { t_acq_ns, channel, warmer: said(t_acq_ns, ink), x });
            }
        }
        Thermometer { rings, middle_c: 30.0 }
    }

    #[test]
    fn a_temperature_that_no_ring_shows_is_replaced_by_the_one_that_they_show() {
        let said = |t: i64, ink: f64| match t {
            3 => -30.0,
            9 => f64::NAN,
            14 => ink + 4.0,
            _ => ink,
        };
        let (right, told) = bursts(said, Vector2::zeros()).right();
        assert_eq!(right.keys().copied().collect::<Vec<_>>(), [3, 9, 14]);
        for (t, found) in right {
            let ink = 8.0 * (t as f64 / 5.0).sin();
            assert!((found - 30.0 - ink).abs() < 0.2, "burst {t}: {found}");
        }
        let told = told.warning("head").unwrap();
        assert!(told.contains("of 40 bursts: of 1 none was recorded, and of 2 it was"), "{told}");
    }

    #[test]
    fn what_is_right_stays_and_so_does_what_no_temperature_explains() {
        let as_it_is = |_: i64, ink: f64| ink;
        assert!(bursts(as_it_is, Vector2::zeros()).right().0.is_empty());
        assert!(bursts(as_it_is, Vector2::new(0.1, 0.02)).right().0.is_empty());
        // rings that temperature does not move do not say what it was
        let at_random = |t: i64, _: f64| (t as f64 * 5.1).sin() * 6.0;
        assert!(bursts(at_random, Vector2::zeros()).right().0.is_empty());
    }
}
