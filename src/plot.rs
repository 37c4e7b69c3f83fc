//! Figures: one set of axes with points and lines. In: data and words. Out: SVG, PNG and the data
//! as CSV, under one name. The only door to `plotters`. Beside them [`raster`], pictures of cells, and
//! [`page`], what figures stand on.

pub mod page;
pub mod raster;

use plotters::coord::Shift;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};
use std::io::Write;
use std::ops::Range;
use std::path::Path;
use std::sync::Once;
use thiserror::Error;

#[derive(Debug, Error)]
pub enum PlotError {
    #[error("{path}: {message}")]
    Failed { path: String, message: String },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    Points,
    Line,
    /// Large points, told apart in the legend also on an axis of categories.
    Dots,
    /// The area between a lower edge and an upper one: its points go there and back. Where each other
    /// series has one, it has that one's colour.
    Band,
    /// Bars: each from a point to the next, with a dot in the middle.
    Bars,
    /// The same without dots: the middle is not what was measured.
    Spans,
}

#[derive(Clone, Debug)]
pub struct Series {
    pub name: String,
    pub mark: Mark,
    pub points: Vec<(f64, f64)>,
}

#[derive(Clone, Debug, Default)]
pub struct Axis {
    /// With the unit.
    pub label: String,
    pub log: bool,
    /// Names of the positions 0, 1, 2 ...; empty: numbers.
    pub categories: Vec<String>,
    /// `None`: what the data take.
    pub range: Option<(f64, f64)>,
}

impl Axis {
    pub fn new(label: &str) -> Axis {
        Axis { label: label.into(), ..Axis::default() }
    }
}

#[derive(Clone, Debug, Default)]
pub struct Figure {
    /// What it shows, as a finding.
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    pub series: Vec<Series>,
    /// Vertical lines: where, and what.
    pub thresholds: Vec<(f64, String)>,
}

const SIZE: (u32, u32) = (1000, 640);
const FONT: &str = "DejaVu Sans";
/// Told apart also without colour vision (Okabe and Ito 2008), then darker ones.
const COLOURS: [RGBColor; 10] = [
    RGBColor(0, 0, 0),
    RGBColor(213, 94, 0),
    RGBColor(0, 114, 178),
    RGBColor(0, 158, 115),
    RGBColor(230, 159, 0),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(150, 140, 0),
    RGBColor(120, 60, 20),
    RGBColor(130, 130, 130),
];

impl Figure {
    /// Writes `<name>.svg`, `<name>.png` and `<name>.csv` into `dir`.
    pub fn write(&self, dir: &Path, name: &str) -> Result<(), PlotError> {
        let path = |extension: &str| dir.join(format!("{name}.{extension}"));
        let failed = |path: &Path, message: String| PlotError::Failed {
            path: path.display().to_string(),
            message,
        };
        let csv = path("csv");
        self.write_csv(&csv).map_err(|e| failed(&csv, e.to_string()))?;
        let (svg, png) = (path("svg"), path("png"));
        self.draw(SVGBackend::new(&svg, SIZE).into_drawing_area()).map_err(|e| failed(&svg, e))?;
        self.draw(BitMapBackend::new(&png, SIZE).into_drawing_area()).map_err(|e| failed(&png, e))
    }

    /// The figure as an SVG document.
    pub fn svg(&self) -> Result<String, PlotError> {
        self.svg_of_size(SIZE)
    }

    /// The same, so many pixels wide and high.
    pub fn svg_of_size(&self, size: (u32, u32)) -> Result<String, PlotError> {
        let mut text = String::new();
        let drawn = self.draw(SVGBackend::with_string(&mut text, size).into_drawing_area());
        drawn.map_err(|message| PlotError::Failed { path: self.title.clone(), message })?;
        Ok(text)
    }

    fn write_csv(&self, path: &Path) -> std::io::Result<()> {
        let mut file = std::io::BufWriter::new(std::fs::File::create(path)?);
        let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
        writeln!(file, "series,{},{}", quoted(&self.x.label), quoted(&self.y.label))?;
        for series in &self.series {
            for (x, y) in &series.points {
                writeln!(file, "{},{x},{y}", quoted(&series.name))?;
            }
        }
        for (x, what) in &self.thresholds {
            writeln!(file, "{},{x},", quoted(what))?;
        }
        file.flush()
    }

    fn draw<B: DrawingBackend>(&self, area: DrawingArea<B, Shift>) -> Result<(), String> {
        static ONCE: Once = Once::new();
        ONCE.call_once(|| {
            // the crate's own bytes of a valid font: a failure shows below as a missing font
            let _ = register_font(FONT, FontStyle::Normal, dejavu::sans::regular());
        });
        let text = |e: DrawingAreaErrorKind<B::ErrorType>| e.to_string();
        area.fill(&WHITE).map_err(text)?;
        let xs = || self.series.iter().flat_map(|s| s.points.iter().map(|p| p.0));
        let marked = self.thresholds.iter().map(|t| t.0);
        let (x0, x1) = self.x.span(xs().chain(marked));
        let (y0, y1) = self.y.span(self.series.iter().flat_map(|s| s.points.iter().map(|p| p.1)));
        let mut chart = ChartBuilder::on(&area)
            .caption(&self.title, (FONT, 21))
            .margin(14)
            .x_label_area_size(54)
            // names of categories take the room of their letters
            .y_label_area_size(
                self.y
                    .categories
                    .iter()
                    .map(|c| 24 + 8 * c.len() as u32)
                    .fold(84, u32::max)
                    .min(320),
            )
            .build_cartesian_2d(
                Scale { low: x0, high: x1, ticks: self.x.ticks(x0, x1) },
                Scale { low: y0, high: y1, ticks: self.y.ticks(y0, y1) },
            )
            .map_err(text)?;
        let named = |axis: &Axis, v: &f64| axis.tick(*v);
        chart
            .configure_mesh()
            .light_line_style(RGBColor(240, 240, 240))
            .bold_line_style(RGBColor(220, 220, 220))
            .label_style((FONT, 16))
            .axis_desc_style((FONT, 18))
            .x_desc(&self.x.label)
            .y_desc(&self.y.label)
            .x_labels(9)
            .y_labels(self.y.categories.len().max(8) + 2)
            .x_label_formatter(&|v| named(&self.x, v))
            .y_label_formatter(&|v| named(&self.y, v))
            .draw()
            .map_err(text)?;
        let place = |p: &(f64, f64)| (self.x.at(p.0), self.y.at(p.1));
        let inside = |&(x, y): &(f64, f64)| (x0..=x1).contains(&x) && (y0..=y1).contains(&y);
        let bands = self.series.iter().filter(|s| s.mark == Mark::Band).count();
        let paired = 2 * bands == self.series.len();
        let (mut of_band, mut of_other) = (0, 0);
        for (k, series) in self.series.iter().enumerate() {
            let own = if series.mark == Mark::Band { &mut of_band } else { &mut of_other };
            let colour = COLOURS[if paired { *own } else { k } % COLOURS.len()];
            *own += 1;
            let points = series.points.iter().map(place);
            let drawn = match series.mark {
                Mark::Line => chart.draw_series(LineSeries::new(points, colour.stroke_width(2))),
                Mark::Points => chart.draw_series(
                    points.filter(inside).map(|p| Circle::new(p, 2, colour.mix(0.55).filled())),
                ),
                Mark::Dots => chart.draw_series(
                    points.filter(inside).map(|p| Circle::new(p, 5, colour.mix(0.8).filled())),
                ),
                Mark::Band => {
                    let area: Vec<(f64, f64)> = points.collect();
                    chart.draw_series([Polygon::new(area, colour.mix(0.18).filled())])
                }
                Mark::Bars | Mark::Spans => {
                    let ends: Vec<(f64, f64)> = points.collect();
                    let bars = ends.as_chunks::<2>().0.iter().map(|bar| bar.to_vec());
                    let style = colour.stroke_width(2);
                    let middles = ends
                        .as_chunks::<2>()
                        .0
                        .iter()
                        .map(|[p, q]| (0.5 * (p.0 + q.0), 0.5 * (p.1 + q.1)))
                        .filter(|at| series.mark == Mark::Bars && inside(at));
                    chart
                        .draw_series(middles.map(|at| Circle::new(at, 4, colour.filled())))
                        .map_err(text)?;
                    chart.draw_series(bars.map(|bar| PathElement::new(bar, style)))
                }
            };
            let drawn = drawn.map_err(text)?;
            // categories stand on their axis: no legend for them
            let named = self.y.categories.is_empty() || series.mark == Mark::Dots;
            if named && !series.name.is_empty() {
                drawn.label(&series.name).legend(move |(x, y)| {
                    Rectangle::new([(x, y - 4), (x + 14, y + 4)], colour.filled())
                });
            }
        }
        for (k, (x, what)) in self.thresholds.iter().enumerate() {
            // several belong to the series, one by one
            let colour = if self.thresholds.len() > 1 { COLOURS[k % COLOURS.len()] } else { RED };
            let x = self.x.at(*x);
            chart
                .draw_series(DashedLineSeries::new(
                    [(x, y0), (x, y1)],
                    8,
                    5,
                    colour.stroke_width(2),
                ))
                .map_err(text)?
                .label(what)
                .legend(move |(x, y)| {
                    PathElement::new([(x, y), (x + 14, y)], colour.stroke_width(2))
                });
        }
        let named = self.series.iter().filter(|s| !s.name.is_empty()).count();
        if named + self.thresholds.len() > 1 {
            chart
                .configure_series_labels()
                .position(SeriesLabelPosition::UpperRight)
                .background_style(WHITE.mix(0.85))
                .border_style(RGBColor(200, 200, 200))
                .label_font((FONT, 16))
                .draw()
                .map_err(text)?;
        }
        area.present().map_err(text)
    }
}

impl Axis {
    /// A value's place on the axis.
    fn at(&self, v: f64) -> f64 {
        if self.log { v.max(f64::MIN_POSITIVE).log10() } else { v }
    }

    fn span(&self, values: impl Iterator<Item = f64>) -> (f64, f64) {
        if let Some((low, high)) = self.range {
            return (self.at(low), self.at(high));
        }
        if !self.categories.is_empty() {
            return (-0.7, self.categories.len() as f64 - 0.3);
        }
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for v in values.filter(|v| v.is_finite()).map(|v| self.at(v)) {
            (low, high) = (low.min(v), high.max(v));
        }
        if low > high {
            return (0.0, 1.0);
        }
        let room = 0.04 * (high - low).max(1e-9 * (1.0 + high.abs()));
        (low - room, high + room)
    }

    fn tick(&self, v: f64) -> String {
        if !self.categories.is_empty() {
            let near = v.round();
            let on = (v - near).abs() < 1e-6 && near >= 0.0;
            return self.categories.get(near as usize).filter(|_| on).cloned().unwrap_or_default();
        }
        if self.log {
            let power = v.round();
            if (v - power).abs() < 1e-6 && !(-3.0..=5.0).contains(&power) {
                return format!("1e{}", power as i32);
            }
            return plain(10f64.powf(v));
        }
        plain(v)
    }

    /// Where the axis is written at, between two places on it.
    fn ticks(&self, low: f64, high: f64) -> Vec<f64> {
        if !self.categories.is_empty() {
            return (0..self.categories.len()).map(|k| k as f64).collect();
        }
        let span = high - low;
        if !(span > 0.0 && span.is_finite()) {
            return vec![low];
        }
        if self.log {
            let mantissas: &[f64] = match span {
                s if s < 0.9 => &[1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0],
                s if s < 1.8 => &[1.0, 1.5, 2.0, 3.0, 5.0, 7.0],
                s if s < 3.2 => &[1.0, 2.0, 5.0],
                _ => &[1.0],
            };
            let every = (span / MOST_TICKS).ceil().max(1.0) as i32;
            let decades = (low.floor() as i32)..=(high.ceil() as i32);
            let all = decades
                .filter(|d| d % every == 0)
                .flat_map(|d| mantissas.iter().map(move |m| f64::from(d) + m.log10()));
            return all.filter(|at| (low..=high).contains(at)).collect();
        }
        let rough = span / MOST_TICKS;
        let power = 10f64.powf(rough.log10().floor());
        let step = power
            * [1.0, 2.0, 2.5, 5.0, 10.0].into_iter().find(|m| m * power >= rough).unwrap_or(10.0);
        let first = (low / step).ceil() as i64;
        (0..=MOST_TICKS as i64 + 1)
            .map(|k| (first + k) as f64 * step)
            .take_while(|at| *at <= high + 1e-9 * span)
            .collect()
    }
}

/// An axis that is written at where we say.
struct Scale {
    low: f64,
    high: f64,
    ticks: Vec<f64>,
}

impl Ranged for Scale {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        RangedCoordf64::from(self.low..self.high).map(value, limit)
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() { Vec::new() } else { self.ticks.clone() }
    }

    fn range(&self) -> Range<f64> {
        self.low..self.high
    }
}

const MOST_TICKS: f64 = 8.0;

/// A number of an axis, without what rounding adds.
fn plain(v: f64) -> String {
    if v != 0.0 && !(1e-4..1e7).contains(&v.abs()) {
        return format!("{v:.2e}");
    }
    let text = format!("{v:.6}");
    let short = text.trim_end_matches('0').trim_end_matches('.');
    if short == "-0" { "0".into() } else { short.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_is_three_files_and_its_csv_holds_the_data() {
        let dir = tempfile::tempdir().unwrap();
        let line = |name: &str, mark| Series {
            name: name.into(),
            mark,
            points: (1..50).map(|k| (f64::from(k), f64::from(k * k))).collect(),
        };
        let figure = Figure {
            title: "squares grow".into(),
            x: Axis::new("k"),
            y: Axis { log: true, ..Axis::new("k², counts") },
            series: vec![line("a \"b\"", Mark::Line), line("c", Mark::Points)],
            thresholds: vec![(7.0, "seven".into())],
        };
        figure.write(dir.path(), "squares").unwrap();
        let read = |e: &str| std::fs::read(dir.path().join(format!("squares.{e}"))).unwrap();
        assert_eq!(&read("png")[1..4], b"PNG");
        let svg = String::from_utf8(read("svg")).unwrap();
        assert!(svg.contains("squares grow") && svg.contains("counts"));
        let csv = String::from_utf8(read("csv")).unwrap();
        assert_eq!(csv.lines().count(), 1 + 2 * 49 + 1);
        assert!(csv.starts_with("series,\"k\",\"k², counts\"\n\"a \"\"b\"\"\",1,1\n"));
    }

    #[test]
    fn a_directory_that_is_not_there_is_an_error_that_names_it() {
        let e = Figure::default().write(Path::new("not/there"), "x").unwrap_err();
        assert!(e.to_string().contains("there"));
    }
}
