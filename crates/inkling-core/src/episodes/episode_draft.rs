//! Gathers what a channel's flagged signals say of its episode, burst by burst.
//!
//! In: what isolation says of one flagged signal after another ([`EpisodeDraft::add`]). Out: what
//! [`super::channel_episode`] makes an episode of. A draft is begun for what may become an episode,
//! and is discarded if nothing comes of it.

use super::classes::ClassFilter;
use super::rules::Rules;
use super::{IsolatedSignal, Rings};
use crate::verdict::{Appearance, Reason};
use std::collections::BTreeMap;

#[derive(Clone, Debug, Default)]
pub struct EpisodeDraft {
    /// Time at which the evidence sufficed, ns; 0 until then.
    pub raised_at_ns: i64,
    /// Time of the first of the last looks that fit the return to healthy, and number of looks before.
    pub fading: Option<(i64, u64)>,
    /// Of a fault that comes and goes, the share of looks in which it was flagged.
    pub share: Option<f64>,
    pub classes: ClassFilter,
    /// Number of signals of which isolation said something.
    pub named: u64,
    /// Number of these that fit no class, and that are of a class, but may as well be none.
    pub fits_none: u64,
    pub as_well: u64,
    /// Sum of the weights of each class over the signals that have a name; together as many signals as they are
    /// certain.
    pub votes: Vec<f64>,
    /// What the last signal looks like that is of no class, or may as well be none.
    pub appearance: Option<Appearance>,
    /// Running mean of the faulty rings, and of the healthy ones in their place, and its number of looks.
    pub rings: Option<Rings>,
    pub ring_looks: f64,
    pub resonance: Option<(f32, f32)>,
    /// Whether one of the signals was a ring.
    pub has_ring: bool,
    /// The category and class under which the episode was announced last (`Channel::news`).
    pub announced_as: (Option<String>, Option<String>),
    pub reasons: BTreeMap<Reason, u64>,
    /// Severities by the quantity that they measure, at the index of [`Rules::quantities`].
    pub sizes: Vec<Option<Sizes>>,
}

/// The severities of one quantity, with the standard deviation of the last.
#[derive(Clone, Copy, Debug)]
pub struct Sizes {
    pub first: f32,
    pub max: f32,
    pub last: f32,
    pub sd: Option<f32>,
    /// Whether the signals that have it carry a name.
    pub is_named: bool,
}

impl EpisodeDraft {
    pub fn new(rules: &Rules) -> EpisodeDraft {
        let (classes, votes) = (ClassFilter::new(&rules.priors), vec![0.0; rules.priors.len()]);
        EpisodeDraft { classes, votes, ..EpisodeDraft::default() }
    }

    pub fn add(&mut self, named: &IsolatedSignal, rules: &Rules) {
        named.reason.iter().for_each(|reason| *self.reasons.entry(*reason).or_default() += 1);
        // the ring that is nearest to what is no ring says nothing of the channel, as long as others do
        let is_ring = named.reason != Some(Reason::NoRing);
        if is_ring && !self.has_ring {
            (self.has_ring, self.ring_looks, self.rings) = (true, 0.0, None);
        }
        if is_ring || !self.has_ring {
            self.resonance = named.resonance.or(self.resonance);
        }
        if let Some(ring) = named.rings.filter(|_| is_ring || !self.has_ring) {
            self.ring_looks = (self.ring_looks + 1.0).min(10.0);
            let mean = |of: f64, now: f64| of + (1.0 / self.ring_looks) * (now - of);
            let of = self.rings.unwrap_or(ring);
            self.rings = Some(Rings {
                frequency_hz: mean(of.frequency_hz, ring.frequency_hz),
                damping_per_s: mean(of.damping_per_s, ring.damping_per_s),
                healthy_frequency_hz: mean(of.healthy_frequency_hz, ring.healthy_frequency_hz),
                healthy_damping_per_s: mean(of.healthy_damping_per_s, ring.healthy_damping_per_s),
            });
        }

        if named.weights.is_empty() && !named.fits_none() {
            return;
        }
        self.appearance = named.appearance.clone().or(self.appearance.take());
        self.named += 1;
        self.fits_none += u64::from(named.fits_none());
        self.as_well += u64::from(named.appearance.is_some() && !named.fits_none());
        self.classes.look(&named.weights, &rules.priors);
        if named.reason.is_none() && named.weights.iter().all(|weight| weight.is_finite()) {
            let all = self.votes.iter_mut().zip(&named.weights);
            all.for_each(|(votes, weight)| *votes += f64::from(*weight));
        }

        self.add_size(named, rules);
    }

    /// An episode's size is that of signals that carry a name. Where each of them is too uncertain for one, it is that of
    /// what they most likely are: all together they may be certain.
    fn add_size(&mut self, of: &IsolatedSignal, rules: &Rules) {
        let is_named = match of.reason {
            None => true,
            Some(Reason::Uncertain) => false,
            Some(_) => return,
        };
        let size = of.severity.filter(|size| size.is_finite());
        let quantity = of.candidate.and_then(|class| rules.quantities.get(usize::from(class)));
        let Some((size, quantity)) = size.zip(quantity) else { return };
        self.sizes.resize(rules.classes.len(), None);
        let Some(known) = self.sizes.get_mut(*quantity) else { return };
        if known.is_some_and(|known| known.is_named && !is_named) {
            return;
        }
        let before = known.filter(|known| known.is_named == is_named);
        *known = Some(Sizes {
            first: before.map_or(size, |known| known.first),
            max: before.map_or(size, |known| known.max.max(size)),
            last: size,
            sd: of.severity_sd,
            is_named,
        });
    }

    /// The weights of the classes, and whether "no class" outweighs them. Present signals decide ([`ClassFilter`]),
    /// but where they are of no class and most signals of the episode have a name, each counted by its certainty,
    /// the episode is called what its signals are called.
    pub fn weights(&self) -> (Vec<f64>, bool) {
        let of_no_class = self.named > 0 && self.classes.none > 0.5;
        let votes: f64 = self.votes.iter().sum();
        if of_no_class && 2.0 * votes > self.named as f64 {
            return (self.votes.iter().map(|of| of / votes).collect(), false);
        }
        (self.classes.weights.clone(), of_no_class)
    }

    /// Why the episode has no name: the commonest reason of its signals. `of_no_class`: of those that fit no class;
    /// where each signal alone is uncertain, and only all together are of no class, that is the reason.
    pub fn why_unnamed(&self, of_no_class: bool) -> Reason {
        let is_asked = |reason: &Reason| {
            !of_no_class || matches!(reason, Reason::UnknownFault | Reason::NoRing)
        };
        let asked = self.reasons.iter().filter(|(reason, _)| is_asked(reason));
        let of_all = if of_no_class { Reason::UnknownFault } else { Reason::Uncertain };
        asked.max_by_key(|(_, n)| **n).map_or(of_all, |(reason, _)| *reason)
    }

    /// What the signals look like where they are of no class.
    pub fn looks_like(&self) -> &Appearance {
        let unsaid = if self.has_ring { &Appearance::OtherRing } else { &Appearance::Other };
        self.appearance.as_ref().unwrap_or(unsaid)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fault::Class;

    fn rules() -> Rules {
        Rules::new(&["BN", "PBN", "SDN"].map(Class::plain), &[0.28; 3], 0.8, 16.0)
    }

    #[test]
    fn an_episode_has_the_size_of_signals_with_a_name_or_else_of_what_they_most_likely_are() {
        let rules = rules();
        let mut draft = EpisodeDraft::new(&rules);
        let mut last = |reason, size| {
            let weights = vec![0.0, 0.7, 0.1];
            let (candidate, severity) = (Some(1), Some(size));
            let of = IsolatedSignal { reason, candidate, severity, weights, ..Default::default() };
            draft.add(&of, &rules);
            draft.sizes.iter().flatten().next().map(|of| of.last)
        };
        assert_eq!(last(Some(Reason::UnknownFault), 0.5), None);
        assert_eq!(last(Some(Reason::Uncertain), 0.04), Some(0.04));
        assert_eq!(last(None, 0.06), Some(0.06));
        assert_eq!(last(Some(Reason::Uncertain), 0.1), Some(0.06));
    }

    #[test]
    fn a_ring_is_told_by_the_mean_of_about_ten_looks() {
        let rules = rules();
        let mut draft = EpisodeDraft::new(&rules);
        let mut look = |of: f64| {
            let rings = Some(Rings {
                frequency_hz: 60e3 * of,
                damping_per_s: 3e4 * 2.0 * of,
                healthy_frequency_hz: 60e3,
                healthy_damping_per_s: 3e4,
            });
            draft.add(&IsolatedSignal { rings, ..IsolatedSignal::default() }, &rules);
            let Rings { frequency_hz, damping_per_s, .. } = draft.rings.expect("a ring");
            assert!((damping_per_s / frequency_hz - 1.0).abs() < 1e-9);
            frequency_hz / 60e3
        };
        assert!((look(0.9) - 0.9).abs() < 1e-9);
        assert!((look(0.8) - 0.85).abs() < 1e-9);
        assert!((look(0.7) - 0.8).abs() < 1e-9, "the mean of three");
        (0..7).for_each(|_| {
            look(0.8);
        });
        assert!((look(0.9) - 0.81).abs() < 1e-9, "a tenth of the way");
    }

    #[test]
    fn one_signal_that_is_no_ring_changes_nothing_that_is_said_of_the_others() {
        let rules = rules();
        let signal = |damping_per_s: f64, reason: Option<Reason>| {
            let rings = Some(Rings {
                frequency_hz: 60e3,
                damping_per_s,
                healthy_frequency_hz: 60e3,
                healthy_damping_per_s: 3e4,
            });
            let resonance = Some((60e3, damping_per_s as f32));
            IsolatedSignal { rings, resonance, reason, ..IsolatedSignal::default() }
        };
        let odd = signal(9e5, Some(Reason::NoRing));
        for at in 0..3 {
            let mut draft = EpisodeDraft::new(&rules);
            for i in 0..3 {
                let ring = signal(4e4, None);
                draft.add(if i == at { &odd } else { &ring }, &rules);
            }
            assert_eq!(draft.rings.map(|of| of.damping_per_s), Some(4e4));
            assert_eq!(draft.resonance, Some((60e3, 4e4)));
        }
        let mut draft = EpisodeDraft::new(&rules);
        draft.add(&odd, &rules);
        assert_eq!(draft.rings.map(|of| of.damping_per_s), Some(9e5), "nothing else is known");
    }

    #[test]
    fn an_episode_whose_last_signals_are_of_no_class_is_called_what_most_signals_are_called() {
        let rules = rules();
        let of_class =
            IsolatedSignal { weights: vec![0.01, 0.02, 0.95], ..IsolatedSignal::default() };
        let none =
            IsolatedSignal { reason: Some(Reason::UnknownFault), ..IsolatedSignal::default() };
        let after = |named: usize, without: usize| {
            let mut draft = EpisodeDraft::new(&rules);
            (0..named).for_each(|_| draft.add(&of_class, &rules));
            (0..without).for_each(|_| draft.add(&none, &rules));
            draft.weights()
        };
        let (weights, of_no_class) = after(115, 60);
        assert!(!of_no_class && weights[2] > 0.95, "{weights:?}");
        assert!(after(60, 115).1, "most are of no class");
        assert!(!after(20, 0).1);
    }

    #[test]
    fn signals_that_are_of_no_class_only_together_are_told_as_such() {
        let rules = rules();
        let uncertain = IsolatedSignal {
            weights: vec![0.02, 0.05, 0.2],
            reason: Some(Reason::Uncertain),
            ..IsolatedSignal::default()
        };
        let mut draft = EpisodeDraft::new(&rules);
        (0..40).for_each(|_| draft.add(&uncertain, &rules));
        let (_, of_no_class) = draft.weights();
        assert!(of_no_class);
        assert_eq!(draft.why_unnamed(of_no_class), Reason::UnknownFault);
        assert_eq!(draft.looks_like(), &Appearance::OtherRing);
    }

    #[test]
    fn signals_that_may_as_well_be_no_class_are_counted_apart_from_those_of_none() {
        let rules = rules();
        let mut draft = EpisodeDraft::new(&rules);
        let of_class = IsolatedSignal { weights: vec![0.0, 0.9, 0.0], ..IsolatedSignal::default() };
        let twin = Some(Appearance::Like("a heavier restrictor".into()));
        let as_well = IsolatedSignal { appearance: twin.clone(), ..of_class.clone() };
        let none = IsolatedSignal {
            appearance: Some(Appearance::OtherRing),
            reason: Some(Reason::UnknownFault),
            ..of_class.clone()
        };
        for signal in [&of_class, &none, &as_well, &as_well, &of_class] {
            draft.add(signal, &rules);
        }
        assert_eq!((draft.named, draft.fits_none, draft.as_well), (5, 1, 2));
        assert_eq!(draft.appearance, twin, "of the last that had one");
    }
}
