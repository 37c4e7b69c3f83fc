//! What the numbers of `tuned.rs` are worth on looks that the sequential test does not assume: heavy
//! tails, levels that wander, classes that are not certain. Healthy channels are played to `Evidence`,
//! classes to `ClassFilter`, flags to `Flags`, each by itself.
//!
//! The table of `docs/design/numbers.md` has what half and twice of each number did here.

use super::classes::ClassFilter;
use super::evidence::{Evidence, Step};
use super::intermittent::Flags;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, StudentT};

/// ln likelihood ratio at which a fault is raised, by default.
const BOUND: f32 = 16.1;
/// Share of healthy looks that are flagged.
const RATE: f64 = 7e-4;

/// Draws looks at one channel: three features of Student's t, one of which wanders and lies off for
/// good.
struct Looks {
    rng: ChaCha8Rng,
    law: StudentT<f64>,
    /// How far the channel lies off for good, in standard deviations of a feature or nearly so.
    off: f64,
    wander: f64,
}

impl Looks {
    fn new(seed: u64) -> Looks {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let off = rng.random_range(-1.2..1.2);
        Looks { rng, law: StudentT::new(10.0).unwrap(), off, wander: 0.0 }
    }

    /// The square distance of three features from zero.
    fn statistic(&mut self) -> f64 {
        let step: f64 = StandardNormal.sample(&mut self.rng);
        self.wander = 0.98 * self.wander + 0.08 * step;
        let mut feature = |off: f64| (off + self.law.sample(&mut self.rng)).powi(2);
        feature(self.off + self.wander) + feature(0.0) + feature(0.0)
    }
}

fn threshold() -> f64 {
    let of = |channel: u64| {
        let mut looks = Looks::new(10_000 + channel);
        (0..200).map(|_| looks.statistic()).collect::<Vec<f64>>()
    };
    let mut all: Vec<f64> = (0..1000).flat_map(of).collect();
    all.sort_unstable_by(f64::total_cmp);
    all[((1.0 - RATE) * all.len() as f64) as usize]
}

/// Number of episodes of healthy channels in a million looks; each channel's model changes once.
fn false_episodes(threshold: f64) -> f64 {
    let raised = |channel: u64| {
        let (mut looks, mut evidence) = (Looks::new(50_000 + channel), Evidence::default());
        (0..500).any(|k| {
            if k == 250 {
                evidence.change_model(1.0);
                looks.off += 0.5;
            }
            let ratio = (looks.statistic() / threshold) as f32;
            evidence.look(ratio, BOUND) == Step::Raised
        })
    };
    (0..2000).filter(|channel| raised(*channel)).count() as f64
}

/// Of the later looks at faults, the share of those that say another class than is true.
fn wrong_classes() -> f64 {
    const FAULTS: u64 = 300;
    let mut wrong = 0.0;
    for fault in 0..FAULTS {
        let mut rng = ChaCha8Rng::seed_from_u64(fault);
        let priors = [0.3, 0.3, 0.3];
        let mut filter = ClassFilter::new(&priors);
        // what the looks of one channel share: its own deviation
        let own: [f64; 3] = std::array::from_fn(|_| StandardNormal.sample(&mut rng));
        for k in 0..30 {
            let mut weights: [f64; 3] = std::array::from_fn(|class| {
                let drawn: f64 = StandardNormal.sample(&mut rng);
                let by = if class == 0 { 1.5 } else { 0.0 };
                (by + 0.7 * own[class] + drawn).exp()
            });
            let sum: f64 = weights.iter().sum();
            weights.iter_mut().for_each(|w| *w *= 0.98 / sum);
            if k % 15 == 9 {
                weights = [1e-6, 1e-6, 0.98]; // a look may be sure, and wrong
            }
            filter.look(&weights.map(|w| w as f32), &priors);
            let best = (0..3).max_by(|&a, &b| filter.weights[a].total_cmp(&filter.weights[b]));
            wrong += f64::from(u8::from(k >= 10 && best != Some(0)));
        }
    }
    wrong / (20 * FAULTS) as f64
}

/// Of channels that are flagged in twelve of a thousand looks, the share that was raised within two
/// thousand looks; and of healthy ones that are flagged at three times the stated rate, the share
/// within ten thousand.
fn comes_and_goes() -> [f64; 2] {
    let told = |rate: f64, looks: u32, channel: u64| {
        let mut rng = ChaCha8Rng::seed_from_u64(channel);
        let mut flags = Flags::default();
        let all = Flags { looks: 600_000, flagged: (RATE * 600_000.0) as u64 };
        (0..looks).any(|_| {
            let is_flagged = rng.random_bool(rate);
            if is_flagged && flags.begin_anew(all) {
                flags = Flags::default();
            }
            flags.add(is_flagged);
            is_flagged && flags.evidence(all) >= f64::from(BOUND)
        })
    };
    let share = |rate: f64, looks: u32| {
        (0..200).filter(|channel| told(rate, looks, *channel)).count() as f64 / 200.0
    };
    [share(0.012, 2000), share(3.0 * RATE, 10_000)]
}

#[test]
fn looks_that_the_test_does_not_assume() {
    let false_episodes = false_episodes(threshold());
    assert!(false_episodes <= 2.0, "{false_episodes}");
    let wrong = wrong_classes();
    assert!(wrong < 0.25, "{wrong}");
    let [found, false_told] = comes_and_goes();
    assert!(found > 0.3 && false_told < 0.01, "{found} {false_told}");
}
