//! Neighbours that fail together. In: open faults, how the nozzles lie. Out: [`Group`]s of the same sort
//! that touch each other: an air front, a flooded plate.

use super::fault::Fault;
use super::settings::ReportSettings;
use super::words;

/// Onsets of a group in the order of their places: at least so many show a direction.
const LEAST_OF_A_FRONT: usize = 4;

/// Faults of one category on neighbouring nozzles, on at the same time.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// Into the faults.
    pub members: Vec<usize>,
    pub sentence: String,
}

/// Groups of two and more, the largest first.
pub fn groups(faults: &[Fault], settings: &ReportSettings) -> Vec<Group> {
    let mut left: Vec<usize> = (0..faults.len()).filter(|k| faults[*k].is_open()).collect();
    let mut groups = Vec::new();
    while let Some(first) = left.pop() {
        let mut members = vec![first];
        let mut at = 0;
        while at < members.len() {
            let of = &faults[members[at]];
            let (near, far) =
                left.into_iter().partition::<Vec<usize>, _>(|k| touch(of, &faults[*k], settings));
            members.extend(near);
            left = far;
            at += 1;
        }
        if members.len() > 1 {
            members.sort_by_key(|k| faults[*k].story.channel);
            let sentence = sentence(&members, faults, settings);
            groups.push(Group { members, sentence });
        }
    }
    groups.sort_by_key(|g| (std::cmp::Reverse(g.members.len()), g.members.clone()));
    groups
}

/// Beside each other in a row, or in the next row.
fn touch(a: &Fault, b: &Fault, settings: &ReportSettings) -> bool {
    let (a, b) = (&a.story, &b.story);
    let place =
        |channel: u32| (i64::from(channel % settings.rows), i64::from(channel / settings.rows));
    let ((row_a, at_a), (row_b, at_b)) = (place(a.channel), place(b.channel));
    let together = |x: Option<i64>, y: i64| x.is_none_or(|end| end >= y);
    a.printhead == b.printhead
        && a.category.is_some()
        && a.category == b.category
        && (row_a - row_b).abs() <= 1
        && (at_a - at_b).abs() <= 1
        && together(a.ended_at_ns, b.began_at_ns)
        && together(b.ended_at_ns, a.began_at_ns)
}

fn sentence(members: &[usize], faults: &[Fault], settings: &ReportSettings) -> String {
    let stories: Vec<_> = members.iter().map(|k| &faults[*k].story).collect();
    let category = stories[0].category.as_deref().unwrap_or_default();
    let channels = |k: usize| stories[k].channel;
    let last = stories.len() - 1;
    let mut text = format!(
        "{}: {} neighbouring channels, {} to {}, have the same fault ({})",
        stories[0].printhead,
        stories.len(),
        channels(0),
        channels(last),
        category.replace('_', " ")
    );
    if settings.pitch > 0.0 {
        let width = f64::from(channels(last) / settings.rows - channels(0) / settings.rows);
        text += &format!(", over {:.2} mm", width * settings.pitch / 1e3);
    }
    let onsets: Vec<i64> = stories.iter().map(|s| s.began_at_ns).collect();
    let (rising, falling) = (onsets.is_sorted(), onsets.iter().rev().is_sorted());
    let moves = onsets[0] != onsets[last] && onsets.len() >= LEAST_OF_A_FRONT;
    let since = words::clock(*onsets.iter().min().unwrap_or(&0));
    text += &match (category, rising || falling) {
        (_, true) if moves => {
            let to = channels(if rising { last } else { 0 });
            format!(", one after the other towards channel {to} since {since}: a front that moves")
        }
        ("air_bubble" | "empty_channel", _) => {
            format!(", since {since}: air in what they share, not in each nozzle")
        }
        ("blocked_nozzle" | "dried_nozzle", _) => {
            format!(", since {since}: something on the plate, not in each nozzle")
        }
        _ => format!(", since {since}"),
    };
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::episodes::Episode;
    use crate::report::story::{Rates, stories};
    use crate::report::watch::{Spell, Watch};

    fn fault(channel: u32, began: i64, category: &str) -> Fault {
        let episode = Episode {
            printhead: "p".into(),
            channel,
            category: Some(category.into()),
            fault: None,
            raised_at_ns: began,
            began_at_ns: began,
            ended_at_ns: None,
            bursts: 9,
            certainty: None,
            severity_first: None,
            severity_max: None,
            severity_last: None,
            severity_sd: None,
            explanation: String::new(),
        };
        let spell = Spell { recording: 0, episode, looked: Default::default() };
        let story = stories(&Watch::new(vec![spell]), &Rates::default()).remove(0);
        Fault::new(story, &ReportSettings::default())
    }

    fn of(faults: &[Fault], rows: u32) -> Vec<Group> {
        groups(faults, &ReportSettings { rows, pitch: 100.0, ..ReportSettings::default() })
    }

    #[test]
    fn neighbours_of_one_sort_are_a_group_and_others_are_not() {
        let faults = [
            fault(3, 0, "dried_nozzle"),
            fault(4, 0, "dried_nozzle"),
            fault(5, 0, "air_bubble"),
            fault(9, 0, "dried_nozzle"),
        ];
        let groups = of(&faults, 1);
        assert_eq!(groups.len(), 1);
        assert_eq!(groups[0].members, [0, 1]);
        assert!(groups[0].sentence.contains("on the plate"), "{}", groups[0].sentence);
        assert!(groups[0].sentence.contains("0.10 mm"), "{}", groups[0].sentence);
    }

    #[test]
    fn onsets_one_after_the_other_are_a_front() {
        let faults: Vec<Fault> =
            (0..5).map(|k| fault(10 - k, 1000 * i64::from(k), "air_bubble")).collect();
        let sentence = &of(&faults, 1)[0].sentence;
        assert!(sentence.contains("towards channel 6") && sentence.contains("front"), "{sentence}");
    }

    #[test]
    fn rows_say_who_the_neighbours_are() {
        let faults = [fault(8, 0, "air_bubble"), fault(12, 0, "air_bubble")];
        assert_eq!(of(&faults, 1).len(), 0);
        assert_eq!(of(&faults, 4).len(), 1, "the same row, beside each other");
        let faults = [fault(3, 0, "air_bubble"), fault(4, 0, "air_bubble")];
        assert_eq!(of(&faults, 4).len(), 0, "the last row and the first");
    }
}
