//! Figures: one set of axes with points and lines. This is the only place that uses `plotters`.
//!
//! In: a `Figure` (title, axes, series). Out: an SVG document.
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

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// Small, transparent points, for many of them.
    Points,
    Line,
    /// Large points.
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
}

impl Series {
    pub fn new(name: &str, mark: Mark, points: Vec<(f64, f64)>) -> Series {
        Series { name: name.into(), mark, points }
    }
}

/// Width and height of a figure in pixels, where nothing else is asked for.
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
    pub fn new(title: String, x: Axis, y: Axis, series: Vec<Series>) -> Figure {
        Figure { title, x, y, series }
    }

    /// The figure as an SVG document of this width and height, pixels.
    pub fn svg(&self, size: (u32, u32)) -> Result<String, String> {
        let mut text = String::new();
        self.draw(SVGBackend::with_string(&mut text, size).into_drawing_area())?;
        Ok(text)
    }

    fn draw(&self, area: DrawingArea<SVGBackend, Shift>) -> Result<(), String> {
        area.fill(&WHITE).map_err(text)?;

        // The axes: ranges hold all points, unless the figure fixes them.
        let points = || self.series.iter().flat_map(|s| s.points.iter());
        let x = self.x.scale(points().map(|p| p.0));
        let y = self.y.scale(points().map(|p| p.1));
        let ends = [x.range(), y.range()];

        // The frame, the grid, then the series in their order, so that later ones lie above.
        let mut chart = ChartBuilder::on(&area)
            .caption(shown(&self.title), (FONT, 21))
            .margin(14)
            .x_label_area_size(54)
            .y_label_area_size(84)
            .build_cartesian_2d(x, y)
            .map_err(text)?;
        self.draw_mesh(&mut chart)?;
        for (series, colour) in self.series.iter().zip(self.colours()) {
            self.draw_series(&mut chart, &ends, series, colour)?;
        }

        // A legend is of use from two names on.
        let named = self.series.iter().filter(|s| !s.name.is_empty()).count();
        if named > 1 {
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
            .y_labels(10)
            .x_label_formatter(&|v| self.x.tick(*v))
            .y_label_formatter(&|v| self.y.tick(*v))
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
        // points that all lie outside the axes need no legend
        let is_seen = series.mark != Mark::Points
            || series.points.iter().any(|p| inside(&(self.x.at(p.0), self.y.at(p.1))));
        if is_seen && !series.name.is_empty() {
            drawn.label(shown(&series.name)).legend(move |(x, y)| {
                Rectangle::new([(x, y - 4), (x + 14, y + 4)], colour.filled())
            });
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
    fn a_figure_shows_its_title_and_labels() {
        let line = |name: &str, mark| {
            let points = (1..50).map(|k| (f64::from(k), f64::from(k * k)));
            Series::new(name, mark, points.collect())
        };
        let figure = Figure {
            title: "squares grow".into(),
            x: Axis::new("k"),
            y: Axis::log("k², counts"),
            series: vec![line("of <a>", Mark::Line), line("of b", Mark::Points)],
        };
        let svg = figure.svg(SIZE).unwrap();
        for words in ["squares grow", "k², counts", "of &lt;a&gt;", "of b"] {
            assert!(svg.contains(words), "{words}");
        }
    }
}
