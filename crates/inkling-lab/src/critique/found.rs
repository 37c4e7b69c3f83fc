//! What is found beside the causes that move what is expected: in codes, in noise, in the trigger.
//!
//! In: a test's statistic. Out: [`Found`], accepted where chance gives it less often than the threshold allows.

use super::catalogue::CauseId;
use super::chance::{DETECTION_LIMIT, THRESHOLD};
use super::finding::{Cause, Evidence, NOT_SIGNIFICANT};
use super::words::cause_sentence;

#[derive(Clone, Debug)]
pub struct Found {
    pub evidence: Evidence,
    /// What is there for sure and is none of the catalogue, in words.
    pub unlike: Option<&'static str>,
}

impl Found {
    /// `surprise`: -ln of the chance of that statistic; `value` and its standard error in the catalogue's unit.
    pub fn of(id: CauseId, surprise: f64, statistic: f64, value: f64, sd: f64) -> Found {
        let accepted = surprise > THRESHOLD;
        Found {
            evidence: Evidence {
                step: 0,
                id,
                statistic,
                threshold: DETECTION_LIMIT,
                p: (-surprise).exp(),
                delta_bic: statistic - (statistic.max(3.0)).ln(),
                strength_dl: (statistic.max(0.0) / DETECTION_LIMIT).sqrt(),
                value,
                sd,
                tested: true,
                accepted,
                why_not: if accepted { String::new() } else { NOT_SIGNIFICANT.into() },
            },
            unlike: None,
        }
    }

    pub fn nothing(id: CauseId) -> Found {
        Found::of(id, 0.0, 0.0, f64::NAN, f64::NAN)
    }

    pub fn untested(id: CauseId, why: &str) -> Found {
        let mut found = Found::nothing(id);
        found.evidence.tested = false;
        found.evidence.why_not = why.into();
        found
    }

    pub fn is(&self, id: CauseId) -> bool {
        self.evidence.id == id
    }

    pub fn cause(&self) -> Cause {
        let e = &self.evidence;
        let cause = Cause::new(e.id, e.value, e.sd, e.strength_dl, e.delta_bic);
        Cause { sentence: cause_sentence(&cause), ..cause }
    }

    pub fn leave_out(&mut self, why: &str) {
        self.evidence.accepted = false;
        self.evidence.why_not = why.into();
    }
}

/// The value of a cause among those found.
pub fn accepted(found: &[Found], id: CauseId) -> Option<f64> {
    found.iter().find(|f| f.is(id) && f.evidence.accepted).map(|f| f.evidence.value)
}

/// What was found in codes, and in noise and trigger.
#[derive(Clone, Debug, Default)]
pub struct Aside {
    pub codes: Vec<Found>,
    pub noise: Vec<Found>,
    /// -ln of the chance of the misfits that few signals have, and that are left out for them.
    pub odd_signals: f64,
}

impl Aside {
    pub fn all(&self) -> impl Iterator<Item = &Found> {
        self.codes.iter().chain(&self.noise)
    }

    pub fn accepted(&self) -> impl Iterator<Item = &Found> {
        self.all().filter(|f| f.evidence.accepted)
    }
}
