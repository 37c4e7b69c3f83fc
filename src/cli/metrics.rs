//! Metrics in Prometheus's text format: those of the live view (`/metrics`) and those that `inkling night` writes for
//! the textfile collector. Both have the same families of what is faulty and of what was not judged ([`Found`]).
//!
//! In: counts. Out: text (`docs/every_night.md` lists the families; `docs/alerts.yml` has rules for them).

use std::collections::BTreeMap;
use std::fmt::Write;

/// How every file of metrics begins.
pub const BEGIN: &str = "# HELP inkling_";

/// Number of channels by printhead and category.
pub type ByCategory<'a> = BTreeMap<(&'a str, &'a str), u64>;

/// What was found, and what could not be judged.
#[derive(Debug, Default)]
pub struct Found<'a> {
    /// Channels to clean that nobody has acknowledged; each printhead has an entry of 0 under an empty category, so
    /// that one without faults is there, too.
    pub open: ByCategory<'a>,
    /// Channels whose fault is acknowledged.
    pub known: ByCategory<'a>,
    /// Signals, judged or not, and those that were not judged by reason.
    pub signals: u64,
    pub rejected: BTreeMap<&'static str, u64>,
    pub newest_ns: Option<i64>,
}

/// The category of a fault as the value of a label.
pub fn category(of: Option<&str>) -> &str {
    of.unwrap_or("not_named")
}

impl Found<'_> {
    pub fn metrics(&self) -> Metrics {
        let mut metrics = Metrics::default();
        for (name, help, of) in [
            (
                "inkling_open_faults",
                "Channels with a fault that nobody has acknowledged.",
                &self.open,
            ),
            ("inkling_known_faults", "Channels with a fault that is acknowledged.", &self.known),
        ] {
            let series = of.iter().map(|((head, category), n)| {
                (vec![("printhead", *head), ("category", *category)], *n as f64)
            });
            metrics.family(name, "gauge", help, series);
        }
        metrics.one(
            "inkling_signals_total",
            "counter",
            "Signals judged or not.",
            self.signals as f64,
        );
        let of_reason = |(reason, n): (&&'static str, &u64)| (vec![("reason", *reason)], *n as f64);
        let rejected = self.rejected.iter().map(of_reason);
        metrics.family(
            "inkling_rejected_total",
            "counter",
            "Signals that were not judged.",
            rejected,
        );
        let newest = self.newest_ns.map(|ns| (Vec::new(), ns as f64 / 1e9));
        metrics.family("inkling_newest_burst_seconds", "gauge", "t_a of the newest burst.", newest);
        metrics
    }
}

/// Families of metrics, as text.
#[derive(Debug, Default)]
pub struct Metrics {
    pub text: String,
}

impl Metrics {
    /// Adds a family: its help, its type, and a line for each series, which are labels with their values.
    pub fn family<'a>(
        &mut self,
        name: &str,
        kind: &str,
        help: &str,
        series: impl IntoIterator<Item = (Vec<(&'a str, &'a str)>, f64)>,
    ) {
        let _ = writeln!(self.text, "# HELP {name} {help}\n# TYPE {name} {kind}");
        for (labels, value) in series {
            let pair = |(name, value): &(&str, &str)| format!("{name}=\"{}\"", escaped(value));
            let labels = labels.iter().map(pair).collect::<Vec<_>>().join(",");
            let labels = if labels.is_empty() { labels } else { format!("{{{labels}}}") };
            let _ = writeln!(self.text, "{name}{labels} {value}");
        }
    }

    /// Adds a family of one series.
    pub fn one(&mut self, name: &str, kind: &str, help: &str, value: f64) {
        self.family(name, kind, help, [(Vec::new(), value)]);
    }
}

/// A text as the value of a label.
fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}
