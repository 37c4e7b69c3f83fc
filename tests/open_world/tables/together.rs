//! Heads all of whose channels drift alike, unrecorded, some of them faulty from a round on: what is
//! raised, what is found, what is said of the head.

use super::{STATED, Shown};
use crate::open_world::chance::Rate;
use crate::open_world::drift::Drift;
use crate::open_world::lab::{Lab, Library, Mode, Program, Refusal};
use crate::open_world::plant::{Plant, random};
use crate::open_world::recording::Rows;
use crate::open_world::scatter::{Scatter, Shape};

pub struct Plan {
    pub seed: u64,
    /// Of all channels, a second apart.
    pub rounds: usize,
    /// Channels of one burst.
    pub per_burst: usize,
    /// Channels, and those of them that are faulty.
    pub channels: usize,
    pub faulty: usize,
    pub modes: Vec<Mode>,
    pub drifts: Vec<Drift>,
}

/// What is wrong with faulty channels, one after the other, from a round on.
const FAULTS: [&str; 3] = ["DDN", "BN", "AB2"];

pub struct Row {
    pub drift: Drift,
    pub scatter: Scatter,
    pub mode: Mode,
    pub false_episodes: usize,
    pub false_alarms: Rate,
    pub recall: Rate,
    /// Warnings of what all channels have in common.
    pub said: usize,
}

pub fn measure(program: &Program, plan: &Plan) -> Result<Vec<Row>, Refusal> {
    let plant = Plant::thesis_form();
    let lab = Lab::new(program);
    lab.train(&Library::THESIS, &plant, plan.seed)?;
    let mut rows = Vec::new();
    for (i, &drift) in plan.drifts.iter().enumerate() {
        // lasting differences within what the design was trained on
        let scatter = match i % 2 {
            0 => Scatter { shape: Shape::Lasting, width: 0.5 },
            _ => Scatter::BOX,
        };
        let seed = plan.seed + 1 + i as u64;
        let mut rng = random(seed, 4);
        let rows_of = Rows { per_burst: plan.per_burst, ..Rows::whole(plan.channels) };
        // evenly over the head
        let is_faulty = |channel: usize| (channel * plan.faulty) % plan.channels < plan.faulty;
        let fault_of = |place: usize| {
            let (channel, round) = (rows_of.channel(place), place / plan.channels);
            let late = is_faulty(channel) && round >= plan.rounds / 3;
            late.then(|| plant.faults[FAULTS[channel % FAULTS.len()]])
        };
        let signals = (0..plan.rounds * plan.channels).map(|place| {
            let features = match fault_of(place) {
                Some(ranges) => ranges.draw(&mut rng),
                None => scatter.features(&plant, seed, rows_of.channel(place), &mut rng),
            };
            let t_s = (place / plan.channels) as f64 * rows_of.every_s;
            plant.signal(drift.at(t_s, features), &mut rng)
        });
        lab.write("together", rows_of, &plant, signals);
        let places = 0..plan.rounds * plan.channels;
        let faulty: Vec<bool> = places.map(|place| fault_of(place).is_some()).collect();
        for &mode in &plan.modes {
            let (mut false_alarms, mut recall) = (Rate::default(), Rate::default());
            for (verdict, is_faulty) in lab.judge_known("together", mode, "", &faulty)? {
                let rate = if *is_faulty { &mut recall } else { &mut false_alarms };
                rate.add(verdict.is_flagged());
            }
            let episodes = lab.episodes("together");
            let false_episodes = episodes.iter().filter(|e| !is_faulty(e.channel as usize)).count();
            let said = lab.warnings("together");
            let said = said.iter().filter(|w| w.contains("moved together")).count();
            rows.push(Row { drift, scatter, mode, false_episodes, false_alarms, recall, said });
        }
    }
    Ok(rows)
}

/// No false episode, twice the stated rate, nearly every faulty signal, and one word of what goes beyond
/// the bounds.
pub fn missed(rows: &[Row]) -> Vec<String> {
    let mut missed = Vec::new();
    for row in rows {
        let whose = format!("{}, {}, {:?}", row.drift, row.scatter, row.mode);
        if row.false_episodes > 0 {
            missed.push(format!("{whose}: {} false episodes", row.false_episodes));
        }
        missed.extend(row.false_alarms.beyond(2.0 * STATED, &format!("{whose}: false alarms")));
        missed.extend(row.recall.below(0.99, &format!("{whose}: recall")));
        if !row.drift.warnings().contains(&row.said) {
            missed.push(format!("{whose}: {} warnings of the head", row.said));
        }
    }
    missed
}

pub fn show(rows: &[Row]) -> Shown {
    let head = "drift | scatter | mode | false episodes | false alarms | recall | head's warnings";
    Shown::of("Heads whose channels all drift alike, unrecorded", head, rows, |row| {
        vec![
            row.drift.to_string(),
            row.scatter.to_string(),
            format!("{:?}", row.mode),
            row.false_episodes.to_string(),
            format!("{:.1e}", row.false_alarms.share()),
            format!("{:.3}", row.recall.share()),
            row.said.to_string(),
        ]
    })
}
