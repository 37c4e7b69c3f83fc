//! One draw of a disturbance, its size still open, and the size at which a given energy of it is
//! what no healthy ring explains.

use super::plant::{Plant, Random};
use super::ring::Ring;
use super::unexplained;

pub enum Pattern {
    /// So many times this.
    Added(Vec<f64>),
    /// Steps of this size.
    Coarse,
    /// From a sample on the ring is so many samples older.
    Later(usize),
    /// The frequency sweeps over so much of itself.
    Sweeping,
}

#[derive(Clone, Copy)]
pub struct Undisturbed<'a> {
    pub ring: &'a Ring,
    pub base: &'a [f64],
    pub plant: &'a Plant,
}

impl Undisturbed<'_> {
    fn height(&self) -> f64 {
        height(self.base)
    }
}

/// What is added is at most so many times as high as the ring.
const HIGHEST: f64 = 4.0;
/// Of the energy that is asked for.
const TOLERANCE: f64 = 0.03;
const MOST_STEPS: usize = 40;

impl Pattern {
    /// As recorded, so large that `x` noise variances are unexplained. `None`: it cannot be so large.
    pub fn signal(&self, x: f64, of: &Undisturbed, rng: &mut Random) -> Option<Vec<f32>> {
        let size = self.size(x, of)?;
        let mut y = self.of_size(size, of);
        of.plant.add_noise(&mut y, rng);
        self.after_noise(size, &mut y);
        Some(of.plant.recorded(y))
    }

    /// The secant in logarithms, kept inside a bracket.
    fn size(&self, x: f64, of: &Undisturbed) -> Option<f64> {
        let ratio = |size: f64| {
            let y = self.of_size(size, of);
            let noise = of.plant.noise_counts();
            unexplained::energy(&y, of.ring, of.plant.sampling(), noise) / x
        };
        let (mut low, mut high) = (0.0, self.most(of));
        if ratio(high) < 1.0 {
            return None;
        }
        let mut size = self.first_guess(of);
        for _ in 0..MOST_STEPS {
            if size <= low || size >= high {
                size = (low + high) / 2.0;
            }
            let ratio = ratio(size);
            if (ratio - 1.0).abs() < TOLERANCE {
                return Some(size);
            }
            *(if ratio < 1.0 { &mut low } else { &mut high }) = size;
            // energy grows with the square of the size, about
            size *= ratio.powf(-0.5).clamp(0.2, 5.0);
        }
        None
    }

    fn of_size(&self, size: f64, of: &Undisturbed) -> Vec<f64> {
        let sampling = of.plant.sampling();
        match self {
            Pattern::Added(v) => of.base.iter().zip(v).map(|(y, v)| y + size * v).collect(),
            Pattern::Coarse => {
                let mut y = of.base.to_vec();
                self.after_noise(size, &mut y);
                y
            }
            Pattern::Later(from) => {
                let later = size * sampling.period_s;
                let times = sampling.times().enumerate();
                times.map(|(k, t)| of.ring.at(if k >= *from { t + later } else { t })).collect()
            }
            Pattern::Sweeping => {
                let at = |t: f64| {
                    let swept = size * (t / sampling.duration_s() - 0.5);
                    let phase_rad = of.ring.phase_rad + of.ring.omega() * t * swept;
                    Ring { phase_rad, ..*of.ring }.at(t)
                };
                sampling.times().map(at).collect()
            }
        }
    }

    /// What the converter does, it does to signal and noise.
    fn after_noise(&self, size: f64, y: &mut [f64]) {
        if let Pattern::Coarse = self {
            y.iter_mut().for_each(|y| *y = (*y / size).round() * size);
        }
    }

    fn first_guess(&self, of: &Undisturbed) -> f64 {
        let noise = of.plant.noise_counts();
        match self {
            Pattern::Added(v) => 20.0 * noise / v.iter().map(|v| v * v).sum::<f64>().sqrt(),
            Pattern::Coarse => 6.0 * noise,
            Pattern::Later(_) => 2.0,
            Pattern::Sweeping => 0.2,
        }
    }

    /// Beyond it a pattern is something else, or grows no more.
    fn most(&self, of: &Undisturbed) -> f64 {
        match self {
            Pattern::Added(v) => HIGHEST * of.height() / height(v),
            Pattern::Coarse => of.height(),
            Pattern::Later(_) => 8.0,
            Pattern::Sweeping => 2.0,
        }
    }
}

fn height(y: &[f64]) -> f64 {
    y.iter().fold(0.0, |most, y| most.max(y.abs()))
}
