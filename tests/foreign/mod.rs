//! The critique on recordings of another generator: families of healthy behaviour that break what it could assume,
//! alone and with one effect in them. Nothing here knows the library's constants, nor they this.

mod effect;
mod extended;
mod healthy;
mod plant;

use crate::goals::Goals;
use crate::on_two_threads;
use crate::recorded::AS_RECORDED;
use clap::ValueEnum;
use effect::{Effect, Hidden, Place};
use healthy::{Family, Layout, Signal, normal};
use inkling::burst::{Beside, Burst};
use inkling::critique::engine::{Rings, critique};
use inkling::critique::finding::{Critique, Verdict};
use inkling::critique::observations::Sampler;
use inkling::score::blind::{CritiqueAnswer, Outcome, outcome};
use inkling::score::truth::Truth;
use plant::Plant;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::ops::Range;
use std::sync::Mutex;

/// One recording.
#[derive(Clone, Copy, Debug)]
struct Case {
    family: Family,
    hidden: Hidden,
    seed: u64,
}

const NOTHING: Hidden = Hidden { effect: Effect::Nothing, strength: 0.0 };

impl Case {
    /// What is heard, burst by burst.
    fn heard(&self) -> Heard {
        let Case { family, hidden, seed } = self;
        let mut rng = ChaCha8Rng::seed_from_u64(*seed);
        let families = Family::value_variants().len() as u64;
        let layout = family.layout(seed / families);
        let channels: Vec<_> = (0..layout.channels).map(|_| family.channel(&mut rng)).collect();
        let bursts = layout.signals.div_ceil(layout.a_burst);
        let mut signals = Vec::new();
        let warmth_phase = TAU * rng.random::<f64>();
        // of another stream, so that whoever has no neighbours draws as without them
        let mut others = ChaCha8Rng::seed_from_u64(!*seed);
        let (turn, slowness) = (others.random::<f64>(), others.random::<f64>());
        for burst in 0..bursts {
            let common = family.burst(&mut rng);
            let drive_v =
                layout.drives[0] + (layout.drives[1] - layout.drives[0]) * rng.random::<f64>();
            let progress = burst as f64 / (bursts - 1) as f64;
            let warmer_c = 2.2 * (9.0 * progress + warmth_phase).sin() + 0.5 * normal(&mut rng);
            let (trigger, phase) = (normal(&mut rng), TAU * rng.random::<f64>());
            for slot in 0..layout.a_burst {
                let number = burst * layout.a_burst + slot;
                let channel = number % layout.channels;
                let at = Place {
                    progress,
                    position: channel as f64 / (layout.channels - 1) as f64 - 0.5,
                    warmer_c,
                    idle_s: rng.random_range(35e-6..110e-6),
                    neighbours: f64::from(rng.random_range(0..4_u8)),
                    neighbour: channels[(channel + 1) % layout.channels],
                    way_s: 7.0e-6 + turn * 16.0e-6,
                    drive: drive_v / 20.0,
                    trigger,
                    phase,
                    number,
                };
                let mut signal = Signal {
                    channel: channels[channel],
                    common,
                    drive: at.drive,
                    gain: 1.0,
                    stiff: 1.0,
                    loss: 1.0,
                    clock: 1.0,
                    late_s: 0.0,
                };
                hidden.moves(&mut signal, &at, &layout);
                let nominal = Plant { rates: signal.channel.rates, terms: plant::Terms::default() };
                let terms = hidden.terms(nominal.sigma(), nominal.omega());
                let (plant, x) = family.scattered(&signal, terms, &mut rng);
                let mut y = plant.samples(x, layout.period_s, layout.samples);
                hidden.senses(&mut y, &plant, x, &at, layout.period_s);
                let [rho, growth] = hidden.noise();
                let mut before = family.noise(&mut rng);
                let mut noise = Vec::from_iter(y.iter().map(|_| family.noise(&mut rng)));
                hidden.stray(&mut noise, slowness, &mut others);
                for (y, e) in y.iter_mut().zip(noise) {
                    before = rho * before + (1.0 - rho * rho).sqrt() * e;
                    let grown = (1.0 + growth * (*y / 100.0).powi(2)).sqrt();
                    *y = hidden.code(*y + layout.noise * grown * before);
                }
                let beside = Beside {
                    channel: channel as u32,
                    t_acq_ns: burst as i64 * 700_000_000,
                    drive_v: if layout.drive_recorded { drive_v } else { f64::NAN },
                    temperature_c: 28.0 + warmer_c,
                    idle_s: at.idle_s,
                    neighbours: at.neighbours,
                };
                signals.push((beside, y));
            }
        }
        Heard { layout, signals }
    }

    fn truth(&self) -> Truth {
        let Hidden { effect, strength } = self.hidden;
        let one = serde_json::json!({
            "id": effect.id(),
            "in_catalogue": effect.is_in_the_catalogue(),
            "value": 0.0, // intervals are not scored here
            "strength_dl": strength,
            "ties": effect.ties(),
        });
        let effects = if effect == Effect::Nothing { vec![] } else { vec![one] };
        serde_json::from_value(serde_json::json!({ "effects": effects })).unwrap()
    }
}

/// The signals of a recording, and what was recorded beside each.
struct Heard {
    layout: Layout,
    signals: Vec<(Beside, Vec<f64>)>,
}

impl Heard {
    fn critique(&self) -> Critique {
        let mut sampler = Sampler::new(self.layout.period_s, usize::MAX);
        self.signals.iter().for_each(|(beside, y)| sampler.offer("head", *beside, y));
        critique(&sampler.finish(), Rings::InkChannel, false).unwrap().critique
    }

    /// Whole counts, as the command reads them.
    fn bursts(&self) -> Vec<Burst> {
        let (format, layout) = AS_RECORDED;
        let of = |some: &[(Beside, Vec<f64>)]| {
            let counts = |(_, y): &(Beside, Vec<f64>)| y.iter().map(|y| *y as f32).collect();
            let signals: Vec<Vec<f32>> = some.iter().map(counts).collect();
            let first = some[0].0;
            Burst {
                t_acq_ns: 1_750_000_000_000_000_000 + first.t_acq_ns,
                printhead: "head".into(),
                first_channel: first.channel,
                temperature_c: Some(first.temperature_c),
                drive_voltage_v: Some(first.drive_v),
                idle_time_s: some.iter().map(|(beside, _)| beside.idle_s as f32).collect(),
                neighbours_fired: some.iter().map(|(beside, _)| beside.neighbours as u8).collect(),
                ..Burst::of(&signals, self.layout.period_s, format, layout)
            }
        };
        self.signals.chunks(self.layout.a_burst).map(of).collect()
    }
}

/// Every family in turns, nothing hidden.
fn null(seeds: Range<u64>) -> Vec<Case> {
    let families = Family::value_variants();
    let family = |seed: u64| families[(seed % families.len() as u64) as usize];
    seeds.map(|seed| Case { family: family(seed), hidden: NOTHING, seed }).collect()
}

/// One effect each, of so many detection limits in turns, in families that can show it.
fn planted(effects: &[Effect], strengths: &[f64], first_seed: u64, count: usize) -> Vec<Case> {
    const ABLE: [Family; 5] = [
        Family::Proportional,
        Family::Isotropic,
        Family::Tied,
        Family::Lasting,
        Family::CommonAmplitude,
    ];
    (0..count)
        .map(|i| {
            let (effect, round) = (effects[i % effects.len()], i / effects.len());
            let strength = strengths[round % strengths.len()];
            // every effect comes with every family and every size of burst
            let (seed, family) = (first_seed + i as u64, ABLE[(round + i) % ABLE.len()]);
            Case { family, hidden: Hidden { effect, strength }, seed }
        })
        .collect()
}

/// What became of all cases, on two threads; what was not right is printed.
fn judged(cases: &[Case]) -> BTreeMap<Outcome, usize> {
    let all = Mutex::new(BTreeMap::<Outcome, usize>::new());
    on_two_threads(cases, |case| {
        let said = case.heard().critique();
        let answer: CritiqueAnswer =
            serde_json::from_value(serde_json::to_value(&said).unwrap()).unwrap();
        let outcome = outcome(&answer, &case.truth());
        *all.lock().unwrap().entry(outcome).or_default() += 1;
        if !matches!(outcome, Outcome::Right | Outcome::Tied) {
            let (word, verdict) = (outcome.word(), answer.verdict.as_str());
            println!("{word} {case:?}: {verdict} {} {:?}", said.sentence, said.remarks);
        }
    });
    all.into_inner().unwrap()
}

/// Two recordings of each family, all sizes of bursts among them. None of 34 is surer than one of 51 was: it misses critics
/// that name something in one of twenty with 17 % (27 %), of ten with 3 % (3 %).
#[test]
fn nothing_is_named_in_healthy_runs_of_any_family() {
    let mut cases = null(400_000..400_051);
    // of three turns of the sizes each family leaves out another one
    cases.retain(|case| !(case.seed % 17 + case.seed / 17).is_multiple_of(3));
    let row = judged(&cases);
    assert_eq!(row, BTreeMap::from([(Outcome::Right, 34)]));
}

/// No wrong name, and not less than a share of right answers.
#[test]
fn effects_have_their_own_name_or_none_whoever_put_them_in() {
    let (named, right) = (&[Outcome::Right, Outcome::Tied][..], &[Outcome::Right][..]);
    let (catalogue, others) = (Effect::all(true), Effect::all(false));
    let of_all = [2.0, 4.0, 8.0, 16.0];
    let mut goals = Goals::default();
    for (what, effects, strengths, first_seed, count, answers, least) in [
        ("clearly there", &catalogue[..], &[6.0][..], 500_000, catalogue.len(), named, 0.9),
        // where some are missed
        ("barely there", &catalogue, &[2.0], 520_000, catalogue.len(), named, 0.75),
        ("not in the catalogue", &others, &[8.0], 510_000, others.len(), right, 0.9),
        // whatever the phase of the neighbours' ring, which comes from channels of rates of their own
        ("crosstalk", &[Effect::NeighboursRing], &of_all, 540_000, 40, right, 0.95),
        ("an autoregression", &[Effect::CorrelatedNoise], &of_all, 560_000, 16, right, 0.95),
        // correlated at lag one, too, and no autoregressions
        ("noise of two levels", &[Effect::TelegraphNoise], &of_all, 550_000, 16, right, 0.95),
        ("noise that flickers", &[Effect::PinkNoise], &of_all, 550_100, 16, right, 0.95),
    ] {
        let row = judged(&planted(effects, strengths, first_seed, count));
        let met: usize = answers.iter().filter_map(|of| row.get(of)).sum();
        let share = met as f64 / count as f64;
        goals.met(share >= least, format!("{what}, at least {least}: {row:?}"));
        let is_wrong = row.contains_key(&Outcome::Wrong);
        goals.met(!is_wrong, format!("{what}, no wrong name: {row:?}"));
    }
    goals.all_are_met();
}

/// An order of the bursts in which temperatures have nothing to do with what they were.
fn unrelated(temperatures: &[f64]) -> Vec<usize> {
    let n = temperatures.len();
    let mean = temperatures.iter().sum::<f64>() / n as f64;
    let shared = |order: &[usize]| -> f64 {
        let pairs = order.iter().zip(temperatures);
        pairs.map(|(&k, t)| (temperatures[k] - mean) * (t - mean)).sum::<f64>().abs()
    };
    let orders = (0..n).flat_map(|from| (1..n).step_by(2).map(move |step| (from, step)));
    let order = |(from, step)| (0..n).map(|i| (from + step * i) % n).collect::<Vec<usize>>();
    orders.map(order).min_by(|x, y| shared(x).total_cmp(&shared(y))).unwrap()
}

/// The temperatures change places among the bursts: what followed them is no longer theirs.
#[test]
fn a_permuted_covariate_loses_its_name() {
    let hidden = Hidden { effect: Effect::Temperature, strength: 8.0 };
    for seed in 530_000..530_003 {
        let mut heard = Case { family: Family::Tied, hidden, seed }.heard();
        let names = |heard: &Heard| {
            let said = heard.critique();
            let claims = matches!(said.verdict, Verdict::Named | Verdict::Tie);
            claims && said.causes.iter().any(|cause| cause.id.name() == "temperature")
        };
        assert!(names(&heard), "seed {seed}: temperature is named");
        let bursts = heard.signals.chunks_mut(heard.layout.a_burst);
        let temperatures: Vec<f64> = bursts.map(|burst| burst[0].0.temperature_c).collect();
        let bursts = heard.signals.chunks_mut(heard.layout.a_burst);
        for (burst, from) in bursts.zip(unrelated(&temperatures)) {
            burst.iter_mut().for_each(|(beside, _)| beside.temperature_c = temperatures[from]);
        }
        assert!(!names(&heard), "seed {seed}: a permuted temperature is no cause");
    }
}
