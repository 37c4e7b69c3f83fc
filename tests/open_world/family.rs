//! Every family of signals that belongs to no class, under one name.

use super::broken::Broken;
use super::disturbance::Disturbance;
use super::plant::{Plant, Random};
use super::stranger::Stranger;
use clap::ValueEnum;
use std::fmt;

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Family {
    /// A healthy ring and so many noise variances that no ring explains.
    Disturbed(Disturbance, f64),
    Broken(Broken),
    Stranger(Stranger),
}

/// Draws of a disturbance that cannot be made large enough, in a row.
const MOST_DRAWS: usize = 200;

impl Family {
    pub fn all(levels: &[f64]) -> Vec<Family> {
        let disturbed =
            all::<Disturbance>().flat_map(|d| levels.iter().map(move |&x| Family::Disturbed(d, x)));
        let broken = all().map(Family::Broken);
        let strangers = all().map(Family::Stranger);
        disturbed.chain(broken).chain(strangers).collect()
    }

    /// `None`: it does not come so large.
    pub fn signal(self, plant: &Plant, rng: &mut Random) -> Option<Vec<f32>> {
        match self {
            Family::Broken(broken) => {
                let healthy = plant.ring(plant.healthy.draw(rng));
                Some(broken.signal(&healthy, plant, rng))
            }
            Family::Stranger(stranger) => Some(stranger.signal(plant, rng)),
            Family::Disturbed(disturbance, x) => (0..MOST_DRAWS).find_map(|_| {
                let healthy = plant.ring(plant.healthy.draw(rng));
                disturbance.signal(&healthy, x, plant, rng)
            }),
        }
    }
}

impl fmt::Display for Family {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Family::Disturbed(disturbance, x) => write!(f, "{}, x = {x}", words(disturbance)),
            Family::Broken(broken) => write!(f, "{}", words(broken)),
            Family::Stranger(stranger) => write!(f, "strange {}", words(stranger)),
        }
    }
}

/// The variants of an enum, in its order.
pub fn all<E: ValueEnum + Copy + 'static>() -> impl Iterator<Item = E> {
    E::value_variants().iter().copied()
}

/// `TwoRings` as "two rings".
pub fn words(name: &impl fmt::Debug) -> String {
    let mut words = String::new();
    for c in format!("{name:?}").chars() {
        if c.is_uppercase() && !words.is_empty() {
            words.push(' ');
        }
        words.extend(c.to_lowercase());
    }
    words
}
