//! Detection by `detect.method` = `sensitivity`: the distances of many signals along and beside the ring of
//! one judge.
//!
//! In: the bursts of one judge, from [`super::statistics`]. Out: each signal's [`Detection`]; for `own_levels`
//! also features, and distances from a channel's own level. A signal goes this way:
//!
//! 1. In f32, up to 32 signals side by side (*lanes*, one signal in each): the squared distance along the
//!    sensitivities (`side_by_side`). A bound on the rounding says whether the verdict is *settled*, that is the
//!    same as in f64; nearly always it is.
//! 2. The others, and all signals where a judge has no lanes, are computed in f64: a first look, to first order
//!    (`first_look`).
//! 3. Where that does not decide, a second look by fitted rings, which are fitted side by side (`second_look`).

use super::batches::Detected;
use super::rings::Deviations;
use inkling_core::burst::Burst;
use inkling_core::design::{
    Detection, FirstLook, Judge, JudgeKey, OwnBaseline, SensitivityDetector,
};
use inkling_core::detect::lane_sensitivity::{Condition, LaneSensitivity};
use inkling_core::detect::row_projection::{LANES, Projections, Room};
use inkling_core::model::ring_fit::{Fit, FitBuffers};
use inkling_core::verdict::Reason;
use nalgebra::{Matrix3, Vector4};

/// The buffers of one worker.
#[derive(Default)]
pub struct Distances {
    pub deviations: Deviations,
    condition: LastCondition,
    /// Projections of signals onto the sensitivities (of amplitude, damping, frequency).
    along: Projections<3>,
    /// Projections that give the features, the phase free.
    features: Projections<4>,
    room: Room,
    own: Vec<f64>,
    products: FitBuffers,
}

/// A burst, and where in the batch its first signal stands.
pub struct PlacedBurst<'a> {
    pub judge: &'a Judge,
    pub first: usize,
    pub burst: &'a Burst,
}

#[derive(Clone, Copy)]
struct WaitingSignal<'a> {
    at: usize,
    burst: &'a Burst,
    row: usize,
}

/// A signal whose first look asks for a fit.
struct LookedAt<'a> {
    signal: WaitingSignal<'a>,
    look: FirstLook,
    /// The fit with the phase held; `None`: not made yet, or failed.
    held: Option<Fit>,
}

/// The condition (judge, drive, temperature) of the burst before, which consecutive bursts mostly share.
#[derive(Default)]
struct LastCondition(Option<(JudgeKey, Condition)>);

impl Distances {
    /// `rails`: limits of the converter, counts.
    pub fn new(rails: [f64; 2]) -> Distances {
        Distances { deviations: Deviations::new(rails), ..Distances::default() }
    }

    /// Writes the statistics of the bursts' signals; `statistic`: one entry per signal of the batch.
    pub fn of(
        &mut self,
        judge: &Judge,
        detector: &SensitivityDetector,
        bursts: &[PlacedBurst],
        statistic: &mut [Detected],
    ) {
        let mut unsettled = Vec::new();
        for &PlacedBurst { first, burst, .. } in bursts {
            match judge.lanes_for(burst) {
                Some(lanes) => {
                    self.side_by_side(judge, lanes, (burst, first), statistic, &mut unsettled);
                }
                None => {
                    let rows = 0..burst.channels as usize;
                    unsettled.extend(rows.map(|row| WaitingSignal { at: first + row, burst, row }));
                }
            }
        }
        let looked_at = self.first_look(judge, detector, &unsettled, statistic);
        self.second_look(judge, detector, looked_at, statistic);
    }

    /// Judges a burst's signals straight from the burst's samples. `first`: where in the batch its first signal
    /// stands; `unsettled` gets the signals that wait for f64.
    fn side_by_side<'a>(
        &mut self,
        judge: &Judge,
        lanes: &LaneSensitivity,
        (burst, first): (&'a Burst, usize),
        statistic: &mut [Detected],
        unsettled: &mut Vec<WaitingSignal<'a>>,
    ) {
        let condition = self.condition.of(judge, lanes, burst, self.deviations.rails);
        let products = &mut self.along;
        let channels = burst.channels as usize;
        for from in (0..channels).step_by(LANES) {
            let rows = from..(from + LANES).min(channels);
            let of_burst = (burst, rows.clone());
            lanes.columns.project(of_burst, &condition.expected, products, &mut self.room);
            let judged = lanes.judge(condition, products, rows.len());
            for (lane, row) in rows.enumerate() {
                let at = first + row;
                match judged.settled[lane] {
                    true => {
                        let (ring, unexplained) =
                            (judged.statistic[lane], judged.unexplained[lane]);
                        statistic[at] = Ok(Detection { ring, unexplained });
                    }
                    false => unsettled.push(WaitingSignal { at, burst, row }),
                }
            }
        }
    }

    /// The statistics to first order. Returned are the signals for which they do not decide.
    fn first_look<'a>(
        &mut self,
        judge: &Judge,
        detector: &SensitivityDetector,
        unsettled: &[WaitingSignal<'a>],
        statistic: &mut [Detected],
    ) -> Vec<LookedAt<'a>> {
        let mut looked_at = Vec::new();
        for &signal in unsettled {
            let WaitingSignal { at, burst, row } = signal;
            let deviation = self.deviations.usable(judge, burst, row);
            let look = deviation.map(|y| detector.first_look(y, judge.drive(burst)));
            statistic[at] = look.and_then(|look| finite(look.detection()));
            if let Some(look) = look.ok().filter(|look| look.asks().is_some()) {
                looked_at.push(LookedAt { signal, look, held: None });
            }
        }
        looked_at
    }

    /// Fits rings with the phase held, for the distance along the ring; and where the first look asks for it once
    /// more with the phase free, for the misfit beside the ring.
    fn second_look(
        &mut self,
        judge: &Judge,
        detector: &SensitivityDetector,
        mut looked_at: Vec<LookedAt>,
        statistic: &mut [Detected],
    ) {
        // rings are fitted to signals corrected to the reference drive and temperature
        let copy = |WaitingSignal { burst, row, .. }: WaitingSignal, y: &mut [f64]| {
            burst.copy_signal(row, y);
            judge.take_off(burst, row, y);
            judge.at_reference(y, judge.drive(burst), judge.warmer(burst));
        };

        let starts: Vec<_> = looked_at.iter().map(|of| of.look.asks()).collect();
        let signal = |i: usize, y: &mut [f64]| copy(looked_at[i].signal, y);
        let held = detector.fitter().fit_all(false, &mut self.products, &starts, signal);
        looked_at.iter_mut().zip(held).for_each(|(of, held)| of.held = held);

        let (beside, decided): (Vec<_>, Vec<_>) =
            looked_at.into_iter().partition(|of| of.look.asks_beside());
        for LookedAt { signal, look, held } in decided {
            let drive = judge.drive(signal.burst);
            statistic[signal.at] = finite(detector.second_look(&look, held.as_ref(), None, drive));
        }

        // the second fit starts from the first
        let starts: Vec<_> = beside.iter().map(|of| Some(of.look.near(of.held.as_ref()))).collect();
        let signal = |i: usize, y: &mut [f64]| copy(beside[i].signal, y);
        let free = detector.fitter().fit_all(true, &mut self.products, &starts, signal);
        for (LookedAt { signal, look, held }, free) in beside.into_iter().zip(free) {
            let y = &mut self.deviations.signal;
            y.resize(signal.burst.samples_per_channel as usize, 0.0);
            copy(signal, y);
            let free = free.as_ref().map(|fit| (y.as_slice(), fit));
            let drive = judge.drive(signal.burst);
            statistic[signal.at] = finite(detector.second_look(&look, held.as_ref(), free, drive));
        }
    }

    /// Features of a burst's signals (ln amplitude, ln damping, ln frequency, phase, from the judge's ring) to
    /// second order, row by row; empty where the judge has no detector. For a signal
    /// that cannot be judged the values mean nothing.
    pub fn features(&mut self, judge: &Judge, burst: &Burst, features: &mut Vec<Vector4<f64>>) {
        features.clear();
        let Some(detector) = judge.detector() else { return };
        let drive = judge.drive(burst);
        if let Some(lanes) = judge.lanes_for(burst) {
            let columns = detector.own_columns();
            let condition = self.condition.of(judge, lanes, burst, self.deviations.rails);
            let products = &mut self.features;
            while features.len() < burst.channels as usize {
                let rows = features.len()..(features.len() + LANES).min(burst.channels as usize);
                let of_burst = (burst, rows.clone());
                columns.project(of_burst, &condition.expected, products, &mut self.room);
                let of_lane = |l: usize| -> Vector4<f64> {
                    let of = products.products.each_ref().map(|of| of[l] / condition.drive);
                    detector.straightened(Vector4::from(of.map(f64::from)), drive)
                };
                features.extend((0..rows.len()).map(of_lane));
            }
        }

        // one by one where there are no lanes, and where f32 overflowed
        features.resize(burst.channels as usize, Vector4::repeat(f64::NAN));
        for (row, features) in features.iter_mut().enumerate() {
            if features.iter().all(|x| x.is_finite()) {
                continue;
            }
            *features = match self.deviations.usable(judge, burst, row) {
                Ok(deviation) => detector.own_features(deviation, drive),
                Err(_) => Vector4::zeros(),
            };
        }
    }

    /// The squared distance of a signal from its channel's own level, by a fit. `metric`: the inverse
    /// covariance; `features`: where the fit starts. `None`: the signal is no ring, or cannot be judged.
    pub fn own_distance(
        &mut self,
        (judge, burst, row): (&Judge, &Burst, usize),
        metric: &Matrix3<f64>,
        (features, baseline): (&Vector4<f64>, &OwnBaseline),
    ) -> Option<f64> {
        let deviation = self.deviations.usable(judge, burst, row).ok()?;
        let signal = (deviation, judge.drive(burst));
        judge.detector()?.own_distance(metric, (features, baseline), signal, &mut self.own)
    }
}

impl LastCondition {
    /// The condition at a burst's drive and temperature; a new one, whose expected signal takes time to make,
    /// only if that differs from the last one's.
    fn of(
        &mut self,
        judge: &Judge,
        lanes: &LaneSensitivity,
        burst: &Burst,
        rails: [f64; 2],
    ) -> &Condition {
        let (drive, warmer) = (judge.drive(burst), judge.warmer(burst));
        let last = self.0.take().filter(|(of, last)| {
            // the condition is kept in f32, so it is compared in f32
            let same = |p: f32, q: f64| p.to_bits() == (q as f32).to_bits();
            *of == judge.key() && same(last.drive, drive) && same(last.warmer, warmer)
        });
        let new = || (judge.key(), lanes.condition(drive, warmer, judge.model.limits(), rails));
        &self.0.insert(last.unwrap_or_else(new)).1
    }
}

/// Rejects a first statistic that is not finite, as absurd covariates give: that is not healthy.
pub fn finite(found: Detection) -> Detected {
    if found.ring.is_finite() { Ok(found) } else { Err(Reason::NonFinite) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use inkling_core::burst::{Format, Layout};
    use inkling_core::design::{Design, OwnBaseline, Workspace};
    use inkling_core::model::ring_fit::Features;
    use inkling_io::design_file;
    use nalgebra::{DVector, Matrix3};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};
    use std::path::Path;
    use std::sync::Arc;

    fn design() -> Design {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("sample_logs/design.json");
        design_file::read(&path).unwrap().0
    }

    /// By the pooled model.
    fn judge(design: &Design, reference_v: Option<f64>) -> Judge {
        let model = Arc::new(design.pooled.clone());
        Judge::new(0, model, reference_v, Some(design), &Default::default()).unwrap()
    }

    /// A sample within the range of f32 may have inner products beyond it: features are then those of f64.
    #[test]
    fn features_beyond_f32_are_those_of_f64() {
        let design = design();
        let reference_v = design.drive_voltage_v;
        let judge = judge(&design, reference_v);
        let usual: Vec<f32> = design.pooled.expected.iter().map(|y| y.round() as f32).collect();
        let mut huge = usual.clone();
        huge[5] = 9e37;
        for layout in [Layout::ChannelMajor, Layout::SampleMajor] {
            let signals = [usual.clone(), huge.clone()];
            let mut burst = Burst::of(&signals, design.sample_period_s, Format::F32Le, layout);
            burst.drive_voltage_v = reference_v.map(|v| 1e-30 * v);
            let mut distances = Distances::new([-1e39, 1e39]);
            let mut features = Vec::new();
            distances.features(&judge, &burst, &mut features);
            let deviation = distances.deviations.usable(&judge, &burst, 1).unwrap();
            let want = judge.detector().unwrap().own_features(deviation, judge.drive(&burst));
            assert!(want.iter().any(|x| x.abs() > f64::from(f32::MAX)), "f32 would do: {want}");
            assert_eq!(features[1], want);
        }
    }

    /// A channel that rings elsewhere than the model is found where it rings, whether a fit is asked
    /// for or not. By the first order alone it would be found elsewhere, each time that noise
    /// decides which of the two tells.
    #[test]
    fn features_are_a_rings_own_however_far_it_lies_from_the_model() {
        let judge = judge(&design(), None);
        let detector = judge.detector().unwrap();
        let ring = |at: &Features| detector.fitter().tangent(at).column(0).into_owned();
        let mut work = Workspace::default();
        for (ln_frequency, ln_damping) in [(0.012, 0.03), (-0.012, 0.03), (0.008, -0.05)] {
            let at = Features { ln_amplitude: -0.03, ln_damping, ln_frequency, phase_rad: 0.02 };
            let deviation = ring(&at) - ring(&Features::HEALTHY);
            let truth = at.coordinates();
            let first = detector.fitter().features_of(deviation.as_slice()).unwrap();
            let off = |of: Vector4<f64>| (of - truth).amax();
            let (first, second) =
                (off(first), off(detector.own_features(deviation.as_slice(), 1.0)));
            assert!(second < 0.25 * first, "{at:?}: first order {first}, second {second}");
            // upside down it is no such ring, though a ring whose phase is held would fit it
            let turned = ring(&at) * -1.0 - ring(&Features::HEALTHY);
            let own = OwnBaseline { baseline: truth, ..OwnBaseline::default() };
            let distance = |of: &DVector<f64>| {
                let (metric, deviation) = (Matrix3::identity(), (of.as_slice(), 1.0));
                detector.own_distance(&metric, (&truth, &own), deviation, &mut Default::default())
            };
            assert!(distance(&deviation).is_some_and(|d| d < 1e-6));
            assert_eq!(distance(&turned), None);
            let features =
                judge.features(deviation.as_slice(), (1.0, 0.0), true, &mut work).unwrap();
            assert!(off(features + judge.healthy_mean().unwrap()) <= second + 1e-6);
            // if also all that is beside the ring is upside down, the wiring is
            // inverted: the same ring, half a turn on
            let expected = DVector::from_column_slice(&judge.model.expected);
            let inverted = &deviation * -1.0 - expected * 2.0;
            let found = judge.features(inverted.as_slice(), (1.0, 0.0), true, &mut work).unwrap();
            let half_a_turn = Vector4::new(0.0, 0.0, 0.0, std::f64::consts::PI);
            assert!((found - features - half_a_turn).amax() < 1e-9, "{found} {features}");
        }
    }

    /// Where a cable is out, a fit finds a ring in what noise is left; that says nothing of where the channel lies. So
    /// it does at another temperature than the model's, where the correction takes off what no ring has put there. A
    /// signal of zeros is neither upright nor upside down.
    #[test]
    fn noise_alone_is_no_ring() {
        let mut design = design();
        let fitter = judge(&design, None).detector().unwrap().fitter().clone();
        let per_k = Vector4::new(0.0, -0.02, 0.002, 0.0);
        let response = fitter.tangent(&Features::HEALTHY) * per_k;
        design.pooled.temperature_response = Some(response.as_slice().to_vec());
        (design.pooled.damping_per_k, design.pooled.frequency_per_k) = (per_k[1], per_k[2]);
        let judge = judge(&design, None);

        let mut rng = ChaCha8Rng::seed_from_u64(3);
        for (i, warmer) in [-12.0, 0.0, 12.0].repeat(60).into_iter().enumerate() {
            let warmer = warmer + 0.013 * i as f64;
            let expected = DVector::from_column_slice(&judge.model.expected) + &response * warmer;
            let noise = expected.map(|_| -> f64 {
                let z: f64 = StandardNormal.sample(&mut rng);
                judge.model.noise * z
            });
            let found = |signal: DVector<f64>| {
                let deviation = signal - &expected;
                judge.features(deviation.as_slice(), (1.0, warmer), true, &mut Workspace::default())
            };
            assert_eq!(found(noise.clone()), None, "{warmer} K");
            assert_eq!(found(&noise * 0.0), None, "{warmer} K");
            assert!(found(noise + &expected).is_some(), "{warmer} K");
        }
    }

    #[test]
    fn a_fault_is_over_for_a_signal_that_lies_where_its_channel_was_healthy() {
        let judge = judge(&design(), None);
        let detector = judge.detector().unwrap();
        let metric = Matrix3::from_diagonal_element(1e4); // standard deviations of a hundredth
        let at = |ln_frequency: f64| Vector4::new(0.0, 0.0, ln_frequency, 0.0);
        let own = |fault| OwnBaseline { off: 2.0, fault, ..OwnBaseline::default() };
        let is_over =
            |of: f64, fault: Option<f64>| detector.is_over(&metric, &at(of), &own(fault.map(at)));
        // a slow fault, at two standard deviations: a signal of it may look healthy
        assert!(!is_over(0.0, Some(0.02)) && !is_over(0.02, Some(0.02)));
        assert!(is_over(0.0, Some(-0.1)) && !is_over(-0.1, Some(-0.1)));
        assert!(!is_over(0.0, None), "nobody knows where its fault is");
    }

    /// What lies beside a healthy ring moves with its ink, too, so the misfit of a warmer head grows in all
    /// of its channels. Channels are looked at up to the misfit that the second test calls healthy; beyond, a
    /// signal says nothing of where its head is.
    #[test]
    fn a_ring_far_off_is_looked_at_up_to_the_misfit_of_healthy_signals() {
        let design = design();
        let misfit = design.pooled.misfit.clone().unwrap();
        let judge = judge(&design, None);
        let fitter = judge.detector().unwrap().fitter();
        let ring = |at: &Features| fitter.tangent(at).column(0).into_owned();
        let at = Features { ln_damping: 0.12, ln_frequency: 0.018, ..Features::HEALTHY };
        let moved = ring(&at) - ring(&Features::HEALTHY);
        let found = |square: f64| {
            let each = (square / moved.len() as f64).sqrt();
            let beside = |i: usize, y: &f64| if i.is_multiple_of(2) { y + each } else { y - each };
            let deviation: Vec<f64> = moved.iter().enumerate().map(|(i, y)| beside(i, y)).collect();
            judge.features(&deviation, (1.0, 0.0), true, &mut Workspace::default())
        };
        let (settled, healthy) = (misfit.settled_square(), misfit.healthy_square());
        assert!(healthy > 1.2 * settled, "{settled} {healthy}");
        let off = found(0.5 * (settled + healthy)).unwrap() + judge.healthy_mean().unwrap()
            - at.coordinates();
        assert!(off.amax() < 0.01, "{off}");
        assert_eq!(found(2.0 * healthy), None);
    }
}
