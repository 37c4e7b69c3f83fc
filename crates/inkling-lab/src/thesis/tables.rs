//! The page `tables.md` of `inkling thesis`: this program's figures beside the thesis's.
//!
//! In: a `Chapter`, the figures of each data set over its rounds. Out to `thesis::write`: Markdown, namely for
//! each data set the tables of detection, of isolation, of what is beside the thesis's tables, and confusion
//! matrices.
//!
//! A number is shown as mean ± standard deviation over rounds, then the thesis's in brackets, marked
//! *differs* where the test of `published` says so.

use super::methods::{Beside, COMPARED, Detection, ROWS, Size, figure};
use super::outcome::{Chapter, DataSet, Measured, Rounds, Spread};
use super::published::{Matrix, Published, matrices, published};
use inkling_core::fault::CLASSES;

/// The whole page. It begins with what the rounds are.
pub fn markdown(chapter: &Chapter) -> String {
    let mut out = String::from("# Chapter 4 again\n\n");
    out += &match &chapter.rounds {
        Rounds::Seeds(seeds) if seeds.len() == 1 => format!(
            "Simulated data of the seed {}. Nobody can tell from one seed by how much others would differ. Every signal that is \
             tested on is one that no filter, threshold or class has seen.\n",
            seeds[0]
        ),
        Rounds::Seeds(seeds) => format!(
            "Simulated data, {} seeds, {} to {}: mean ± standard deviation from seed to seed. Every signal that is tested on is \
             one that no filter, threshold or class has seen.\n",
            seeds.len(),
            seeds.first().unwrap_or(&0),
            seeds.last().unwrap_or(&0),
        ),
        Rounds::Folds { number, left_out } => {
            let left_out: String =
                left_out.iter().map(|why| format!("* {}\n", escaped(why))).collect();
            format!(
                "Your recordings, divided by channel into {number} parts: each is tested on once, by what was learned on the channels \
                 of the others. The picture beside this page is of the first part. Mean ± standard deviation from part to part.\n\n{left_out}"
            )
        }
    };
    if chapter.sets.iter().any(|of| of.set == DataSet::ThesisForm) {
        out += "\nIn brackets the thesis's number. *differs*: were the thesis's data one more of our rounds, its number would be as far \
                from ours with a probability below .05, with the sampling error of its signals and of ours, and what our \
                rounds differ by beyond it.\n";
    }
    for of in &chapter.sets {
        data_set(of, &mut out);
    }
    if chapter.set(DataSet::ThesisForm).is_some() {
        out += REMARKS;
    }
    out
}

/// The tables of one data set.
fn data_set(of: &Measured, out: &mut String) {
    *out += &format!(
        "\n## {}\n\nLearned from {:.0} healthy and {:.0} faulty signals, tested on {:.0} and {:.0}; mu of (3-4) is {}.\n",
        of.set.title(),
        of.mean("learned/healthy"),
        of.mean("learned/faulty"),
        of.mean("tested/healthy"),
        of.mean("tested/faulty"),
        of.mean("mu"),
    );
    detection(of, out);
    isolation(of, out);
    beside(of, out);

    // Our two main confusions are shown on every data set; then the others that the thesis has.
    for (key, confusion) in
        [("LR on r", "Linear regression on r"), ("default", "inkling's default")]
    {
        let theirs = matrices().iter().find(|matrix| matrix.set == of.set && matrix.ours == key);
        let title = theirs.map_or(format!("{confusion}, every faulty signal"), |m| m.title.clone());
        matrix(of, key, &title, theirs, out);
    }
    let others = matrices().iter().filter(|m| m.set == of.set && m.ours != "LR on r");
    others.for_each(|theirs| matrix(of, &theirs.ours, &theirs.title, Some(theirs), out));
    if !of.failed.is_empty() {
        out.push_str("\nNot possible on these data:\n\n");
        of.failed.iter().for_each(|(what, why)| {
            *out += &format!("* {what}: {}\n", escaped(why));
        });
    }
}

/// In brackets, which of the thesis's tables is about these data.
fn beside_table(of: &Measured, [of_form, of_drying]: [&str; 2]) -> String {
    match of.set {
        DataSet::ThesisForm => format!(" (thesis Table {of_form})"),
        DataSet::Drying => format!(" (thesis Table {of_drying})"),
        _ => String::new(),
    }
}

/// The table of detection.
fn detection(of: &Measured, out: &mut String) {
    let table = beside_table(of, ["4-1", "4-2"]);
    let (faulty, healthy) = (of.mean("tested/faulty"), of.mean("tested/healthy"));
    *out += &format!(
        "\n### Detection{table}\n\n| | misses of {faulty:.0} | false alarms of {healthy:.0} | share right |\n|---|---|---|---|\n"
    );
    let practice = ("practice", "the current practice: thresholds on frequency and damping");
    let rows = ROWS.detections.iter().map(|Detection { name, words, .. }| (&**name, &**words));
    for (name, words) in rows.chain([practice]) {
        if of.values(&format!("{name}/right")).is_empty() {
            continue;
        }
        let misses = counts(of, &format!("{name}/misses"), faulty);
        let false_alarms = counts(of, &format!("{name}/false alarms"), healthy);
        let right = shares(of, &format!("{name}/right"), faulty + healthy);
        *out += &format!("| {words} | {misses} | {false_alarms} | {right} |\n");
    }
}

/// The table of isolation, by training size and method. Methods that failed have no row.
fn isolation(of: &Measured, out: &mut String) {
    let table = beside_table(of, ["4-6", "4-7"]);
    let faulty = of.mean("tested/faulty");
    *out += &format!(
        "\n### Isolation{table}\n\nEvery faulty signal, detected or not.\n\n\
         | method, faulty signals learned from | class right | where phi or certainty >= .8 | of | category right |\n\
         |---|---|---|---|---|\n"
    );
    for size in Size::EACH {
        let learned = of.mean(&format!("learned/{}", size.name));
        for name in COMPARED.iter().map(|method| method.name).chain(["default"]) {
            let key = |what| figure(name, size, what);
            if of.values(&key("accuracy")).is_empty() {
                continue;
            }
            let certain = of.mean(&key("coverage")) * faulty;
            // the vote of one neighbour is no certainty
            let [right_where, coverage] = match name.starts_with("1-NN") {
                true => ["–".into(), "–".into()],
                false => {
                    [shares(of, &key("certain"), certain), shares(of, &key("coverage"), faulty)]
                }
            };
            *out += &format!(
                "| {name}, {learned:.0} | {} | {right_where} | {coverage} | {} |\n",
                shares(of, &key("accuracy"), faulty),
                shares(of, &key("category"), faulty),
            );
        }
    }
}

/// The table of further shares: figures that the thesis has in its text, or not at all.
fn beside(of: &Measured, out: &mut String) {
    let faulty = of.mean("tested/faulty");
    out.push_str("\n### Beside the tables\n\n| | share |\n|---|---|\n");
    for Beside { figure, words } in &ROWS.beside {
        if !of.values(figure).is_empty() {
            *out += &format!("| {words} | {} |\n", shares(of, figure, faulty));
        }
    }
}

/// A confusion matrix, with the thesis's counts in brackets. `key`: the name of ours; without it nothing is
/// written. The classes are the thesis's, or else those that were met.
fn matrix(of: &Measured, key: &str, title: &str, theirs: Option<&Matrix>, out: &mut String) {
    let Some(ours) = of.confusions.get(key) else { return };
    let theirs = theirs.map(|theirs| &theirs.confusion);
    let classes: Vec<String> = match theirs {
        Some(theirs) => theirs.classes.clone(),
        None => {
            // Known classes that were met stand in the thesis's order, a user's own ones after them.
            let is_met = |class: &&String| {
                let with = |other| ours.count(class, other) + ours.count(other, class);
                ours.classes.iter().any(|other| with(other) > 0.0)
            };
            let mut met: Vec<String> = ours.classes.iter().filter(is_met).cloned().collect();
            let place = |class: &str| CLASSES.iter().position(|known| *known == class);
            met.sort_by_key(|class| (place(class).unwrap_or(CLASSES.len()), class.clone()));
            met
        }
    };
    let names: Vec<String> = classes.iter().map(|class| escaped(class)).collect();
    *out += &format!("\n### {title}\n\nRows: truth; columns: what was said. Mean over rounds.\n\n");
    *out += &format!("| | {} |\n", names.join(" | "));
    *out += &format!("|---{}|\n", "|---".repeat(classes.len()));
    for (class, shown) in classes.iter().zip(&names) {
        *out += &format!("| {shown} |");
        for name in &classes {
            let n = ours.count(class, name);
            let n = if n >= 0.05 { format!("{n:.1}") } else { "·".into() };
            let theirs = theirs.map_or(0.0, |theirs| theirs.count(class, name));
            let theirs = if theirs > 0.0 { format!(" ({theirs})") } else { String::new() };
            *out += &format!(" {n}{theirs} |");
        }
        out.push('\n');
    }
}

/// `.801 ± .008 (.801)`: a share of `signals` signals per round, and the thesis's.
fn shares(of: &Measured, key: &str, signals: f64) -> String {
    let theirs = published(of.set, key);
    let theirs = beside_theirs(theirs, &of.values(key), signals, |p| format!("{:.3}", p.share));
    number(of, key, 3) + &theirs
}

/// `95.7 ± 18.6 (92)`: the number of cases among `signals` signals per round, and the thesis's.
fn counts(of: &Measured, key: &str, signals: f64) -> String {
    let each: Vec<f64> = of.values(key).iter().map(|n| n / signals).collect();
    let theirs = published(of.set, key);
    number(of, key, 1)
        + &beside_theirs(theirs, &each, signals, |p| format!("{:.0}", p.share * f64::from(p.of)))
}

/// The thesis's number in brackets, marked if it differs. `ours`: our share in each round; `signals`: of how
/// many signals each is; `written`: the thesis's number as text.
fn beside_theirs(
    theirs: Option<Published>,
    ours: &[f64],
    signals: f64,
    written: impl Fn(Published) -> String,
) -> String {
    let Some(theirs) = theirs.filter(|_| !ours.is_empty()) else { return String::new() };
    let differs = theirs.differs(ours, signals) == Some(true);
    format!(" ({}){}", written(theirs), if differs { " *differs*" } else { "" })
}

/// A text for a cell of a Markdown table: nothing in it ends the cell or is HTML.
fn escaped(text: &str) -> String {
    let safe = |c: char| match c {
        '|' => "\\|".to_owned(),
        '<' => "&lt;".to_owned(),
        '&' => "&amp;".to_owned(),
        c if c.is_control() => " ".to_owned(),
        c => c.to_string(),
    };
    text.chars().map(safe).collect()
}

/// The mean over rounds, with the standard deviation if there are several.
fn number(of: &Measured, key: &str, digits: usize) -> String {
    match (of.spread(key), of.values(key).len()) {
        (None, _) => "–".into(),
        (Some(Spread { mean, .. }), 1) => format!("{mean:.digits$}"),
        (Some(Spread { mean, sd, .. }), _) => format!("{mean:.digits$} ± {sd:.digits$}"),
    }
}

const REMARKS: &str = include_str!("remarks.md");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_users_words_end_no_cell_and_are_no_html() {
        assert_eq!(escaped("a|b\n<script>&\u{1b}[1m"), "a\\|b &lt;script>&amp; [1m");
    }
}
