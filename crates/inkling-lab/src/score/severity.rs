//! How well faults are sized: the stated severity and its standard deviation against the label's
//! severity.
//!
//! In: one signal after another (`SeverityScore::add`), from `inkling score`. Out: a `SeverityReport`
//! for each class or category: root mean square error, R2 and the coverage of the 95 % intervals.

use super::sums::named;
use serde::Serialize;
use std::collections::BTreeMap;

/// Figures of one class, over the signals that were labelled with a size and sized as this class.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SeverityReport {
    pub signals: u64,
    /// Root mean square error, in the unit of the class's severity.
    pub rmse: f64,
    /// Share of the labels' variance that the stated severities explain, 1 - (sum of squared
    /// errors) / (sum of squares of the labels about their mean); below 0 where the mean label
    /// would do better. Null where the labels do not vary.
    pub r2: Option<f64>,
    /// Share of the labels that lie within 1.96 stated standard deviations; null where none was stated.
    pub coverage95: Option<f64>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    n: u64,
    /// Mean of the labels and the sum of their squares about it (Welford).
    mean: f64,
    about_mean: f64,
    /// Sum of squared errors; number of signals with a stated standard deviation; and number of
    /// these whose label lies within 1.96 of it.
    squared_error: f64,
    stated: u64,
    covered: u64,
}

#[derive(Clone, Debug, Default)]
pub struct SeverityScore {
    by_class: BTreeMap<String, Sums>,
}

impl SeverityScore {
    /// Adds one signal that was sized as the class that it is: the stated size with its standard
    /// deviation, and the label's size. Sizes that are NaN or infinite are passed over.
    pub fn add(&mut self, class: &str, stated: f64, sd: Option<f64>, truth: f64) {
        if !(stated.is_finite() && truth.is_finite()) {
            return;
        }
        let sums = named(&mut self.by_class, class);
        sums.n += 1;

        // Welford's update does not lose digits where the labels vary little.
        let before = truth - sums.mean;
        sums.mean += before / sums.n as f64;
        sums.about_mean += before * (truth - sums.mean);
        let error = stated - truth;
        sums.squared_error += error * error;
        if let Some(sd) = sd.filter(|sd| sd.is_finite()) {
            sums.stated += 1;
            sums.covered += u64::from(error.abs() <= 1.96 * sd);
        }
    }

    pub fn report(&self) -> BTreeMap<String, SeverityReport> {
        let report = |s: &Sums| SeverityReport {
            signals: s.n,
            rmse: (s.squared_error / s.n as f64).sqrt(),
            r2: (s.about_mean > 0.0).then(|| 1.0 - s.squared_error / s.about_mean),
            coverage95: (s.stated > 0).then(|| s.covered as f64 / s.stated as f64),
        };
        self.by_class.iter().map(|(class, sums)| (class.clone(), report(sums))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_those_worked_by_hand() {
        let mut score = SeverityScore::default();
        for (stated, sd, truth) in [(1.0, 0.5, 1.5), (2.0, 0.1, 2.5), (3.0, 0.5, 2.0)] {
            score.add("SDN", stated, Some(sd), truth);
        }
        score.add("SDN", f64::NAN, None, 1.0);
        score.add("EC", 0.5, None, 0.5);
        let report = score.report();
        let sdn = &report["SDN"];
        assert!((sdn.rmse - (1.5f64 / 3.0).sqrt()).abs() < 1e-12);
        // labels 1.5, 2.5, 2: squares about their mean 0.5
        assert!((sdn.r2.unwrap() - (1.0 - 1.5 / 0.5)).abs() < 1e-12);
        assert_eq!((sdn.signals, sdn.coverage95), (3, Some(1.0 / 3.0)));
        assert_eq!((report["EC"].r2, report["EC"].coverage95), (None, None));
    }
}
