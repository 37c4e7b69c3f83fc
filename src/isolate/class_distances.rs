//! Squared distances of a signal from all learned classes at once, one class in each SIMD lane.
//!
//! In: class densities, features. Out: per class [`ClassDensity::square`] and the upper bound of its density.
//! No multiplication is fused with an addition, so the result does not depend on the processor.

use super::class_density::ClassDensity;
use crate::processor::for_processor;

/// Classes that are compared at once.
const LANES: usize = 8;
type OfClasses = [f64; LANES];

#[derive(Clone, Debug)]
pub struct ClassDistances {
    groups: Vec<Group>,
    /// Per class the upper bound of its ln density, [`ClassDensity::ln_highest`].
    pub ln_highest: Vec<f64>,
}

/// Up to [`LANES`] classes. The distance along an axis is max(|to_axes (x - mean)| - width, 0); a Gaussian
/// axis has width 0 and its standard deviation divided into `to_axes`. Where there is no class the width is
/// -infinity, and so the distance infinite.
#[derive(Clone, Debug)]
struct Group {
    mean: [OfClasses; 4],
    to_axes: [[OfClasses; 4]; 4],
    width: [OfClasses; 4],
}

impl ClassDistances {
    pub fn of(classes: &[Option<ClassDensity>]) -> ClassDistances {
        let group = |of: &[Option<ClassDensity>]| {
            let zero = [0.0; LANES];
            let none = [f64::NEG_INFINITY; LANES];
            let mut group = Group { mean: [zero; 4], to_axes: [[zero; 4]; 4], width: [none; 4] };
            for (l, class) in of.iter().enumerate() {
                let Some(class) = class else { continue };
                group.width.iter_mut().for_each(|width| width[l] = 0.0);
                class.mean().iter().zip(&mut group.mean).for_each(|(m, mean)| mean[l] = *m);
                let axes = class.distances();
                for ((row, width), (to, of)) in
                    axes.zip(group.to_axes.iter_mut().zip(&mut group.width))
                {
                    row.zip(to).for_each(|(b, to)| to[l] = b);
                    of[l] = width;
                }
            }
            group
        };
        let highest = |class: &Option<ClassDensity>| {
            class.as_ref().map_or(f64::NEG_INFINITY, ClassDensity::ln_highest)
        };
        ClassDistances {
            groups: classes.chunks(LANES).map(group).collect(),
            ln_highest: classes.iter().map(highest).collect(),
        }
    }

    /// Squared distance of each class; infinite where there is none. At most four features.
    pub fn squares(&self, features: &[f64], out: &mut [f64]) {
        let mut x = [0.0; 4];
        x.iter_mut().zip(features).for_each(|(x, f)| *x = *f);
        for (group, out) in self.groups.iter().zip(out.chunks_mut(LANES)) {
            out.copy_from_slice(&squares(group, &x)[..out.len()]);
        }
    }
}

for_processor! {
    fn squares(of: &Group, x: &[f64; 4]) -> OfClasses { portable }
}

#[inline(always)] // compiled once per instruction set
fn portable(of: &Group, x: &[f64; 4]) -> OfClasses {
    let (mut d, mut squares) = ([[0.0; LANES]; 4], [0.0; LANES]);
    for (d, (x, mean)) in d.iter_mut().zip(x.iter().zip(&of.mean)) {
        for l in 0..LANES {
            d[l] = x - mean[l];
        }
    }
    for (row, width) in of.to_axes.iter().zip(&of.width) {
        for l in 0..LANES {
            let along = (row[0][l] * d[0][l] + row[1][l] * d[1][l])
                + (row[2][l] * d[2][l] + row[3][l] * d[3][l]);
            let outside = along.abs() - width[l];
            let outside = if outside > 0.0 { outside } else { 0.0 };
            squares[l] += outside * outside;
        }
    }
    squares
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use rand::{RngExt, SeedableRng};

    #[test]
    fn property_all_at_once_are_as_far_as_each_class_says() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(8);
        for coordinates in [3, 4] {
            let classes: Vec<Option<ClassDensity>> = (0..11)
                .map(|k| {
                    let wide = rng.random_range(0.01..1.0);
                    let features: Vec<DVector<f64>> = (0..60)
                        .map(|_| {
                            let x =
                                DVector::from_fn(coordinates, |_, _| rng.random_range(-0.1..0.1));
                            x * wide
                        })
                        .collect();
                    let noise = DMatrix::identity(coordinates, coordinates) * 1e-4;
                    (k % 4 != 2)
                        .then(|| ClassDensity::learn(&features, &noise, None, k % 3 > 0))
                        .flatten()
                })
                .collect();
            let all = ClassDistances::of(&classes);
            for _ in 0..100 {
                let x: Vec<f64> = (0..coordinates).map(|_| rng.random_range(-1.0..1.0)).collect();
                let mut squares = vec![0.0; classes.len()];
                all.squares(&x, &mut squares);
                for (square, class) in squares.iter().zip(&classes) {
                    let one = class.as_ref().map_or(f64::INFINITY, |class| class.square(&x));
                    assert!(*square == one || (square / one - 1.0).abs() < 1e-12, "{square} {one}");
                }
            }
        }
    }
}
