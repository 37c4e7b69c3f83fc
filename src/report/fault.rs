//! A story as an entry of the cleaning list: how urgent the fault is, what to do, and one sentence.
//!
//! In: the `Story`s of one channel in the order of time, and the report's settings. Out: a `Fault`
//! for each (`Fault::of_channel`), which the page, the terminal's list and `report.faults.parquet`
//! show. Only the last fault of a channel is to be cleaned; those before it are its past.
//!
//! The formulas: urgency = certainty x expected loss of a drop x (1 if the fault is on, 0.5 if it
//! is over but came back before, 0 if it is over). The loss is a rough share of a drop by class and
//! severity (`loss`), a day ahead where the trend is certain. Of a fault without a name of now it is 1 - 1 / d,
//! where d is its distance from healthy in distances of the threshold, at least the loss of the size that it had
//! last; its certainty counts as a half, since nothing is known of its drop. The forecast (`hours_to_visible`)
//! follows the trend until half of a drop is lost. The factors are heuristic; nothing was tuned.

use super::acknowledged;
use super::settings::ReportSettings;
use super::story::Story;
use super::trend::{Direction, Trend};
use super::watch::{DISTANCE, Spell, sized_as};
use super::words;
use inkling_core::episodes::{share, size_in_words};
use inkling_core::fault;
use inkling_core::model::bisection::bisected;
use inkling_core::model::faults::{self, Law};
use inkling_core::verdict::Reason;
use std::cmp::Reverse;

/// Certainty or loss where it is not known. Arbitrary: the middle.
const UNKNOWN: f64 = 0.5;
/// Factor of the urgency for a fault that is over, but came back before. Arbitrary.
const MAY_RETURN: f64 = 0.5;

/// Urgencies are rounded to multiples of this, so that faults that differ by less are equally urgent.
const URGENCY_STEP: f64 = 0.01;

/// A row of the cleaning list and of `report.faults.parquet`.
#[derive(Clone, Debug)]
pub struct Fault {
    pub story: Story,
    /// From 0 to 1, by the formula of the file's doc; 0 for a fault that another one followed.
    pub urgency: f64,
    pub action: String,
    pub sentence: String,
    /// Whether this is the last fault of its channel, which tells the present state of the channel.
    pub is_latest: bool,
    /// For the last fault of a channel: the faults before it. Empty for others.
    pub earlier: Vec<EarlierFault>,
}

/// An earlier fault of a channel, in words, from its onset to its end (`None`: no end was seen).
#[derive(Clone, Debug, PartialEq)]
pub struct EarlierFault {
    pub what: String,
    pub from_ns: i64,
    pub to_ns: Option<i64>,
}

impl Fault {
    /// The faults of one channel, from its stories in the order of time.
    pub fn of_channel(mut stories: Vec<Story>, settings: &ReportSettings) -> Vec<Fault> {
        let latest = stories.pop();
        let earlier_fault = |story: &Story| {
            let (from_ns, to_ns) = (story.began_at_ns, story.ended_at_ns);
            EarlierFault { what: what(story), from_ns, to_ns }
        };
        let past = stories.iter().map(earlier_fault).collect();
        let earlier = stories.into_iter().map(|story| Fault::new(story, None, settings));
        earlier.chain(latest.map(|story| Fault::new(story, Some(past), settings))).collect()
    }

    /// A fault. `past`: the faults before it, if it is the last one of its channel.
    fn new(story: Story, past: Option<Vec<EarlierFault>>, settings: &ReportSettings) -> Fault {
        let is_latest = past.is_some();
        let urgency = (urgency(&story) / URGENCY_STEP).round() * URGENCY_STEP;
        let mut fault = Fault {
            urgency: if is_latest && story.replaced_at_ns.is_none() { urgency } else { 0.0 },
            action: settings.action(key(&story)).to_owned(),
            sentence: String::new(),
            is_latest,
            earlier: past.unwrap_or_default(),
            story,
        };
        fault.sentence = sentence_of(&fault);
        fault
    }

    /// Whether the channel is to be cleaned: its last fault is still on, or is over but came back before.
    pub fn is_open(&self) -> bool {
        let is_on = self.story.ended_at_ns.is_none() || self.story.cures > 0;
        self.is_latest && is_on && self.story.replaced_at_ns.is_none()
    }
}

/// The key under which the settings hold the action: the reason for which signals have no name, or else the category.
fn key(story: &Story) -> &str {
    story.reason.map(Reason::as_str).or(story.category.as_deref()).unwrap_or_default()
}

/// The urgency by the file's formula. A certain trend extrapolates the severity by a day, or by the time over
/// which the trend was seen if that is shorter.
fn urgency(story: &Story) -> f64 {
    let ahead = certain_trend(story).map_or(0.0, |t| t.per_day * t.span_days.min(1.0));
    let of_class = |severity| loss(story.fault.as_deref(), story.category.as_deref(), severity);
    let (certainty, loss) = match story.reason {
        // a signal without a ring certainly has a fault, though nothing is known of the nozzle
        Some(Reason::NoRing) => (1.0, UNKNOWN),
        _ if is_named_now(story) => {
            (story.certainty.unwrap_or(UNKNOWN), of_class(story.severity_last.map(|s| s + ahead)))
        }
        _ => {
            let by_distance = story.distance.map_or(UNKNOWN, |d| 1.0 - 1.0 / (d + ahead).max(1.0));
            let before = story.lost.and_then(|of| of.severity);
            (UNKNOWN, by_distance.max(before.map_or(0.0, |s| of_class(Some(s)))))
        }
    };
    let on = match (story.ended_at_ns, story.cures) {
        (None, _) => 1.0,
        (Some(_), 0) => 0.0,
        (Some(_), _) => MAY_RETURN,
    };
    certainty.clamp(0.0, 1.0) * loss * on
}

/// Whether present signals carry the fault's name.
pub fn is_named_now(story: &Story) -> bool {
    story.category.is_some() && story.lost.is_none()
}

/// Rough share of a healthy drop that is lost: 0 none, 1 all. `severity` is in the class's unit;
/// without a class the category's classes are taken for one if they are sized alike.
fn loss(class: Option<&str>, category: Option<&str>, severity: Option<f64>) -> f64 {
    let class = class.or_else(|| match category? {
        "empty_channel" => Some("EC"),
        category => sized_as(category),
    });
    let of = |loss: fn(f64) -> f64| severity.map_or(UNKNOWN, loss).clamp(0.0, 1.0);
    match class.unwrap_or_default() {
        // A blocked nozzle and a bubble in the nozzle (AB1) take their share of the nozzle. A dried
        // nozzle has its viscosity times the severity, and 1 / severity of the drop is taken to come
        // out. A bubble in the chamber (AB2, AB3) adds its compliance to the chamber's, which is taken
        // to keep that part of the drive.
        "EC" => 1.0, // no ink, no drop
        "BN" | "PBN" | "AB1" => of(|s| s),
        "SDN" | "IDN" | "DDN" => of(|s| 1.0 - 1.0 / s.max(1.0)),
        "AB2" | "AB3" => of(|s| s / (1.0 + s.max(0.0))),
        _ => UNKNOWN,
    }
}

/// What the fault is in words, without its size.
pub fn what(story: &Story) -> String {
    let words = name_in_words(story);
    match (story.lost, story.ended_at_ns) {
        (None, _) => words,
        (Some(_), None) => {
            let now = story.explanation.as_deref().unwrap_or("no longer named");
            format!("{now}; {words} when last known")
        }
        (Some(_), Some(_)) => format!("not named at its end; {words} when last known"),
    }
}

/// The name of the fault, or what stands for it.
fn name_in_words(story: &Story) -> String {
    match (&story.fault, &story.category, &story.explanation, story.reason) {
        (Some(class), ..) => match fault::in_words(class) {
            words if words == class => class.clone(),
            words => format!("{words} ({class})"),
        },
        (None, Some(category), ..) => category.replace('_', " "),
        (None, None, Some(words), _) => words.clone(),
        (None, None, None, Some(Reason::NoRing)) => "no ring: sensor line or acquisition".into(),
        (None, None, None, Some(Reason::UnknownFault)) => "a ring of no known class".into(),
        (None, None, None, _) => "not named".into(),
    }
}

/// The size of the fault in words, with its time where that is over; empty if it was not sized.
pub fn size(story: &Story) -> String {
    let of_category = || sized_as(story.category.as_deref()?);
    let Some(class) = story.fault.as_deref().or_else(of_category) else { return String::new() };
    let of = story.lost.map_or((story.severity_last, story.severity_sd), |of| (of.severity, of.sd));
    let size = size_in_words(class, of.0, of.1);
    let at = story.lost.map(|_| format!("at {}", words::clock(story.known_at_ns)));
    words::joined([size.trim_start_matches(", ").to_owned(), at.unwrap_or_default()], " ")
}

/// Of a fault that signals no longer name: since when that is so, and what is known instead.
pub fn instead_in_words(story: &Story) -> Option<String> {
    story.lost?;
    let since = words::clock(story.known_at_ns);
    if story.ended_at_ns.is_some() {
        return Some(format!("its signals carried no name after {since}"));
    }
    let distance = story.distance.map(|d| {
        format!("now {} times as far from healthy as the threshold", words::three_digits(d))
    });
    let ring = |of: &&Spell| of.episode.resonance_hz.zip(of.episode.damping_per_s);
    let rings = story
        .spells
        .iter()
        .find_map(|of| ring(&of))
        .zip(story.spells.iter().rev().find_map(|of| ring(&of)));
    let ring = rings.map(|((f0, d0), (f, d))| {
        let of = |now: f64, then: f64| words::signed(100.0 * (now / then - 1.0), 1);
        format!("resonance {} % and damping {} % since its first episode", of(f, f0), of(d, d0))
    });
    let known = words::joined([distance.unwrap_or_default(), ring.unwrap_or_default()], ", ");
    Some(words::joined([format!("its signals carry no name since {since}"), known], "; "))
}

/// Least change of a fault over the span of its trend, as a share of its size, that is told. Whoever asks night after night
/// whether a constant fault grows is told so some night, by chance; and a change of less moves nobody.
const LEAST_CHANGE: f64 = 0.1;

/// The trend, if its 95 % interval excludes 0 and it changes the fault by a tenth. Tables and forecasts use no other.
pub fn certain_trend(story: &Story) -> Option<&Trend> {
    let class = story.fault.as_deref().or_else(|| sized_as(story.category.as_deref()?));
    let none = class.and_then(faults::law).map_or(0.0, Law::none);
    let size = story.severity_last.map(|size| (size - none).abs()).or(story.distance);
    let matters = |trend: &&Trend| {
        let change = trend.per_day.abs() * trend.span_days;
        change >= LEAST_CHANGE * size.unwrap_or_default()
    };
    let trend = story.trend.as_ref().filter(|trend| trend.direction() != Direction::Steady);
    trend.filter(matters)
}

/// The trend in words, `getting worse: +3.1 points a day (+2.5 to +3.7)`. The change is per day if
/// it was seen over a day or more, else per hour. Only a certain change is told, else `no trend
/// yet`; the text is empty if the fault was not sized, or has no name and no certain trend.
pub fn trend_in_words(story: &Story) -> String {
    let is_unnamed = story.quantity.as_deref() == Some(DISTANCE);
    if story.severity_last.is_none() && !is_unnamed {
        return String::new();
    }
    let Some(trend) = certain_trend(story) else {
        return if is_unnamed { String::new() } else { "no trend yet".into() };
    };

    let (per, unit) = match trend.span_days {
        days if days >= 1.0 => (1.0, "day"),
        _ => (24.0, "hour"),
    };
    // Severities that are factors, and those of a user's own classes (their category is named like
    // the class), are shown as they are; severities that are shares are shown in hundredths.
    let class = story.fault.as_deref().unwrap_or_default();
    let is_factor = story.category.as_deref() == Some("dried_nozzle");
    let is_own = !class.is_empty() && fault::category(class) == class;
    let (scale, of) = match () {
        () if is_unnamed => (1.0, " thresholds"),
        () if is_factor || is_own => (1.0, ""),
        () => (100.0, " points"),
    };
    let [low, high] = trend.interval.map(|v| v * scale / per);

    // As many decimals as show the first digit of the uncertainty.
    // and, within reason, the first digit of the bound that lies next to 0
    let digits = words::digits_of((high - low) / 2.0);
    let digits = digits.max(words::digits_of(low.abs().min(high.abs())).min(digits + 2));
    let n = |v: f64| words::signed(v, digits);
    let word = match trend.direction() {
        Direction::Worse => "getting worse",
        _ => "getting better",
    };
    let rate = n(trend.per_day * scale / per);
    let what = if is_unnamed { ", how far it is from healthy" } else { "" };
    format!("{word}: {rate}{of} a {unit} ({} to {}){what}", n(low), n(high))
}

/// A defect counts as visible from this loss of a drop on.
const VISIBLE_LOSS: f64 = 0.5;

/// The time until the defect is visible, if the fault goes on getting worse at the same rate: hours
/// from the last look, and an interval from the 95 % intervals of trend and size. `None` if the
/// fault does not get worse, is over or is visible already, if it would take more than about a
/// year, or if the interval reaches beyond ten times the likeliest time.
pub fn hours_to_visible(story: &Story) -> Option<(f64, [f64; 2])> {
    let trend = certain_trend(story).filter(|trend| trend.direction() == Direction::Worse)?;
    let (last, sd) = (story.severity_last?, story.severity_sd.unwrap_or(0.0));
    let loss_at =
        |severity| loss(story.fault.as_deref(), story.category.as_deref(), Some(severity));
    let ahead = |hours: f64| last + trend.per_day * hours / 24.0;
    if story.ended_at_ns.is_some() || loss_at(last) >= VISIBLE_LOSS {
        return None;
    }

    // Double the time until the loss, which grows with severity, is beyond the limit, then bisect.
    let mut beyond = 1.0;
    while loss_at(ahead(beyond)) < VISIBLE_LOSS {
        beyond *= 2.0;
        if beyond > 24.0 * 365.0 {
            return None;
        }
    }
    let [_, visible] = bisected(0.0, beyond, 40, |hours| loss_at(ahead(hours)) < VISIBLE_LOSS);

    // The time is the severity that is left until then over the trend. The earliest time has the largest size
    // now and the largest change, the latest time the smallest of both.
    let left = ahead(visible) - last;
    let hours = |left: f64, per_day: f64| 24.0 * (left / per_day).max(0.0);
    let interval =
        [hours(left - 1.96 * sd, trend.interval[1]), hours(left + 1.96 * sd, trend.interval[0])];
    (interval[1] <= 10.0 * visible).then_some((visible, interval))
}

/// The forecast in words, `visible defect (half of a drop lost) in about 9 hours (7 to 12), if it goes on so`.
pub fn forecast_in_words(story: &Story) -> Option<String> {
    let (hours, [low, high]) = hours_to_visible(story)?;
    let (per, unit) = if hours < 72.0 { (1.0, "hours") } else { (24.0, "days") };
    let n = |hours: f64| match hours / per {
        few if few < 10.0 => format!("{few:.1}"),
        many => format!("{many:.0}"),
    };
    let when = match low < 0.1 * hours {
        true => format!("within {} {unit}, perhaps by now", n(high)),
        false => format!("in about {} {unit} ({} to {})", n(hours), n(low), n(high)),
    };
    Some(format!("visible defect (half of a drop lost) {when}, if it goes on so"))
}

/// The fault in one sentence, with what to do if the channel is to be cleaned.
fn sentence_of(fault: &Fault) -> String {
    let story = &fault.story;
    // the weight of the best class of what has no name says nothing
    let certainty = story.certainty.filter(|_| is_named_now(story));
    let certainty = certainty.map_or(String::new(), |c| format!("certainty {}", share(c)));
    let mut parts = vec![words::joined([what(story), size(story), certainty], ", ")];
    let since = words::clock(story.began_at_ns);
    let recordings = words::counted(story.recordings.into(), "recording");
    parts.push(match (story.ended_at_ns, story.cures) {
        (None, 0) => format!("since {since}, in {recordings}, still on"),
        (None, cures) => format!(
            "since {since}, in {recordings}, {} in between, on again since {}",
            words::counted_as(cures.into(), "cured once", "times cured"),
            words::clock(story.last_began_at_ns)
        ),
        (Some(end), _) if story.replaced_at_ns == Some(end) => {
            format!("from {since} to {}; the channel was replaced", words::clock(end))
        }
        (Some(end), _) if story.ended_with_all => format!(
            "from {since} to {}; since then all channels ring otherwise, and this one as they do: it need not be healthy",
            words::clock(end)
        ),
        (Some(end), 0) => format!("from {since} to {}, healthy since", words::clock(end)),
        (Some(end), cures) => format!(
            "since {since}, in {recordings}, came back {}; last healthy again {}",
            words::counted_as(cures.into(), "once", "times"),
            words::clock(end)
        ),
    });
    parts.extend(instead_in_words(story));
    if certain_trend(story).is_some() && story.ended_at_ns.is_none() {
        parts.push(trend_in_words(story));
    }
    parts.extend(forecast_in_words(story));
    if !fault.is_latest {
        parts.push("another fault came after it".into());
    }
    parts.extend(story.known.as_deref().map(acknowledged::in_words));
    let text = format!("channel {}: {}", story.channel, parts.join("; "));
    if fault.is_open() { format!("{text}: {}", fault.action) } else { text }
}

/// Sorts the most urgent faults first, then those that are still on, then by printhead and channel, as a
/// technician walks, then the newest first, so that the order is unique.
pub fn sort(faults: &mut [Fault]) {
    let place = |Fault { story, .. }: &Fault| {
        let is_over = story.ended_at_ns.is_some();
        (is_over, story.printhead.clone(), story.channel, Reverse(story.began_at_ns))
    };
    faults.sort_by(|a, b| b.urgency.total_cmp(&a.urgency).then_with(|| place(a).cmp(&place(b))));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::fixtures::spell;
    use crate::report::story::{Rates, stories};
    use crate::report::watch::Watch;

    #[test]
    fn equally_urgent_faults_have_one_order() {
        let of = |channel: u32| {
            let mut on = spell(0, 10, None, "dried_nozzle");
            (on.episode.channel, on.episode.certainty) =
                (channel, Some(0.9 + 1e-6 * f64::from(channel)));
            let stories = stories(&Watch::new(vec![on]), &Rates::default());
            Fault::of_channel(stories, &ReportSettings::default()).remove(0)
        };
        let mut faults = vec![of(9), of(2), of(5)];
        sort(&mut faults);
        let order: Vec<u32> = faults.iter().map(|f| f.story.channel).collect();
        assert_eq!(order, [2, 5, 9]);
    }

    #[test]
    fn visible_defects_are_forecast_where_a_trend_is_certain() {
        let stories =
            stories(&Watch::new(vec![spell(0, 10, None, "dried_nozzle")]), &Rates::default());
        let growing = |last, per_day: f64, half: f64| Story {
            severity_last: Some(last),
            severity_sd: Some(0.02),
            trend: Some(Trend {
                per_day,
                interval: [per_day - half, per_day + half],
                span_days: 2.0,
            }),
            ..stories[0].clone()
        };
        // half of a drop is lost where the severity is 2: from 1.5 it takes .5 more, at .25 a day two days
        let (hours, [low, high]) = hours_to_visible(&growing(1.5, 0.25, 0.05)).unwrap();
        assert!((hours - 48.0).abs() < 0.01, "{hours}");
        assert!((36.0..38.0).contains(&low) && (64.0..66.0).contains(&high), "{low} {high}");
        let words = forecast_in_words(&growing(1.5, 0.25, 0.05)).unwrap();
        assert!(words.contains("in about 48 hours (37 to 65)"), "{words}");
        // no forecast: already visible, getting better, too uncertain, and below a fault that is over
        assert_eq!(hours_to_visible(&growing(2.5, 0.25, 0.05)), None);
        assert_eq!(hours_to_visible(&growing(1.5, -0.25, 0.05)), None);
        assert_eq!(hours_to_visible(&growing(1.5, 0.25, 0.3)), None);
        let soon = Story { severity_sd: Some(0.3), ..growing(1.8, 0.25, 0.05) };
        let words = forecast_in_words(&soon).unwrap();
        assert!(words.contains("perhaps by now"), "{words}");
        assert_eq!(hours_to_visible(&growing(1.5, 0.25, 0.24)), None);
        let over = Story { ended_at_ns: Some(20), ..growing(1.5, 0.25, 0.05) };
        assert_eq!(hours_to_visible(&over), None);
    }

    #[test]
    fn a_trend_is_told_that_changes_the_fault_by_a_tenth() {
        let stories =
            stories(&Watch::new(vec![spell(0, 10, None, "dried_nozzle")]), &Rates::default());
        // viscosity x 1.5 is .5 off no fault: .05 in two days
        let of = |per_day: f64, ended_with_all: bool| Story {
            severity_last: Some(1.5),
            trend: Some(Trend {
                per_day,
                interval: [0.9 * per_day, 1.1 * per_day],
                span_days: 2.0,
            }),
            ended_with_all,
            ..stories[0].clone()
        };
        assert!(certain_trend(&of(0.026, false)).is_some());
        assert!(certain_trend(&of(0.024, false)).is_none());
        // and what ends as all channels move is not called healthy
        let over = |with_all| Story { ended_at_ns: Some(20), ..of(0.0, with_all) };
        let said = [true, false].map(|with_all| {
            let faults = Fault::of_channel(vec![over(with_all)], &ReportSettings::default());
            faults[0].sentence.contains("healthy since")
        });
        assert_eq!(said, [false, true]);
    }
}
