use super::*;
use crate::fixtures::{assert_refused, place};
use inkling_core::labels::Channels;

const HEADER: &str = "printhead,channel,from,to,state,severity";

fn of_rows(rows: &str) -> Result<Labels, FileError> {
    reading(&format!("{HEADER}\n{rows}"))
}

fn reading(text: &str) -> Result<Labels, FileError> {
    let (_dir, path) = place("labels.csv");
    std::fs::write(&path, text).unwrap();
    read(&path)
}

#[test]
fn labels_survive_the_round_trip() {
    let rows = vec![
        Label {
            printhead: "a, \"b\"".into(),
            channel: Channels::Range(2, 9),
            from_ns: None,
            to_ns: Some(1_700_000_000_123_456_789),
            state: "healthy".into(),
            severity: None,
        },
        Label {
            printhead: "c".into(),
            channel: Channels::One(7),
            from_ns: Some(-1),
            to_ns: None,
            state: "own class".into(),
            severity: Some(0.25),
        },
    ];
    let (_dir, path) = place("labels.csv");
    write(&path, &rows).unwrap();
    assert_eq!(read(&path).unwrap().rows(), rows);
}

#[test]
fn later_beats_earlier_and_narrower_beats_wider() {
    let rows = "p,3,10,20,EC,\np,3,15,20,BN,0.9\np,*,,,healthy,\n\
        q,3-9,,,EC,\nq,5,,,BN,\nq,2-20,,,IDN,\nq,*,,,healthy,\n\
        *,5,,,AB1,\n*,*,,,ignore,\n*,30-31,,,DDN,\n";
    let labels = of_rows(rows).unwrap();
    for (printhead, channel, t_ns, state) in [
        ("p", 3, 10, "EC"),
        ("p", 3, 15, "BN"),
        ("p", 3, 20, "healthy"),
        ("p", 4, 15, "healthy"),
        ("q", 2, 0, "IDN"),
        ("q", 3, 0, "EC"),
        ("q", 5, 0, "BN"),
        ("q", 10, 0, "IDN"),
        ("q", 21, 0, "healthy"),
        ("r", 5, 0, "AB1"),
        ("r", 6, 0, "ignore"),
        ("r", 30, 0, "DDN"),
    ] {
        let row = labels.row_at(printhead, channel, t_ns).unwrap();
        assert_eq!(row.state, state, "{printhead} {channel} at {t_ns}");
        let told = labels.at(printhead, channel, t_ns);
        assert_eq!(told, (state != "ignore").then_some(row));
    }
    assert_eq!(of_rows("p,*,,,healthy,\n").unwrap().at("q", 3, 15), None);
}

#[test]
fn bad_rows_are_named_by_line() {
    for (row, word) in [
        ("p,x,,,healthy,", "channel"),
        ("p,7-3,,,healthy,", "range"),
        ("p,1,,,Healthy,", "write `healthy`"),
        ("p,1,,,heatlhy,", "write `healthy`"),
        ("p,1,,,pbn,", "write `PBN`"),
        ("p,1,yesterday,,healthy,", "yesterday"),
        ("p,1,,,,", "state"),
        ("p,1,,,EC,much", "severity"),
        ("p,1,2,1,EC,", "later"),
        ("p,1,,,EC,1.1", "density"),
        ("p,1,,,BN,-0.1", "cross-section"),
        ("p,1,,,AB1,2", "length"),
        ("p,1,,,SDN,0.9", "viscosity"),
        ("p,1,,,DDN,1e4", "viscosity"),
        ("p,1,,,AB2,-1", "compliance"),
        ("p,1,,,own,inf", "severity"),
    ] {
        assert_refused(of_rows(row), &[word, "line 2"]);
    }
    assert_refused(reading("a,b\n1,2\n"), &["printhead"]);
}

#[test]
fn severities_of_the_contract_are_taken() {
    for row in ["EC,1", "BN,0", "IDN,1", "DDN,8", "AB3,6", "own,-5e9"] {
        assert_eq!(of_rows(&format!("p,1,,,{row}\n")).unwrap().rows().len(), 1, "{row}");
    }
}

#[test]
fn messages_do_not_repeat_all_of_a_cell_and_quotes_end() {
    for row in ["p,CELL,,,EC,", "p,1,CELL,,EC,", "p,1,,,EC,CELL", "p,1,,,CELL,", "CELL,1,,,EC,"] {
        let message =
            of_rows(&row.replace("CELL", &"x\u{1b}".repeat(5000))).unwrap_err().to_string();
        assert!(message.len() < 600 && !message.contains('\u{1b}'), "{}", message.len());
    }
    let endless = format!("p,1,,,\"{}", "EC,\n".repeat(2 << 20));
    assert_refused(of_rows(&endless), &["never closed"]);
}

#[test]
fn severities_may_have_a_decimal_comma_where_commas_do_not_separate_cells() {
    let semicolons = HEADER.replace(',', ";");
    let labels = reading(&format!("{semicolons}\np;3;;;PBN;0,25\n")).unwrap();
    assert_eq!(labels.rows()[0].severity, Some(0.25));
    // the line is that of an editor, however lines end
    let wrong = reading(&format!("{HEADER}\r\n\r\np,3,,,healthy,\r\np,x,,,healthy,\r\n"));
    assert_refused(wrong, &["line 4: channel"]);
}
