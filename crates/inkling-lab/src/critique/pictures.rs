//! The pictures of a critique's page (`report.rs`).
//!
//! In: the [`Figures`] of a critique. Out: SVG markup with headings. Each title is a
//! sentence that says what the figure shows, computed from its numbers. A figure without numbers is left out.

use super::finding::{Compared, CovariateFigure, Curve, Figures};
use crate::plot::digits::{short, significant};
use crate::plot::{Axis, Figure, Mark, SIZE, Series, page, unit_of_time};

/// Number of figures against covariates that are visible at once; others are folded away.
const OPEN_COVARIATES: usize = 4;

pub fn drawn(f: &Figures) -> String {
    let headed = |heading: &str, drawn: Option<Figure>| {
        let drawn = drawn.map(with_room).map(|of| page::figure(&of, SIZE, &of.title));
        page::section(heading, &drawn.unwrap_or_default())
    };
    let mut page = headed("Misfit, measured minus simulated", mean_misfit(&f.mean_misfit, &f.unit));
    page += &headed("Spectrum of the misfit", spectrum(&f.spectrum, &f.unit));

    // the covariate that stands out most comes first
    let mut covariates: Vec<&CovariateFigure> = f.covariates.iter().collect();
    covariates.sort_by(|x, y| stands_out(y).total_cmp(&stands_out(x)));
    for (k, of) in covariates.iter().enumerate() {
        if k == OPEN_COVARIATES {
            page += "<details><summary>Against what else was recorded</summary>\n";
        }
        let heading = if k == 0 { "Misfit against what was recorded" } else { "" };
        page += &headed(heading, covariate(of));
    }
    if covariates.len() > OPEN_COVARIATES {
        page += "</details>\n";
    }

    page
}

/// Largest distance of a bin's mean (before the extension) from zero, over the half-width of its error bar.
fn stands_out(c: &CovariateFigure) -> f64 {
    let Curve { y, low, high } = &c.means.before;
    let bars = low.iter().zip(high).map(|(low, high)| 0.5 * (high - low));
    let bins = y.iter().zip(bars).filter(|(_, bar)| *bar > 0.0);
    bins.map(|(y, bar)| (y / bar).abs()).fold(0.0, f64::max)
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

fn range(values: &[f64]) -> f64 {
    let (low, high) = ends(values.iter().copied());
    (high - low).max(0.0)
}

/// One parameter's mean misfit (per cent) in the bins of a covariate, as error bars.
pub(super) fn covariate(c: &CovariateFigure) -> Option<Figure> {
    let Compared { x: centre, before, after } = &c.means;
    let largest = centre.iter().copied().reduce(f64::max)?;
    let (by, unit) = match c.unit.as_str() {
        "s" => unit_of_time(largest),
        unit => (1.0, unit),
    };
    let x = match unit {
        "1" | "" => c.covariate.clone(),
        unit => format!("{}, {unit}", c.covariate),
    };
    let centre = scaled(centre, by);
    let low = ends(centre.iter().copied()).0;
    let high = low + range(&centre);
    let log = c.decades && low > 0.0 && high > WIDE * low;
    // the two bars of a bin, before and after, stand side by side
    let aside = |x: f64, sign: f64| match log {
        true => x * (high / low).powf(sign * ASIDE),
        false => x + sign * ASIDE * range(&centre).max(1e-9),
    };
    // a bar is two points, its lower and its upper end
    let bars = |name: &str, Curve { low, high, .. }: &Curve, sign: f64| {
        let edges = centre.iter().zip(low.iter().zip(high));
        let points = edges.flat_map(|(x, (low, high))| {
            let x = aside(*x, sign);
            [(x, 100.0 * low), (x, 100.0 * high)]
        });
        Series::new(name, Mark::Bars, points.collect())
    };
    Some(Figure::new(
        format!(
            "Against {}, {} spans {} % before and {} % after the extension",
            c.covariate,
            c.parameter,
            significant(100.0 * range(&before.y), 2),
            significant(100.0 * range(&after.y), 2)
        ),
        Axis { log, ..Axis::new(&x) },
        Axis::new(&format!("{} against the model, %", c.parameter)),
        vec![bars("before, 95 %", before, -1.0), bars("after, 95 %", after, 1.0)],
    ))
}

/// Distance of a bar from its bin's centre, as a share of the axis.
const ASIDE: f64 = 0.008;
/// Ratio of largest to smallest value from which on an axis of idle times is logarithmic.
const WIDE: f64 = 30.0;
