//! Figures: one set of axes with points and lines. This is the only place that uses `plotters`.
//!
//! In: a `Figure` (title, axes, series, thresholds). Out: with `write` an SVG and the data as CSV under
//! one name; with `svg` an SVG document for a page.
//!
//! Beside figures there are [`raster`], pictures made of cells, [`digits`], numbers for readers, and
//! [`page`], the page that figures stand on.

mod axis;
pub mod digits;
pub mod page;
pub mod raster;

pub use axis::{Axis, unit_of_time};

use axis::Scale;
use plotters::coord::Shift;
use plotters::prelude::*;
use std::ops::Range;
use std::path::Path;
use thiserror::Error;

/// A figure could not be drawn or written to the file at `path`.
#[derive(Debug, Error)]
#[error("{path}: {message}")]
pub struct PlotError {
    path: String,
    message: String,
}

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// Small, transparent points, for many of them.
    Points,
    Line,
    /// Large points, which the legend tells apart even on an axis of categories.
    Dots,
    /// The area between a lower edge and an upper one: its points go along one and back along the other.
    /// Where every other series has a band, the band has the colour of its series.
    Band,
    /// Bars, each from one point to the next (so points come in pairs), with a dot in the middle.
    Bars,
}

/// Points (x, y) that are drawn alike, under one name. A series with an empty name is not in the
/// legend.
#[derive(Clone, Debug)]
pub struct Series {
    pub name: String,
    pub mark: Mark,
    pub points: Vec<(f64, f64)>,
}

/// One set of axes with all that is drawn on them.
#[derive(Clone, Debug, Default)]
pub struct Figure {
    /// What the figure shows, as a finding.
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    pub series: Vec<Series>,
    /// Vertical lines: the place on the x axis and the name of each.
    pub thresholds: Vec<(f64, String)>,
}

impl Series {
    pub fn new(name: &str, mark: Mark, points: Vec<(f64, f64)>) -> Series {
        Series { name: name.into(), mark, points }
    }

    /// Samples `y` over the time since the first one, µs.
    pub fn over_time(name: &str, mark: Mark, y: &[f64], dt_s: f64) -> Series {
        let points = y.iter().enumerate().map(|(k, &v)| (k as f64 * dt_s * 1e6, v));
        Series::new(name, mark, points.collect())
    }
}

/// Width and height in pixels of a figure that is written.
pub const SIZE: (u32, u32) = (1000, 640);
const FONT: &str = "DejaVu Sans";
/// Colours that can be told apart without colour vision, too (Okabe and Ito 2008), then darker ones.
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
    /// A figure without vertical lines.
    pub fn new(title: String, x: Axis, y: Axis, series: Vec<Series>) -> Figure {
        Figure { title, x, y, series, thresholds: Vec::new() }
    }

    /// A figure of series that are made by [`Series::over_time`]. `y`: the label of the y axis.
    pub fn over_time(title: String, y: &str, series: Vec<Series>) -> Figure {
        Figure::new(title, Axis::new("time since acquisition began, µs"), Axis::new(y), series)
    }

    /// Writes `<name>.svg` and `<name>.csv` into `dir`.
    pub fn write(&self, dir: &Path, name: &str) -> Result<(), PlotError> {
        let files =
            [("csv", Ok(self.csv().into_bytes())), ("svg", self.svg(SIZE).map(String::into_bytes))];
        for (extension, contents) in files {
            let path = dir.join(format!("{name}.{extension}"));
            contents
                .and_then(|bytes| std::fs::write(&path, bytes).map_err(|e| e.to_string()))
                .map_err(|message| PlotError { path: path.display().to_string(), message })?;
        }
        Ok(())
    }

    /// The figure as an SVG document of this width and height, pixels.
    pub fn svg(&self, size: (u32, u32)) -> Result<String, String> {
        let mut text = String::new();
        self.draw(SVGBackend::with_string(&mut text, size).into_drawing_area())?;
        Ok(text)
    }

    /// All points as rows `series,x,y`, and after them the thresholds, which have no y.
    fn csv(&self) -> String {
        let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
        let mut text = format!("series,{},{}\n", quoted(&self.x.label), quoted(&self.y.label));
        for series in &self.series {
            let name = quoted(&series.name);
            text.extend(series.points.iter().map(|(x, y)| format!("{name},{x},{y}\n")));
        }
        text.extend(self.thresholds.iter().map(|(x, what)| format!("{},{x},\n", quoted(what))));
        text
    }

    fn draw(&self, area: DrawingArea<SVGBackend, Shift>) -> Result<(), String> {
        area.fill(&WHITE).map_err(text)?;

        // The axes: ranges hold all points and thresholds, unless the figure fixes them.
        let points = || self.series.iter().flat_map(|s| s.points.iter());
        let marked = self.thresholds.iter().map(|t| t.0);
        let x = self.x.scale(points().map(|p| p.0).chain(marked));
        let y = self.y.scale(points().map(|p| p.1));
        let ends = [x.range(), y.range()];
        // the y axis is as wide as the longest name of a category
        let names = self.y.categories.iter().map(|c| 24 + 8 * c.len() as u32);

        // The frame, the grid, then the series in their order, so that later ones lie above.
        let mut chart = ChartBuilder::on(&area)
            .caption(shown(&self.title), (FONT, 21))
            .margin(14)
            .x_label_area_size(54)
            .y_label_area_size(names.fold(84, u32::max).min(320))
            .build_cartesian_2d(x, y)
            .map_err(text)?;
        self.draw_mesh(&mut chart)?;
        for (series, colour) in self.series.iter().zip(self.colours()) {
            self.draw_series(&mut chart, &ends, series, colour)?;
        }
        self.draw_thresholds(&mut chart, &ends)?;

        // A legend is of use from two names on.
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

    /// Draws the grid, the ticks and the labels of the axes.
    fn draw_mesh(&self, chart: &mut Chart) -> Result<(), String> {
        chart
            .configure_mesh()
            .light_line_style(RGBColor(240, 240, 240))
            .bold_line_style(RGBColor(220, 220, 220))
            .label_style((FONT, 16))
            .axis_desc_style((FONT, 18))
            .x_desc(shown(&self.x.label))
            .y_desc(shown(&self.y.label))
            .x_labels(9)
            .y_labels(self.y.categories.len().max(8) + 2)
            .x_label_formatter(&|v| self.x.tick(*v))
            .y_label_formatter(&|v| shown(&self.y.tick(*v)))
            .draw()
            .map_err(text)
    }

    /// The colour of each series: one of its own, or, if every other series is a band, the same for
    /// a series and its band, the first band with the first other series and so on.
    fn colours(&self) -> Vec<RGBColor> {
        let is_band = |s: &Series| s.mark == Mark::Band;
        let paired = 2 * self.series.iter().filter(|s| is_band(s)).count() == self.series.len();
        let (mut bands, mut others) = (0, 0);
        let colour = |(k, series): (usize, &Series)| {
            let of_kind = if is_band(series) { &mut bands } else { &mut others };
            let place = if paired { *of_kind } else { k };
            *of_kind += 1;
            COLOURS[place % COLOURS.len()]
        };
        self.series.iter().enumerate().map(colour).collect()
    }

    /// Draws one series, and puts it into the legend where that tells something. Points and dots
    /// outside the axes are not drawn.
    fn draw_series(
        &self,
        chart: &mut Chart,
        ends: &Ends,
        series: &Series,
        colour: RGBColor,
    ) -> Result<(), String> {
        let points = series.points.iter().map(|p| (self.x.at(p.0), self.y.at(p.1)));
        let circle = |p, radius, opacity| Circle::new(p, radius, colour.mix(opacity).filled());
        let inside = |p: &(f64, f64)| {
            let within = |end: &Range<f64>, v: &f64| (end.start..=end.end).contains(v);
            within(&ends[0], &p.0) && within(&ends[1], &p.1)
        };
        let drawn = match series.mark {
            Mark::Line => chart.draw_series(LineSeries::new(points, colour.stroke_width(2))),
            Mark::Points => chart.draw_series(points.filter(inside).map(|p| circle(p, 2, 0.55))),
            Mark::Dots => chart.draw_series(points.filter(inside).map(|p| circle(p, 5, 0.8))),
            Mark::Band => {
                let area: Vec<(f64, f64)> = points.collect();
                chart.draw_series([Polygon::new(area, colour.mix(0.18).filled())])
            }
            Mark::Bars => {
                // one bar for each two points
                let edges: Vec<(f64, f64)> = points.collect();
                let bars = edges.as_chunks::<2>().0;
                let middles =
                    bars.iter().map(|[p, q]| (0.5 * (p.0 + q.0), 0.5 * (p.1 + q.1))).filter(inside);
                chart
                    .draw_series(middles.map(|at| Circle::new(at, 4, colour.filled())))
                    .map_err(text)?;
                let style = colour.stroke_width(2);
                chart.draw_series(bars.iter().map(|bar| PathElement::new(bar.to_vec(), style)))
            }
        };
        let drawn = drawn.map_err(text)?;
        // on an axis of categories the names stand on the axis, so no legend repeats them, but for dots
        let named = self.y.categories.is_empty() || series.mark == Mark::Dots;
        // points that all lie outside the axes need no legend either
        let is_seen = series.mark != Mark::Points
            || series.points.iter().any(|p| inside(&(self.x.at(p.0), self.y.at(p.1))));
        if named && is_seen && !series.name.is_empty() {
            drawn.label(shown(&series.name)).legend(move |(x, y)| {
                Rectangle::new([(x, y - 4), (x + 14, y + 4)], colour.filled())
            });
        }
        Ok(())
    }

    /// Draws the vertical lines, dashed, over the whole height.
    fn draw_thresholds(&self, chart: &mut Chart, ends: &Ends) -> Result<(), String> {
        for (k, (x, what)) in self.thresholds.iter().enumerate() {
            // several thresholds belong to the series one by one, and have the colours of these; a
            // single one is red
            let colour = if self.thresholds.len() > 1 { COLOURS[k % COLOURS.len()] } else { RED };
            let (x, style) = (self.x.at(*x), colour.stroke_width(2));
            let line = DashedLineSeries::new([(x, ends[1].start), (x, ends[1].end)], 8, 5, style);
            chart
                .draw_series(line)
                .map_err(text)?
                .label(shown(what))
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 14, y)], style));
        }
        Ok(())
    }
}

type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<Scale, Scale>>;

/// From the lowest to the highest coordinate of the x axis, and of the y axis.
type Ends = [Range<f64>; 2];

/// A text as figures show it: at most 200 characters, all of them inert. SVG escapes markup, and lets others through.
fn shown(text: &str) -> String {
    text.chars().map(inert).take(200).collect()
}

/// The character, or the replacement character in place of one that controls something (a line end, too) or
/// turns the direction of reading.
fn inert(c: char) -> char {
    match c {
        '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => '\u{fffd}',
        c if c.is_control() => '\u{fffd}',
        c => c,
    }
}

/// The words of the backend's error.
fn text(e: DrawingAreaErrorKind<std::io::Error>) -> String {
    e.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_is_two_files_and_its_csv_holds_the_data() {
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
        let svg = String::from_utf8(read("svg")).unwrap();
        assert!(svg.contains("squares grow") && svg.contains("counts"));
        let csv = String::from_utf8(read("csv")).unwrap();
        assert_eq!(csv.lines().count(), 1 + 2 * 49 + 1);
        assert!(csv.starts_with("series,\"k\",\"k², counts\"\n\"a \"\"b\"\"\",1,1\n"));
    }
}
