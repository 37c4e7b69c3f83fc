//! What faults do to a channel's own rates. In: class, severity, healthy rates. Out: faulty rates.
//!
//! thesis (2-1): a fault adds B_f f = A_f - A to A; here A_f itself is made, from the four rates
//! that it depends on, thesis (2-2)..(2-5) and §2-2 1)-4). Severities have the units of the
//! contract's `severity` column.
//!
//! Departs: thesis §2-2 1) has an empty channel as a loss of density alone; that raises damping, so
//! viscosity is lost with it. §2-2 2) says that a blocked nozzle damps more; beyond about half the
//! cross-section it damps less again, because the nozzle takes no part any more.

use super::InkChannel;

/// What each class changes, written as scenario files write it. [`apply`] computes exactly this, and a
/// scenario that states anything else is refused.
const CHANGES: [(&str, &str); 9] = [
    ("EC", "q = 1 - s; viscosity falls with it, by 0.3 q: a, b / q; g, d * 0.3"),
    ("AB1", "b / (1 - s); d unchanged (R_n and I_n shrink together)"),
    ("AB2", "a, b / (1 + s)"),
    ("AB3", "a, b / (1 + s)"),
    ("BN", "b * (1 - s); d / (1 - s)"),
    ("PBN", "b * (1 - s); d / (1 - s)"),
    ("SDN", "d * s"),
    ("IDN", "d * s"),
    ("DDN", "d * s"),
];

/// What class `class` changes, written as scenario files write it; `None`: no such class.
pub fn change(class: &str) -> Option<&'static str> {
    CHANGES.iter().find(|(name, _)| *name == class).map(|(_, change)| *change)
}

/// The class in whose severity unit faults of all `classes` are measured: the first, if all of them are one
/// physical fault in different degrees. `None`: they are different faults, or one is unknown.
pub fn one_kind(classes: &[String]) -> Option<&str> {
    let first = classes.first()?;
    let kind = change(first)?;
    classes.iter().all(|class| change(class) == Some(kind)).then_some(first)
}

/// Which severities a class's name means: classes with the same `change` differ in severity alone.
///
/// Departs: thesis §2-2 names degrees of drying and blockage without numbers. A nozzle is dried
/// slightly up to half an octave of viscosity, deeply from one octave on; blocked from four fifths of
/// its cross-section on; a bubble is large where it yields more than the chamber itself. The outer
/// ends are what a channel can still ring with.
const RANGES: [(&str, [f64; 2]); 9] = [
    ("EC", [0.05, 0.6]),
    ("AB1", [0.02, 0.6]),
    ("AB2", [0.03, 1.0]),
    ("AB3", [1.0, 6.0]),
    ("BN", [0.8, 0.999]),
    ("PBN", [0.02, 0.8]),
    ("SDN", [1.03, std::f64::consts::SQRT_2]),
    ("IDN", [std::f64::consts::SQRT_2, 2.0]),
    ("DDN", [2.0, 8.0]),
];

/// The severities that a class's name means; `None`: no such class.
pub fn severity_range(class: &str) -> Option<[f64; 2]> {
    RANGES.iter().find(|(name, _)| *name == class).map(|(_, range)| *range)
}

/// The largest severity of any class whose change is that of `class`; `None`: no such class.
pub fn largest(class: &str) -> Option<f64> {
    let kind = change(class)?;
    let alike = RANGES.iter().filter(|(name, _)| change(name) == Some(kind));
    alike.map(|(_, [_, most])| *most).reduce(f64::max)
}

/// The coordinate of severity in which the prior is uniform: the logarithm of a factor (viscosity,
/// compliance), a share itself. `None`: no such class.
pub fn scale(class: &str, severity: f64) -> Option<f64> {
    change(class)?;
    Some(match class {
        "SDN" | "IDN" | "DDN" => severity.ln(),
        "AB2" | "AB3" => severity.ln_1p(),
        _ => severity,
    })
}

/// The severity at a coordinate of [`scale`], its inverse.
pub fn severity_at(class: &str, place: f64) -> Option<f64> {
    change(class)?;
    Some(match class {
        "SDN" | "IDN" | "DDN" => place.exp(),
        "AB2" | "AB3" => place.exp_m1(),
        _ => place,
    })
}

/// The severity at which a fault of this class would be none: the drying factor is 1, all others
/// are shares or additions. `None`: no such class.
pub fn no_fault_severity(class: &str) -> Option<f64> {
    change(class)?;
    Some(if matches!(class, "SDN" | "IDN" | "DDN") { 1.0 } else { 0.0 })
}

/// The rates of `channel` with a fault of severity s, thesis (2-1). `None`: no such class, or a
/// severity that leaves no positive inertance, compliance or resistance.
pub fn apply(class: &str, severity: f64, channel: &InkChannel) -> Option<InkChannel> {
    let s = severity;
    let InkChannel { a_per_s2: a, b_per_s2: b, g_per_s: g, d_per_s: d } = *channel;
    // (factor on a, on b, on g, on d)
    let (on_a, on_b, on_g, on_d) = match class {
        // I = rho L/A: a, b ~ 1/q. R/I = 8 pi (mu/rho)/A with mu -> 0.3 q mu, rho -> q rho.
        "EC" => (1.0 / (1.0 - s), 1.0 / (1.0 - s), 0.3, 0.3),
        // I_n, R_n ~ the length of ink that remains in the nozzle.
        "AB1" => (1.0, 1.0 / (1.0 - s), 1.0, 1.0),
        "AB2" | "AB3" => (1.0 / (1.0 + s), 1.0 / (1.0 + s), 1.0, 1.0),
        // I_n ~ 1/A_n, R_n ~ 1/A_n^2.
        "BN" | "PBN" => (1.0, 1.0 - s, 1.0, 1.0 / (1.0 - s)),
        "SDN" | "IDN" | "DDN" => (1.0, 1.0, 1.0, s),
        _ => return None,
    };
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
