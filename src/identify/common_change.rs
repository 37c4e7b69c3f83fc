//! What moves all channels of a printhead alike: ink whose temperature nobody recorded, a supply that sags,
//! another ink. A fault does not.
//!
//! In: burst by burst, features of some channels' rings (ln amplitude, ln damping, ln frequency), all
//! against one ring. Out: how far all of them have moved since the model was learned. It must not move
//! with what fewer than two in five of the channels do.

use nalgebra::Vector3;
use std::collections::BTreeMap;

/// Channels that tell: fewer do not outvote faulty ones.
const FEWEST: usize = 8;
/// Channels of a printhead that are looked at.
pub const MOST: u32 = 32;
/// A channel that was not looked at for so long says nothing of now, ns.
const HORIZON_NS: u64 = 10_000_000_000;
/// Least share of a new estimate in the level: where it stands still, an estimate's noise falls to .4.
const LEAST_GAIN: f64 = 0.3;
/// Share of the newest in what is known of how far estimates lie off the level.
const MEMORY: f64 = 0.1;
/// Estimates whose mean is where the level began, where no window says it; in a window at least so many.
const FIRST: u32 = 16;
const FEWEST_FIRST: u32 = 4;
/// So many healthy standard deviations from a model that was learned elsewhere, a printhead is another one.
const ELSEWHERE: f64 = 1.0;
/// Share of the channels that must lie as close together as healthy ones do.
const LEAST_ALIKE: f64 = 0.4;

/// A channel's features when it was last looked at.
#[derive(Clone, Copy, Debug)]
struct Look {
    t_ns: i64,
    features: Vector3<f64>,
}

/// Of one printhead.
#[derive(Clone, Debug)]
pub struct CommonChange {
    /// End of the window that the model was learned from; `None`: it was learned elsewhere.
    window_to_ns: Option<i64>,
    /// Standard deviations of healthy features, noise included.
    healthy: Vector3<f64>,
    /// So far the level may step at once, and lie from the model from the first burst on.
    step: Vector3<f64>,
    looks: BTreeMap<u32, Look>,
    /// Looks since the last estimate.
    fresh: usize,
    level: Option<Vector3<f64>>,
    /// Mean square of how far estimates lie off the level before them.
    off: Vector3<f64>,
    first: Vector3<f64>,
    estimates: u32,
}

impl CommonChange {
    pub fn new(
        window_to_ns: Option<i64>,
        healthy: Vector3<f64>,
        step: Vector3<f64>,
    ) -> CommonChange {
        CommonChange {
            window_to_ns,
            healthy,
            step,
            looks: BTreeMap::new(),
            fresh: 0,
            level: None,
            off: Vector3::zeros(),
            first: Vector3::zeros(),
            estimates: 0,
        }
    }

    /// The next look at a channel.
    pub fn look(&mut self, t_ns: i64, channel: u32, features: Vector3<f64>) {
        self.looks.insert(channel, Look { t_ns, features });
        self.fresh += 1;
    }

    /// After the looks of a burst: how far the channels have moved alike since the model was learned.
    /// `None`: not known, or not yet.
    pub fn change(&mut self, t_ns: i64) -> Option<Vector3<f64>> {
        if 2 * self.fresh >= self.looks.len().max(FEWEST) {
            self.looks.retain(|_, look| t_ns.abs_diff(look.t_ns) <= HORIZON_NS);
            self.fresh = 0;
            if let Some(estimate) = self.estimate() {
                self.take(t_ns, estimate);
            }
        }
        let known = self.estimates > 0 && !self.is_learning(t_ns);
        self.level.filter(|_| known).map(|level| level - self.origin())
    }

    /// Standard deviations of healthy features, noise included.
    pub fn healthy(&self) -> Vector3<f64> {
        self.healthy
    }

    /// Where the level began: what is looked at is not all that the model was learned from.
    fn origin(&self) -> Vector3<f64> {
        let first = self.first / f64::from(self.estimates.max(1));
        let lies_elsewhere = first.component_div(&self.healthy).norm() > ELSEWHERE
            && (0..3).all(|k| first[k].abs() <= self.step[k]);
        match self.window_to_ns {
            None if lies_elsewhere => Vector3::zeros(),
            _ => first,
        }
    }

    /// Where the level began is still being learned.
    fn is_learning(&self, t_ns: i64) -> bool {
        match self.window_to_ns {
            Some(to) => t_ns < to || self.estimates < FEWEST_FIRST,
            None => self.estimates < FIRST,
        }
    }

    fn take(&mut self, t_ns: i64, estimate: [Location; 3]) {
        let now = Vector3::from(estimate.map(|of| of.middle));
        let too_far =
            |level: Vector3<f64>| (0..3).any(|k| (now[k] - level[k]).abs() > self.step[k]);
        if self.level.is_some_and(too_far) {
            return; // no ink does that from one burst to the next
        }
        let noise = Vector3::from(estimate.map(|of| of.middle_sd().powi(2)));
        let level = match self.level {
            None => {
                self.off = noise;
                now
            }
            Some(level) => Vector3::from_fn(|k, _| {
                let off = now[k] - level[k];
                self.off[k] += MEMORY * (off * off - self.off[k]);
                // of estimates that lie further off than their noise the level has moved
                let gain = (1.0 - 1.5 * noise[k] / self.off[k]).max(LEAST_GAIN);
                level[k] + gain * off
            }),
        };
        if self.is_learning(t_ns) {
            self.first += now;
            self.estimates += 1;
        }
        self.level = Some(level);
    }

    fn estimate(&self) -> Option<[Location; 3]> {
        if self.looks.len() < FEWEST {
            return None;
        }
        let along = |k: usize| {
            let values = self.looks.values().map(|look| look.features[k]).collect();
            Location::of(values, self.healthy[k])
        };
        let found = [along(0), along(1), along(2)];
        let alike = found.iter().all(|of| of.weight >= LEAST_ALIKE * self.looks.len() as f64);
        alike.then_some(found)
    }
}

/// Where most of some numbers lie.
#[derive(Clone, Copy, Debug)]
struct Location {
    middle: f64,
    /// Of one number about it.
    sd: f64,
    /// What counts, in whole numbers.
    weight: f64,
}

impl Location {
    /// Tukey's M-estimate from the middle of the shortest half on: it redescends, so that what lies far off
    /// counts for nothing, and moves smoothly with every number (Maronna, Martin, Yohai 2006, section
    /// 2.2). `sd`: of healthy numbers. At least one number.
    fn of(mut values: Vec<f64>, sd: f64) -> Location {
        /// In standard deviations, what counts for nothing: nine tenths of a mean's efficiency for a
        /// Gaussian.
        const FAR: f64 = 4.0;
        const STEPS: usize = 12;
        values.sort_unstable_by(f64::total_cmp);
        let n = values.len();
        let half = n.div_ceil(2);
        let length = |from: usize| values[from + half - 1] - values[from];
        let from = (0..=n - half).min_by(|&p, &q| length(p).total_cmp(&length(q))).unwrap_or(0);
        let mut middle = 0.5 * (values[from] + values[from + half - 1]);
        let far = FAR * sd;
        let weight_at = |v: f64, middle: f64| (1.0 - ((v - middle) / far).powi(2)).max(0.0).powi(2);
        for _ in 0..STEPS {
            let (mut sum, mut weight) = (0.0, 0.0);
            for &v in &values {
                let w = weight_at(v, middle);
                (sum, weight) = (sum + w * v, weight + w);
            }
            if weight <= 0.0 {
                break;
            }
            middle = sum / weight;
        }
        let weights: Vec<f64> = values.iter().map(|&v| weight_at(v, middle)).collect();
        let weight = weights.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let square =
            values.iter().zip(&weights).map(|(v, w)| w * (v - middle).powi(2)).sum::<f64>();
        Location { middle, sd: (square / weight).sqrt(), weight }
    }

    fn middle_sd(&self) -> f64 {
        self.sd / self.weight.max(1.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const SD: [f64; 3] = [0.05, 0.03, 0.002];
    const STEP: [f64; 3] = [0.1, 0.12, 0.01];
    const CHANNELS: u32 = 32;
    const EVERY_NS: i64 = 100_000_000;

    fn normal(rng: &mut ChaCha8Rng) -> f64 {
        StandardNormal.sample(rng)
    }

    /// A head whose channels differ for good by most of the healthy spread.
    struct Head {
        lasting: Vec<Vector3<f64>>,
        rng: ChaCha8Rng,
    }

    impl Head {
        fn new(seed: u64) -> Head {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let lasting = (0..CHANNELS)
                .map(|_| Vector3::from_fn(|k, _| 0.9 * SD[k] * normal(&mut rng)))
                .collect();
            Head { lasting, rng }
        }

        /// Changes that are found, burst by burst. `of`: what is added to a channel's features.
        fn run(
            &mut self,
            window_to_ns: Option<i64>,
            bursts: i64,
            of: impl Fn(i64, u32) -> [f64; 3],
        ) -> Vec<Option<Vector3<f64>>> {
            let mut change = CommonChange::new(window_to_ns, SD.into(), STEP.into());
            (0..bursts)
                .map(|b| {
                    for channel in 0..CHANNELS {
                        let noise = Vector3::from_fn(|k, _| 0.4 * SD[k] * normal(&mut self.rng));
                        let added = Vector3::from(of(b, channel));
                        let features = self.lasting[channel as usize] + noise + added;
                        change.look(b * EVERY_NS, channel, features);
                    }
                    change.change(b * EVERY_NS)
                })
                .collect()
        }
    }

    #[test]
    fn a_head_that_stands_still_hardly_moves_and_a_drift_is_followed_at_once() {
        for seed in 0..6 {
            let window = (seed % 2 == 0).then_some(20 * EVERY_NS);
            let still = Head::new(seed).run(window, 2000, |_, _| [0.0; 3]);
            let most =
                |k: usize| still.iter().flatten().map(|c| (c[k] / SD[k]).abs()).fold(0.0, f64::max);
            assert!((0..3).all(|k| most(k) < 0.25), "{} {} {}", most(0), most(1), most(2));
            // eight per cent of damping, to and fro within 200 s
            let swing = |b: i64| 0.08 * (std::f64::consts::TAU * (b - 20) as f64 / 2000.0).sin();
            let moved = Head::new(seed).run(window, 2000, |b, _| [0.0, swing(b.max(20)), 0.0]);
            for (b, found) in moved.iter().enumerate().skip(20) {
                let off = found.unwrap()[1] - swing(b as i64);
                assert!(off.abs() < 0.4 * SD[1], "{off} in burst {b}");
            }
            let sag = |b: i64| 1.4 * SD[0] * (std::f64::consts::TAU * b as f64 / 90.0).sin();
            let sagging = Head::new(seed).run(None, 600, |b, _| [sag(b - 20), 0.0, 0.0]);
            let origin = sagging[20].unwrap()[0] - sag(0);
            for (b, found) in sagging.iter().enumerate().skip(20) {
                let off = found.unwrap()[0] - sag(b as i64 - 20) - origin;
                assert!(off.abs() < 0.5 * SD[0], "{off} in burst {b}");
            }
            let step = |b: i64| if b < 500 { 0.0 } else { 0.1 };
            let stepped = Head::new(seed).run(window, 600, |b, _| [0.0, step(b), 0.0]);
            assert!((stepped[500].unwrap()[1] - 0.1).abs() < 0.4 * SD[1]);
            // a burst of faults alone
            let leapt = Head::new(seed).run(window, 600, |b, _| [0.0, 3.0 * step(b), 0.0]);
            assert!(leapt[599].unwrap()[1].abs() < 0.4 * SD[1]);
        }
    }

    #[test]
    fn two_in_five_faulty_channels_and_one_slow_fault_move_nothing() {
        let sudden = |b: i64, channel: u32| {
            if b >= 100 && channel < 12 { [0.3, 0.6, -0.05] } else { [0.0; 3] }
        };
        let found = Head::new(11).run(Some(20 * EVERY_NS), 300, sudden);
        let most = found.iter().flatten().map(|c| (c[1] / SD[1]).abs()).fold(0.0, f64::max);
        assert!(most < 0.5, "{most}");
        let slow = |b: i64, channel: u32| {
            if channel == 5 { [0.0, 0.3 * b as f64 / 2000.0, 0.0] } else { [0.0; 3] }
        };
        let found = Head::new(12).run(Some(20 * EVERY_NS), 2000, slow);
        let most = found.iter().flatten().map(|c| (c[1] / SD[1]).abs()).fold(0.0, f64::max);
        assert!(most < 0.3, "{most}");
    }

    #[test]
    fn channels_that_share_nothing_and_channels_that_are_few_have_no_common_change() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let any: Vec<[f64; 3]> =
            (0..CHANNELS).map(|_| [0.0; 3].map(|_: f64| rng.random_range(-1.0..1.0))).collect();
        let found = Head::new(5).run(None, 100, |_, channel| any[channel as usize]);
        assert!(found.iter().all(Option::is_none));
        let mut few = CommonChange::new(None, SD.into(), STEP.into());
        for b in 0..200 {
            (0..FEWEST as u32 - 1).for_each(|channel| few.look(b, channel, Vector3::zeros()));
            assert!(few.change(b).is_none());
        }
    }

    #[test]
    fn bursts_of_one_channel_are_pooled() {
        let mut head = Head::new(7);
        let mut change = CommonChange::new(None, SD.into(), STEP.into());
        let mut found = None;
        for b in 0..64 * i64::from(CHANNELS) {
            let channel = (b % i64::from(CHANNELS)) as u32;
            let moved = if b < 40 * i64::from(CHANNELS) { 0.0 } else { 0.1 };
            let noise = Vector3::from_fn(|k, _| 0.4 * SD[k] * normal(&mut head.rng));
            let features = head.lasting[channel as usize] + noise + Vector3::new(0.0, moved, 0.0);
            change.look(b * 1_000_000, channel, features);
            found = change.change(b * 1_000_000);
        }
        assert!((found.unwrap()[1] - 0.1).abs() < 0.4 * SD[1]);
    }

    #[test]
    fn location_is_the_middle_of_a_gaussian_as_well_as_a_mean_nearly() {
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        let (mut square, mut sd) = (0.0, 0.0);
        for _ in 0..2000 {
            let found = Location::of((0..32).map(|_| normal(&mut rng)).collect(), 1.0);
            square += found.middle.powi(2) / 2000.0;
            sd += found.sd / 2000.0;
        }
        // a mean's variance is 1/32
        assert!(square < 1.25 / 32.0, "{square}");
        assert!((0.7..1.05).contains(&sd), "{sd}");
        // two in five lie elsewhere: the middle stays within the healthy ones
        let (mut off, mut most) = (0.0, 0.0f64);
        for _ in 0..500 {
            let healthy = (0..60).map(|_| normal(&mut rng));
            let values = healthy.chain((0..40).map(|i| 4.0 + 0.1 * f64::from(i))).collect();
            let found = Location::of(values, 1.0).middle;
            (off, most) = (off + found / 500.0, most.max(found));
        }
        assert!(off.abs() < 0.3 && most < 1.0, "{off} {most}");
    }
}
