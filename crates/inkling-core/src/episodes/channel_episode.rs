//! Makes an [`Episode`] of a channel's state and its draft, with a name, sizes and a sentence.
//!
//! In: a [`Channel`], which counts the looks and knows the onset; an [`EpisodeDraft`], which holds
//! what isolation said of the flagged signals; and [`Rules`], with the rule of names. Out: an
//! [`Episode`] when it ends or the recording does ([`Channel::episode`]), and, for whoever wants to
//! hear of it at once, when it is raised or gets another name ([`Channel::news`]).

use super::Episode;
use super::channel::Channel;
use super::episode_draft::EpisodeDraft;
use super::explanation::{self, Instead};
use super::rules::Rules;
use std::sync::Arc;

impl Channel {
    /// The channel's episode, if the look at `t_ns` raised it or gave it another name than it was
    /// announced with; not if it only loses a name. `is_isolated`: isolation said something of it.
    pub fn news(
        &mut self,
        printhead: &Arc<str>,
        t_ns: i64,
        is_isolated: bool,
        rules: &Rules,
    ) -> Option<Episode> {
        let draft = self.draft.as_ref().filter(|_| self.evidence.raised)?;
        let is_new = draft.raised_at_ns == t_ns;
        if !is_new && !is_isolated {
            return None;
        }

        let now = self.episode(printhead, draft, rules, None);
        let is_other =
            |now: &Option<String>, before: &Option<String>| now.is_some() && now != before;
        let (category, fault) = &draft.announced_as;
        if !is_new && !is_other(&now.category, category) && !is_other(&now.fault, fault) {
            return None;
        }
        self.draft.as_mut()?.announced_as = (now.category.clone(), now.fault.clone());
        Some(now)
    }

    /// It is to be called before the channel's next look. `ended_at_ns`: `None` if it is still on.
    pub fn episode(
        &self,
        printhead: &Arc<str>,
        draft: &EpisodeDraft,
        rules: &Rules,
        ended_at_ns: Option<i64>,
    ) -> Episode {
        // no name if "no class" has more than half of the weight, or if none of the signals fits one;
        // the certainty then is the weight of the best class
        let (weights, of_no_class) = draft.weights();
        let any_fits = draft.named > draft.fits_none;
        let likeliest = rules.naming.name(&weights, 1.0).filter(|_| any_fits);
        let best = likeliest.map(|of| (of.best, weights[of.best]));
        let named = likeliest.filter(|_| !of_no_class);
        let certainty = named.map_or(best.map(|(_, weight)| weight), |named| Some(named.certainty));
        let class = named.and_then(|named| rules.classes.get(usize::from(named.fault?)));
        let category = named
            .and_then(|named| rules.naming.categories.get(usize::from(named.category?)).cloned());

        // sizes are in the quantity that the best class is sized by, even if it is not named
        let sizes = best.and_then(|(class, _)| *draft.sizes.get(rules.quantities[class])?);
        // an episode that has ended does not count the looks that already fit the return to healthy
        let bursts = match (ended_at_ns, draft.fading) {
            (Some(_), Some((_, before))) => before,
            _ => self.looks,
        };
        let mut episode = Episode {
            printhead: printhead.clone(),
            channel: self.number,
            reason: category.is_none().then(|| draft.why_unnamed(of_no_class)),
            category,
            fault: class.map(|class| class.name.clone()),
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
            ..Episode::default()
        };

        let nearest = best.map(|(class, weight)| (&rules.classes[class], weight));
        let instead = instead(draft, of_no_class);
        episode.explanation =
            explanation::sentence(&episode, draft.rings.as_ref(), nearest, instead);
        // what is flagged in half of the looks is not said to come and go
        if let Some(share) = draft.share.filter(|share| *share < 0.5) {
            let one_of = 1.0 / share;
            episode.explanation +=
                &format!(", comes and goes: in about 1 of {one_of:.0} of its bursts");
        }
        episode
    }
}

fn instead(draft: &EpisodeDraft, of_no_class: bool) -> Instead<'_> {
    match &draft.appearance {
        _ if of_no_class => Instead::NoClass(draft.looks_like()),
        Some(appearance) if 2 * draft.as_well > draft.named => Instead::OrThis(appearance),
        _ => Instead::Nothing,
    }
}
