//! Settings of fault isolation: `pipeline.toml` section `[isolate]`, with its defaults and the
//! check of its values. `pipeline.toml` explains each key to users.

use super::IsolateError;
use crate::fault::{CLASSES, is_reserved};
use crate::model::Waveform;
use crate::model::faults::Catalogue;
use crate::ranges::check;
use crate::verdict::named;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::Bound;

named! {
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "kebab-case")]
    IsolateMethod {
        /// By a posterior: the density of the features of a fitted ring in each class.
        #[default]
        Posterior "posterior";
        /// Thesis §3-3-2: by mixture weights phi on the simplex of mean residuals.
        ResidualMatching "residual-matching";
        /// Thesis §3-3-1: by one identified model per fault class; the smallest residual wins.
        ModelMatching "model-matching";
        /// Thesis §4-3-1: by the shares of the classes among the nearest training signals.
        Neighbours "neighbours";
    }
}

/// The signals that residual matching and neighbours compare.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum IsolateSignal {
    /// The FD filter's residual, thesis r.
    #[default]
    Residual,
    /// The deviation y - y_hat, which stands for the thesis's y: distances between signals, and
    /// mixtures whose weights sum to 1, are the same for both.
    Deviation,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct IsolateSettings {
    pub method: IsolateMethod,
    pub signal: IsolateSignal,
    pub neighbours: usize,
    /// Whether only flagged signals are isolated; false: all, as in the thesis's Tables 4-3ff.
    pub gate: bool,
    /// Smallest weight with which a class or category is named, 0 to 1.
    pub certainty: f64,
    /// How frequent a class is among faults, 1 if it is not listed; of `posterior` only.
    pub priors: BTreeMap<String, f64>,
    /// Names of the user's own, each with the classes that it stands for; for `train` only.
    pub classes: BTreeMap<String, Vec<String>>,
    /// Whether a design gets by the physics the thesis's classes of which no signal is labelled.
    pub unlabelled_classes: bool,
    /// Laws of the user's own, by name, beside those of `faults.toml`.
    #[serde(skip_serializing_if = "Catalogue::is_empty")]
    pub physics: Catalogue,
    /// Width of the actuation pulse, s; absent: as usual at the ring's frequency.
    pub pulse_s: Option<f64>,
    /// Duration, s, and voltage over the drive's, of each step if there is no single pulse.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub waveform: Vec<[f64; 2]>,
    /// Time from the end of the pulse to t_a, s; a first guess, which the healthy phase refines.
    /// Absent: as usual at the ring's frequency.
    pub delay_s: Option<f64>,
    /// Relative standard deviation of the ratios a/b and g/d of `identify.grey_box`.
    pub guess_sd: f64,
}

impl Default for IsolateSettings {
    fn default() -> Self {
        IsolateSettings {
            method: IsolateMethod::Posterior,
            signal: IsolateSignal::Residual,
            neighbours: 1,
            gate: true,
            certainty: 0.8,
            priors: BTreeMap::new(),
            classes: BTreeMap::new(),
            unlabelled_classes: true,
            physics: Catalogue::default(),
            pulse_s: None,
            waveform: Vec::new(),
            delay_s: None,
            guess_sd: 0.05,
        }
    }
}

impl IsolateSettings {
    pub fn check(&self) -> Result<(), String> {
        check("neighbours", self.neighbours, 1..=1000, "1 to 1000")?;
        for (class, weight) in &self.priors {
            let weights = (Bound::Excluded(0.0), Bound::Included(1e6));
            check(&format!("priors.{class}"), *weight, weights, "a weight above 0, up to 1e6")?;
        }
        self.physics.check().map_err(|why| format!("physics.{why}"))?;
        self.check_classes()?;
        let ranges = [
            ("pulse_s", self.pulse_s, 1e-9..=1e-2, "1e-9 to 1e-2"),
            ("delay_s", self.delay_s, 0.0..=1e-2, "0 to 1e-2"),
            ("guess_sd", Some(self.guess_sd), 1e-4..=2.0, "1e-4 to 2"),
            ("certainty", Some(self.certainty), 0.0..=1.0, "0 to 1"),
        ];
        for (key, value, range, words) in ranges {
            value.map_or(Ok(()), |value| check(key, value, range, words))?;
        }
        if !self.waveform.is_empty() {
            let (_, pulse_s) =
                Waveform::new(&self.waveform).map_err(|why| format!("waveform: {why}"))?;
            if self.pulse_s.is_some() {
                return Err(
                    "waveform beside pulse_s: its durations are the pulse's; give one".into()
                );
            }
            if !(1e-9..=1e-2).contains(&pulse_s) {
                return Err(format!("waveform lasts {pulse_s:e} s: give 1e-9 to 1e-2 s in all"));
            }
        }
        Ok(())
    }

    /// Refuses names that are taken or empty, and classes that are unknown or under two names.
    fn check_classes(&self) -> Result<(), String> {
        let mut taken: BTreeMap<&str, &str> = BTreeMap::new();
        let known: Vec<&str> = CLASSES.into_iter().chain(self.physics.own_classes()).collect();
        for (name, of) in &self.classes {
            if name.is_empty() || is_reserved(name) || self.physics.law(name).is_some() {
                return Err(format!("classes.\"{name}\": give a name of your own"));
            }
            if of.is_empty() {
                return Err(format!("classes.\"{name}\" = []: name at least one class"));
            }
            for class in of {
                if !known.contains(&class.as_str()) {
                    let known = known.join(", ");
                    return Err(format!(
                        "classes.\"{name}\": there is no class \"{class}\" (there are {known})"
                    ));
                }
                if let Some(other) = taken.insert(class, name) {
                    return Err(format!(
                        "classes.\"{name}\": {class} is taken by \"{other}\" already; a class can \
                         stand in one of them"
                    ));
                }
            }
        }
        Ok(())
    }

    /// The class name of signals with this label.
    pub fn name_of<'a>(&'a self, label: &'a str) -> &'a str {
        let declared = self.classes.iter().find(|(_, of)| of.iter().any(|class| class == label));
        declared.map_or(label, |(name, _)| name)
    }

    /// They sum to 1. An error if `priors` names no class of the design.
    pub fn prior_weights(&self, classes: &[String]) -> Result<Vec<f64>, IsolateError> {
        if let Some(name) = self.priors.keys().find(|name| !classes.contains(name)) {
            let classes = classes.join(", ");
            return Err(IsolateError::UnknownPrior { name: name.clone(), classes });
        }
        let weight = |class: &String| self.priors.get(class).copied().unwrap_or(1.0);
        let sum: f64 = classes.iter().map(weight).sum();
        Ok(classes.iter().map(|class| weight(class) / sum).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_class_cannot_have_a_name_that_means_something_else() {
        let named = |name: &str| IsolateSettings {
            classes: [(name.to_owned(), vec!["AB1".to_owned()])].into(),
            ..IsolateSettings::default()
        };
        for name in ["", "healthy", "ignore", "rejected", "unlabelled", "other_sampling", "BN"] {
            let refused = named(name).check().unwrap_err();
            assert!(refused.contains("give a name of your own"), "{name}: {refused}");
        }
        named("Luft").check().unwrap();
    }

    #[test]
    fn priors_sum_to_one_and_name_known_classes_only() {
        let classes = ["EC", "BN", "own"].map(String::from);
        let with = |name: &str, weight: f64| IsolateSettings {
            priors: [(name.to_owned(), weight)].into(),
            ..IsolateSettings::default()
        };
        let equal = IsolateSettings::default().prior_weights(&classes).unwrap();
        assert_eq!(equal, [1.0 / 3.0; 3]);
        assert_eq!(with("own", 2.0).prior_weights(&classes).unwrap(), [0.25, 0.25, 0.5]);
        let refused = with("ow", 2.0).prior_weights(&classes).unwrap_err().to_string();
        assert!(refused.contains("ow") && refused.contains("EC, BN, own"), "{refused}");
        for weight in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(with("EC", weight).check().is_err());
        }
    }
}
