//! Fig. 3-5 of the thesis: the columns of R, each the mean residual of a fault class.
//!
//! In: a part, from `thesis::write`. Out: an SVG document. The filter is that of the thesis's own design,
//! learned from the part.

use super::datasets::Part;
use super::measure::train;
use super::methods::{own_isolation, thesis_detect};
use super::outcome::ThesisError;
use crate::plot::{Axis, Figure, Mark, SIZE, Series};

/// The picture. Its title tells which class has the largest residual, and which the smallest.
pub fn picture(part: &Part) -> Result<String, ThesisError> {
    let design = train(&part.learn, &thesis_detect(part.mu), &own_isolation())?;
    // The filter is linear, so the residuals of the mean deviations are the mean residuals rho of §3-3-2.
    let each = design.classes.iter().zip(design.class_names()).map(|(class, name)| {
        let mut rho = vec![0.0; class.deviation.len()];
        design.pooled.generator.filter(&class.deviation, &mut rho);
        (name, rho)
    });
    let each: Vec<(String, Vec<f64>)> = each.collect();
    let energy = |rho: &[f64]| rho.iter().map(|r| r * r).sum::<f64>();
    let mut by_energy: Vec<(f64, &str)> =
        each.iter().map(|(name, rho)| (energy(rho), name.as_str())).collect();
    by_energy.sort_by(|a, b| a.0.total_cmp(&b.0));
    let [weakest, strongest] =
        [by_energy.first(), by_energy.last()].map(|of| of.map_or("", |(_, name)| name));

    let time_us = |k: usize| k as f64 * part.learn.sample_period_s * 1e6;
    let series = each.iter().map(|(name, rho)| {
        let points = rho.iter().enumerate().map(|(k, &r)| (time_us(k), r));
        Series::new(name, Mark::Line, points.collect())
    });
    let figure = Figure::new(
        format!(
            "R holds the mean residual of each of {} faults: {strongest} has the largest, {weakest} the smallest",
            each.len()
        ),
        Axis::new("time since acquisition began, µs"),
        Axis::new("mean residual rho, counts"),
        series.collect(),
    );
    figure.svg(SIZE).map_err(ThesisError::Data)
}
