//! Simulates recordings with a hidden effect, by which the critique is tested (`simulate --hide SEED`).
//!
//! In: a scenario with a healthy print run, and a seed. Out: [`Hidden`]: bursts, labels of faulty channels, and
//! the truth, which the caller seals in a file of its own.
//!
//! The steps: (1) draw what is hidden: in 30 % of the cases nothing, in 45 % one effect of the catalogue,
//! in 15 % one outside it, in 10 % two, each of 1, 2, 4, 8 or 30 detection limits, and sometimes an awkward
//! [`Circumstance`]; (2) draw the base of the recording, whose rates are off the scenario's (`run::Base`);
//! (3) find each effect's size from its strength ([`strength`], with [`baseline`]); (4) simulate the bursts
//! ([`run`], [`plant`], [`effect`]).
//!
//! The critique's room may not be imported here, nor this room there: what finds an effect must not know how
//! it was put in.

pub mod baseline;
pub mod effect;
pub mod plant;
pub mod run;
pub mod strength;

use super::draws::{Purpose, part, stream};
use super::scenario::{
    HiddenRun, Physics, PrintRun, Recorded, RecordingOptions, ScenarioError, require,
};
use super::simulated::{SimulatedRecording, healthy_everywhere, healthy_heads};
use crate::score::truth::{Circumstance, TrueEffect, Truth};
use effect::{Effect, Needs};
use inkling_core::burst::Compression;
use inkling_core::labels::{Channels, Label};
use rand::RngExt;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;
use run::{Acquisitions, Base};
use std::sync::Arc;
use strength::{STRENGTHS_DL, Strength, Yardstick};

/// Smallest distance of a line (tone, mode) from the resonance and its multiples, relative to the resonance.
const CLEAR_OF_HARMONICS: f64 = 0.12;

#[derive(Clone, Debug, Default)]
pub struct Plan {
    /// Effects, each with its strength in detection limits; their sizes are not known yet.
    pub effects: Vec<(Effect, f64)>,
    /// What makes the recording awkward beside them.
    pub circumstances: Vec<Circumstance>,
}

pub struct Hidden {
    pub recording: SimulatedRecording,
    pub labels: Vec<Label>,
    pub truth: Truth,
}

/// Draws what is hidden, and hides it. The error says what in the scenario makes it unfit for this.
pub fn recording(
    physics: &Arc<Physics>,
    options: &RecordingOptions,
    seed: u64,
) -> Result<Hidden, ScenarioError> {
    let (run, hidden) = healthy_run(physics)?;
    let plan = draw(physics, &run, &hidden, seed);
    planted(physics, options, &plan, seed)
}

/// Hides what `plan` contains. Tests call it with plans of their own.
pub fn planted(
    physics: &Arc<Physics>,
    options: &RecordingOptions,
    plan: &Plan,
    seed: u64,
) -> Result<Hidden, ScenarioError> {
    let (run, hidden) = healthy_run(physics)?;
    let base = Base::new(physics, &run, &hidden, &plan.circumstances, seed);
    // from strengths to sizes; the yardstick may find that only a smaller strength is possible
    let no_ring = || ScenarioError::value("channel", "does not ring");
    let yardstick = Yardstick::new(&base).ok_or_else(no_ring)?;
    let mut effects = Vec::new();
    let mut truths = Vec::new();
    for (effect, strength_dl) in &plan.effects {
        let Strength { size, strength_dl } = yardstick.size(effect, *strength_dl);
        let effect = effect.of_size(size);
        truths.push(true_effect(&effect, strength_dl, &yardstick, plan));
        effects.push(effect);
    }
    // the truth, salted
    let mut salt = stream(seed, Purpose::Hidden, part::HIDDEN + 2);
    let faulty = base.heads.iter().flatten().filter(|made| made.faulty).count();
    let truth = Truth {
        version: 1,
        salt: (0..4).map(|_| format!("{:016x}", salt.random::<u64>())).collect(),
        seed,
        effects: truths,
        circumstances: plan.circumstances.clone(),
        signals: run.printheads * run.channels * run.bursts_per_channel,
        faulty_signals: faulty * run.bursts_per_channel,
    };
    let labels = labels(&base);
    Ok(Hidden { recording: bursts(Acquisitions::new(base, effects), options), labels, truth })
}

/// The scenario's print run and `[hidden]` table, if something can be hidden in this run.
fn healthy_run(physics: &Physics) -> Result<(PrintRun, HiddenRun), ScenarioError> {
    let why = "--hide hides something in a print run";
    let run = physics.print_run.clone().ok_or_else(|| ScenarioError::value("print_run", why))?;
    let is_healthy = run.faulty_channels <= 0.0 && run.fault.is_empty();
    require(is_healthy, "print_run", "--hide needs a healthy run, without faults")?;
    let why = "must be 0 with --hide: damping that follows temperature is one of the effects";
    require(physics.temperature.viscosity_per_k == 0.0, "temperature.viscosity_per_k", why)?;
    let is_long = run.bursts_per_channel >= 2 && run.channels * run.bursts_per_channel >= 16;
    let why = "--hide needs 2 bursts of each channel and 16 signals at least";
    require(is_long, "print_run.bursts_per_channel", why)?;
    Ok((run, physics.hidden.clone().unwrap_or_default()))
}

/// Whether an effect can be seen in a run: its covariate must be recorded and vary; a gradient needs channels.
fn testable(effect: &Effect, physics: &Physics, run: &PrintRun, hidden: &HiddenRun) -> bool {
    let recorded = |what| hidden.recorded.contains(&what);
    match effect.needs {
        Needs::Nothing => effect.id != "position_gradient" || run.channels >= 8,
        Needs::DriveScan => recorded(Recorded::Drive) && physics.drive.levels_v.len() > 1,
        Needs::Temperature => recorded(Recorded::Temperature) && physics.temperature.swing_c > 0.0,
        Needs::Idle => recorded(Recorded::Idle) && hidden.idle_times_us.len() > 1,
        Needs::Neighbours => recorded(Recorded::Neighbours),
    }
}

/// Draws what is hidden, and the circumstances. Only effects that the run can show are drawn.
fn draw(physics: &Physics, run: &PrintRun, hidden: &HiddenRun, seed: u64) -> Plan {
    let mut rng = stream(seed, Purpose::Hidden, part::HIDDEN + 1);
    let known = |effects: &[Effect]| -> Vec<Effect> {
        effects.iter().filter(|e| testable(e, physics, run, hidden)).copied().collect()
    };
    let (catalogue, outside) = (known(&effect::CATALOGUE), known(&effect::OUTSIDE));
    let kind: f64 = rng.random();
    let mut effects: Vec<(Effect, f64)> = Vec::new();
    let (from, count) = match kind {
        k if k < 0.30 => (&catalogue, 0),
        k if k < 0.75 => (&catalogue, 1),
        k if k < 0.90 => (&outside, 1),
        _ => (&catalogue, 2),
    };
    while effects.len() < count {
        let Some(effect) = from.choose(&mut rng) else { break };
        let strength = STRENGTHS_DL[rng.random_range(0..STRENGTHS_DL.len())];
        // no two equal effects, nor two of a class whose members may be tied with each other
        let told_apart =
            effects.iter().all(|(e, _)| e.id != effect.id && !e.ties.contains(&effect.id));
        if told_apart {
            effects.push((shaped(*effect, physics, &mut rng), strength));
        }
    }

    // at most one circumstance; the last two only where they are fair
    let circumstance: f64 = rng.random();
    let sd = rng.random_range(0.005..0.02);
    let time_bound = |e: &Effect| matches!(e.id, "ageing" | "clock_drift" | "temperature");
    // The temperature may follow time only if it is recorded and if the right answer stays clear.
    let collinear = hidden.recorded.contains(&Recorded::Temperature)
        && effects.iter().all(|(e, _)| e.ties.is_empty() && e.id != "clock_drift")
        && (effects.is_empty() || effects.iter().any(|(e, _)| time_bound(e)));
    let circumstances = match circumstance {
        c if c < 0.4 => vec![],
        c if c < 0.5 => vec![Circumstance::FrequencyScatter(sd)],
        c if c < 0.6 => vec![Circumstance::BurstScatter(sd)],
        c if c < 0.75 => vec![Circumstance::FaultyChannels],
        c if c < 0.9 && collinear => vec![Circumstance::TemperatureFollowsTime],
        c if c >= 0.9 && effects.is_empty() => vec![Circumstance::HeavyTails],
        _ => vec![],
    };
    Plan { effects, circumstances }
}

/// The effect with its shape drawn from its range; lines keep clear of the resonance and its multiples. After
/// 1000 failures the range's lower end is taken.
pub fn shaped(effect: Effect, physics: &Physics, rng: &mut ChaCha8Rng) -> Effect {
    let [low, high] = effect.shapes;
    let resonance_hz = physics.channel.poles().map_or(0.0, |p| p.frequency_hz);
    for _ in 0..1000 {
        let shape = low + (high - low) * rng.random::<f64>();
        let order = shape / resonance_hz;
        if !effect.is_line() || (order - order.round().max(1.0)).abs() > CLEAR_OF_HARMONICS {
            return Effect { shape, ..effect };
        }
    }
    Effect { shape: low, ..effect }
}

fn true_effect(
    effect: &Effect,
    strength_dl: f64,
    yardstick: &Yardstick,
    plan: &Plan,
) -> TrueEffect {
    let mut ties: Vec<String> = effect.ties.iter().map(|t| (*t).to_owned()).collect();
    let follows = plan.circumstances.contains(&Circumstance::TemperatureFollowsTime);
    if follows && matches!(effect.id, "temperature" | "ageing") {
        ties = vec!["temperature".to_owned(), "ageing".to_owned()];
    }
    TrueEffect {
        id: effect.id.to_owned(),
        in_catalogue: !effect.id.starts_with("outside_"),
        parameter: effect.parameter.to_owned(),
        unit: effect.unit.to_owned(),
        value: yardstick.parameter(effect),
        strength_dl,
        ties,
    }
}

/// Labels: a healthy row for each printhead, and a row for each faulty channel.
fn labels(base: &Base) -> Vec<Label> {
    let run = &base.run;
    let mut labels = healthy_heads(run);
    for (head, channels) in base.heads.iter().enumerate() {
        for (channel, _) in channels.iter().enumerate().filter(|(_, made)| made.faulty) {
            labels.push(Label {
                channel: Channels::One(channel as u32),
                state: "faulty".to_owned(),
                ..healthy_everywhere(&run.name(head))
            });
        }
    }
    labels
}

/// The recording, not yet made. It is never compressed, since its size would tell what is in it.
fn bursts(mut acquisitions: Acquisitions, options: &RecordingOptions) -> SimulatedRecording {
    let options = RecordingOptions { compression: Compression::None, ..options.clone() };
    let (run, start_ns) = (acquisitions.base.run.clone(), options.start_ns);
    let acquire = move |head, step| acquisitions.acquire(head, step, start_ns);
    SimulatedRecording::of_run(&run, options, acquire)
}
