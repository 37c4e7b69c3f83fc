//! The rules that all channels of a tracker share. In: the design's classes with their priors, and
//! settings. Out: [`Rules`]: how much evidence raises an episode, which classes it may be named by,
//! how certain a name must be, and which classes' sizes may be compared.

use crate::fault::{Class, Naming};
use crate::model::faults::{self, Catalogue};

#[derive(Debug)]
pub struct Rules {
    /// Evidence (ln likelihood ratio) that raises an episode, and that ends it.
    pub bound: f32,
    pub classes: Vec<Class>,
    /// Prior weight of each class, and to 1 of no class.
    pub priors: Vec<f64>,
    /// For each class, the index of the first class whose severity measures the same quantity.
    pub quantities: Vec<usize>,
    pub naming: Naming,
}

impl Rules {
    pub fn new(classes: &[Class], priors: &[f64], certainty: f64, bound: f32) -> Rules {
        let (quantities, naming) = (quantities(classes), Naming::new(classes, certainty));
        Rules { bound, classes: classes.to_vec(), priors: priors.to_vec(), quantities, naming }
    }
}

fn quantities(classes: &[Class]) -> Vec<usize> {
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
