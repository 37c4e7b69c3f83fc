//! A gain that changed while healthy signals were recorded. Training takes all sizes in between for what healthy channels
//! may do, so that no fault that makes a ring smaller or larger within them would ever be found.
//!
//! In: a design and the signals that it was learned from. Out: a warning for each printhead of which all channels
//! together ring differently strongly from burst to burst.

use super::{Design, HealthyModel, tuned};
use crate::identify::SignalSet;
use crate::model::inner_product::dot;
use crate::model::median::{median, median_of};
use crate::numbers::FEW;
use std::collections::BTreeMap;

impl Design {
    pub(super) fn gain_steps(&self, healthy: &BTreeMap<String, SignalSet>) -> Vec<String> {
        let of_head = self.with_models(healthy).into_iter().zip(healthy.keys());
        of_head.filter_map(|((model, set), name)| warning(name, &sizes(model, set))).collect()
    }
}

/// For each burst, in the order of time, ln of how strongly its channels ring: the median over channels, each beside
/// what it does otherwise.
fn sizes(model: &HealthyModel, set: &SignalSet) -> Vec<f64> {
    let size = |i: usize| {
        let y: Vec<f64> = set.signal(i).iter().map(|y| f64::from(*y) / set.drive[i]).collect();
        dot(&y, &model.expected).abs().ln()
    };
    let sizes: Vec<f64> = (0..set.len()).map(size).collect();
    let mut of_channel: BTreeMap<u32, Vec<f64>> = BTreeMap::new();
    set.channel
        .iter()
        .zip(&sizes)
        .for_each(|(k, size)| of_channel.entry(*k).or_default().push(*size));
    let usual: BTreeMap<u32, f64> =
        of_channel.into_iter().map(|(k, of)| (k, median_of(of.into_iter()))).collect();

    let mut of_burst: BTreeMap<i64, Vec<f64>> = BTreeMap::new();
    for ((t_ns, channel), size) in set.t_acq_ns.iter().zip(&set.channel).zip(sizes) {
        of_burst.entry(*t_ns).or_default().push(size - usual[channel]);
    }
    of_burst.into_values().map(|mut of| median(&mut of)).collect()
}

/// `sizes`: of the bursts in the order of time, ln.
fn warning(printhead: &str, sizes: &[f64]) -> Option<String> {
    let mut sorted = sizes.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let stray = (tuned::STRAY_BURSTS * sizes.len() as f64) as usize;
    let (low, high) = (sorted.get(stray)?, sorted[sizes.len() - 1 - stray]);
    let is_steady = high - low <= (1.0 + tuned::GAIN_BOUND).ln();
    if sizes.len() < FEW || is_steady {
        return None;
    }
    let steps = sizes.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let (before, _) = steps.enumerate().max_by(|p, q| p.1.total_cmp(&q.1))?;
    Some(format!(
        "printhead {printhead}: all channels together ring {:.2} times as strongly in some of its {} bursts as in others, \
         with the largest step after the first {}: was an amplifier's gain changed, or the drive? Any size in between \
         counts as healthy from now on: leave out those of the gain that is no more",
        (high - low).exp(),
        sizes.len(),
        before + 1
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gain_that_changed_is_told_with_its_place_and_what_wanders_or_strays_is_not() {
        let wanders = |k: usize| 0.05 * (k as f64 / 20.0).sin();
        let bursts = |size: &dyn Fn(usize) -> f64| (0..300).map(size).collect::<Vec<f64>>();
        assert_eq!(warning("head", &bursts(&wanders)), None);
        assert_eq!(
            warning("head", &bursts(&|k| if k % 40 == 7 { -3.0 } else { wanders(k) })),
            None
        );
        let stepped = bursts(&|k| wanders(k) + if k < 100 { 0.0 } else { 1.3f64.ln() });
        let told = warning("head", &stepped).unwrap();
        assert!(told.contains("its 300 bursts") && told.contains("after the first 100:"), "{told}");
        assert_eq!(warning("head", &[0.0, 1.0]), None);
    }
}
