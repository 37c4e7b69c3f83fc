//! How the ring-downs of several channels are laid out in a row of numbers, inferred from the
//! numbers themselves.
//!
//! In: the numbers of one message, in any unit. Out: the number of channels, whether samples or
//! channels are contiguous, and the evidence. In the right layout neighbouring samples of a channel
//! are alike (correlated), channels ring alike (their mean has much of the energy), and the numbers
//! jump from one row of the memory to the next (`edge`). Of all plausible layouts the one with the
//! clearest jumps wins. The bounds are heuristic.

/// Smallest number of samples per channel; fewer show no ring.
const FEWEST_SAMPLES: usize = 16;
pub const LEAST_NEIGHBOURS: f64 = 0.3;
const LEAST_ALIKE: f64 = 0.5;
/// Smallest `edge` at which rows are told apart.
const LEAST_EDGE: f64 = 1.5;
/// Edges of this share of the clearest are as clear. Rows of half the length have half of it.
const AS_CLEAR: f64 = 0.75;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowLayout {
    pub channels: usize,
    /// Whether the samples of one moment lie side by side; else those of one channel do.
    pub sample_major: bool,
    /// Correlation of neighbouring samples of a channel.
    pub neighbours: f64,
    /// Share of the channels' energy that their mean has, less the share 1 / channels of unrelated
    /// channels, scaled such that equal channels have 1. Of a single channel it is 1.
    pub alike: f64,
}

impl RowLayout {
    /// `None`: `x` cannot be laid out so, a channel has too few samples, or all numbers are equal.
    pub fn of(x: &[f64], channels: usize, sample_major: bool) -> Option<RowLayout> {
        let samples = x.len().checked_div(channels)?;
        if samples < FEWEST_SAMPLES || samples * channels != x.len() {
            return None;
        }
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        let at = |channel: usize, k: usize| match sample_major {
            true => x[k * channels + channel] - mean,
            false => x[channel * samples + k] - mean,
        };

        let (mut square, mut beside) = (0.0, 0.0);
        let mut sums = vec![0.0; samples];
        for channel in 0..channels {
            for (k, sum) in sums.iter_mut().enumerate() {
                let here = at(channel, k);
                *sum += here;
                square += here * here;
                beside += if k + 1 < samples { here * at(channel, k + 1) } else { 0.0 };
            }
        }

        // the energy of the channels' mean, counted once for each channel, over the whole energy
        let rows = channels as f64;
        let of_mean = sums.iter().map(|sum| sum * sum).sum::<f64>() / rows;
        let chance = 1.0 / rows;
        let alike = (of_mean / square - chance) / (1.0 - chance);
        let alike = if channels == 1 { 1.0 } else { alike };
        let neighbours = beside / square;
        let layout = RowLayout { channels, sample_major, neighbours, alike };
        (square > 0.0 && square.is_finite()).then_some(layout)
    }

    pub fn is_plausible(&self) -> bool {
        self.neighbours >= LEAST_NEIGHBOURS && self.alike >= LEAST_ALIKE
    }

    /// Of the plausible layouts of several channels the one with the clearest edges between rows,
    /// if these reach `LEAST_EDGE`. `may_be`: tells whether a number of channels is possible.
    pub fn likeliest(x: &[f64], may_be: impl Fn(usize) -> bool) -> Option<RowLayout> {
        let most = x.len() / FEWEST_SAMPLES;
        let possible = (2..=most).filter(|n| x.len().is_multiple_of(*n) && may_be(*n));
        let both = possible.flat_map(|n| [(n, false), (n, true)]);
        let plausible =
            both.filter_map(|(n, major)| Self::of(x, n, major)).filter(Self::is_plausible);

        // correlation and likeness hold in some wrong layouts, too, as with half the channels
        let edges: Vec<(f64, usize, RowLayout)> = plausible
            .map(|layout| {
                let channels = layout.channels;
                let row = if layout.sample_major { channels } else { x.len() / channels };
                (edge(x, row), row, layout)
            })
            .collect();
        let (clearest, _, best) = *edges.iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
        // every other edge of the right rows is as clear as all of them: the shortest rows are right
        let alike = |(edge, _, layout): &&(f64, usize, RowLayout)| {
            layout.sample_major == best.sample_major && *edge >= AS_CLEAR * clearest
        };
        let shortest = edges.iter().filter(alike).min_by_key(|(_, row, _)| *row);
        shortest.filter(|_| clearest >= LEAST_EDGE).map(|(.., layout)| *layout)
    }
}

/// The mean square step from one row (of `row` numbers) to the next, over that within rows.
fn edge(x: &[f64], row: usize) -> f64 {
    let (mut across, mut within) = ((0.0, 0), (0.0, 0));
    for (i, pair) in x.windows(2).enumerate() {
        let sums = if (i + 1).is_multiple_of(row) { &mut across } else { &mut within };
        *sums = (sums.0 + (pair[1] - pair[0]).powi(2), sums.1 + 1);
    }
    let mean = |(sum, n): (f64, usize)| sum / n.max(1) as f64;
    mean(across) / mean(within).max(f64::MIN_POSITIVE)
}

/// How many periods a signal has, by its spectrum's peak. `None`: none, or a number is not finite.
pub fn periods(signal: &[f64]) -> Option<f64> {
    const MOST: usize = 2048;
    let all = signal.len();
    let signal = &signal[..all.min(MOST)];
    let n = signal.len();
    let mean = signal.iter().sum::<f64>() / n.max(1) as f64;

    let power = |bin: usize| {
        let turn = 2.0 * std::f64::consts::PI * bin as f64 / n as f64;
        let (mut re, mut im) = (0.0, 0.0);
        for (k, y) in signal.iter().enumerate() {
            let (sin, cos) = (turn * k as f64).sin_cos();
            (re, im) = (re + (y - mean) * cos, im + (y - mean) * sin);
        }
        re * re + im * im
    };
    let powers: Vec<f64> = (0..=n / 2).map(power).collect();
    let (bin, most) = powers.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
    if !(most > 0.0 && most.is_finite()) {
        return None;
    }

    let shown = match bin {
        // The spectrum cannot tell less than one period from one. The root mean square of a
        // sinusoid's steps over its own is its phase advance per sample.
        0..=1 => {
            let centred = || signal.iter().map(|y| y - mean);
            let square: f64 = centred().map(|y| y * y).sum();
            let step: f64 = centred().zip(centred().skip(1)).map(|(a, b)| (b - a).powi(2)).sum();
            (step / square).sqrt() * n as f64 / (2.0 * std::f64::consts::PI)
        }
        _ => bin as f64,
    };

    Some(shown * all as f64 / n as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noisy ring-downs of channels whose amplitudes differ a little, in either layout.
    fn rings(channels: usize, samples: usize, sample_major: bool) -> Vec<f64> {
        let mut normal = crate::model::normal::draws(1);
        let sizes: Vec<f64> = (0..channels).map(|_| 1000.0 * (1.0 + 0.06 * normal())).collect();
        let ring = |c: usize, k: usize| {
            let t = k as f64 / samples as f64;
            sizes[c] * (-5.0 * t).exp() * (40.0 * t).cos()
        };
        let at = |i: usize| match sample_major {
            true => ring(i % channels, i / channels),
            false => ring(i / samples, i % samples),
        };
        (0..channels * samples).map(|i| at(i) + 6.0 * normal()).collect()
    }

    #[test]
    fn the_layout_is_told_by_the_numbers() {
        for (channels, samples) in [(2, 128), (12, 100), (64, 128), (128, 64)] {
            for sample_major in [false, true] {
                let rows = rings(channels, samples, sample_major);
                let layout = RowLayout::likeliest(&rows, |_| true);
                let found = layout.map(|of| (of.channels, of.sample_major));
                assert_eq!(found, Some((channels, sample_major)), "{samples} samples");
            }
        }
    }

    #[test]
    fn periods_are_counted() {
        let wave = |n: f64| -> Vec<f64> {
            (0..128).map(|k| (n * 2.0 * std::f64::consts::PI * k as f64 / 128.0).cos()).collect()
        };
        assert!((periods(&wave(6.0)).unwrap() - 6.0).abs() < 0.5);
        assert!(periods(&wave(0.1)).unwrap() < 1.0);
        assert_eq!(periods(&[3.0; 64]), None);
    }

    #[test]
    fn one_channel_and_noise_are_no_several_channels() {
        assert_eq!(RowLayout::likeliest(&rings(1, 512, false), |_| true), None);
        let noise: Vec<f64> = rings(16, 64, false).iter().map(|x| (x * 1e7).sin()).collect();
        assert_eq!(RowLayout::likeliest(&noise, |_| true), None);
        assert!(!RowLayout::of(&rings(64, 128, true), 64, false).unwrap().is_plausible());
    }
}
