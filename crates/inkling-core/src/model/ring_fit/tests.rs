use super::*;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;

const DT_S: f64 = 0.78125e-6;
const HEALTHY: Ring = Ring {
    amplitude: 400.0,
    phase_rad: 0.4,
    damping_per_s: 2.9e4,
    frequency_hz: 64_700.0,
    real_share: 0.06,
    lambda_per_s: 3.7e4,
};

/// A clean signal: amplitude, damping and frequency as multiples of the healthy ring's, the
/// phase turned by `turn`.
fn signal(a: f64, damping: f64, frequency: f64, turn: f64) -> Vec<f64> {
    (0..128)
        .map(|k| {
            let t = k as f64 * DT_S;
            let angle = 2.0 * std::f64::consts::PI * HEALTHY.frequency_hz * frequency * t;
            let pair = (-HEALTHY.damping_per_s * damping * t).exp()
                * (angle + HEALTHY.phase_rad + turn).cos();
            let real = HEALTHY.real_share * (-HEALTHY.lambda_per_s * t).exp() * turn.cos();
            HEALTHY.amplitude * a * (pair + real)
        })
        .collect()
}

/// Draws what [`signal`] takes, from the range that a fit searches.
fn any_ring(rng: &mut impl RngExt) -> [f64; 4] {
    [0.5..1.6, 0.1..3.0, 0.45..1.4, -0.5..0.5].map(|of| rng.random_range(of))
}

#[test]
fn clean_rings_come_back_from_anywhere_in_the_range() {
    let fitter = RingFitter::new(HEALTHY, DT_S, 128);
    let mut work = FitBuffers::default();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
    for _ in 0..500 {
        let [a, d, f, turn] = any_ring(&mut rng);
        let fit = fitter.fit(&signal(a, d, f, turn), true, &mut work).unwrap();
        let x = fit.features;
        assert!((x.ln_frequency - f.ln()).abs() < 1e-4, "{a} {d} {f} {turn}: {x:?}");
        assert!((x.ln_damping - d.ln()).abs() < 5e-3, "{a} {d} {f} {turn}: {x:?}");
        assert!((x.phase_rad - turn).abs() < 1e-3);
    }
}

#[test]
fn fit_is_a_stationary_point_of_the_misfit() {
    let fitter = RingFitter::new(HEALTHY, DT_S, 128);
    let mut work = FitBuffers::default();
    let mut normal = crate::model::normal::draws(6);
    for _ in 0..50 {
        let ring = signal(0.9, 1.5, 0.93, 0.0);
        let y: Vec<f64> = ring.iter().map(|v| v + 17.6 * normal()).collect();
        for phase in [false, true] {
            let fit = fitter.fit(&y, phase, &mut work).unwrap();
            let at = |d: f64, f: f64| {
                let (damping, frequency) =
                    (fit.features.ln_damping + d, fit.features.ln_frequency + f);
                misfit(&fitter, &y, damping.exp(), frequency.exp(), phase)
            };
            let here = at(0.0, 0.0);
            for (d, f) in [(0.01, 0.0), (-0.01, 0.0), (0.0, 0.001), (0.0, -0.001)] {
                assert!(at(d, f) >= here - 1e-9 * here, "lower beside the fit");
            }
        }
    }
}

/// The misfit at a damping and a frequency, by least squares on the columns themselves.
fn misfit(fitter: &RingFitter, y: &[f64], damping: f64, frequency: f64, phase: bool) -> f64 {
    let columns = fitter.columns(damping, frequency);
    let kept = if phase { 2 } else { 1 };
    let matrix = DMatrix::from_fn(y.len(), kept, |k, j| columns[j][k]);
    let y = nalgebra::DVector::from_row_slice(y);
    let gram = (matrix.transpose() * &matrix).try_inverse().unwrap();
    let amplitudes = gram * matrix.transpose() * &y;
    (y - matrix * amplitudes).norm_squared()
}

#[test]
fn property_signals_side_by_side_are_fitted_as_each_alone() {
    for samples in [128, 61] {
        let fitter = RingFitter::new(HEALTHY, DT_S, samples);
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let signals: Vec<Vec<f64>> = (0..150)
            .map(|i| {
                let [a, d, f, turn] = any_ring(&mut rng);
                let noise = if i % 20 == 3 { f64::NAN } else { 10.0 * (i % 3) as f64 };
                let y = signal(a, d, f, turn);
                let noisy = |y: f64, e: f64| if i % 20 == 7 { 0.0 } else { y + noise * e };
                y[..samples].iter().map(|&y| noisy(y, rng.sample(StandardNormal))).collect()
            })
            .collect();
        let healthy = Features::HEALTHY;
        for near in [None, Some(healthy)] {
            for phase in [false, true] {
                let mut work = FitBuffers::default();
                let starts = vec![near; signals.len()];
                let copy = |i: usize, y: &mut [f64]| y.copy_from_slice(&signals[i]);
                let fits = fitter.fit_all(phase, &mut work, &starts, copy);
                for (y, fit) in signals.iter().zip(fits) {
                    let alone = match near {
                        None => fitter.fit(y, phase, &mut work),
                        Some(near) => fitter.fit_from(y, &near, phase),
                    };
                    let bits = |fit: Option<Fit>| {
                        fit.map(|f| (f.features.coordinates().map(f64::to_bits), f.misfit))
                    };
                    assert_eq!(bits(fit), bits(alone));
                }
            }
        }
    }
}

#[test]
fn tangent_is_the_slope_of_the_ring() {
    let fitter = RingFitter::new(HEALTHY, DT_S, 128);
    let at = Features { ln_amplitude: -0.1, ln_damping: 0.3, ln_frequency: -0.05, phase_rad: 0.0 };
    let ring = |d: [f64; 3]| {
        let x = [at.ln_amplitude + d[0], at.ln_damping + d[1], at.ln_frequency + d[2]];
        signal(x[0].exp(), x[1].exp(), x[2].exp(), 0.0)
    };
    let tangent = fitter.tangent(&at);
    for j in 0..3 {
        let mut d = [0.0; 3];
        d[j] = 1e-5;
        let (up, down) = (ring(d), ring(d.map(|v| -v)));
        for k in 0..128 {
            let slope = (up[k] - down[k]) / 2e-5;
            assert!((tangent[(k, j)] - slope).abs() < 1e-3 + 1e-5 * slope.abs(), "{j} {k}");
        }
    }
}

#[test]
fn nothing_is_no_ring() {
    let fitter = RingFitter::new(HEALTHY, DT_S, 128);
    assert!(fitter.fit(&[0.0; 128], true, &mut FitBuffers::default()).is_none());
    assert!(fitter.fit(&[f64::NAN; 128], true, &mut FitBuffers::default()).is_none());
}
