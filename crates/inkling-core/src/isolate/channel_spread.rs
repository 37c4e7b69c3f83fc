//! How healthy channels differ in their rates and gain, from the scatter of their features.

use super::class_density::mean_and_scatter;
use super::fault_simulator::{CHANGES, Slope};
use nalgebra::{DMatrix, DVector, SMatrix};
use serde::{Deserialize, Serialize};

const MOST_PASSES: usize = 10_000;

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ChannelSpread {
    /// Standard deviations over healthy channels of ln a, ln b, ln g, ln d, ln gain.
    pub changes: [f64; CHANGES],
    /// Standard deviation of the phase by other causes, rad.
    pub phase: f64,
}

/// How healthy channels differ. Arguments and
/// `None`: as in `FaultPhysics::learn_spread`; `slope`: Jacobian of the features by these. The
/// model is: covariance of the features = slope diag(variances) slope' + noise + a variance of the
/// phase by other causes. Four features do not determine six variances, so a and b are given the
/// same, and so are g and d. The four ln standard deviations are estimated by maximum a
/// posteriori: Gaussian likelihood of the sample covariance, counted as often as there are
/// channels, and a weak prior; by a coordinate search.
pub(super) fn spread_of_channels(
    slope: &Slope,
    features: &[DVector<f64>],
    noise: &DMatrix<f64>,
    channels: usize,
) -> Option<ChannelSpread> {
    let n = features.len() as f64;
    if features.len() < 16 || noise.nrows() != 4 {
        return None;
    }

    let (_, scatter) = mean_and_scatter(features, DMatrix::zeros(4, 4));
    let sample = scatter.fixed_view::<4, 4>(0, 0) / (n - 1.0);
    let noise = noise.fixed_view::<4, 4>(0, 0);

    // Minus the log posterior. `ln_sd`: of a and b, of g and d, of gain, and of the phase by other
    // causes (such as the trigger).
    let cost = |ln_sd: &[f64; 4]| -> f64 {
        let v = ln_sd.map(|l| (2.0 * l).exp());
        let rates = SMatrix::<f64, CHANGES, 1>::from([v[0], v[0], v[1], v[1], v[2]]);
        let mut model = slope * SMatrix::from_diagonal(&rates) * slope.transpose() + noise;
        model[(3, 3)] += v[3];
        let Some(cholesky) = model.cholesky() else { return f64::INFINITY };
        // minus twice the Gaussian log likelihood per channel, up to a constant
        let fit = cholesky.determinant().ln() + (cholesky.inverse() * sample).trace();
        let small: f64 = ln_sd.iter().map(|l| ((l + 5.0) / 3.0).powi(2)).sum();
        0.5 * (channels as f64 * fit + small)
    };
    let mut best = [-5.0; 4];
    let mut least = cost(&best);
    if !least.is_finite() {
        return None; // features or noise so large that their squares overflow
    }

    let mut step = 1.0;
    for _ in 0..MOST_PASSES {
        if step <= 1e-3 {
            break;
        }
        let before = least;
        for k in 0..best.len() {
            for sign in [-1.0, 1.0] {
                let mut trial = best;
                trial[k] = (trial[k] + sign * step).clamp(-12.0, 0.0);
                let c = cost(&trial);
                if c < least {
                    (best, least) = (trial, c);
                }
            }
        }
        if before - least >= 1e-6 {
            continue; // false where either is NaN
        }
        step /= 2.0;
    }
    let sd = best.map(f64::exp);
    let changes = [sd[0], sd[0], sd[1], sd[1], sd[2]];
    least.is_finite().then_some(ChannelSpread { changes, phase: sd[3] })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn features_that_are_no_numbers_have_no_spread_and_an_end() {
        let noise = DMatrix::identity(4, 4) * 1e-6;
        for wrong in [f64::NAN, f64::INFINITY, 1e200] {
            let mut features = vec![DVector::repeat(4, 1e-3); 20];
            features[7][2] = wrong;
            assert_eq!(spread_of_channels(&Slope::identity(), &features, &noise, 10), None);
        }
        let features: Vec<_> =
            (0..20).map(|i| DVector::repeat(4, 0.1 * f64::from(i % 3 - 1))).collect();
        assert!(spread_of_channels(&Slope::identity(), &features, &noise, 10).is_some());
    }
}
