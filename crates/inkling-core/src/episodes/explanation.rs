//! One plain sentence per episode, for a technician.
//!
//! In: an [`Episode`], the rings of its signals, the class that is nearest or what the signals look
//! like instead. Out: the sentence: the channel; how the ring has changed; the class with its size,
//! the category, or where to look for the cause of what is of no class; and the certainty.

use super::{Episode, Rings};
use crate::fault::{self, Class};
use crate::model::faults::Catalogue;
use crate::verdict::Appearance;

/// The sentence of an episode: `channel 713: resonance 64.7 → 61.9 kHz, damping +31 %: partly
/// blocked nozzle, 22 ± 3 % of the cross-section, certainty .97`. `nearest`: the class with the
/// largest weight and that weight; `instead`: what else the signals look like.
pub fn sentence(
    episode: &Episode,
    rings: Option<&Rings>,
    nearest: Option<(&Class, f64)>,
    instead: Instead,
) -> String {
    let mut text = format!("channel {}: ", episode.channel);
    if let Instead::NoClass(strange) = instead {
        if let Some(rings) = rings.filter(|_| strange.is_a_ring()) {
            text += &format!("{}: ", ring_in_words(rings));
        }
        return text + &in_words(strange);
    }

    let or = match instead {
        Instead::OrThis(other) => in_short(other).map_or(String::new(), |it| format!(" or {it}")),
        _ => String::new(),
    };
    match rings {
        Some(r) => text += &format!("{}: ", ring_in_words(r)),
        None => text += "rings unlike a healthy channel: ",
    }
    let certainty =
        episode.certainty.map_or(String::new(), |c| format!(", certainty {}", share(c)));

    match (&episode.fault, &episode.category, nearest) {
        (Some(name), ..) => {
            text += fault::in_words(name);
            // the size in the words of the kind of fault that the class is, or in the user's own unit
            let laws = Catalogue::default();
            let kind = nearest.and_then(|(class, _)| laws.one_kind(&class.of)).unwrap_or(name);
            let size = size_in_words(kind, episode.severity_last, episode.severity_sd);
            let unit = nearest.and_then(|(class, _)| class.unit.as_deref());
            match unit.filter(|_| !size.is_empty()) {
                Some(unit) => text += &format!("{} {unit}", size.replace(" severity", "")),
                None => text += &size,
            }
            text += &(or + &certainty);
        }
        (None, Some(category), nearest) => {
            text += &category.replace('_', " ");
            // the likeliest class may be of another category, whose classes together weigh less
            if let Some((class, _)) = nearest.filter(|(class, _)| class.category == *category) {
                text += &format!(" (at best {})", class.name);
            }
            text += &(or + &certainty);
        }
        (None, None, Some((class, weight))) => {
            text += &format!("not named; at best {}{or}", fault::in_words(&class.name));
            text += &format!(", certainty {}", share(weight));
        }
        (None, None, None) => text += "not named",
    }
    text
}

#[derive(Clone, Copy, Debug)]
pub enum Instead<'a> {
    Nothing,
    /// The signals belong to no known class, and look like this.
    NoClass(&'a Appearance),
    /// The signals may as well be this ([`Appearance::AS_WELL`]).
    OrThis(&'a Appearance),
}

impl Appearance {
    /// Whether resonance and damping mean something: it is a ring with nothing beside it.
    fn is_a_ring(&self) -> bool {
        use Appearance::{AllOff, Late, Like, OtherClock, OtherGain, OtherRing};
        matches!(self, OtherGain(_) | OtherClock(_) | Late(_) | AllOff | Like(_) | OtherRing)
    }
}

fn in_short(other: &Appearance) -> Option<String> {
    Some(match other {
        Appearance::OtherGain(ratio) => format!("{} times the gain", times(*ratio)),
        Appearance::OtherClock(ratio) => {
            format!("a clock {} off", signed_percent(100.0 * (ratio - 1.0)))
        }
        Appearance::Late(s) if *s < 0.0 => format!("{:.1} µs too early", -1e6 * s),
        Appearance::Late(s) => format!("a delay of {:.1} µs", 1e6 * s),
        Appearance::AllOff => "all elements a little off".into(),
        Appearance::Like(name) => name.to_string(),
        _ => return None,
    })
}

/// A ratio of two digits behind the point, or of two digits where it is small.
fn times(ratio: f64) -> String {
    if ratio.abs() < 0.1 { format!("{ratio:.1e}") } else { format!("{ratio:.2}") }
}

fn in_words(strange: &Appearance) -> String {
    const LOOK: &str = "look at cable, connector and amplifier, not at the nozzle";
    match *strange {
        Appearance::NoiseAlone => {
            format!("nothing rings, noise alone: a dead sensor line or a broken wire; {LOOK}")
        }
        Appearance::Constant => format!("nothing rings, a constant value: {LOOK}"),
        Appearance::OtherGain(ratio) if ratio < 0.0 => format!(
            "rings upside down, {} times as large as a healthy channel: swapped wires; {LOOK}",
            times(-ratio)
        ),
        Appearance::OtherGain(ratio) => format!(
            "rings like a healthy channel with {} times its size: gain or contact of the \
             sensor line; {LOOK}",
            times(ratio)
        ),
        Appearance::OtherClock(ratio) => format!(
            "rings like a healthy channel {:.*} % {} in damping and frequency alike: the clock of its sampling; \
             {LOOK}",
            usize::from((ratio - 1.0).abs() < 0.0095),
            100.0 * (ratio - 1.0).abs(),
            if ratio < 1.0 { "slower" } else { "faster" }
        ),
        Appearance::Late(s) => format!(
            "rings like a healthy channel {:.1} µs {}: the trigger or a delay of the acquisition; {LOOK}",
            1e6 * s.abs(),
            if s > 0.0 { "late" } else { "early" }
        ),
        Appearance::AllOff => "all of its elements are a little off, as by no known fault alone: another channel \
                               or actuator, or several faults at once; look at the nozzle, then at the sensor line"
            .into(),
        Appearance::Like(ref name) => {
            format!("like {name}, which is no class of the design: look at the channel")
        }
        Appearance::Tone(hz) => {
            format!("a steady tone of {:.1} kHz beside the ring: pickup; {LOOK}", hz / 1e3)
        }
        Appearance::Jumps => format!("single samples jump: a loose contact or lost data; {LOOK}"),
        Appearance::Slow => {
            format!("an offset or a slow shape that no ring explains: {LOOK}")
        }
        Appearance::OtherRing => "it rings as no known fault makes it: look at the nozzle, then at the sensor line".into(),
        Appearance::Other => {
            "like no known fault, and unlike a healthy channel: look at the sensor \
                              line first, then at the nozzle"
                .into()
        }
    }
}

fn ring_in_words(r: &Rings) -> String {
    let damping = 100.0 * (r.damping_per_s / r.healthy_damping_per_s - 1.0);
    let (from, to) = (r.healthy_frequency_hz / 1e3, r.frequency_hz / 1e3);
    // one decimal of each, two where the frequencies might look the same
    let digits = if (to - from).abs() < 0.1 { 2 } else { 1 };
    format!("resonance {from:.digits$} → {to:.digits$} kHz, damping {}", signed_percent(damping))
}

/// A change with its sign, `±` if it is rounded to 0: `+31 %`.
fn signed_percent(percent: f64) -> String {
    let sign = match percent.round() {
        0.0 => '±',
        p if p < 0.0 => '−',
        _ => '+',
    };
    format!("{sign}{:.0} %", percent.abs())
}

/// A probability in two digits without the leading zero: `.97`. It is never rounded to 1.
pub fn share(c: f64) -> String {
    let rounded = format!("{:.2}", c.clamp(0.0, 0.99));
    rounded.trim_start_matches('0').to_owned()
}

/// The severity of a class in words, `, 22 ± 3 % of the cross-section`; "severity" for a class of the
/// user's own; empty if none was estimated.
pub fn size_in_words(class: &str, severity: Option<f64>, sd: Option<f64>) -> String {
    let Some(size) = severity.filter(|s| s.is_finite()) else { return String::new() };
    let sd = sd.filter(|sd| sd.is_finite() && *sd > 0.0);
    // the size times `scale`, in as many decimals as one digit of its uncertainty has
    let of = |scale: f64| -> String {
        let size = size * scale;
        match sd.map(|sd| sd * scale) {
            None => format!("{size:.0}"),
            Some(sd) => {
                let digits = if sd >= 0.95 { 0 } else { (-sd.log10()).ceil().min(4.0) as usize };
                format!("{size:.digits$} ± {sd:.digits$}")
            }
        }
    };
    let ratio = || match sd {
        Some(sd) => format!("{size:.2} ± {sd:.2}"),
        None => format!("{size:.2}"),
    };
    match class {
        "EC" => format!(", {} % of the density missing", of(100.0)),
        "BN" | "PBN" => format!(", {} % of the cross-section", of(100.0)),
        "AB1" => format!(", {} % of the nozzle's length", of(100.0)),
        "AB2" | "AB3" => format!(", compliance +{} %", of(100.0)),
        "SDN" | "IDN" | "DDN" => format!(", viscosity × {}", ratio()),
        _ => format!(", severity {}", ratio()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn episode() -> Episode {
        Episode {
            printhead: "p".into(),
            channel: 713,
            category: Some("blocked_nozzle".into()),
            fault: Some("PBN".into()),
            bursts: 9,
            certainty: Some(0.971),
            severity_first: Some(0.05),
            severity_max: Some(0.23),
            severity_last: Some(0.22),
            severity_sd: Some(0.03),
            ..Episode::default()
        }
    }

    const RINGS: Rings = Rings {
        frequency_hz: 61.9e3,
        damping_per_s: 1.31 * 2.9e4,
        healthy_frequency_hz: 64.7e3,
        healthy_damping_per_s: 2.9e4,
    };

    #[test]
    fn named_fault_is_said_as_the_contract_has_it() {
        let nearest = Some((&Class::plain("PBN"), 0.97));
        assert_eq!(
            sentence(&episode(), Some(&RINGS), nearest, Instead::Nothing),
            "channel 713: resonance 64.7 → 61.9 kHz, damping +31 %: partly blocked nozzle, \
             22 ± 3 % of the cross-section, certainty .97"
        );
    }

    #[test]
    fn a_ring_is_told_in_as_many_digits_as_show_its_change() {
        let of = |frequency_hz, damping: f64| {
            let damping_per_s = damping * RINGS.healthy_damping_per_s;
            ring_in_words(&Rings { frequency_hz, damping_per_s, ..RINGS })
        };
        assert_eq!(of(64.66e3, 0.881), "resonance 64.70 → 64.66 kHz, damping −12 %");
        assert_eq!(of(64.74e3, 1.001), "resonance 64.70 → 64.74 kHz, damping ±0 %");
        assert_eq!(of(66.0e3, 1.02), "resonance 64.7 → 66.0 kHz, damping +2 %");
    }

    #[test]
    fn what_is_not_known_is_not_said() {
        let no_size = Episode { severity_last: None, ..episode() };
        let category = Episode { fault: None, ..episode() };
        let unnamed = Episode { category: None, certainty: None, ..category.clone() };
        for (episode, rings, nearest, said) in [
            (&no_size, Some(&RINGS), None, "partly blocked nozzle, certainty .97"),
            (&category, None, Some(("BN", 0.6)), "blocked nozzle (at best BN), certainty .97"),
            (&category, None, Some(("EC", 0.4)), "blocked nozzle, certainty .97"),
            (&unnamed, None, Some(("BN", 0.6)), "not named; at best blocked nozzle, certainty .60"),
            (&unnamed, None, None, "channel 713: rings unlike a healthy channel: not named"),
        ] {
            let nearest = nearest.map(|(class, certainty)| (Class::plain(class), certainty));
            let nearest = nearest.as_ref().map(|(class, certainty)| (class, *certainty));
            let text = sentence(episode, rings, nearest, Instead::Nothing);
            assert!(text.ends_with(said), "{text}");
        }
        let (nearest, rather) = (Class::plain("BN"), Instead::NoClass(&Appearance::NoiseAlone));
        let text = sentence(&unnamed, None, Some((&nearest, 0.6)), rather);
        assert!(text.contains("noise alone") && text.contains("not at the nozzle"), "{text}");
    }

    #[test]
    fn what_may_be_as_well_as_the_class_is_told_beside_it() {
        let unnamed = Episode { fault: None, category: None, certainty: None, ..episode() };
        let twin = Appearance::Like("a blocked restrictor".into());
        let nearest = Some((&Class::plain("PBN"), 0.6));
        let text = sentence(&unnamed, Some(&RINGS), nearest, Instead::OrThis(&twin));
        let said =
            "not named; at best partly blocked nozzle or a blocked restrictor, certainty .60";
        assert!(text.ends_with(said), "{text}");
        let text = sentence(&unnamed, Some(&RINGS), nearest, Instead::NoClass(&twin));
        assert!(text.contains("61.9 kHz, damping +31 %: like a blocked restrictor"), "{text}");
        let own = Class { unit: Some("of the nozzle's mass".into()), ..Class::plain("wetting") };
        let named = Episode { fault: Some("wetting".into()), ..episode() };
        let text = sentence(&named, None, Some((&own, 0.97)), Instead::Nothing);
        assert!(
            text.ends_with("wetting, 0.22 ± 0.03 of the nozzle's mass, certainty .97"),
            "{text}"
        );
    }

    #[test]
    fn what_is_of_no_class_is_told_by_what_it_looks_like() {
        use Appearance::{Constant, Jumps, Late, Other, OtherClock, OtherGain, Slow, Tone};
        for (strange, said) in [
            (OtherGain(-0.98), "rings upside down, 0.98 times as large"),
            (OtherGain(0.51), "rings like a healthy channel with 0.51 times its size"),
            (OtherGain(1.5e-4), "with 1.5e-4 times its size"),
            (OtherClock(0.9), "healthy channel 10 % slower"),
            (OtherClock(0.996), "healthy channel 0.4 % slower"),
            (Late(0.78e-6), "0.8 µs late"),
            (Tone(76_340.0), "a steady tone of 76.3 kHz"),
            (Jumps, "single samples jump"),
            (Slow, "an offset or a slow shape"),
            (Constant, "a constant value"),
        ] {
            let text = in_words(&strange);
            assert!(text.contains(said) && text.ends_with("not at the nozzle"), "{text}");
        }
        assert!(in_words(&Other).contains("then at the nozzle"));
    }

    #[test]
    fn every_kind_of_size_has_its_words() {
        let size = |class: &str, s, sd| size_in_words(class, Some(s), Some(sd));
        assert_eq!(size("IDN", 1.583, 0.043), ", viscosity × 1.58 ± 0.04");
        assert_eq!(size("AB2", 0.322, 0.021), ", compliance +32 ± 2 %");
        assert_eq!(size("AB1", 0.1213, 0.004), ", 12.1 ± 0.4 % of the nozzle's length");
        assert_eq!(size("own", 3.0, 0.5), ", severity 3.00 ± 0.50");
        assert_eq!(size_in_words("EC", Some(0.4), None), ", 40 % of the density missing");
        assert_eq!(size_in_words("EC", Some(0.4), Some(0.0)), ", 40 % of the density missing");
        assert_eq!(size_in_words("EC", Some(f64::NAN), None), "");
        assert_eq!(size("IDN", 1.5, f64::NAN), ", viscosity × 1.50");
    }
}
