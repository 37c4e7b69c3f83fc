//! What faults do to a channel's own rates. In: class, severity, healthy rates. Out: faulty rates.
//!
//! thesis (2-1): a fault adds B_f f = A_f - A to A; here A_f itself is made, from the four rates
//! that it depends on, thesis (2-2)..(2-5) and §2-2 1)-4). Severities have the units of the
//! contract's `severity` column. The faults themselves are data: `faults.toml`, which also says where they depart.

use super::InkChannel;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::sync::OnceLock;

/// What a kind of fault does to the elements of a channel, as `faults.toml` writes it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Law {
    change: String,
    size: Size,
    #[serde(default)]
    restrictor_inertance: f64,
    #[serde(default)]
    restrictor_resistance: f64,
    #[serde(default)]
    nozzle_inertance: f64,
    #[serde(default)]
    nozzle_resistance: f64,
    #[serde(default)]
    compliance: f64,
    #[serde(default = "one")]
    resistances: f64,
    range: [f64; 2],
    /// Of what is no class: its probability a priori.
    #[serde(default)]
    pub weight: f64,
}

/// How a severity is counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Size {
    /// The share that is missing.
    Share,
    /// What is added, over what was there.
    Added,
    Factor,
}

fn one() -> f64 {
    1.0
}

/// All that is known to happen to a channel, by name.
fn laws() -> &'static BTreeMap<String, Law> {
    static LAWS: OnceLock<BTreeMap<String, Law>> = OnceLock::new();
    LAWS.get_or_init(|| {
        toml::from_str(include_str!("faults.toml")).expect("faults.toml is part of the program")
    })
}

fn law(name: &str) -> Option<&'static Law> {
    laws().get(name)
}

/// What happens to channels and is no class of faults, by name.
pub fn contrasts() -> impl Iterator<Item = (&'static str, &'static Law)> {
    laws().iter().filter(|(_, law)| law.weight > 0.0).map(|(name, law)| (name.as_str(), law))
}

/// What class `class` changes, written as scenario files write it; `None`: no such class.
pub fn change(class: &str) -> Option<&'static str> {
    law(class).map(|law| law.change.as_str())
}

/// The class in whose severity unit faults of all `classes` are measured: the first, if all of them are one
/// physical fault in different degrees. `None`: they are different faults, or one is unknown.
pub fn one_kind(classes: &[String]) -> Option<&str> {
    let first = classes.first()?;
    let kind = change(first)?;
    classes.iter().all(|class| change(class) == Some(kind)).then_some(first)
}

/// The severities that a class's name means; `None`: no such class.
pub fn severity_range(class: &str) -> Option<[f64; 2]> {
    law(class).map(|law| law.range)
}

/// The severity farthest from no fault of any class whose change is that of `class`; `None`: no such class.
pub fn largest(class: &str) -> Option<f64> {
    let Law { change, size, .. } = law(class)?;
    let alike = laws().values().filter(|law| law.change == *change);
    let farther = |a: f64, b: f64| if size.far(a) > size.far(b) { a } else { b };
    alike.map(|law| law.range[1]).reduce(farther)
}

impl Size {
    fn none(self) -> f64 {
        if self == Size::Factor { 1.0 } else { 0.0 }
    }

    fn far(self, severity: f64) -> f64 {
        (severity - self.none()).abs()
    }

    /// The factor that grows or shrinks with the severity.
    fn base(self, severity: f64) -> f64 {
        match self {
            Size::Share => 1.0 - severity,
            Size::Added => 1.0 + severity,
            Size::Factor => severity,
        }
    }
}

/// The coordinate of severity in which the prior is uniform: the logarithm of a factor (viscosity,
/// compliance), a share itself. `None`: no such class.
pub fn scale(class: &str, severity: f64) -> Option<f64> {
    Some(match law(class)?.size {
        Size::Share => severity,
        Size::Added => severity.ln_1p(),
        Size::Factor => severity.ln(),
    })
}

/// The severity at a coordinate of [`scale`], its inverse.
pub fn severity_at(class: &str, place: f64) -> Option<f64> {
    Some(match law(class)?.size {
        Size::Share => place,
        Size::Added => place.exp_m1(),
        Size::Factor => place.exp(),
    })
}

/// The severity at which a fault of this class would be none: the drying factor is 1, all others
/// are shares or additions. `None`: no such class.
pub fn no_fault_severity(class: &str) -> Option<f64> {
    law(class).map(|law| law.size.none())
}

/// The rates of `channel` with a fault of severity s, thesis (2-1). `None`: no such class, or a
/// severity that leaves no positive inertance, compliance or resistance.
pub fn apply(class: &str, severity: f64, channel: &InkChannel) -> Option<InkChannel> {
    let law = law(class)?;
    let base = law.size.base(severity);
    if base.is_nan() || base <= 0.0 {
        return None;
    }
    // whole powers to the last bit, whatever the machine's pow
    let to = |power: f64| match power.fract() == 0.0 {
        true => base.powi(power as i32),
        false => base.powf(power),
    };
    // a = 1 / (I_r B), b = 1 / (I_n B), g = R_r / I_r, d = R_n / I_n
    let on_a = to(-law.restrictor_inertance - law.compliance);
    let on_b = to(-law.nozzle_inertance - law.compliance);
    let on_g = law.resistances * to(law.restrictor_resistance - law.restrictor_inertance);
    let on_d = law.resistances * to(law.nozzle_resistance - law.nozzle_inertance);
    let InkChannel { a_per_s2: a, b_per_s2: b, g_per_s: g, d_per_s: d } = *channel;
    let physical = [on_a, on_b, on_g, on_d].iter().all(|f| *f > 0.0 && f.is_finite());
    physical.then_some(InkChannel {
        a_per_s2: a * on_a,
        b_per_s2: b * on_b,
        g_per_s: g * on_g,
        d_per_s: d * on_d,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fault::CLASSES;

    const NOMINAL: InkChannel = InkChannel::NOMINAL;

    fn poles(class: &str, severity: f64) -> (f64, f64) {
        let p = apply(class, severity, &NOMINAL).unwrap().poles().unwrap();
        (p.frequency_hz / 1e3, p.damping_per_s)
    }

    fn near(x: f64, expected: f64, relative: f64) -> bool {
        (x / expected - 1.0).abs() < relative
    }

    #[test]
    fn blocking_the_nozzle_lowers_the_frequency_and_damps_first_more_then_less() {
        for (s, khz) in [(0.0, 64.7), (0.2, 60.0), (0.6, 47.9), (0.95, 37.7)] {
            let class = if s < 0.9 { "PBN" } else { "BN" };
            assert!((poles(class, s).0 - khz).abs() < 0.051, "{s}: {}", poles(class, s).0);
        }
        assert!(near(poles("PBN", 0.6).1, 4.35e4, 0.01));
        assert!(near(poles("BN", 0.95).1, 1.0e4, 0.05));
    }

    #[test]
    fn drying_the_nozzle_damps_and_the_damping_peaks_near_six_fold_viscosity() {
        assert!(near(poles("SDN", 1.0).1, 2.9e4, 0.01));
        assert!(near(poles("IDN", 2.0).1, 5.5e4, 0.01));
        assert!(near(poles("DDN", 4.0).1, 1e5, 0.03));
        let damping = |x| poles("DDN", x).1;
        let peak = (40..90).map(|i| f64::from(i) / 10.0);
        let peak = peak.max_by(|x, y| damping(*x).total_cmp(&damping(*y))).unwrap();
        assert!((5.0..7.0).contains(&peak), "{peak}");
    }

    #[test]
    fn added_compliance_lowers_the_frequency_and_leaves_the_damping() {
        let (small, large) = (poles("AB2", 0.3), poles("AB3", 4.0));
        assert!(large.0 < 33.0 && large.0 < small.0 && small.0 < 60.0);
        assert!(
            near(small.1, 2.917e4, 0.03) && near(large.1, 2.917e4, 0.35),
            "{small:?} {large:?}"
        );
    }

    #[test]
    fn air_in_the_nozzle_and_an_emptied_channel_ring_faster() {
        assert!(poles("AB1", 0.2).0 > 67.0);
        assert!(poles("EC", 0.3).0 > 75.0);
        // and the emptied channel hardly damps, because its viscosity is gone with its density
        assert!(poles("EC", 0.3).1 < 1.4e4);
    }

    #[test]
    fn every_class_has_its_words_and_none_fault_is_the_healthy_channel() {
        for class in CLASSES {
            assert!(change(class).is_some());
            let none = apply(class, no_fault_severity(class).unwrap(), &NOMINAL).unwrap();
            // EC is the exception by definition: its viscosity factor 0.3 does not depend on s.
            assert_eq!(none == NOMINAL, class != "EC", "{class}");
        }
    }

    #[test]
    fn unphysical_severities_and_unknown_classes_are_none() {
        for (class, s) in [("EC", 1.0), ("AB1", 1.5), ("BN", 1.0), ("PBN", f64::NAN), ("DDN", 0.0)]
        {
            assert_eq!(apply(class, s, &NOMINAL), None, "{class} {s}");
        }
        assert_eq!(apply("AB2", f64::INFINITY, &NOMINAL), None);
        assert_eq!(apply("healthy", 0.0, &NOMINAL), None);
        assert_eq!(no_fault_severity("XYZ"), None);
    }
}
