//! Where printheads' first windows end, in the identify stage: from there on channels that were not remembered are
//! judged by what they said in it.
//!
//! In: batches in the recording's order. Out: nothing but the baselines in use. Of the first burst after a window what
//! came before must have been heard, so that the stage waits for the filter's workers, once a printhead, and only where
//! channels are new. A burst that belongs before what was decided asks for passes of their own
//! ([`super::heard_before`]).

use super::baseline::Remembered;
use super::hearing::{Hearing, Listener};
use super::statistics::Statistics;
use super::{Control, PipelineError};
use crate::burst::{Acquisition, Burst};
use crate::design::Judge;
use crate::verdict::Reason;
use std::collections::HashMap;
use std::sync::Arc;

pub struct FirstWindows<'a> {
    remembered: &'a Remembered<'a>,
    hearing: &'a Hearing<'a>,
    control: &'a Control,
    printheads: HashMap<Arc<str>, Window>,
    /// Batches that went on to the filter.
    sent: u64,
    listener: Listener<'a>,
    statistics: Statistics,
}

#[derive(Clone, Copy)]
struct Window {
    start_ns: i64,
    end_ns: i64,
    /// Some channel in it was not remembered.
    has_new: bool,
    is_over: bool,
}

/// Who judges each acquisition.
type Judges = [Result<Arc<Judge>, Reason>];

impl<'a> FirstWindows<'a> {
    pub fn new(
        remembered: &'a Remembered<'a>,
        hearing: &'a Hearing<'a>,
        rails: [f64; 2],
        control: &'a Control,
    ) -> FirstWindows<'a> {
        FirstWindows {
            remembered,
            hearing,
            control,
            printheads: HashMap::new(),
            sent: 0,
            listener: hearing.listener(),
            statistics: Statistics::new(rails),
        }
    }

    /// The next batch, which goes on to the filter then. Which of its acquisitions were heard here; empty: none.
    pub fn take(
        &mut self,
        of: &[Acquisition],
        judges: &Judges,
    ) -> Result<Vec<bool>, PipelineError> {
        let mut heard = Vec::new();
        for (i, acquisition) in of.iter().enumerate() {
            let Acquisition::Usable(burst) = acquisition else { continue };
            if self.ends_with(burst)? {
                let (before, judges) = (&of[..i], &judges[..i]);
                heard.resize(of.len(), false);
                self.end(&burst.printhead, before, judges, &mut heard)?;
            }
        }
        self.sent += 1;
        Ok(heard)
    }

    /// Whether a printhead's first window is found to be over by its next burst, and new channels were in it.
    fn ends_with(&mut self, burst: &Burst) -> Result<bool, PipelineError> {
        let t_ns = burst.t_acq_ns;
        let Some(window) = self.printheads.get_mut(&burst.printhead) else {
            if self.printheads.len() >= super::survey::MOST_GROUPS {
                return Ok(false);
            }
            self.remembered.begin(&burst.printhead, self.hearing.in_use);
            let (end_ns, has_new) = (self.remembered.end_ns(t_ns), !self.remembered.knows(burst));
            let window = Window { start_ns: t_ns, end_ns, has_new, is_over: false };
            self.printheads.insert(burst.printhead.clone(), window);
            return Ok(false);
        };
        if t_ns < window.start_ns || (t_ns < window.end_ns && window.is_over) {
            return Err(PipelineError::NeedsTwoPasses(format!(
                "bursts of the first window of {} come after later ones",
                crate::io::printable::line(&burst.printhead, 64)
            )));
        }
        if t_ns < window.end_ns {
            window.has_new = window.has_new || !self.remembered.knows(burst);
            return Ok(false);
        }
        let ends = !window.is_over && window.has_new;
        window.is_over = true;
        Ok(ends)
    }

    /// A printhead's first window is over. `before`: what of this batch came before; the rest of it is on its way.
    fn end(
        &mut self,
        printhead: &Arc<str>,
        before: &[Acquisition],
        judges: &Judges,
        heard: &mut [bool],
    ) -> Result<(), PipelineError> {
        let is_of = |of: &Acquisition| match of {
            Acquisition::Usable(burst) => burst.printhead == *printhead,
            Acquisition::Unusable(_) => false,
        };
        let mut statistic = Vec::new();
        for (i, (acquisition, judge)) in before.iter().zip(judges).enumerate() {
            if is_of(acquisition) {
                let (of, by) = (std::slice::from_ref(acquisition), std::slice::from_ref(judge));
                self.statistics.of(of, by, &mut statistic);
                self.listener.judge(of, by, &[], &mut self.statistics, &mut statistic);
                heard[i] = true;
            }
        }
        if !self.hearing.wait_for(self.sent, || self.control.is_abandoned()) {
            return Ok(()); // nobody takes what comes now
        }
        let told = self.hearing.of(printhead);
        let end_ns = self.printheads.get(printhead).map_or(i64::MAX, |window| window.end_ns);
        self.remembered.end(printhead, end_ns, &told, self.hearing.in_use);
        Ok(())
    }
}
