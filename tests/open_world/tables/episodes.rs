//! Episodes: how many a clean recording raises, and what is said where a channel's signals are of no
//! class from some burst on.

use super::Shown;
use crate::open_world::chance::Rate;
use crate::open_world::family::Family;
use crate::open_world::lab::{Lab, Library, Mode, Program, Refusal};
use crate::open_world::plant::{Plant, random};
use crate::open_world::recording::Rows;
use crate::open_world::scatter::{Scatter, Shape};

pub struct Clean {
    pub seed: u64,
    /// Of each mode and shape, in recordings of at most `RECORDED`.
    pub signals: usize,
    pub modes: Vec<Mode>,
}

const RECORDED: usize = 512_000;
const CLEAN_ROWS: Rows = Rows::whole(256);

pub struct CleanRow {
    pub scatter: Scatter,
    pub mode: Mode,
    pub signals: usize,
    pub episodes: usize,
}

pub fn measure_clean(program: &Program, plan: &Clean) -> Result<Vec<CleanRow>, Refusal> {
    let plant = Plant::thesis_form();
    let lab = Lab::new(program);
    lab.train(&Library::THESIS, &plant, plan.seed)?;
    let mut rows = Vec::new();
    for shape in [Shape::Box, Shape::Lasting] {
        let scatter = Scatter { shape, width: 1.0 };
        let first = rows.len();
        let row = |&mode| CleanRow { scatter, mode, signals: 0, episodes: 0 };
        rows.extend(plan.modes.iter().map(row));
        for recording in 0..plan.signals.div_ceil(RECORDED) as u64 {
            let seed = plan.seed + 1 + recording;
            let mut rng = random(seed, 2);
            let count = RECORDED.min(plan.signals);
            let signals = (0..count).map(|place| {
                let channel = CLEAN_ROWS.channel(place);
                let features = scatter.features(&plant, seed, channel, &mut rng);
                plant.signal(features, &mut rng)
            });
            lab.write("clean", CLEAN_ROWS, &plant, signals);
            for row in &mut rows[first..] {
                row.signals += count;
                row.episodes += lab.replay("clean", row.mode)?.len();
            }
        }
    }
    Ok(rows)
}

/// Against the goal: half an episode per million.
pub fn missed_clean(rows: &[CleanRow]) -> Vec<String> {
    let beyond =
        rows.iter().filter(|row| !Rate { count: row.episodes, of: row.signals }.is_at_most(0.5e-6));
    let said = |row: &CleanRow| {
        format!("{}, {:?}: {} episodes of {}", row.scatter, row.mode, row.episodes, row.signals)
    };
    beyond.map(said).collect()
}

pub fn show_clean(rows: &[CleanRow]) -> Shown {
    let head = "scatter | mode | clean signals | episodes | per million";
    Shown::of("False episodes", head, rows, |row| {
        vec![
            row.scatter.to_string(),
            format!("{:?}", row.mode),
            row.signals.to_string(),
            row.episodes.to_string(),
            format!("{:.2}", row.episodes as f64 / row.signals as f64 * 1e6),
        ]
    })
}

pub struct Foreign {
    pub seed: u64,
    /// Channels of each family.
    pub channels: usize,
    pub level: f64,
}

/// Bursts, and the one from which on a channel is foreign.
const BURSTS: usize = 100;
const FROM: usize = 40;

pub struct ForeignRow {
    pub family: Family,
    /// Of its channels.
    pub raised: Rate,
    /// Of its episodes: a class or a category is named.
    pub named: Rate,
    pub sentence: Option<String>,
}

pub fn measure_foreign(program: &Program, plan: &Foreign) -> Result<Vec<ForeignRow>, Refusal> {
    let plant = Plant::thesis_form();
    let lab = Lab::new(program);
    lab.train(&Library::THESIS, &plant, plan.seed)?;
    let families = Family::all(&[plan.level]);
    let rows = Rows::whole(2 * families.len() * plan.channels);
    let mut rng = random(plan.seed, 3);
    let signals = (0..rows.channels * BURSTS).map(|place| {
        let family = families.get(rows.channel(place) / plan.channels);
        let foreign = family.filter(|_| place / rows.channels >= FROM);
        foreign.and_then(|family| family.signal(&plant, &mut rng)).unwrap_or_else(|| {
            let features = plant.healthy.draw(&mut rng);
            plant.signal(features, &mut rng)
        })
    });
    lab.write("foreign", rows, &plant, signals);
    let episodes = lab.replay("foreign", Mode::Design)?;
    let of_family = |(i, &family): (usize, &Family)| {
        let mut row =
            ForeignRow { family, raised: Rate::default(), named: Rate::default(), sentence: None };
        for channel in i * plan.channels..(i + 1) * plan.channels {
            let mut raised = false;
            for episode in episodes.iter().filter(|e| e.channel as usize == channel) {
                raised = true;
                row.named.add(episode.fault.is_some() || episode.category.is_some());
                row.sentence.get_or_insert(episode.explanation.clone());
            }
            row.raised.add(raised);
        }
        row
    };
    Ok(families.iter().enumerate().map(of_family).collect())
}

/// Every channel raises an episode, and hardly any names something.
pub fn missed_foreign(rows: &[ForeignRow]) -> Vec<String> {
    let said = |row: &ForeignRow| {
        let (raised, named) = (row.raised.share(), row.named.share());
        format!("{}: raised {raised:.2}, named {named:.2}", row.family)
    };
    let is_wrong = |row: &&ForeignRow| row.raised.share() < 1.0 || row.named.share() > 0.5;
    let mut missed: Vec<String> = rows.iter().filter(is_wrong).map(said).collect();
    let of_all = |all: Rate, row: &ForeignRow| Rate {
        count: all.count + row.named.count,
        of: all.of + row.named.of,
    };
    let named = rows.iter().fold(Rate::default(), of_all);
    missed.extend(named.beyond(0.02, "all families: named"));
    missed
}

pub fn show_foreign(rows: &[ForeignRow]) -> Shown {
    let title = "Episodes of channels that are of no class from some burst on";
    let head = "family | channels raised | episodes | named | the first says";
    Shown::of(title, head, rows, |row| {
        vec![
            row.family.to_string(),
            format!("{:.2}", row.raised.share()),
            row.named.of.to_string(),
            format!("{:.2}", row.named.share()),
            row.sentence.clone().unwrap_or_default(),
        ]
    })
}
