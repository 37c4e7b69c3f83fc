//! What a healthy ring leaves unexplained: amplitude, phase, damping, frequency and real pole free,
//! fitted by Levenberg and Marquardt from the healthy ring on. Written for the tests, from (2-2)'s
//! shape alone, so that the size of a disturbance is nobody's opinion.

use super::ring::{Ring, Sampling};
use nalgebra::{SMatrix, SVector};

const UNKNOWNS: usize = 6;
/// A ring is of the healthy kind while its resonance and its real pole are within these factors.
const FREQUENCY_FACTOR: f64 = 1.5;
/// A much slower pole would be an offset, and explain one.
const POLE_FACTOR: f64 = 1.2;
const MOST_STEPS: usize = 40;
/// A step that gains less of what is left is the last.
const LEAST_GAIN: f64 = 1e-5;

type Unknowns = SVector<f64, UNKNOWNS>;

/// Sum of squares of `y` less the best healthy ring, in variances of the noise.
pub fn energy(y: &[f64], healthy: &Ring, sampling: Sampling, noise_sd: f64) -> f64 {
    let fit = Fit { y, healthy, sampling, duration_s: sampling.duration_s() };
    let mut at = fit.start();
    let (mut left, mut normal, mut gradient) = fit.expand(&at);
    let mut caution = 1e-3;
    for _ in 0..MOST_STEPS {
        let (mut matrix, mut towards) = (normal, gradient);
        for i in 0..UNKNOWNS {
            matrix[(i, i)] += caution * normal[(i, i)] + 1e-12;
        }
        // what stands at a bound and would go beyond stays, and the others move without it
        for i in fit.held(&at, &gradient) {
            let diagonal = matrix[(i, i)];
            matrix.fill_row(i, 0.0);
            matrix.fill_column(i, 0.0);
            matrix[(i, i)] = diagonal;
            towards[i] = 0.0;
        }
        let Some(step) = matrix.cholesky().map(|c| c.solve(&towards)) else { break };
        let next = fit.within(at + step);
        let (left_next, normal_next, gradient_next) = fit.expand(&next);
        if left_next < left {
            let gain = (left - left_next) / left;
            (at, left, normal, gradient) = (next, left_next, normal_next, gradient_next);
            caution *= 0.2;
            if gain < LEAST_GAIN {
                break;
            }
        } else {
            caution *= 8.0;
            if caution > 1e8 {
                break;
            }
        }
    }
    left / (noise_sd * noise_sd)
}

struct Fit<'a> {
    y: &'a [f64],
    healthy: &'a Ring,
    sampling: Sampling,
    duration_s: f64,
}

impl Fit<'_> {
    /// Cosine, sine, pole; damping, circular frequency and pole rate per duration.
    fn start(&self) -> Unknowns {
        let ring = self.healthy;
        Unknowns::from([
            ring.amplitude * ring.phase_rad.cos(),
            -ring.amplitude * ring.phase_rad.sin(),
            ring.amplitude * ring.pole_share,
            ring.damping_per_s * self.duration_s,
            ring.omega() * self.duration_s,
            ring.pole_per_s * self.duration_s,
        ])
    }

    fn bounds(&self) -> [[f64; 2]; UNKNOWNS] {
        let start = self.start();
        let free = [f64::NEG_INFINITY, f64::INFINITY];
        let around = |i: usize, factor: f64| [start[i] / factor, start[i] * factor];
        let damping = [0.0, f64::INFINITY];
        [free, free, free, damping, around(4, FREQUENCY_FACTOR), around(5, POLE_FACTOR)]
    }

    fn within(&self, at: Unknowns) -> Unknowns {
        let bounds = self.bounds();
        Unknowns::from_fn(|i, _| at[i].clamp(bounds[i][0], bounds[i][1]))
    }

    fn held(&self, at: &Unknowns, descent: &Unknowns) -> Vec<usize> {
        let bounds = self.bounds();
        let is_held = |&i: &usize| {
            let [low, high] = bounds[i];
            (at[i] <= low && descent[i] < 0.0) || (at[i] >= high && descent[i] > 0.0)
        };
        (0..UNKNOWNS).filter(is_held).collect()
    }

    /// Sum of squares, its normal matrix and its descent.
    fn expand(&self, at: &Unknowns) -> (f64, SMatrix<f64, UNKNOWNS, UNKNOWNS>, Unknowns) {
        let (mut left, mut normal, mut gradient) = (0.0, SMatrix::zeros(), Unknowns::zeros());
        for (y, t) in self.y.iter().zip(self.sampling.times()) {
            let u = t / self.duration_s;
            let (decay, pole) = ((-at[3] * u).exp(), (-at[5] * u).exp());
            let (sin, cos) = (at[4] * u).sin_cos();
            let oscillation = decay * (at[0] * cos + at[1] * sin);
            let miss = y - oscillation - at[2] * pole;
            let slope = Unknowns::from([
                decay * cos,
                decay * sin,
                pole,
                -u * oscillation,
                u * decay * (at[1] * cos - at[0] * sin),
                -u * at[2] * pole,
            ]);
            left += miss * miss;
            normal += slope * slope.transpose();
            gradient += slope * miss;
        }
        (left, normal, gradient)
    }
}
