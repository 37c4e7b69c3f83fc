//! The pictures of a critique's page (`report.rs`).
//!
//! In: the [`Figures`] of a critique. Out: SVG markup with headings. Each title is a
//! sentence that says what the figure shows, computed from its numbers. A figure without numbers is left out.

use super::finding::{Compared, Curve, Figures};
use crate::plot::digits::short;
use crate::plot::{Axis, Figure, Mark, SIZE, Series, page, unit_of_time};

pub fn drawn(f: &Figures) -> String {
    let headed = |heading: &str, drawn: Option<Figure>| {
        let drawn = drawn.map(with_room).map(|of| page::figure(&of, SIZE, &of.title));
        page::section(heading, &drawn.unwrap_or_default())
    };
    let misfit = mean_misfit(&f.mean_misfit, &f.unit);
    headed("Misfit, measured minus simulated", misfit)
        + &headed("Spectrum of the misfit", spectrum(&f.spectrum, &f.unit))
}

/// The figure with room for its legend above the data.
fn with_room(mut figure: Figure) -> Figure {
    let (low, high) = ends(figure.series.iter().flat_map(|s| &s.points).map(|p| p.1));
    if !figure.y.log && low < high {
        figure.y.range = Some((low - 0.05 * (high - low), high + 0.4 * (high - low)));
    }
    figure
}

fn line(name: &str, x: &[f64], y: &[f64]) -> Series {
    Series::new(name, Mark::Line, x.iter().copied().zip(y.iter().copied()).collect())
}

fn band(name: &str, x: &[f64], Curve { low, high, .. }: &Curve) -> Series {
    let there = x.iter().copied().zip(low.iter().copied());
    let back = x.iter().copied().zip(high.iter().copied()).rev();
    Series::new(name, Mark::Band, there.chain(back).collect())
}

/// Share of the samples at which the band does not hold zero.
fn off_zero(Curve { low, high, .. }: &Curve) -> String {
    let off = low.iter().zip(high).filter(|(low, high)| **low > 0.0 || **high < 0.0).count();
    format!("{:.0} %", 100.0 * off as f64 / low.len().max(1) as f64)
}

fn scaled(values: &[f64], by: f64) -> Vec<f64> {
    values.iter().map(|x| x * by).collect()
}

/// The mean misfit against time. `signals`: unit of the samples.
fn mean_misfit(m: &Compared, signals: &str) -> Option<Figure> {
    let (scale, unit) = unit_of_time(*m.x.last()?);
    let t = scaled(&m.x, scale);
    Some(Figure::new(
        format!(
            "The mean misfit is off zero at {} of the samples, after the extension at {} (chance: 5 %)",
            off_zero(&m.before),
            off_zero(&m.after)
        ),
        Axis::new(&format!("time since t_a, {unit}")),
        Axis::new(&format!("mean of measured minus simulated, {signals}")),
        vec![
            line("before", &t, &m.before.y),
            line("after", &t, &m.after.y),
            band("95 % of before", &t, &m.before),
            band("95 % of after", &t, &m.after),
        ],
    ))
}

/// The largest ratio of the power to the band's upper edge, and the frequency where it is reached.
fn loudest(frequency_hz: &[f64], power: &Curve) -> Option<(f64, f64)> {
    let all = frequency_hz.iter().zip(power.y.iter().zip(&power.high));
    let ratios = all.filter(|(_, (_, high))| **high > 0.0).map(|(f, (p, high))| (p / high, *f));
    ratios.max_by(|x, y| x.0.total_cmp(&y.0))
}

/// The mean periodogram of the misfit, with the band of a right model. `signals`: unit of the samples.
fn spectrum(s: &Compared, signals: &str) -> Option<Figure> {
    let (before, at_hz) = loudest(&s.x, &s.before)?;
    let (after, _) = loudest(&s.x, &s.after)?;
    let (scale, unit) = match s.x.last()? {
        f if *f >= 2e3 => (1e-3, "kHz"),
        _ => (1.0, "Hz"),
    };
    let f = scaled(&s.x, scale);
    Some(Figure::new(
        format!(
            "The misfit is loudest at {} {unit}: {} of what a right model may have; after: {}",
            short(at_hz * scale),
            short(before),
            short(after)
        ),
        Axis::new(&format!("frequency, {unit}")),
        Axis::log(&format!("mean periodogram of the misfit, ({signals})²")),
        vec![
            line("before", &f, &s.before.y),
            line("after", &f, &s.after.y),
            band("95 % of a right model", &f, &s.after),
        ],
    ))
}

fn ends(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let none = (f64::INFINITY, f64::NEG_INFINITY);
    values.filter(|v| v.is_finite()).fold(none, |(l, h), v| (l.min(v), h.max(v)))
}
