//! What a critique tells of its work while it goes on, which is also where it can be ended.
//!
//! In: a function of whoever asked for the critique ([`Work::told`]). The signals carry it with them, so that
//! every loop over them can call it ([`Work::goes_on`], many times in a second), and each stage when it begins
//! ([`Work::begins`]). To end the critique, the function does not return.

use std::fmt;
use std::sync::Arc;

/// What is done in a stage, and the share of the time that has usually gone by before it.
pub type Stage = (&'static str, f64);

pub const BASELINE: Stage = ("fitting the baseline", 0.0);
pub const CODES: Stage = ("looking at codes and noise", 0.1);
/// The first step of the search for causes; later ones lie evenly up to `MEASURING`.
pub const CATALOGUE: Stage = ("testing the catalogue, refitting what competes", 0.2);
pub const MEASURING: Stage = ("measuring the causes", 0.7);
pub const WHAT_IS_LEFT: Stage = ("checking what is left", 0.75);
pub const GAIN: Stage = ("measuring the gain", 0.8);
pub const DESIGN: Stage = ("extending the design", 0.95);
// of oscillators
pub const ONSET: Stage = ("looking for where the decays become free", 0.0);
pub const OSCILLATION: Stage = ("fitting one damped oscillation", 0.15);
pub const TERMS: Stage = ("trying what may be added", 0.2);

pub enum Now {
    Begins(Stage),
    GoesOn,
}

/// The default tells nobody.
#[derive(Clone, Default)]
pub struct Work(Option<Arc<dyn Fn(Now) + Send + Sync>>);

impl Work {
    /// `to` is called by several threads.
    pub fn told(to: impl Fn(Now) + Send + Sync + 'static) -> Work {
        Work(Some(Arc::new(to)))
    }

    pub fn begins(&self, stage: Stage) {
        self.tell(Now::Begins(stage));
    }

    /// A step of so many (`most`) of the search for causes begins.
    pub fn begins_step(&self, (what, share): Stage, step: u32, most: u32) {
        let all = MEASURING.1 - CATALOGUE.1;
        self.begins((what, share + all * f64::from(step) / f64::from(most + 1)));
    }

    pub fn goes_on(&self) {
        self.tell(Now::GoesOn);
    }

    fn tell(&self, now: Now) {
        if let Some(to) = &self.0 {
            to(now);
        }
    }
}

impl fmt::Debug for Work {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Work")
    }
}
