//! Thesis (3-1): the rates of A and the acquisition state whose free decay is nearest to the
//! average.
//!
//! In: the average signal (N counts per unit drive), or a whole window. Out: [`Identification`].
//! The problem is minimise over a, b, d, x_a: sum over k of (y_k - C e^(A k dt) x_a)².
//!
//! 1. The best damped cosine tells the time scale, to which the guessed rates are moved.
//! 2. The rates are searched from several starts within the bounds (`rate_search`).
//! 3. A fit that is much worse than the damped cosine is refused: it did not find the ring.
//! 4. Poles, acquisition state and uncertainty are computed from the rates.
//! 5. Of a window ([`identify_scattered`]) the bias by channels that differ is taken out, and 2 to
//!    4 are repeated.
//!
//! Departs: thesis (3-1) fits all of A and x_a. One decay carries 6 numbers, A and x_a have 8: the
//! ratio g/d (that is A_n/A_r, thesis (2-3), (2-4)) is held at the guess, and the state's component
//! along (1, -1, 0, 0) at 0. The result says what was held.

use super::averaging::MeanSignal;
use super::cubic::{RATES_PER_US, per_us, poles_of};
use super::damped_cosine::damped_cosine;
use super::identification::Scatter;
use super::rate_search::{End, Problem, Projection};
use super::scatter::scatter;
use super::{GreyBoxSettings, IdentifyError, SignalSet, identifiability};
use crate::model::InkChannel;
use nalgebra::{Vector3, matrix};

pub use super::identification::Identification;

/// Smallest number of samples: 6 numbers are fitted, and the misfit needs degrees of freedom.
pub const FEWEST_SAMPLES: usize = 12;
/// Largest misfit over that of the best damped cosine (and the noise). Heuristic.
const WORSE: f64 = 1.5;

/// Solves thesis (3-1) for one signal `y`, N counts. `noise`: standard deviation of one sample of
/// it, counts (0: estimated from the misfit). `near`: a channel that this one is probably close to:
/// one search from there suffices unless it explains too little, or ends at a bound.
pub fn identify(
    y: &[f64],
    dt_s: f64,
    noise: f64,
    settings: &GreyBoxSettings,
    near: Option<&InkChannel>,
) -> Result<Identification, IdentifyError> {
    if y.len() < FEWEST_SAMPLES {
        return Err(IdentifyError::TooFewSamples { samples: y.len(), needed: FEWEST_SAMPLES });
    }
    let scale = damped_cosine(y, dt_s).ok_or(IdentifyError::NoRingDown)?;

    // the cosine has four free numbers (two of them on a grid) and a constant, the model has six
    let most = WORSE * scale.misfit_rms + noise;

    let settings = settings.at_frequency(scale.frequency_hz);
    if let Some(near) = near
        && let Ok(found) = identify_from(y, dt_s, noise, &settings, Some(near))
        && found.misfit_rms <= most
        && found.at_bounds.is_empty()
    {
        return Ok(found);
    }
    let found = identify_from(y, dt_s, noise, &settings, None)?;
    if found.misfit_rms > most {
        return Err(IdentifyError::WorseThanACosine {
            model: found.misfit_rms,
            cosine: scale.misfit_rms,
            frequency_hz: scale.frequency_hz,
        });
    }
    Ok(found)
}

/// Thesis (3-1) searched from one start or from several, not compared with the damped cosine.
fn identify_from(
    y: &[f64],
    dt_s: f64,
    noise: f64,
    settings: &GreyBoxSettings,
    start: Option<&InkChannel>,
) -> Result<Identification, IdentifyError> {
    let mean = y.iter().sum::<f64>() / y.len() as f64;
    let spread = y.iter().map(|v| (v - mean).powi(2)).sum::<f64>().sqrt();
    if !spread.is_finite() || spread <= f64::MIN_POSITIVE {
        return Err(IdentifyError::NoRingDown);
    }

    let problem = Problem::new(y, dt_s, noise, settings);
    let starts = start.map_or_else(|| problem.starts(), |near| vec![problem.theta(near)]);
    let mut ends: Vec<End> = starts.iter().filter_map(|&start| problem.search(start)).collect();
    ends.sort_by(|p, q| p.cost.total_cmp(&q.cost));
    let best = ends.first().cloned().ok_or_else(|| {
        IdentifyError::NotConverged(format!(
            "{} starts within bound_factor = {} of the guess; give rates of the right order",
            starts.len(),
            settings.bound_factor
        ))
    })?;

    // ends of equal cost are the same optimum; relative to ||y||² rounding makes 1e-16 and less
    let same =
        |end: &&End| end.cost - best.cost <= 1e-3 * best.cost + 1e-14 * problem.y.norm_squared();
    let agreeing = ends.iter().filter(same).count();

    let channel = problem.channel(&best.theta);
    let cubic = channel.cubic();
    let Projection { state, misfit, .. } =
        problem.project(&best.theta).ok_or(IdentifyError::NoRingDown)?;
    let output_state = [state[0], state[1] * 1e6, state[2] * 1e12];
    Ok(Identification {
        poles: poles_of(cubic)
            .ok_or_else(|| IdentifyError::NotConverged("the fit does not oscillate".into()))?,
        acquisition_state: acquisition_state(&channel, output_state),
        fit_percent: 100.0 * (1.0 - misfit.norm() / spread),
        misfit_rms: misfit.norm() / (y.len() as f64).sqrt(),
        convergence: best.convergence,
        iterations: best.iterations,
        starts_agreeing: agreeing,
        starts: starts.len(),
        uncertainty: identifiability::uncertainty(cubic, &state, dt_s, y.len(), noise, &misfit),
        scatter: Scatter::default(),
        held_fixed: problem.held_fixed(),
        at_bounds: problem.at_bounds(&best.theta),
        not_identifiable: identifiability::in_words(),
        channel,
        cubic,
        output_state,
    })
}

/// Solves (3-1) for a window: step 5 of the header, at most `ROUNDS` times, until the damping
/// changes by less than 1e-5. `mean`: the average of `set`, the healthy signals of the window.
///
/// Departs: the thesis fits the plain average, whose damping is then biased and whose real pole
/// takes up the curvature. `plain_mean` does so here.
pub fn identify_scattered(
    set: &SignalSet,
    mean: &MeanSignal,
    dt_s: f64,
    settings: &GreyBoxSettings,
    near: Option<&InkChannel>,
) -> Result<Identification, IdentifyError> {
    const ROUNDS: usize = 8;
    let mut fit = identify(&mean.y, dt_s, mean.standard_error(), settings, near)?;
    if settings.plain_mean {
        return Ok(fit);
    }

    let settings = &settings.at_frequency(fit.poles.frequency_hz);
    for _ in 0..ROUNDS {
        let Some((found, straight)) = scatter(set, &fit, mean, dt_s) else { break };
        let near = Some(&fit.channel);
        let next = identify_from(&straight, dt_s, mean.standard_error(), settings, near)?;
        let step = (next.poles.damping_per_s / fit.poles.damping_per_s - 1.0).abs();
        let (starts, starts_agreeing) = (fit.starts, fit.starts_agreeing);
        fit = Identification { scatter: found, starts, starts_agreeing, ..next };
        if step < 1e-5 {
            break;
        }
    }

    // the mean over channels is at least as uncertain as the channels' own spread makes it
    let (poles, sd) = (fit.poles, &mut fit.uncertainty);
    sd.damping_sd_per_s = sd.damping_sd_per_s.max(fit.scatter.damping_se * poles.damping_per_s);
    sd.frequency_sd_hz = sd.frequency_sd_hz.max(fit.scatter.frequency_se * poles.frequency_hz);
    Ok(fit)
}

/// The acquisition state of thesis (2-2), counts·s and counts, from y, y', y'' in counts, counts/s,
/// counts/s²: V_r = V_n = V/2, so that nothing lies along the unobservable (1, -1, 0, 0).
fn acquisition_state(channel: &InkChannel, output_state: [f64; 3]) -> [f64; 4] {
    // For (V, q_r, q_n), per µs: y = q_r + q_n;  y' = -(a+b) V - g q_r - d q_n; y'' = -(a+b) y + (g
    // a + d b) V + g^2 q_r + d^2 q_n.
    let [a, b, g, d] = channel.times(RATES_PER_US).rates();
    let m = matrix![
        0.0, 1.0, 1.0;
        -(a + b), -g, -d;
        g * a + d * b, g * g - (a + b), d * d - (a + b)];
    let output = Vector3::from(per_us(output_state));
    let x = m.lu().solve(&output).unwrap_or_else(Vector3::zeros);
    [x[0] * 0.5e-6, x[0] * 0.5e-6, x[1], x[2]]
}

#[cfg(test)]
mod tests {
    use super::super::rate_search::tests::{DT_S, PLANTED, decay};
    use super::*;
    use crate::model::normal::draws;
    use crate::model::ring_down::{Poles, ring_down};
    use nalgebra::DVector;

    /// A fit of a decay with noise of this standard deviation.
    fn fitted(y: &[f64], noise: f64, near: Option<&InkChannel>) -> Identification {
        identify(y, DT_S, noise, &GreyBoxSettings::default(), near).unwrap()
    }

    /// How far damping and frequency lie off, in the fit's own standard deviations.
    fn off(fit: &Identification, truth: &Poles) -> [f64; 2] {
        [
            (fit.poles.damping_per_s - truth.damping_per_s) / fit.uncertainty.damping_sd_per_s,
            (fit.poles.frequency_hz - truth.frequency_hz) / fit.uncertainty.frequency_sd_hz,
        ]
    }

    #[test]
    fn planted_poles_and_the_signal_come_back_from_a_clean_decay() {
        let fit = fitted(&decay(), 0.0, None);
        let truth = poles_of(PLANTED.cubic()).unwrap();
        let close = |a: f64, b: f64, relative: f64| (a / b - 1.0).abs() <= relative;
        assert!(close(fit.poles.damping_per_s, truth.damping_per_s, 1e-6), "{fit:?}");
        assert!(close(fit.poles.frequency_hz, truth.frequency_hz, 1e-8));
        assert!(close(fit.poles.lambda_per_s, truth.lambda_per_s, 1e-4));
        assert!(fit.at_bounds.is_empty());
        let state = DVector::from_row_slice(&fit.acquisition_state);
        for again in [ring_down(&fit.channel, &state, DT_S, 128), fit.expected(DT_S, 128)] {
            assert!(decay().iter().zip(&again).all(|(y, z)| (y - z).abs() < 1e-5), "{again:?}");
        }
    }

    #[test]
    fn planted_poles_lie_within_their_stated_intervals() {
        let truth = poles_of(PLANTED.cubic()).unwrap();
        let (clean, noise) = (decay(), 4.0);
        let mut normal = draws(7);
        let (mut covered, runs) = ([0; 2], 200);
        for _ in 0..runs {
            let y: Vec<f64> = clean.iter().map(|v| v + noise * normal()).collect();
            for (covered, off) in covered.iter_mut().zip(off(&fitted(&y, noise, None), &truth)) {
                *covered += usize::from(off.abs() <= 1.96);
            }
        }
        for hits in covered {
            let share = hits as f64 / f64::from(runs);
            assert!((0.90..=0.99).contains(&share), "95 % intervals cover {share}");
        }
    }

    #[test]
    fn wherever_it_starts_a_search_ends_where_all_starts_do() {
        let by = |stiffness: f64, loss: f64| InkChannel {
            a_per_s2: PLANTED.a_per_s2 * stiffness,
            b_per_s2: PLANTED.b_per_s2 * stiffness,
            g_per_s: PLANTED.g_per_s * loss,
            d_per_s: PLANTED.d_per_s * loss,
        };
        for seed in 0..20 {
            let mut normal = draws(seed);
            let y: Vec<f64> = decay().iter().map(|v| v + 2.0 * normal()).collect();
            let cold = fitted(&y, 2.0, None);
            // starts from the window before, from another ink, and from what no ink is
            for near in [by(1.01, 0.96), by(0.8, 1.5), by(4.0, 0.1)] {
                let off = off(&cold, &fitted(&y, 2.0, Some(&near)).poles);
                assert!(off.iter().all(|off| off.abs() < 0.01), "{near:?}: {off:?}");
            }
        }
    }

    /// Thesis (3-1) bounds the parameters of A by predetermined values, each its own.
    #[test]
    fn a_bound_of_ones_own_holds_and_is_told() {
        let free = fitted(&decay(), 1.0, None);
        let mut settings = GreyBoxSettings { plain_mean: true, ..GreyBoxSettings::default() };
        let low = 1.2 * free.channel.d_per_s;
        settings.d_per_s = 1.3 * free.channel.d_per_s;
        settings.g_per_s = 0.2 * settings.d_per_s;
        settings.bounds.d_per_s = Some([low, 2.0 * low]);
        settings.check().unwrap();
        // the settings' channel is scaled to the ring's own time scale, its bounds are not
        let fit = identify_from(&decay(), DT_S, 1.0, &settings, None).unwrap();
        assert!((fit.channel.d_per_s / low - 1.0).abs() < 1e-6, "{}", fit.channel.d_per_s / low);
        assert_eq!(fit.at_bounds, ["d_per_s"]);
        assert!(fit.held_fixed.iter().all(|what| !what.contains("prior")), "{:?}", fit.held_fixed);
    }

    #[test]
    fn nothing_that_rings_is_an_error() {
        let settings = GreyBoxSettings::default();
        let flat = identify(&[3.0; 128], DT_S, 1.0, &settings, None);
        assert!(matches!(flat, Err(IdentifyError::NoRingDown)));
        let short = identify(&[1.0; 5], DT_S, 1.0, &settings, None);
        assert!(matches!(short, Err(IdentifyError::TooFewSamples { .. })));
    }
}
