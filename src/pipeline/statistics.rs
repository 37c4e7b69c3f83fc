//! Computes the detection statistics of a batch's signals: of many at once by the streaming kernel, and again
//! by the reference where the kernel alone cannot settle the verdict.
//!
//! In: bursts with their judges, from the filter stage ([`Statistics::of`]). Out: for each signal its
//! detection statistics ([`Detection`]), or why it has none; for `own_levels` also features and distances.
//!
//! The bursts of a batch are taken judge by judge, and each signal goes this way:
//! 1. In f32, many signals side by side (*lanes*, one signal in each): the squared distance along the
//!    sensitivities (`along`), or the residual energy (`filter`), by the judge's method. A bound on the
//!    rounding says whether the verdict is *settled*, that is the same as in f64; nearly always it is.
//! 2. The others, and all signals where a judge has no lanes, are computed in f64 (`look_again`). With
//!    `detect.method` = `sensitivity` that is a first look, and where the first order does not decide, a second
//!    look by a fitted ring; rings are fitted side by side.
//!
//! A signal's statistics do not depend on what else is in the batch, because a lane does not know
//! its neighbours ([`inkling_core::detect::kernel`]).

use super::batches::{AssignedBatch, Detected};
use super::rings::Deviations;
use inkling_core::burst::{Acquisition, Burst};
use inkling_core::design::{Detection, Judge, JudgeKey, Lanes, OwnBaseline, Workspace};
use inkling_core::detect::kernel::{LaneFilter, LaneStatistics};
use inkling_core::detect::lane_sensitivity::{Condition, LaneSensitivity};
use inkling_core::detect::row_projection::{LANES, Projections, Room};
use inkling_core::detect::tile::Tile;
use inkling_core::model::ring_fit::{Fit, FitBuffers};
use inkling_core::verdict::Reason;
use nalgebra::{Matrix3, Vector4};

/// The buffers of one worker, for the judges of one schedule.
#[derive(Default)]
pub struct Statistics {
    /// Signals that wait to be judged by their residual energy, one in each lane.
    tile: Tile,
    condition: LastCondition,
    /// Projections of signals onto the sensitivities (of amplitude, damping, frequency).
    along: Projections<3>,
    /// Projections that give the features, the phase free.
    features: Projections<4>,
    room: Room,
    deviations: Deviations,
    work: Workspace,
    own: Vec<f64>,
    products: FitBuffers,
}

#[derive(Clone, Copy)]
struct WaitingSignal<'a> {
    at: usize,
    burst: &'a Burst,
    row: usize,
}

/// The condition (judge, drive, temperature) of the burst before, which consecutive bursts mostly share.
#[derive(Default)]
struct LastCondition(Option<(JudgeKey, Condition)>);

struct PlacedBurst<'a> {
    judge: &'a Judge,
    first: usize,
    burst: &'a Burst,
}

impl Statistics {
    pub fn new(rails: [f64; 2]) -> Statistics {
        Statistics { deviations: Deviations::new(rails), ..Statistics::default() }
    }

    /// Computes the statistics of a batch into `statistic`: one entry per signal, in the batch's order.
    pub fn of(&mut self, batch: &AssignedBatch, statistic: &mut Vec<Detected>) {
        statistic.clear();
        statistic.reserve(batch.read.batch.rows());
        let mut bursts = Vec::with_capacity(batch.judges.len());

        for (signals, acquisition, of) in batch.placed() {
            let fill = match (acquisition, &of.judge) {
                (Acquisition::Usable(burst), Ok(judge)) => {
                    bursts.push(PlacedBurst { judge, first: signals.start, burst });
                    Ok(Detection { ring: f64::NAN, unexplained: f64::NAN })
                }
                (_, Err(reason)) => Err(*reason),
                (Acquisition::Unusable(unusable), Ok(_)) => Err(unusable.why),
            };
            statistic.resize(signals.end, fill);
        }

        // one judge after the other, so that lanes are full even if short bursts of several judges alternate
        bursts.sort_by_key(|of| (of.judge.key(), of.first));
        for of_judge in bursts.chunk_by(|p, q| p.judge.key() == q.judge.key()) {
            self.of_judge(of_judge[0].judge, of_judge, statistic);
        }
    }

    fn of_judge(&mut self, judge: &Judge, bursts: &[PlacedBurst], statistic: &mut [Detected]) {
        let mut unsettled: Vec<WaitingSignal> = Vec::new();
        let mut signals = Vec::with_capacity(LANES);
        for &PlacedBurst { first, burst, .. } in bursts {
            let waiting = |row: usize| WaitingSignal { at: first + row, burst, row };
            let rows = 0..burst.channels as usize;
            let lanes = judge.lanes.as_ref();
            match lanes.filter(|of| of.samples() == burst.samples_per_channel as usize) {
                None => unsettled.extend(rows.map(waiting)),
                Some(Lanes::Sensitivity(lanes)) => {
                    self.along(judge, lanes, (burst, waiting), statistic, &mut unsettled);
                }
                // the signals of several bursts share a tile; it is judged whenever it is full
                Some(Lanes::ResidualEnergy(lanes)) => {
                    let (drive, warmer) = (judge.drive(burst), judge.warmer(burst));
                    let mut rows = rows;
                    while !rows.is_empty() {
                        let pushed = self.tile.push(burst, rows.clone(), drive, warmer);
                        signals.extend(rows.by_ref().take(pushed).map(waiting));
                        if self.tile.is_full() {
                            self.filter(judge, lanes, &mut signals, statistic, &mut unsettled);
                        }
                    }
                }
            }
        }

        // what is left in a tile that did not become full; then what the lanes did not settle
        if let Some(Lanes::ResidualEnergy(lanes)) = &judge.lanes {
            self.filter(judge, lanes, &mut signals, statistic, &mut unsettled);
        }
        self.look_again(judge, unsettled, statistic);
    }

    /// With the method `sensitivity` there are up to three steps, each for the signals for which the one
    /// before asks for more: a first look, to first order; a fit with the phase held, for the distance along
    /// the ring; a fit with the phase free, for the misfit beside the ring.
    fn look_again(
        &mut self,
        judge: &Judge,
        mut unsettled: Vec<WaitingSignal>,
        statistic: &mut [Detected],
    ) {
        let Some(detector) = judge.detector() else {
            for WaitingSignal { at, burst, row } in unsettled {
                let deviation = self.deviations.usable(judge, burst, row);
                statistic[at] = deviation.and_then(|deviation| {
                    finite(judge.detect(deviation, judge.drive(burst), &mut self.work))
                });
            }
            return;
        };

        // First look. `unsettled` keeps only the signals for which it asks for a fit, beside their looks.
        let mut looks = Vec::new();
        unsettled.retain(|&WaitingSignal { at, burst, row }| {
            let deviation = self.deviations.usable(judge, burst, row);
            let look = deviation.map(|y| detector.first_look(y, judge.drive(burst)));
            statistic[at] = look.and_then(|look| finite(look.detection()));
            let asks = look.ok().filter(|look| look.asks().is_some());
            looks.extend(asks);
            asks.is_some()
        });

        let mut products = std::mem::take(&mut self.products);
        // rings are fitted to signals corrected to the reference drive and temperature
        let copy = |&WaitingSignal { burst, row, .. }: &WaitingSignal, y: &mut [f64]| {
            burst.copy_signal(row, y);
            judge.take_off_extension(burst, row, y);
            judge.at_reference(y, judge.drive(burst), judge.warmer(burst));
        };

        // Second look, with the phase held: the fit decides, or the look also asks for the misfit. `beside`:
        // the signals for which it does (indices in `unsettled`), with their fits so far.
        let mut next = unsettled.iter().zip(&looks);
        let mut beside: Vec<(usize, Option<Fit>)> = Vec::new();
        detector.fitter().fit_all(
            false,
            &mut products,
            |y| {
                let (waiting, look) = next.next()?;
                copy(waiting, y);
                Some(look.asks())
            },
            |i, fit| match looks[i].asks_beside() {
                true => beside.push((i, fit)),
                false => {
                    let drive = judge.drive(unsettled[i].burst);
                    statistic[unsettled[i].at] =
                        finite(detector.second_look(&looks[i], fit.as_ref(), None, drive));
                }
            },
        );

        // for the misfit beside the ring the phase must be free: a second fit, which starts from the first
        let mut next = beside.iter();
        detector.fitter().fit_all(
            true,
            &mut products,
            |y| {
                let (i, held) = next.next()?;
                copy(&unsettled[*i], y);
                Some(Some(looks[*i].near(held.as_ref())))
            },
            |j, free| {
                let (i, held) = &beside[j];
                let (waiting, look) = (unsettled[*i], &looks[*i]);
                let signal = &mut self.deviations.signal;
                signal.resize(waiting.burst.samples_per_channel as usize, 0.0);
                copy(&waiting, signal);
                let free = free.as_ref().map(|fit| (signal.as_slice(), fit));
                let drive = judge.drive(waiting.burst);
                statistic[waiting.at] =
                    finite(detector.second_look(look, held.as_ref(), free, drive));
            },
        );
        self.products = products;
    }

    /// Judges a burst's signals by their distance along the sensitivities, straight from the burst's samples.
    /// `waiting`: makes of a row the signal that waits for f64.
    fn along<'a>(
        &mut self,
        judge: &Judge,
        lanes: &LaneSensitivity,
        (burst, waiting): (&'a Burst, impl Fn(usize) -> WaitingSignal<'a>),
        statistic: &mut [Detected],
        unsettled: &mut Vec<WaitingSignal<'a>>,
    ) {
        let condition = self.condition.of(judge, lanes, burst, self.deviations.rails);
        let products = &mut self.along;
        let channels = burst.channels as usize;
        for row in (0..channels).step_by(LANES) {
            let rows = row..(row + LANES).min(channels);
            let of_burst = (burst, rows.clone());
            lanes.columns.project(of_burst, &condition.expected, 0, products, &mut self.room);
            let judged = lanes.judge(condition, products, rows.len());
            settle(&judged, rows.map(&waiting), statistic, unsettled);
        }
    }

    /// Judges the signals that wait in the tile, lane by lane in `signals`, and empties the tile.
    fn filter<'a>(
        &mut self,
        judge: &Judge,
        lanes: &LaneFilter,
        signals: &mut Vec<WaitingSignal<'a>>,
        statistic: &mut [Detected],
        unsettled: &mut Vec<WaitingSignal<'a>>,
    ) {
        let judged =
            lanes.judge(&mut self.tile, judge.model.threshold.value, self.deviations.rails);
        settle(&judged, signals.drain(..), statistic, unsettled);
        self.tile.empty();
    }

    /// Features of a burst's signals (ln amplitude, ln damping, ln frequency, phase, from the judge's ring) to
    /// second order, row by row, with `detect.method` = `sensitivity`; empty with another method. For a signal
    /// that cannot be judged the values mean nothing.
    pub fn features(&mut self, judge: &Judge, burst: &Burst, features: &mut Vec<Vector4<f64>>) {
        features.clear();
        let Some(detector) = judge.detector() else { return };
        let (drive, n) = (judge.drive(burst), burst.samples_per_channel as usize);
        let lanes = judge.lanes.as_ref().filter(|lanes| lanes.samples() == n);

        if let Some(Lanes::Sensitivity(lanes)) = lanes {
            let columns = detector.own_columns();
            let condition = self.condition.of(judge, lanes, burst, self.deviations.rails);
            let products = &mut self.features;
            while features.len() < burst.channels as usize {
                let rows = features.len()..(features.len() + LANES).min(burst.channels as usize);
                let of_burst = (burst, rows.clone());
                columns.project(of_burst, &condition.expected, 0, products, &mut self.room);
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
        let new = || {
            let limits = Lanes::limits(&judge.model);
            (judge.key(), lanes.condition(drive, warmer, limits, rails))
        };
        &self.0.insert(last.unwrap_or_else(new)).1
    }
}

/// Takes the statistics of the lanes that are settled; the other signals wait for f64.
fn settle<'a>(
    judged: &LaneStatistics,
    signals: impl Iterator<Item = WaitingSignal<'a>>,
    statistic: &mut [Detected],
    unsettled: &mut Vec<WaitingSignal<'a>>,
) {
    for (lane, of) in signals.enumerate() {
        match judged.settled[lane] {
            true => {
                let (ring, unexplained) = (judged.statistic[lane], judged.unexplained[lane]);
                statistic[of.at] = Ok(Detection { ring, unexplained });
            }
            false => unsettled.push(of),
        }
    }
}

/// Rejects a first statistic that is not finite, as absurd covariates give: that is not healthy.
fn finite(found: Detection) -> Detected {
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
        huge[5] = 3e38;
        for layout in [Layout::ChannelMajor, Layout::SampleMajor] {
            let signals = [usual.clone(), huge.clone()];
            let mut burst = Burst::of(&signals, design.sample_period_s, Format::F32Le, layout);
            burst.drive_voltage_v = reference_v.map(|v| 1e-30 * v);
            let mut statistics = Statistics::new([-1e39, 1e39]);
            let mut features = Vec::new();
            statistics.features(&judge, &burst, &mut features);
            let deviation = statistics.deviations.usable(&judge, &burst, 1).unwrap();
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
            let features = judge.features(deviation.as_slice(), 1.0, true, &mut work).unwrap();
            assert!(off(features + judge.healthy_mean().unwrap()) <= second + 1e-6);
            // if also all that is beside the ring is upside down, the wiring is
            // inverted: the same ring, half a turn on
            let expected = DVector::from_column_slice(&judge.model.expected);
            let inverted = &deviation * -1.0 - expected * 2.0;
            let found = judge.features(inverted.as_slice(), 1.0, true, &mut work).unwrap();
            let half_a_turn = Vector4::new(0.0, 0.0, 0.0, std::f64::consts::PI);
            assert!((found - features - half_a_turn).amax() < 1e-9, "{found} {features}");
        }
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
            judge.features(&deviation, 1.0, true, &mut Workspace::default())
        };
        let (settled, healthy) = (misfit.settled_square(), misfit.healthy_square());
        assert!(healthy > 1.2 * settled, "{settled} {healthy}");
        let off = found(0.5 * (settled + healthy)).unwrap() + judge.healthy_mean().unwrap()
            - at.coordinates();
        assert!(off.amax() < 0.01, "{off}");
        assert_eq!(found(2.0 * healthy), None);
    }
}
