//! What the truth itself would reach, were it known: healthy channels, faults, noise, and the threshold of each rate exactly.
//! What is beyond these figures no better estimate of anything gives.

use super::Shown;
use crate::open_world::plant::{Plant, Random, random};
use crate::open_world::ranges::{Features, Range, Ranges};
use crate::open_world::scatter::{Scatter, Shape};
use rand_distr::{Distribution, StandardNormal};

const FAULTY_OF_SET: f64 = 2025.0;
const HEALTHY_OF_SET: f64 = 2475.0;

pub struct Plan {
    pub seed: u64,
    /// Healthy signals, and a tenth of it faulty ones of each class.
    pub signals: usize,
    /// Of 2475 healthy signals.
    pub false_alarms: Vec<f64>,
}

pub struct Row {
    pub scatter: Scatter,
    pub statistic: &'static str,
    pub false_alarms: f64,
    /// Of 2025 faulty signals.
    pub misses: f64,
}

/// Amplitude, damping, frequency as the best fit finds them.
type Estimate = [f64; 3];

/// A fit's noise, of least variance (Cramer and Rao) at the typical healthy ring: of amplitude and damping; the frequency's is
/// independent of these.
struct Noise {
    sd: Estimate,
    correlation: f64,
}

pub fn measure(plan: &Plan) -> Vec<Row> {
    let plant = Plant::thesis_form();
    let noise = Noise::of(&plant);
    let mut rng = random(plan.seed, 0);
    let mut faulty = Vec::new();
    for ranges in plant.faults.values() {
        let draw = |_| noise.found(ranges.draw(&mut rng), &mut rng);
        faulty.extend((0..plan.signals / 10).map(draw).collect::<Vec<Estimate>>());
    }
    let mut rows = Vec::new();
    for shape in [Shape::Box, Shape::Gaussian, Shape::Skewed, Shape::Heavy] {
        let scatter = Scatter { shape, width: 1.0 };
        let draw = |_| noise.found(scatter.features(&plant, plan.seed, 0, &mut rng), &mut rng);
        let healthy: Vec<Estimate> = (0..plan.signals).map(draw).collect();
        for weight in [1.0, 0.35] {
            let distance = noise.distance(&plant, weight);
            let name = if weight == 1.0 { "distance" } else { "distance, spread x .35" };
            add(&mut rows, plan, (scatter, name), (&healthy, &faulty), distance);
        }
        if shape == Shape::Box {
            let ratio = |x: &Estimate| noise.ln_ratio(&plant, x);
            add(&mut rows, plan, (scatter, "likelihood ratio"), (&healthy, &faulty), ratio);
        }
    }
    rows
}

fn add(
    rows: &mut Vec<Row>,
    plan: &Plan,
    (scatter, statistic): (Scatter, &'static str),
    (healthy, faulty): (&[Estimate], &[Estimate]),
    of: impl Fn(&Estimate) -> f64,
) {
    let mut healthy: Vec<f64> = healthy.iter().map(&of).collect();
    healthy.sort_unstable_by(|p, q| q.total_cmp(p));
    let faulty: Vec<f64> = faulty.iter().map(&of).collect();
    for &false_alarms in &plan.false_alarms {
        let beyond = false_alarms / HEALTHY_OF_SET * healthy.len() as f64;
        let threshold = healthy[beyond as usize];
        let missed = faulty.iter().filter(|s| **s <= threshold).count() as f64;
        let misses = missed / faulty.len() as f64 * FAULTY_OF_SET;
        rows.push(Row { scatter, statistic, false_alarms, misses });
    }
}

impl Noise {
    fn of(plant: &Plant) -> Noise {
        let ring = plant.typical();
        let moved = |k: usize, by: f64| {
            let mut ring = ring;
            let of = [&mut ring.amplitude, &mut ring.damping_per_s, &mut ring.frequency_hz];
            *of.into_iter().nth(k).unwrap() *= 1.0 + by;
            plant.clean(&ring)
        };
        let at = [ring.amplitude, ring.damping_per_s, ring.frequency_hz];
        let slope = |k: usize| -> Vec<f64> {
            let (up, down) = (moved(k, 1e-4), moved(k, -1e-4));
            up.iter().zip(&down).map(|(u, d)| (u - d) / (2e-4 * at[k])).collect()
        };
        let slopes = [0, 1, 2].map(slope);
        // rounding to whole counts adds a twelfth
        let variance = plant.noise_counts().powi(2) + 1.0 / 12.0;
        let of = |i: usize, j: usize| -> f64 {
            slopes[i].iter().zip(&slopes[j]).map(|(p, q)| p * q).sum::<f64>() / variance
        };
        let determinant = of(0, 0) * of(1, 1) - of(0, 1).powi(2);
        let sd = [of(1, 1) / determinant, of(0, 0) / determinant, 1.0 / of(2, 2)].map(f64::sqrt);
        Noise { sd, correlation: -of(0, 1) / determinant / (sd[0] * sd[1]) }
    }

    fn found(&self, of: Features, rng: &mut Random) -> Estimate {
        let [p, q, r] = [(); 3].map(|()| -> f64 { StandardNormal.sample(rng) });
        let own = (1.0 - self.correlation * self.correlation).sqrt();
        [
            of.amplitude + self.sd[0] * p,
            of.damping_per_s + self.sd[1] * (self.correlation * p + own * q),
            of.frequency_hz + self.sd[2] * r,
        ]
    }

    /// The squared distance from the healthy middle, in the noise's covariance and `weight` times the channels'.
    fn distance(&self, plant: &Plant, weight: f64) -> impl Fn(&Estimate) -> f64 {
        let Ranges { amplitude, damping_per_s, frequency_hz, .. } = plant.healthy;
        let ranges = [amplitude, damping_per_s, frequency_hz];
        let middle = ranges.map(Range::centre);
        let total = |k: usize| self.sd[k].powi(2) + weight * ranges[k].sd().powi(2);
        let [p, q, r] = [0, 1, 2].map(total);
        let both = self.correlation * self.sd[0] * self.sd[1];
        let determinant = p * q - both * both;
        move |x| {
            let [a, s, f] = [0, 1, 2].map(|k| x[k] - middle[k]);
            (q * a * a - 2.0 * both * a * s + p * s * s) / determinant + f * f / r
        }
    }

    /// ln of the density of all faults over that of healthy signals: no statistic misses fewer (Neyman and Pearson 1933).
    fn ln_ratio(&self, plant: &Plant, x: &Estimate) -> f64 {
        let faults = plant.faults.values().map(|ranges| self.density(ranges, x)).sum::<f64>();
        faults.max(1e-300).ln() - self.density(&plant.healthy, x).max(1e-300).ln()
    }

    /// Of a box, widened by the noise: sums over its part within six standard deviations.
    fn density(&self, of: &Ranges, x: &Estimate) -> f64 {
        const STEPS: usize = 16;
        let near = |range: Range, middle: f64, sd: f64| {
            let (low, high) = (range.low.max(middle - 6.0 * sd), range.high.min(middle + 6.0 * sd));
            let step = (high - low).max(0.0) / STEPS as f64;
            let values = (0..STEPS).map(move |i| low + (i as f64 + 0.5) * step);
            (values, step / (range.high - range.low))
        };
        let normal = |z: f64, sd: f64| (-0.5 * z * z).exp() / sd;
        let (frequencies, step) = near(of.frequency_hz, x[2], self.sd[2]);
        let along: f64 =
            frequencies.map(|f| step * normal((x[2] - f) / self.sd[2], self.sd[2])).sum();
        if along == 0.0 {
            return 0.0;
        }
        let own = self.sd[1] * (1.0 - self.correlation * self.correlation).sqrt();
        let (amplitudes, step) = near(of.amplitude, x[0], self.sd[0]);
        let across: f64 = amplitudes
            .map(|a| {
                let z = (x[0] - a) / self.sd[0];
                let middle = x[1] - self.correlation * self.sd[1] * z;
                let (dampings, part) = near(of.damping_per_s, middle, own);
                let sum: f64 = dampings.map(|s| part * normal((middle - s) / own, own)).sum();
                step * normal(z, self.sd[0]) * sum
            })
            .sum();
        along * across
    }
}

pub fn show(rows: &[Row]) -> Shown {
    let title = "Thesis form, were the truth known: misses of 2025 at so many false alarms of 2475";
    let head = "scatter | statistic | false alarms | stated rate | misses | recall";
    Shown::of(title, head, rows, |row| {
        vec![
            row.scatter.to_string(),
            row.statistic.into(),
            format!("{:.2}", row.false_alarms),
            format!("{:.1e}", row.false_alarms / HEALTHY_OF_SET),
            format!("{:.1}", row.misses),
            format!("{:.4}", 1.0 - row.misses / FAULTY_OF_SET),
        ]
    })
}
