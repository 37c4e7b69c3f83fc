//! How long a recording has gone on, whatever its printheads' clocks say: they may differ, and be set.
//!
//! In: bursts by the number of their group, in the order of the file. Out: the time that has passed for the printhead
//! for which most has, ns; a step of more than two seconds counts as two.

const MOST_STEP_NS: i64 = 2_000_000_000;

#[derive(Debug, Default)]
pub struct Elapsed {
    /// By the number of the group: the latest time of a burst, and the time that has passed, ns.
    groups: Vec<Option<(i64, i64)>>,
    pub now_ns: i64,
}

impl Elapsed {
    pub fn hear(&mut self, group: usize, t_ns: i64) {
        if group >= self.groups.len() {
            self.groups.resize(group + 1, None);
        }
        let (latest, passed) = self.groups[group].get_or_insert((t_ns, 0));
        let step = t_ns.saturating_sub(*latest);
        // a clock that was set back goes on from there
        if !(-MOST_STEP_NS..=0).contains(&step) {
            *passed = passed.saturating_add(step.clamp(0, MOST_STEP_NS));
            *latest = t_ns;
        }
        self.now_ns = self.now_ns.max(*passed);
    }
}
