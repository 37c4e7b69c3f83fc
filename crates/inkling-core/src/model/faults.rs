//! What faults do to a channel's rates: the laws of `faults.toml`, and those that a user adds.
//!
//! In: the name of a class (or of what else happens to channels), a severity, the healthy rates.
//! Out: the faulty rates. thesis (2-1): a fault adds B_f f = A_f - A to A. Here A_f itself is
//! computed, by its four rates, thesis (2-2)..(2-5) and §2-2 1)-4). A law gives each of the
//! channel's five elements (I_r, R_r, I_n, R_n, B_t) a power p. A fault of severity s multiplies
//! the element by u^p, where u is 1 - s, 1 + s or s, depending on how the law counts severities
//! (`Size`). Severities have the units of the contract's `severity` column. Where the laws depart
//! from the thesis stands in `faults.toml`.

use super::InkChannel;
use crate::fault::{Categories, is_reserved};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::OnceLock;

/// A table of `faults.toml` or `[isolate.physics]`: what a fault does to a channel's elements.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Law {
    /// The change in words, as scenario files state it; only in `faults.toml`.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub change: String,
    size: Size,
    /// The powers of u by which the elements are multiplied; 0 leaves an element as it is.
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
    /// The power of u by which the signal itself is multiplied.
    #[serde(default)]
    amplitude: f64,
    /// A factor on both resistances, whatever the severity.
    #[serde(default = "one")]
    resistances: f64,
    /// The severities that the name means, the one nearer to no fault first.
    pub range: [f64; 2],
    /// 0: the law is a class of faults. Above 0: it is a contrast, something else that happens to
    /// channels; the weight is its probability a priori, of all that is flagged.
    #[serde(default)]
    pub weight: f64,
    /// The category of the class; absent: the class is its own category.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub category: Option<String>,
    /// What the severity counts, in words that follow the number, such as `of the nozzle's mass`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Size {
    /// As the share that is missing: u = 1 - s.
    Share,
    /// As what is added, over what was there: u = 1 + s.
    Added,
    /// As the factor itself: u = s, and 1 is no fault.
    Factor,
}

fn one() -> f64 {
    1.0
}

fn laws() -> &'static BTreeMap<String, Law> {
    static LAWS: OnceLock<BTreeMap<String, Law>> = OnceLock::new();
    LAWS.get_or_init(|| {
        toml::from_str(include_str!("faults.toml")).expect("faults.toml is part of the program")
    })
}

/// The laws of `faults.toml` and a user's own (`[isolate.physics]`), which alone are stored.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Catalogue {
    own: BTreeMap<String, Law>,
}

impl Catalogue {
    pub fn is_empty(&self) -> bool {
        self.own.is_empty()
    }

    pub fn law(&self, name: &str) -> Option<&Law> {
        self.own.get(name).or_else(|| laws().get(name))
    }

    /// Adds a law that says nothing but which sizes a user's own class has, the least one first.
    pub fn add_sizes(&mut self, class: &str, range: [f64; 2]) {
        let law = Law {
            change: class.into(),
            size: Size::Added,
            restrictor_inertance: 0.0,
            restrictor_resistance: 0.0,
            nozzle_inertance: 0.0,
            nozzle_resistance: 0.0,
            compliance: 0.0,
            amplitude: 0.0,
            resistances: 1.0,
            range,
            weight: 0.0,
            category: None,
            unit: None,
        };
        self.own.insert(class.into(), law);
    }

    pub fn forget(&mut self, own_class: &str) {
        self.own.remove(own_class);
    }

    pub fn own_classes(&self) -> impl Iterator<Item = &str> {
        self.own.iter().filter(|(_, law)| law.weight == 0.0).map(|(name, _)| name.as_str())
    }

    pub fn contrasts(&self) -> impl Iterator<Item = (&str, &Law)> {
        let all = laws().iter().chain(&self.own).filter(|(_, law)| law.weight > 0.0);
        all.map(|(name, law)| (name.as_str(), law))
    }

    /// The class in whose severity unit faults of all `classes` are measured: the first one.
    /// `None`: they are not one physical fault in different degrees, or one is unknown.
    pub fn one_kind<'a>(&self, classes: &'a [String]) -> Option<&'a str> {
        let first = classes.first()?;
        let kind = self.law(first)?;
        let alike = |class| self.law(class).is_some_and(|law| law.is_kind_of(kind));
        classes.iter().all(|class| alike(class)).then_some(first)
    }

    /// The farthest severity in all laws of the kind of `of`: a fault may outgrow its class.
    pub fn largest(&self, of: &Law) -> f64 {
        let alike = laws().values().chain(self.own.values()).filter(|law| law.is_kind_of(of));
        let farther = |a: f64, b: f64| if of.scale(a).abs() > of.scale(b).abs() { a } else { b };
        alike.map(|law| law.range[1]).fold(of.range[1], farther)
    }

    pub fn categories(&self) -> Categories {
        let declared = |(name, law): (&String, &Law)| Some((name.clone(), law.category.clone()?));
        Categories(self.own.iter().filter_map(declared).collect())
    }

    pub fn check(&self) -> Result<(), String> {
        for (name, law) in &self.own {
            if name.is_empty() || is_reserved(name) || laws().contains_key(name) {
                return Err(format!("\"{name}\": that name has a meaning already; give another"));
            }
            law.check().map_err(|why| format!("\"{name}\": {why}"))?;
        }
        let no_class: f64 = self.own.values().map(|law| law.weight).sum();
        if no_class <= MOST_WEIGHT {
            return Ok(());
        }
        Err(format!(
            "the weights of what is no class add up to {no_class}; give {MOST_WEIGHT} at most, so \
             that faults of known classes remain likelier"
        ))
    }
}

/// Largest total weight of a user's laws that are no classes. With what is there already (.09 in
/// `faults.toml`, .09 in `isolate/alternatives.rs`) that is below two fifths of what is flagged.
const MOST_WEIGHT: f64 = 0.2;
/// Largest accepted power: those of thesis (2-3), (2-4) are at most 2, or 4 in a diameter.
const MOST_POWER: f64 = 4.0;

impl Law {
    fn check(&self) -> Result<(), String> {
        let powers = self.powers();
        if let Some(power) = powers.iter().find(|p| p.is_nan() || p.abs() > MOST_POWER) {
            return Err(format!("power {power}: give -{MOST_POWER} to {MOST_POWER}"));
        }
        if powers.iter().all(|power| *power == 0.0) {
            return Err(
                "changes nothing: give at least one of restrictor_inertance, restrictor_resistance, \
                 nozzle_inertance, nozzle_resistance, compliance, amplitude (the power to which it goes)"
                    .into(),
            );
        }
        if !(0.01..=100.0).contains(&self.resistances) {
            return Err(format!("resistances = {}: give 0.01 to 100", self.resistances));
        }

        // both ends on one side of no fault, the nearer one first, and u positive at both
        let [near, far] = self.range;
        let none = self.none();
        let is_one_side = (near - none) * (far - none) >= 0.0;
        let grows = self.scale(far).abs() > self.scale(near).abs();
        let is_possible = self.base(far) > 0.0 && self.base(near) > 0.0;
        if !(is_one_side && grows && is_possible && far.abs() <= 1e3) {
            return Err(format!(
                "range = [{near}, {far}]: give the severities that the name means, the end nearer to no fault \
                 ({none}) first, both on one side of it{}",
                match self.size {
                    Size::Share => ", shares below 1",
                    Size::Added => ", above -1",
                    Size::Factor => ", factors above 0",
                }
            ));
        }

        if !(0.0..=MOST_WEIGHT).contains(&self.weight) {
            return Err(format!("weight = {}: give 0 to {MOST_WEIGHT}", self.weight));
        }
        if [&self.category, &self.unit].into_iter().flatten().any(|word| word.trim().is_empty()) {
            return Err("category or unit is empty: give words, or leave it out".into());
        }
        if self.weight > 0.0 && self.category.is_some() {
            return Err(
                "what has a weight is no class, and has no category: leave one of them out".into(),
            );
        }
        Ok(())
    }

    fn powers(&self) -> [f64; 6] {
        [
            self.restrictor_inertance,
            self.restrictor_resistance,
            self.nozzle_inertance,
            self.nozzle_resistance,
            self.compliance,
            self.amplitude,
        ]
    }

    pub fn is_kind_of(&self, other: &Law) -> bool {
        let grows = |law: &Law| law.range[1] > law.none();
        let same = self.size == other.size && self.resistances == other.resistances;
        let alike = same && self.powers() == other.powers() && grows(self) == grows(other);
        // laws that say nothing are of the class alone after which they are called
        alike && (!self.changes_nothing() || self.change == other.change)
    }

    pub fn changes_nothing(&self) -> bool {
        self.powers() == [0.0; 6] && self.resistances == 1.0
    }

    pub fn none(&self) -> f64 {
        if self.size == Size::Factor { 1.0 } else { 0.0 }
    }

    fn base(&self, severity: f64) -> f64 {
        match self.size {
            Size::Share => 1.0 - severity,
            Size::Added => 1.0 + severity,
            Size::Factor => severity,
        }
    }

    /// The coordinate in which isolation's prior is uniform: a share itself, else ln u.
    pub fn scale(&self, severity: f64) -> f64 {
        match self.size {
            Size::Share => severity,
            Size::Added => severity.ln_1p(),
            Size::Factor => severity.ln(),
        }
    }

    pub fn severity_at(&self, place: f64) -> f64 {
        match self.size {
            Size::Share => place,
            Size::Added => place.exp_m1(),
            Size::Factor => place.exp(),
        }
    }

    pub fn middle(&self) -> f64 {
        let [one, other] = self.range.map(|severity| self.scale(severity));
        self.severity_at(0.5 * (one + other))
    }

    fn to(&self, severity: f64, power: f64) -> f64 {
        let base = self.base(severity);
        // whole powers are the same to the last bit, whatever the machine's pow is
        match power.fract() == 0.0 {
            true => base.powi(power as i32),
            false => base.powf(power),
        }
    }

    /// The factor on the signal itself, beside what the change of the rates does to it.
    pub fn gain(&self, severity: f64) -> f64 {
        self.to(severity, self.amplitude)
    }

    /// The rates with a fault, thesis (2-1). `None`: one would not be positive and finite.
    pub fn apply(&self, severity: f64, channel: &InkChannel) -> Option<InkChannel> {
        let base = self.base(severity);
        if base.is_nan() || base <= 0.0 {
            return None;
        }

        // a = 1 / (I_r B), b = 1 / (I_n B), g = R_r / I_r, d = R_n / I_n
        let to = |power: f64| self.to(severity, power);
        let by = [
            to(-self.restrictor_inertance - self.compliance),
            to(-self.nozzle_inertance - self.compliance),
            self.resistances * to(self.restrictor_resistance - self.restrictor_inertance),
            self.resistances * to(self.nozzle_resistance - self.nozzle_inertance),
        ];
        by.iter().all(|f| *f > 0.0 && f.is_finite()).then(|| channel.times(by))
    }
}

pub fn law(class: &str) -> Option<&'static Law> {
    laws().get(class)
}

/// [`Law::apply`] of a law of `faults.toml`; `None`: also where there is no such law.
pub fn apply(class: &str, severity: f64, channel: &InkChannel) -> Option<InkChannel> {
    law(class)?.apply(severity, channel)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fault::CLASSES;

    const NOMINAL: InkChannel = InkChannel::NOMINAL;

    /// Frequency, kHz, and damping, 1/s, of the nominal channel with a fault.
    fn poles(class: &str, severity: f64) -> (f64, f64) {
        let p = apply(class, severity, &NOMINAL).unwrap().poles().unwrap();
        (p.frequency_hz / 1e3, p.damping_per_s)
    }

    /// Frequencies, kHz, and dampings, 1/s, of the nominal channel (64.7 kHz, 2.92e4 /s) with a
    /// fault: from the first to the second.
    #[test]
    fn each_fault_moves_the_poles_as_published() {
        const ANY: [f64; 2] = [0.0, f64::INFINITY];
        for (class, severity, khz, damping) in [
            // a blocked nozzle lowers the frequency, and damps first more and then less
            ("PBN", 0.0, [64.649, 64.751], ANY),
            ("PBN", 0.2, [59.949, 60.051], ANY),
            ("PBN", 0.6, [47.849, 47.951], [4.3065e4, 4.3935e4]),
            ("BN", 0.95, [37.649, 37.751], [0.95e4, 1.05e4]),
            // a dried one damps
            ("SDN", 1.0, ANY, [2.871e4, 2.929e4]),
            ("IDN", 2.0, ANY, [5.445e4, 5.555e4]),
            ("DDN", 4.0, ANY, [0.97e5, 1.03e5]),
            // compliance lowers the frequency and leaves the damping
            ("AB2", 0.3, [33.0, 60.0], [2.83e4, 3.004e4]),
            ("AB3", 4.0, [0.0, 33.0], [1.897e4, 3.937e4]),
            // air in the nozzle and an emptied channel ring faster, and the latter hardly damps,
            // because its viscosity is gone with its density
            ("AB1", 0.2, [67.0, f64::INFINITY], ANY),
            ("EC", 0.3, [75.0, f64::INFINITY], [0.0, 1.4e4]),
        ] {
            let found = poles(class, severity);
            let holds = |[low, high]: [f64; 2], x: f64| low < x && x < high;
            assert!(
                holds(khz, found.0) && holds(damping, found.1),
                "{class} {severity}: {found:?}"
            );
        }
    }

    #[test]
    fn the_damping_of_a_dried_nozzle_peaks_near_six_fold_viscosity() {
        let damping = |x| poles("DDN", x).1;
        let peak = (40..90).map(|i| f64::from(i) / 10.0);
        let peak = peak.max_by(|x, y| damping(*x).total_cmp(&damping(*y))).unwrap();
        assert!((5.0..7.0).contains(&peak), "{peak}");
    }

    #[test]
    fn every_class_has_its_words_and_none_fault_is_the_healthy_channel() {
        for class in CLASSES {
            assert!(!law(class).unwrap().change.is_empty());
            let none = apply(class, law(class).unwrap().none(), &NOMINAL).unwrap();
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
        assert!(law("XYZ").is_none());
    }
}
