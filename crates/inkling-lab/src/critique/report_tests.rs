//! Tests of the page that `report.rs` makes of a critique: hostile names cannot inject markup, every part is
//! there, the page loads nothing, and a critique without figures or without extension still is a page.

use super::*;
use crate::critique::catalogue::CauseId::*;
use crate::critique::finding::{Compared, Curve, Figures, Misfit, Signals, VERSION};

/// A curve with a band of one half-width all along.
fn with_a_band(y: Vec<f64>, half_width: f64) -> Curve {
    let count = y.len();
    Curve::about(y, vec![half_width; count])
}

/// A critique in which everything is present; `name` stands wherever a text from outside may stand.
fn full(name: &str) -> Critique {
    let t: Vec<f64> = (0..128).map(|k| f64::from(k) * 0.78e-6).collect();
    let wave = |a: f64| -> Vec<f64> {
        t.iter().map(|t| a * (6.28e5 * t).sin() + 0.02 * (1e9 * t).sin()).collect()
    };
    let (before, after) = (wave(0.6), wave(0.01));
    let frequency_hz: Vec<f64> = (1..64).map(|k| f64::from(k) * 1e4).collect();
    let power = |line: f64| {
        let at = |f: &f64| 4.0 + line * (-((f - 1e5) / 1e4).powi(2)).exp();
        Curve {
            y: frequency_hz.iter().map(at).collect(),
            low: vec![3.2; frequency_hz.len()],
            high: vec![4.8; frequency_hz.len()],
        }
    };
    let figures = |chi2: f64, auc: f64| GainFigures {
        chi2_per_dof: chi2,
        chi2_per_dof_interval: Some([chi2 - 0.01, chi2 + 0.01]),
        nrmse_percent: 3.0 * chi2,
        detection_auc: auc,
        threshold: 10.0 * chi2,
        ..GainFigures::default()
    };
    let cause = Cause {
        id: Tone,
        parameter: "frequency".into(),
        unit: "Hz".into(),
        value: 1e5,
        ci95: [99_800.0, 100_200.0],
        strength_dl: 4.8,
        delta_bic: 470.0,
        tied_with: vec![SecondMode],
        tied_unnamed: vec![],
        matters_for_detection: false,
        explains: None,
        sentence: format!("An interference at 100 kHz on {name}."),
    };
    Critique {
        version: VERSION,
        verdict: Verdict::Named,
        causes: vec![cause],
        not_testable: vec![NotTestable { id: Crosstalk, needs: name.into() }],
        misfit: Misfit::default(),
        gain: Gain {
            log_likelihood_per_signal: None,
            before: figures(1.3, 0.7),
            after: figures(1.0, 0.8),
            detection_gain: 0.1,
            detection_gain_interval: Some([0.05, 0.15]),
            held_out: HeldOut {
                by: "channel+time".into(),
                signals: 96,
                channels: 6,
                fitted_signals: 96,
                fitted_channels: 6,
            },
        },
        extended_model: Some(name.into()),
        plant: None,
        sentence: format!("An interference of 0.6 counts at 100 kHz is in the signals of {name}."),
        remarks: vec![format!("3 outliers on {name} were left out.")],
        equation: "y = C x + 0.6 cos(2 pi 100 kHz t + 0.7)".into(),
        signals: Signals { found: 192, used: 189, outliers: 3, channels: 12, rejected: 0 },
        evidence: Vec::new(),
        figures: Figures {
            unit: "counts".into(),
            mean_misfit: Compared {
                before: with_a_band(before, 0.1),
                after: with_a_band(after, 0.1),
                x: t.clone(),
            },
            spectrum: Compared { before: power(30.0), after: power(0.0), x: frequency_hz },
        },
    }
}

#[test]
fn hostile_names_cannot_inject_markup() {
    for name in [
        "<script>alert(1)</script>",
        "\"><img src=x onerror=alert(1)>",
        "</style></title></svg><svg onload='x'>",
        "a&b<b>\u{0}\u{1b}[31m",
    ] {
        let mut critique = full(name);
        critique.figures.unit = name.into();
        critique.causes[0].parameter = name.into();
        critique.causes[0].unit = name.into();
        critique.equation = name.into();
        critique.gain.held_out.by = name.into();
        let page = html(&critique);
        let markup = [
            "<script",
            "<img",
            "</style></title>",
            "<svg onload",
            "onerror=alert(1)>",
            "<b>\u{fffd}",
            "\u{1b}",
            "\u{0}",
        ];
        for bad in markup {
            assert!(!page.contains(bad), "{name}: {bad} is in the page");
        }
        assert_eq!(page.matches("<style>").count(), 1);
    }
}

#[test]
fn the_page_is_whole_says_the_sentence_first_and_loads_nothing() {
    let page = html(&full("printhead-1"));
    assert!(page.starts_with("<!doctype html>") && page.ends_with("</body></html>\n"));
    let place = |what: &str| page.find(what).unwrap_or_else(|| panic!("{what} is not in the page"));
    assert!(place("is in the signals of printhead-1") < place("<table"));
    for part in [
        "The mean misfit is off zero at",
        "The misfit is loudest at 100 kHz",
        "100.00 kHz (99.80 to 100.20)",
        "signals of 6 channels that nothing was fitted to",
        "crosstalk needs printhead-1",
        "<pre class=\"wide\">y = C x + 0.6 cos",
        "[1.29, 1.31]",
    ] {
        place(part);
    }
    assert_eq!(page.matches("<svg").count(), 2);
    let bare = page.replace("http://www.w3.org/2000/svg", "").replace("http-equiv", "");
    for outside in ["http", "src=", "href=", "url(", "@import"] {
        assert!(!bare.contains(outside), "{outside}");
    }
}

#[test]
fn a_critique_without_figures_is_a_page_too() {
    let mut critique = full("p");
    critique.figures = Figures::default();
    critique.causes.clear();
    critique.verdict = Verdict::None;
    let page = html(&critique);
    assert!(!page.contains("<svg") && page.contains("none"));
}

#[test]
fn a_critique_that_extends_nothing_has_one_column() {
    let mut critique = full("p");
    let page = html(&critique);
    assert!(page.contains("What the extension buys") && page.contains("The extended model"));
    critique.gain.after = critique.gain.before.clone();
    critique.causes.clear();
    let page = html(&critique);
    assert!(page.contains("How well the model predicts") && page.contains("<h2>The model</h2>"));
    for gone in ["<th class=n>after", "The extended model"] {
        assert!(!page.contains(gone), "{gone}");
    }
}

#[test]
fn what_cannot_be_tested_is_one_line_per_reason() {
    let one = |id, needs: &str| NotTestable { id, needs: needs.into() };
    let rows = [one(Ageing, "x"), one(Droop, "y"), one(ClockDrift, "x")];
    assert_eq!(grouped(&rows), ["ageing, clock_drift need x", "droop needs y"]);
}
