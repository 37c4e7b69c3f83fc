//! Whether codes are those of a converter with a coarse step.
//!
//! In: the codes that were met. Out: a [`Lattice`], if every one of them is the whole number next to a multiple
//! of one step, counted from some place. Between two of them multiples may be missed by chance.
//!
//! The first guess is the mean of the smallest gaps. It numbers the codes, and a step near by is sought at which
//! all of them lie within half a count of their multiples. What is left out must be more than what could look
//! regular by chance: m codes of n can be left out in about e^{n H(m/n)} ways (H: entropy), of which about n²
//! are those of a step. Only the codes between neighbouring multiples count: across a wider gap, where no
//! sample came by, some number of nearly any step fits, so that whole counts in clusters had a step of 1.05.

use super::chance::{THRESHOLD, maximum};

pub struct Lattice {
    /// Distance of neighbouring multiples, and its standard deviation; counts.
    pub step: f64,
    pub sd: f64,
}

impl Lattice {
    /// `met`: in ascending order.
    pub fn of(met: &[i64]) -> Option<Lattice> {
        let gaps = || met.windows(2).map(|pair| pair[1] - pair[0]);
        let smallest = gaps().min()?;
        // the rounded multiples of a step are one of two whole numbers apart
        let single: Vec<i64> = gaps().filter(|gap| *gap <= smallest + 1).collect();
        let guess = single.iter().sum::<i64>() as f64 / single.len() as f64;

        // the number of each code, counted in steps from the first
        let mut numbers = vec![0.0];
        for gap in gaps() {
            let steps = if gap <= smallest + 1 { 1.0 } else { (gap as f64 / guess).round() };
            numbers.push(numbers[numbers.len() - 1] + steps);
        }
        let steps = numbers[numbers.len() - 1];
        let spread = |step: f64| {
            let off = met.iter().zip(&numbers).map(|(code, k)| (code - met[0]) as f64 - step * k);
            let ends = off.fold((0.0_f64, 0.0_f64), |(low, high), x| (low.min(x), high.max(x)));
            ends.1 - ends.0
        };
        // the first and the last code are off by half a count at most, which the guess knows less well
        let step = maximum(|step| -spread(step), guess, 4.0 / steps);
        let regular = |step: f64| spread(step) < 1.0 + 1e-3;
        let step = [guess, step].into_iter().find(|step| regular(*step))?;

        let codes = single.iter().sum::<i64>() as f64;
        let share = 1.0 - single.len() as f64 / codes;
        let share = share.clamp(f64::MIN_POSITIVE, 1.0 - f64::EPSILON);
        let entropy = -share * share.ln() - (1.0 - share) * (1.0 - share).ln();
        let surprise = codes * entropy - 2.0 * codes.ln();
        (surprise > THRESHOLD).then_some(Lattice { step, sd: 1.0 / steps })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_of_a_step_are_a_lattice_and_others_are_not() {
        let met =
            |keep: &dyn Fn(i64) -> bool| -> Vec<i64> { (-80..80).filter(|k| keep(*k)).collect() };
        let of = |met: Vec<i64>| Lattice::of(&met).map(|lattice| lattice.step);
        assert_eq!(of(met(&|k| k % 3 == 0)), Some(3.0));
        let rounded = (-40..40).map(|k| (f64::from(k) * 2.5).round() as i64).collect();
        assert!(of(rounded).is_some_and(|step| (step - 2.5).abs() < 0.02));
        // one of the lattice's codes was missed by chance
        assert_eq!(of(met(&|k| k % 3 == 0 && k != 60)), Some(3.0));
        // two neighbouring codes of sixteen never occur, one bit never changes, some are missing anywhere
        assert_eq!(of(met(&|k| !matches!(k.rem_euclid(16), 3 | 4))), None);
        assert_eq!(of(met(&|k| k & 4 == 0)), None);
        assert_eq!(of(met(&|k| k * k % 83 != 1)), None);
        assert_eq!(of(met(&|k| !matches!(k, -41 | 3 | 39))), None);
        // whole counts of a head of little noise, in clusters where its rings turn
        let clusters =
            [-129..=-126, -50..=-47, -21..=-19, -7..=-3, -1..=1, 5..=7, 13..=28, 31..=39];
        let later = [47..=54, 60..=63, 73..=77, 141..=147, 234..=237];
        assert_eq!(of(clusters.into_iter().chain(later).flatten().collect()), None);
        // large numbers that are rounded to the digits of a float
        assert_eq!(of((0..90).map(|k| 1_000_000 * k + k * k % 4).collect()), None);
    }
}
