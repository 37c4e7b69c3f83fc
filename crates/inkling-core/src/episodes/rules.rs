//! The rules that all channels of a tracker share: how much evidence raises an episode, which
//! classes it may be named by, how certain a name must be, and which classes' sizes may be
//! compared.
//!
//! In: the design's classes with their priors, and settings, once at the begin of a recording
//! (`Tracker::new`). Out: [`Rules`], which `channel`, `episode_draft` and `channel_episode` read.

use crate::fault::{Class, Naming};
use crate::model::faults::{self, Catalogue};

/// The rules by which the episodes of all channels are raised, named and sized.
#[derive(Debug)]
pub struct Rules {
    /// Evidence (ln likelihood ratio) that raises an episode, and that ends it.
    pub bound: f32,
    /// The classes, in the order of the weights of signals.
    pub classes: Vec<Class>,
    /// Prior weight of each class; what the weights lack to 1 is that of no class.
    pub priors: Vec<f64>,
    /// For each class, the index of the first class whose severity measures the same quantity, so
    /// that severities of both can be compared.
    pub quantities: Vec<usize>,
    /// Which weights make a class or a category certain.
    pub naming: Naming,
}

impl Rules {
    /// The rules for these classes. `certainty`: least weight of a class or category that is named;
    /// the rest is as the fields of these names say.
    pub fn new(classes: &[Class], priors: &[f64], certainty: f64, bound: f32) -> Rules {
        let (quantities, naming) = (quantities(classes), Naming::new(classes, certainty));
        Rules { bound, classes: classes.to_vec(), priors: priors.to_vec(), quantities, naming }
    }
}

/// The indices of [`Rules::quantities`]. Classes measure the same quantity if their laws are of one
/// kind of fault; a class that stands for no law of `faults.toml`, or for several kinds, is only
/// like itself.
fn quantities(classes: &[Class]) -> Vec<usize> {
    // the law of a class, which may stand for several classes of one kind that were joined
    let laws = Catalogue::default();
    let of = |class: &Class| laws.one_kind(&class.of).and_then(faults::law);
    let first_like = |(number, class): (usize, &Class)| {
        let alike = |own: &faults::Law| {
            classes.iter().position(|other| of(other).is_some_and(|law| law.is_kind_of(own)))
        };
        of(class).and_then(alike).unwrap_or(number)
    };
    classes.iter().enumerate().map(first_like).collect()
}
