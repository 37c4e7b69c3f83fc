//! Makes an [`Episode`] of a channel's state and its draft, with a name, sizes and a sentence.

use super::Episode;
use super::channel::Channel;
use super::episode_draft::EpisodeDraft;
use super::explanation::{self, Instead};
use super::rules::Rules;
use crate::verdict::Appearance;
use std::sync::Arc;

impl Channel {
    /// The channel's episode, if it was raised with the look at hand, or if that look gives it another name
    /// than it was announced with. `t_ns`: time of the look; `is_named`: isolation said something of it.
    pub fn news(
        &mut self,
        printhead: &Arc<str>,
        t_ns: i64,
        is_named: bool,
        rules: &Rules,
    ) -> Option<Episode> {
        let draft = self.draft.as_ref().filter(|_| self.evidence.is_raised())?;
        let is_new = draft.raised_at_ns == t_ns;
        if !is_new && !is_named {
            return None;
        }
        let now = self.episode(printhead, draft, rules, None);
        let announced_as = (now.category.clone(), now.fault.clone());
        // a name that is no longer certain is no other name
        let is_other = announced_as.0.is_some() && announced_as != draft.announced_as;
        if !is_new && !is_other {
            return None;
        }
        self.draft.as_mut()?.announced_as = announced_as;
        Some(now)
    }

    /// The episode that a draft of this channel stands for. `ended_at_ns`: `None` if the episode is still on.
    pub fn episode(
        &self,
        printhead: &Arc<str>,
        draft: &EpisodeDraft,
        rules: &Rules,
        ended_at_ns: Option<i64>,
    ) -> Episode {
        let largest = |weights: &mut dyn Iterator<Item = f64>| -> Option<(usize, f64)> {
            weights.enumerate().reduce(|best, next| if next.1 > best.1 { next } else { best })
        };

        // The name: the class if it is certain, else the category if that is, and none if what is no class
        // weighs most.
        let weights = draft.classes.weights();
        let fits_none = draft.named > 0 && draft.classes.none() > 0.5;
        let named = draft.named > draft.fits_none;
        let best = largest(&mut weights.iter().copied()).filter(|_| named);
        let categories = rules.categories(weights);
        let category = largest(&mut categories.iter().map(|c| c.1));
        let (mut fault, mut named_category, mut certainty) = (None, None, best.map(|b| b.1));
        if let (Some((class, weight)), false) = (best, fits_none) {
            if weight >= rules.certainty {
                let name = &rules.classes[class].name;
                fault = Some(name.clone());
                named_category = Some(rules.classes[class].category.clone());
            } else if let Some((k, sum)) = category.filter(|(_, sum)| *sum >= rules.certainty) {
                named_category = Some(categories[k].0.to_owned());
                certainty = Some(sum);
            }
        }

        // the severities of the quantity that the best class is sized by
        let sizes = best.and_then(|(class, _)| *draft.sizes.get(rules.quantities[class])?);
        // looks that fit the return to healthy are not the fault's, unless it stayed
        let bursts = match (ended_at_ns, draft.fading) {
            (Some(_), Some((_, before))) => before,
            _ => self.looks,
        };

        let mut episode = Episode {
            recording: Arc::default(),
            printhead: printhead.clone(),
            channel: self.number,
            category: named_category,
            fault,
            raised_at_ns: draft.raised_at_ns,
            began_at_ns: self.onset_ns,
            ended_at_ns,
            bursts,
            certainty,
            severity_first: sizes.map(|s| f64::from(s.first)),
            severity_max: sizes.map(|s| f64::from(s.max)),
            severity_last: sizes.map(|s| f64::from(s.last)),
            severity_sd: sizes.and_then(|s| s.sd).map(f64::from),
            resonance_hz: draft.resonance.map(|(f, _)| f.into()),
            damping_per_s: draft.resonance.map(|(_, damping)| damping.into()),
            reason: None,
            explanation: String::new(),
        };

        episode.reason = match episode.category {
            Some(_) => None,
            None => Some(draft.commonest_reason(fits_none)),
        };

        // The sentence. What the signals look like takes the place of the class if they fit none, and stands
        // beside it if most of them may as well be that.
        let nearest = best.map(|(class, weight)| (&rules.classes[class], weight));
        let instead = match (&draft.appearance, fits_none) {
            (appearance, true) => {
                Instead::Rather(appearance.as_ref().unwrap_or(&Appearance::Other))
            }
            (Some(appearance), false) if 2 * draft.as_well > draft.named => {
                Instead::AsWell(appearance)
            }
            _ => Instead::Nothing,
        };
        episode.explanation =
            explanation::sentence(&episode, draft.rings.as_ref(), nearest, instead);
        // only a fault that is flagged in less than half of the bursts is said to come and go
        if let Some(share) = draft.share.filter(|share| *share < 0.5) {
            episode.explanation += &explanation::comes_and_goes(share);
        }
        episode
    }
}
