//! Finds printheads whose recorded temperatures cannot be those of ink, and printheads that were judged at other
//! temperatures than their models were learned at, by models that do not know what temperature does, and whose channels
//! could not be followed.
//!
//! In: bursts and the judges assigned to them, from the identify stage; at the end the printheads that were
//! followed, from `wiring`. Out: a warning per printhead, to `finish`. What temperature does to all channels of a
//! followed printhead is part of its level.

use super::groups::of_printhead;
use inkling_core::burst::Burst;
use inkling_core::design::Judge;
use inkling_core::numbers::LITTLE;
use inkling_lab::plot::digits::significant;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A difference in temperature up to this, K, is not warned about. One K changes damping by some percent
/// (water-based ink: about 2), which is half of what channels differ by.
const HARMLESS_K: f64 = 1.0;
/// Maximum number of printheads that are checked.
const MOST_PRINTHEADS: usize = 1 << 10;

/// The temperatures of each printhead's bursts, as far as models without a temperature response judge them.
#[derive(Debug, Default)]
pub struct TemperatureCheck {
    by_printhead: BTreeMap<Arc<str>, TemperatureRange>,
    /// The temperatures that were not believed, however the printhead was judged.
    not_believed: BTreeMap<Arc<str>, TemperatureRange>,
    /// Numbers of signals without a temperature, though their model knows what it does.
    not_recorded: BTreeMap<Arc<str>, NotRecorded>,
}

#[derive(Clone, Copy, Debug)]
struct NotRecorded {
    signals: u64,
    /// What they count as being at, °C.
    taken_for: f64,
}

/// The range of a printhead's temperatures, °C, and how far the farthest lies from its model's, K.
#[derive(Clone, Copy, Debug)]
struct TemperatureRange {
    least: f64,
    most: f64,
    farthest: f64,
}

impl TemperatureRange {
    fn in_words(&self) -> String {
        let [least, most] = [self.least, self.most].map(|t| significant(t, 3));
        if least == most { least } else { format!("{least} to {most}") }
    }
}

impl TemperatureCheck {
    pub fn take(&mut self, judge: &Judge, burst: &Burst) {
        let Some(t) = burst.temperature_c.filter(|t| t.is_finite()) else {
            let reference =
                judge.model.temperature_response.as_ref().and(judge.model.temperature_c);
            if let Some(taken_for) = reference {
                let all = &mut self.not_recorded;
                let new = || NotRecorded { signals: 0, taken_for };
                let of = of_printhead(all, &burst.printhead, MOST_PRINTHEADS, new);
                of.into_iter().for_each(|of| of.signals += u64::from(burst.channels));
            }
            return;
        };
        let all = match judge.model.temperature_response {
            Some(_) if judge.model.believes(t) => return,
            Some(_) => &mut self.not_believed,
            None => &mut self.by_printhead,
        };
        let off = judge.model.temperature_c.map_or(0.0, |reference| (t - reference).abs());
        let new = || TemperatureRange { least: t, most: t, farthest: off };
        let of = of_printhead(all, &burst.printhead, MOST_PRINTHEADS, new);
        if let Some(range) = of {
            range.least = range.least.min(t);
            range.most = range.most.max(t);
            range.farthest = range.farthest.max(off);
        }
    }

    pub fn forget<'a>(&mut self, followed: impl Iterator<Item = &'a str>) {
        for printhead in followed {
            self.by_printhead.remove(printhead);
        }
    }

    /// Warnings by printhead: where a temperature lay more than `HARMLESS_K` from the model's, or so far from
    /// the middle of the range; or where many signals have none. `signals`: how many a printhead has.
    pub fn warnings(&self, signals: impl Fn(&str) -> u64) -> Vec<(Arc<str>, String)> {
        let says = |range: &TemperatureRange| {
            format!(
                "judged at {} °C by models that do not know what temperature does, and its channels could not be \
                 followed: expect false alarms",
                range.in_words()
            )
        };
        let matters = |range: &TemperatureRange| {
            range.farthest.max(0.5 * (range.most - range.least)) > HARMLESS_K
        };
        let not_believed = |range: &TemperatureRange| {
            format!(
                "temperatures of {} °C were recorded, up to {} K from its model's: they count as not recorded; look at \
                 the sensor, and at the unit",
                range.in_words(),
                significant(range.farthest, 3)
            )
        };
        let of = self.by_printhead.iter().filter(|(_, range)| matters(range));
        let of = of.map(|(name, range)| (name.clone(), says(range)));
        let odd = self.not_believed.iter();
        let missing = self.not_recorded.iter().filter_map(|(name, of)| {
            let (all, NotRecorded { signals, taken_for }) = (signals(name), of);
            let taken_for = significant(*taken_for, 3);
            let what = format!(
                "of {signals} of {all} signals no temperature was recorded, though its model knows what temperature \
                 does: they were judged as if the ink were at {taken_for} °C. Look at the sensor, and at `temperature` in \
                 [[input.dialect]]"
            );
            (*signals as f64 > LITTLE * all as f64).then(|| (name.clone(), what))
        });
        let odd = odd.map(|(name, range)| (name.clone(), not_believed(range)));
        of.chain(odd).chain(missing).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use inkling_core::burst::{Format, Layout};
    use inkling_io::design_file;
    use std::path::Path;

    #[test]
    fn what_is_no_temperature_of_ink_counts_as_not_recorded_and_is_told() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("sample_logs/design.json");
        let design = design_file::read(&path).unwrap().0;
        let mut model = design.pooled.clone();
        model.temperature_c = Some(24.0);
        model.temperature_response = Some(vec![0.1; model.expected.len()]);
        let recorded = [23.5, 40.0, 75.2, -127.0, 297.0, f64::NAN];
        assert_eq!(recorded.map(|t| model.warmer(t)), [-0.5, 16.0, 0.0, 0.0, 0.0, 0.0]);

        let judge = Judge::new(0, Arc::new(model), None, Some(&design), &Default::default());
        let (judge, mut check) = (judge.unwrap(), TemperatureCheck::default());
        let signals = [vec![0.0f32; design.samples]];
        let of =
            || Burst::of(&signals, design.sample_period_s, Format::F32Le, Layout::ChannelMajor);
        for t in [23.5, 85.0] {
            assert!(check.warnings(|_| 2).is_empty(), "before {t}");
            check.take(&judge, &Burst { temperature_c: Some(t), ..of() });
        }
        let told = check.warnings(|_| 2);
        assert!(told[0].1.contains("85") && told[0].1.contains("not recorded"), "{told:?}");

        // one of nine without a temperature is told, and one of twenty is not
        check.take(&judge, &of());
        let [often, seldom] = [9, 20].map(|signals| check.warnings(|_| signals));
        assert!(often[1].1.starts_with("of 1 of 9 signals no temperature"), "{often:?}");
        assert_eq!(seldom.len(), 1);
    }
}
