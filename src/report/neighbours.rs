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
