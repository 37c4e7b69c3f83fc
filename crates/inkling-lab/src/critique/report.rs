//! The critique as one page for a reader. In: a [`Critique`]. Out: `report.html`, self-contained: its
//! figures are SVG inside it, it loads nothing and runs nothing.
//!
//! The sentence comes first, then what can be done, then the numbers it rests on. A figure's title
//! says what it shows, computed from the figure's own data. Every text is escaped: names in a recording
//! are anybody's. It must never compute a finding of its own.

use super::catalogue::{CauseId, joined};
use super::digits::{chance, measured, short, significant};
use super::finding::{
    ALARMS, Cause, CovariateFigure, Critique, Detection, Energies, Evidence, FAULT, Gain,
    GainFigures, HeldOut, MeanMisfit, NotTestable, Spectrum, Verdict,
};
use crate::plot::page::escaped;
use crate::plot::{Axis, Figure, Mark, Series};
use std::fmt::Write;

const STYLE: &str = "body{font:16px/1.5 system-ui,'DejaVu Sans',sans-serif;color:#1a1a1a;background:#fff;\
margin:2rem auto;max-width:62rem;padding:0 1rem}h1{font-size:1.05rem;color:#555;font-weight:600;margin:0}\
.sentence{font-size:1.45rem;line-height:1.35;margin:.4rem 0 1rem}h2{font-size:1.15rem;margin:2.2rem 0 .4rem}\
table{border-collapse:collapse;margin:.6rem 0;font-size:.93rem}th,td{padding:.25rem .8rem .25rem 0;\
text-align:left;border-bottom:1px solid #ddd;vertical-align:top}td.n,th.n{text-align:right}\
pre{background:#f5f5f5;padding:.8rem;overflow-x:auto}svg{max-width:100%;height:auto;margin:.4rem 0}\
.verdict{display:inline-block;padding:0 .6rem;border-radius:.3rem;background:#e8eef5}\
.note{color:#555}li{margin:.2rem 0}";

/// The page.
pub fn html(critique: &Critique) -> String {
    let mut page = String::new();
    // writing to a String cannot fail
    let _ = write_page(critique, &mut page);
    page
}

fn write_page(c: &Critique, page: &mut String) -> std::fmt::Result {
    write!(
        page,
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"generator\" content=\"inkling\">\
         <meta name=\"viewport\" content=\"width=device-width\"><title>Model critique</title>\
         <style>{STYLE}</style></head><body>\n<h1>Model critique \
         <span class=\"verdict\">{}</span></h1>\n<p class=\"sentence\">{}</p>\n",
        c.verdict.as_str(),
        escaped(&c.sentence)
    )?;
    writeln!(page, "<p class=\"note\">{}</p>", in_words(c.verdict))?;
    writeln!(
        page,
        "<p class=\"note\">{} of {} signals used, of {} channels; {} left out as outliers, {} rejected.</p>",
        c.signals.used, c.signals.found, c.signals.channels, c.signals.outliers, c.signals.rejected
    )?;
    causes(c, page)?;
    list(page, "What remains, and what would settle it", &c.remarks)?;
    if !c.equation.is_empty() {
        let heading = if c.causes.is_empty() { "The model" } else { "The extended model" };
        writeln!(page, "<h2>{heading}</h2>\n<pre>{}</pre>", escaped(&c.equation))?;
        if let Some(name) = &c.extended_model {
            let name = escaped(name);
            writeln!(
                page,
                "<p>As a design: <code>{name}</code>, for <code>inkling replay --design</code>.</p>"
            )?;
        }
    }
    gain(&c.gain, page)?;
    figures(c, page)?;
    not_testable(c, page)?;
    evidence_table(&c.evidence, page)?;
    page.write_str("</body></html>\n")
}

/// What a verdict means, beside it.
fn in_words(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::None => {
            "None: nothing in the signals that were used asks for more than the model has."
        }
        Verdict::Named => {
            "Named: what the model lacks is in the catalogue of causes, and told apart from the others there."
        }
        Verdict::Tie => {
            "Tie: several causes explain these signals equally well; what would tell them apart stands below."
        }
        Verdict::Unknown => {
            "Unknown: the model lacks something, and no cause of the catalogue explains it. The nearest ones \
             are told, as a direction and not as an answer."
        }
    }
}

fn causes(c: &Critique, page: &mut String) -> std::fmt::Result {
    if c.causes.is_empty() {
        return Ok(());
    }
    let title = match c.verdict {
        Verdict::Unknown => "The nearest names, which do not explain it",
        Verdict::Tie => "One of these",
        _ => "What it is",
    };
    let shared = explained_together(&c.causes);
    let together = shared.map_or(String::new(), |share| {
        format!("<p>Together they explain {} % of it.</p>\n", short(100.0 * share))
    });
    page.write_str(&format!(
        "<h2>{title}</h2>\n{together}<table><tr><th>cause</th><th>parameter</th><th class=n>value (95 % interval)</th>\
         <th class=n>strength</th><th class=n>delta BIC</th><th class=n>gain per held-out signal, nats</th>\
         <th>matters for detection</th></tr>\n"
    ))?;
    for cause in &c.causes {
        let tied = match cause.is_tied() {
            true => format!("<br>or {}", escaped(&cause.tied_words())),
            false => String::new(),
        };
        let worth = c.gain.worth(cause.id).map_or(String::from("not measured"), |worth| {
            let [low, high] = worth.ci95.map(short);
            format!("{} [{low}, {high}]", short(worth.gain))
        });
        let own = cause.explains.filter(|_| shared.is_none());
        let explains = own.map_or(String::new(), |share| {
            format!("<br>explains {} % of it", short(100.0 * share))
        });
        writeln!(
            page,
            "<tr><td><b>{}</b>{tied}{explains}</td><td>{}</td><td class=n>{}</td>\
             <td class=n>{} DL</td><td class=n>{}</td><td class=n>{worth}</td><td>{}</td></tr>",
            cause.id,
            escaped(&cause.parameter),
            escaped(&measured(cause.value, cause.ci95, &cause.unit)),
            significant(cause.strength_dl, 2),
            short(cause.delta_bic),
            if cause.matters_for_detection { "yes" } else { "no" },
        )?;
    }
    page.write_str("</table>\n")?;
    let sentences: Vec<String> = c.causes.iter().map(|cause| cause.sentence.clone()).collect();
    list(page, "", &sentences)?;
    page.write_str(
        "<p class=\"note\">Strength in DL, detection limits: 1 DL is the size at which a test of this one \
         effect alone would find it in 90 of 100 recordings. Among all candidates it was found in 54 of 103 \
         simulated recordings at 1 DL, in 252 of 253 from 2 DL on. Delta BIC, Bayesian information criterion \
         without the cause minus with it: twice the gain in log-likelihood, less a price for each parameter; 10 \
         is strong evidence. Gain per held-out signal: how much larger the logarithm of its probability is by a \
         model with this cause than by one without it, with its 95 % interval; where that reaches below 0, the \
         cause is there and not worth modelling. Matters for detection: yes where nozzle faults are found better with the extension, \
         and the cause is one that moves signals by themselves, not all of them alike.</p>\n",
    )
}

/// The share that several causes explain as one: it is of none of them alone.
fn explained_together(causes: &[Cause]) -> Option<f64> {
    let first = causes.first()?.explains?;
    (causes.len() > 1 && causes.iter().all(|c| c.explains == Some(first))).then_some(first)
}

fn list(page: &mut String, title: &str, lines: &[String]) -> std::fmt::Result {
    let mut lines = lines.iter().filter(|line| !line.is_empty()).peekable();
    if lines.peek().is_none() {
        return Ok(());
    }
    if !title.is_empty() {
        write!(page, "<h2>{title}</h2>")?;
    }
    page.write_str("<ul>\n")?;
    lines.try_for_each(|line| writeln!(page, "<li>{}</li>", escaped(line)))?;
    page.write_str("</ul>\n")
}

fn gain(gain: &Gain, page: &mut String) -> std::fmt::Result {
    let held = &gain.held_out;
    if held.signals == 0 {
        return Ok(());
    }
    let (before, after) = (&gain.before, &gain.after);
    type Entry = (&'static str, fn(&GainFigures) -> f64, fn(&GainFigures) -> Option<[f64; 2]>);
    let entries: [Entry; 6] = [
        ("chi² per degree of freedom (1: right)", |g| g.chi2_per_dof, |g| g.chi2_per_dof_interval),
        ("misfit, % of the signal (NRMSE)", |g| g.nrmse_percent, |g| g.nrmse_percent_interval),
        (WHITENESS, |g| g.whiteness_p, |_| None),
        ("detection threshold", |g| g.threshold, |_| None),
        ("false alarms, share of the healthy", |g| g.false_alarms, |g| g.false_alarms_interval),
        ("detection of a small fault, AUC", |g| g.detection_auc, |g| g.detection_auc_interval),
    ];
    // not measured here: NaN, and no row
    let there = |g: &GainFigures| entries.iter().all(|e| e.1(g).is_nan() || e.1(g) == e.1(before));
    let one = there(after);
    let heading = if one { "How well the model predicts" } else { "What the extension buys" };
    writeln!(page, "<h2>{heading}</h2>\n<p class=\"note\">{}</p>", escaped(&held_out(held)))?;
    writeln!(
        page,
        "<p class=\"note\">Misfit: measured minus simulated. Chi² per degree of freedom: its mean square over \
         what noise and the scatter of channels allow. NRMSE: root of its mean square over the signal's. AUC, \
         area under the ROC curve: the chance that a signal with a small nozzle fault (damping off by {FAULT} \
         standard deviations of healthy channels, put into held-out signals) looks more faulty than a healthy \
         one; 0.5 is guessing, 1 never wrong.</p>"
    )?;
    page.write_str("<table><tr><th></th>")?;
    page.write_str(match one {
        true => "<th class=n>on these signals</th></tr>\n",
        false => "<th class=n>before</th><th class=n>after</th></tr>\n",
    })?;
    for (name, value, interval) in entries {
        if value(before).is_nan() && value(after).is_nan() {
            continue;
        }
        let cell = |g: &GainFigures| {
            let text = if name == WHITENESS { chance(value(g)) } else { short(value(g)) };
            let range =
                interval(g).map(|[low, high]| format!(" [{}, {}]", short(low), short(high)));
            escaped(&format!("{text}{}", range.unwrap_or_default()))
        };
        write!(page, "<tr><td>{name}</td><td class=n>{}</td>", cell(before))?;
        if !one {
            write!(page, "<td class=n>{}</td>", cell(after))?;
        }
        page.write_str("</tr>\n")?;
    }
    page.write_str("</table>\n")?;
    of_detection(gain, one, page)
}

/// What the detection's numbers are worth. `one`: there is nothing to compare with.
fn of_detection(gain: &Gain, one: bool, page: &mut String) -> std::fmt::Result {
    if let (Some([low, high]), false) = (gain.detection_gain_interval, one) {
        let word = match gain.detection() {
            Detection::Better => "better",
            Detection::Worse => "worse",
            _ => "neither better nor worse, as far as these signals tell",
        };
        writeln!(
            page,
            "<p class=\"note\">Detection with the extension: {word} (AUC {:+.3} [{low:+.3}, {high:+.3}], the \
             same channels before and after).</p>",
            gain.detection_gain
        )?;
    }
    if !gain.before.false_alarms.is_nan() {
        writeln!(
            page,
            "<p class=\"note\">The threshold is meant for {} % of healthy signals of channels never heard. \
             It was learned on {} channels: of so few, how much healthy channels differ is known roughly, \
             and so is the share of false alarms.</p>",
            100.0 * ALARMS,
            gain.held_out.fitted_channels
        )?;
    }
    Ok(())
}

const WHITENESS: &str = "chance that white noise looks like the misfit, p";

fn held_out(held: &HeldOut) -> String {
    if held.by.starts_with("time:") {
        return format!(
            "On {} decays that nothing was fitted to in part (by {}); in brackets 95 % intervals.",
            held.signals, held.by
        );
    }
    format!(
        "On {} signals of {} channels that nothing was fitted to (by {}; the models were fitted to {} \
         signals of {} channels); in brackets 95 % intervals.",
        held.signals, held.channels, held.by, held.fitted_signals, held.fitted_channels
    )
}

fn not_testable(c: &Critique, page: &mut String) -> std::fmt::Result {
    list(page, "Not testable on these recordings", &grouped(&c.not_testable))
}

/// One line per reason: what it keeps from being tested.
pub fn grouped(not_testable: &[NotTestable]) -> Vec<String> {
    let mut groups: Vec<(&str, Vec<CauseId>)> = Vec::new();
    for n in not_testable {
        match groups.iter_mut().find(|(needs, _)| *needs == n.needs) {
            Some((_, ids)) => ids.push(n.id),
            None => groups.push((&n.needs, vec![n.id])),
        }
    }
    let line = |(needs, ids): (&str, Vec<CauseId>)| {
        let verb = if ids.len() == 1 { "needs" } else { "need" };
        format!("{} {verb} {needs}", joined(&ids, ", "))
    };
    groups.into_iter().map(line).collect()
}

/// Figures against covariates that stand open; the others can be opened.
const OPEN_COVARIATES: usize = 4;

fn figures(c: &Critique, page: &mut String) -> std::fmt::Result {
    let f = &c.figures;
    figure("Misfit, measured minus simulated", mean_misfit(&f.mean_misfit, &f.unit), page)?;
    figure("Spectrum of the misfit", spectrum(&f.spectrum, &f.unit), page)?;
    // what stands out most comes first
    let mut covariates: Vec<&CovariateFigure> = f.covariates.iter().collect();
    covariates.sort_by(|x, y| stands_out(y).total_cmp(&stands_out(x)));
    for (k, of) in covariates.iter().enumerate() {
        if k == OPEN_COVARIATES {
            writeln!(page, "<details><summary>Against what else was recorded</summary>")?;
        }
        let heading = if k == 0 { "Misfit against what was recorded" } else { "" };
        figure(heading, covariate(of), page)?;
    }
    if covariates.len() > OPEN_COVARIATES {
        writeln!(page, "</details>")?;
    }
    figure("Evidence for each candidate", evidence(&c.evidence), page)?;
    figure("Detection", energies(&f.energies), page)
}

fn figure(heading: &str, figure: Option<Figure>, page: &mut String) -> std::fmt::Result {
    let Some(figure) = figure.map(plain) else { return Ok(()) };
    if !heading.is_empty() {
        writeln!(page, "<h2>{heading}</h2>")?;
    }
    match figure.svg() {
        Ok(svg) => writeln!(page, "{svg}"),
        Err(e) => writeln!(page, "<p>{}: {}</p>", escaped(&figure.title), escaped(&e.to_string())),
    }
}

/// The furthest bin from none, in its own bars.
fn stands_out(c: &CovariateFigure) -> f64 {
    let bins = c.before.iter().zip(&c.before_bar).filter(|(_, bar)| **bar > 0.0);
    bins.map(|(y, bar)| (y / bar).abs()).fold(0.0, f64::max)
}

/// The figure without control characters (SVG escapes markup, but carries these), and with room for
/// its legend above the data.
fn plain(mut figure: Figure) -> Figure {
    let clean = |text: &mut String| {
        *text =
            text.chars().map(|c| if c.is_control() { '\u{fffd}' } else { c }).take(200).collect();
    };
    clean(&mut figure.title);
    clean(&mut figure.x.label);
    clean(&mut figure.y.label);
    figure.y.categories.iter_mut().for_each(clean);
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for (_, y) in figure.series.iter().flat_map(|s| &s.points).filter(|p| p.1.is_finite()) {
        (low, high) = (low.min(*y), high.max(*y));
    }
    if figure.y.categories.is_empty() && !figure.y.log && low < high {
        figure.y.range = Some((low - 0.05 * (high - low), high + 0.4 * (high - low)));
    }
    figure
}

fn series(name: &str, mark: Mark, points: Vec<(f64, f64)>) -> Series {
    Series { name: name.to_owned(), mark, points }
}

fn line(name: &str, x: &[f64], y: &[f64]) -> Series {
    series(name, Mark::Line, x.iter().copied().zip(y.iter().copied()).collect())
}

/// There along `low`, back along `high`.
fn band(name: &str, x: &[f64], low: &[f64], high: &[f64]) -> Series {
    let there = x.iter().copied().zip(low.iter().copied());
    let back = x.iter().copied().zip(high.iter().copied()).rev();
    series(name, Mark::Band, there.chain(back).collect())
}

fn percent(count: usize, of: usize) -> String {
    format!("{:.0} %", 100.0 * count as f64 / of.max(1) as f64)
}

/// How many samples' bands do not hold zero.
fn off_zero(low: &[f64], high: &[f64]) -> usize {
    low.iter().zip(high).filter(|(low, high)| **low > 0.0 || **high < 0.0).count()
}

/// s in a unit that reads well, and its name.
fn unit_of_time(longest_s: f64) -> (f64, &'static str) {
    match longest_s {
        t if t < 2e-3 => (1e6, "µs"),
        t if t < 2.0 => (1e3, "ms"),
        _ => (1.0, "s"),
    }
}

fn scaled(values: &[f64], by: f64) -> Vec<f64> {
    values.iter().map(|x| x * by).collect()
}

fn mean_misfit(m: &MeanMisfit, signals: &str) -> Option<Figure> {
    let n = m.time_s.len();
    let (scale, unit) = unit_of_time(*m.time_s.last()?);
    let t = scaled(&m.time_s, scale);
    Some(Figure {
        title: format!(
            "The mean misfit is off zero at {} of the samples, after the extension at {} (chance: 5 %)",
            percent(off_zero(&m.before_low, &m.before_high), n),
            percent(off_zero(&m.after_low, &m.after_high), n)
        ),
        x: Axis::new(&format!("time since t_a, {unit}")),
        y: Axis::new(&format!("mean of measured minus simulated, {signals}")),
        series: vec![
            line("before", &t, &m.before),
            line("after", &t, &m.after),
            band("95 % of before", &t, &m.before_low, &m.before_high),
            band("95 % of after", &t, &m.after_low, &m.after_high),
        ],
        thresholds: Vec::new(),
    })
}

/// The largest ratio to the band's upper edge, and where.
fn loudest(frequency_hz: &[f64], power: &[f64], high: &[f64]) -> Option<(f64, f64)> {
    let ratios = frequency_hz.iter().zip(power).zip(high).filter(|(_, high)| **high > 0.0);
    let ratios = ratios.map(|((f, p), high)| (p / high, *f));
    ratios.max_by(|x, y| x.0.total_cmp(&y.0))
}

fn spectrum(s: &Spectrum, signals: &str) -> Option<Figure> {
    let (before, at_hz) = loudest(&s.frequency_hz, &s.before, &s.band_high)?;
    let (after, _) = loudest(&s.frequency_hz, &s.after, &s.band_high)?;
    let (scale, unit) = match s.frequency_hz.last()? {
        f if *f >= 2e3 => (1e-3, "kHz"),
        _ => (1.0, "Hz"),
    };
    let f = scaled(&s.frequency_hz, scale);
    Some(Figure {
        title: format!(
            "The misfit is loudest at {} {unit}: {} of what a right model may have; after: {}",
            short(at_hz * scale),
            short(before),
            short(after)
        ),
        x: Axis::new(&format!("frequency, {unit}")),
        y: Axis {
            log: true,
            ..Axis::new(&format!("mean periodogram of the misfit, ({signals})²"))
        },
        series: vec![
            line("before", &f, &s.before),
            line("after", &f, &s.after),
            band("95 % of a right model", &f, &s.band_low, &s.band_high),
        ],
        thresholds: Vec::new(),
    })
}

fn range(values: &[f64]) -> f64 {
    let finite = || values.iter().filter(|v| v.is_finite());
    let (low, high) =
        finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (v.min(l), v.max(h)));
    (high - low).max(0.0)
}

fn covariate(c: &CovariateFigure) -> Option<Figure> {
    if c.centre.is_empty() {
        return None;
    }
    // seconds in a unit that reads well
    let (by, unit) = match c.unit.as_str() {
        "s" => unit_of_time(c.centre.iter().copied().fold(0.0, f64::max)),
        unit => (1.0, unit),
    };
    let x = match unit {
        "1" | "" => c.covariate.clone(),
        unit => format!("{}, {unit}", c.covariate),
    };
    let centre = scaled(&c.centre, by);
    let (low, high) = (least(&centre), least(&centre) + range(&centre));
    // waiting times spread over decades
    let log = c.decades && low > 0.0 && high > WIDE * low;
    // the two bars of a bin stand side by side
    let aside = |x: f64, sign: f64| match log {
        true => x * (high / low).powf(sign * ASIDE),
        false => x + sign * ASIDE * range(&centre).max(1e-9),
    };
    let bars = |middle: &[f64], bar: &[f64], sign: f64| -> Vec<(f64, f64)> {
        let at = centre.iter().zip(middle.iter().zip(bar));
        at.flat_map(|(x, (y, b))| {
            let x = aside(*x, sign);
            [(x, 100.0 * (y - b)), (x, 100.0 * (y + b))]
        })
        .collect()
    };
    Some(Figure {
        title: format!(
            "Against {}, {} spans {} % before and {} % after the extension",
            c.covariate,
            c.parameter,
            significant(100.0 * range(&c.before), 2),
            significant(100.0 * range(&c.after), 2)
        ),
        x: Axis { log, ..Axis::new(&x) },
        y: Axis::new(&format!("{} against the model, %", c.parameter)),
        series: vec![
            series("before, 95 %", Mark::Bars, bars(&c.before, &c.before_bar, -1.0)),
            series("after, 95 %", Mark::Bars, bars(&c.after, &c.after_bar, 1.0)),
        ],
        thresholds: Vec::new(),
    })
}

/// How far aside the bars of a bin stand, as a share of the axis; and the span from which on an axis is
/// logarithmic.
const ASIDE: f64 = 0.008;
const WIDE: f64 = 30.0;

fn least(values: &[f64]) -> f64 {
    values.iter().copied().filter(|v| v.is_finite()).fold(f64::INFINITY, f64::min)
}

/// Statistic over threshold, of the first step and of the last.
fn evidence(evidence: &[Evidence]) -> Option<Figure> {
    let ratio = |e: &Evidence| (e.statistic / e.threshold).max(1e-3);
    let drawable = |e: &&Evidence| e.tested && e.statistic.is_finite() && e.threshold > 0.0;
    let first: Vec<&Evidence> = evidence.iter().filter(|e| e.step == 0).filter(drawable).collect();
    let last_step = evidence.iter().map(|e| e.step).max()?;
    let mut order = first.clone();
    let strongest = *order.iter().max_by(|x, y| ratio(x).total_cmp(&ratio(y)))?;
    // as it was decided: what was chosen on top, then by evidence
    order.sort_by(|x, y| (x.accepted.cmp(&y.accepted)).then(ratio(x).total_cmp(&ratio(y))));
    let passed_over = order.last().filter(|top| top.accepted && top.id != strongest.id);
    let place = |id: CauseId| order.iter().position(|known| known.id == id).map(|k| k as f64);
    let points = |step: u32| -> Vec<(f64, f64)> {
        let of_step = evidence.iter().filter(|e| e.step == step).filter(drawable);
        of_step.filter_map(|e| Some((ratio(e), place(e.id)?))).collect()
    };
    let beyond = first.iter().filter(|e| ratio(e) > 1.0).count();
    let names = order.iter().map(|e| e.id.to_string());
    let mut series_of = vec![series("against the baseline", Mark::Dots, points(0))];
    if last_step > 0 {
        series_of.push(series("after the extension", Mark::Dots, points(last_step)));
    }
    Some(Figure {
        title: match (beyond, passed_over) {
            (0, _) => "No candidate reaches its threshold".to_owned(),
            (_, Some(chosen)) => format!(
                "{} is chosen, not {} with more evidence: {}",
                chosen.id, strongest.id, strongest.why_not
            ),
            (1, _) => format!("One candidate passes: {}", strongest.id),
            (n, _) => format!("{n} candidates pass alone, {} furthest", strongest.id),
        },
        x: Axis { log: true, ..Axis::new("likelihood-ratio statistic over its threshold") },
        // empty places above, for the legend
        y: Axis {
            categories: names.chain(vec![String::new(); 1 + order.len().div_ceil(5)]).collect(),
            ..Axis::new("")
        },
        series: series_of,
        thresholds: vec![(1.0, "threshold".to_owned())],
    })
}

fn energies(e: &Energies) -> Option<Figure> {
    if e.edges.len() < 2 || e.edges.len() != e.before.len() + 1 {
        return None;
    }
    let steps = |counts: &[u64]| -> Vec<(f64, f64)> {
        let edges = e.edges.windows(2).zip(counts);
        edges.flat_map(|(w, n)| [(w[0], *n as f64), (w[1], *n as f64)]).collect()
    };
    Some(Figure {
        title: match e.threshold_before == e.threshold_after {
            true => format!("The detection threshold is {}", short(e.threshold_before)),
            false => format!(
                "The detection threshold goes from {} to {}",
                short(e.threshold_before),
                short(e.threshold_after)
            ),
        },
        x: Axis {
            log: e.edges[0] > 0.0,
            ..Axis::new("detection statistic of held-out healthy signals")
        },
        y: Axis::new("signals"),
        series: match e.threshold_before == e.threshold_after && e.before == e.after {
            true => vec![series("held-out signals", Mark::Line, steps(&e.before))],
            false => vec![
                series("before", Mark::Line, steps(&e.before)),
                series("after", Mark::Line, steps(&e.after)),
            ],
        },
        thresholds: match e.threshold_before == e.threshold_after {
            true => vec![(e.threshold_before, "threshold".to_owned())],
            false => vec![
                (e.threshold_before, "threshold before".to_owned()),
                (e.threshold_after, "threshold after".to_owned()),
            ],
        },
    })
}

fn evidence_table(evidence: &[Evidence], page: &mut String) -> std::fmt::Result {
    if evidence.is_empty() {
        return Ok(());
    }
    page.write_str(
        "<h2>All evidence</h2>\n<p class=\"note\">Step 0 asks every candidate alone, against the model as it \
         is; each further step asks again beside what was chosen before. Statistic: twice the gain in \
         log-likelihood. Threshold: what chance exceeds once in many recordings, all candidates together. p: \
         the chance of so high a statistic where there is nothing. Accepted: chosen in that step, or why \
         not.</p>\n<details><summary>Every candidate in every step of the selection</summary>\
         <table><tr><th class=n>step</th><th>candidate</th><th class=n>statistic</th>\
         <th class=n>threshold</th><th class=n>p</th><th class=n>delta BIC</th><th class=n>strength, DL</th>\
         <th>accepted</th></tr>\n",
    )?;
    for e in evidence {
        let accepted = if e.accepted { "yes".to_owned() } else { escaped(&e.why_not) };
        writeln!(
            page,
            "<tr><td class=n>{}</td><td>{}</td><td class=n>{}</td><td class=n>{}</td>\
             <td class=n>{}</td><td class=n>{}</td><td class=n>{}</td><td>{accepted}</td></tr>",
            e.step,
            e.id,
            short(e.statistic),
            short(e.threshold),
            escaped(&chance(e.p)),
            short(e.delta_bic),
            significant(e.strength_dl, 2)
        )?;
    }
    page.write_str("</table></details>\n")
}

#[cfg(test)]
#[path = "report_tests.rs"]
mod tests;
