use super::super::table_file::Decay;
use super::*;
use crate::fixtures::assert_refused;
use std::io::Cursor;

fn table(text: &[u8], columns: &Columns) -> Result<(Table, Vec<Decay>), FileError> {
    let mut table = read_from(Cursor::new(text.to_vec()), Path::new("t.csv"), columns)?;
    let decays = std::mem::take(&mut table.decays);
    Ok((table, decays))
}

/// The table of this text by its usual columns.
fn plain(text: &str) -> Result<(Table, Vec<Decay>), FileError> {
    table(text.as_bytes(), &Columns::default())
}

fn columns(time: &str, outputs: &str, burst: &str) -> Columns {
    let some = |name: &str| (!name.is_empty()).then(|| name.to_owned());
    Columns {
        time: some(time),
        outputs: some(outputs).map(|o| o.split(',').map(str::to_owned).collect()),
        burst: some(burst),
        ..Columns::default()
    }
}

#[test]
fn a_burst_column_groups_rows_also_where_they_alternate() {
    let text = "gap,t,in,out\nx,0,9,1\ny,0,9,2\nx,1,9,3\ny,1,9,4\n";
    let (_, decays) = table(text.as_bytes(), &columns("t", "out", "gap")).unwrap();
    let names: Vec<&str> = decays.iter().map(|d| d.name.as_str()).collect();
    assert_eq!(names, ["x", "y"]);
    assert_eq!(decays[1].outputs, [[2.0, 4.0]]);
    assert_eq!(decays[1].line, 3);
    let (t, _) = table(text.as_bytes(), &columns("", "", "gap")).unwrap();
    assert_eq!(t.outputs, ["in", "out"]);
}

#[test]
fn semicolons_decimal_commas_tabs_marks_comments_and_quotes_are_read() {
    let expected = vec![vec![1.5, -2e3]];
    for text in [
        "\u{feff}t;y\r\n0;1,5\r\n1;-2e3\r\n",
        "# made by hand\nt\ty\n0\t1.5\n1\t-2000\n",
        "\"t\", \"y\"\n\n0, \"1.5\"\n1, -2000.0\n",
    ] {
        let (t, decays) = plain(text).unwrap();
        assert_eq!((t.time.as_deref(), &decays[0].outputs), (Some("t"), &expected), "{text}");
    }
}

#[test]
fn points_before_three_decimals_are_no_thousands_where_one_number_says_so() {
    for text in ["t;y\n0;1\n1;0.125\n", "t;y\n0;1.000\n1;2.125\n", "t;y\n0;1\n1;2.125\n2;2.25\n"] {
        assert!(plain(text).is_ok(), "{text}");
    }
    assert!(plain("t;y\n0;1000\n1;2.125\n").is_ok());
}

#[test]
fn missing_cells_are_nan_and_what_is_no_number_names_its_line() {
    let (_, decays) = plain("t,y\n0,\n1,NaN\n2,3\n").unwrap();
    let y = &decays[0].outputs[0];
    assert!(y[0].is_nan() && y[1].is_nan() && y[2] == 3.0);
    for (text, says) in [
        ("t,y\n0,1\n1,abc\n", "line 3: column \"y\": \"abc\" is no number: leave"),
        ("t,y\n0,1\n1,\"1,234.5\"\n", "nothing between thousands"),
        ("t,y\n0,1\n1,-1.5 mV\n", "the unit into the column's name"),
        ("t;y\n0;975\n1;-4.000\n2;12.345\n", "line 3: \"-4.000\" has three digits behind"),
        ("t\ty\tz\n0\t975\t1000\n1\t-4,000\t2\n", "line 3: \"-4,000\" has three digits behind"),
        ("t,a_V,b_mV\n0,1,2\n1,3,4\n", "a_V is in V, and b_mV in mV: choose"),
        ("t,a (mV),b [V]\n0,1,2\n1,3,4\n", "a (mV) is in mV, and b [V] in V: choose"),
        ("t,a,b\n(us),(mV),(V)\n0,1,2\n1,3,4\n", "line 2: a is in (mV), and b in (V): choose"),
        ("t,y\n11/1/2026 8:00:00,1\n11/1/2026 8:00:01,2\n", "write times as 2026-11-01"),
        ("t,y\n0,1\n1,0x1F\n", "base 10"),
        ("t,y\n0,1\n,2\n", "line 3: column \"t\": a row without a time"),
        ("t,y\n0,1\ninf,2\n", "line 3"),
        ("t,y\n0,1\n1\n", "line 3: 1 cells where the header has 2: remove the line"),
        (
            "t, ms,y\n0,1\n1,2\n",
            "line 2: 2 cells where the header has 3: write quotes around a name",
        ),
        ("t,y\n0,1\n1,(0.1114)\n", "\"(0.1114)\" is no number: write numbers alone, as -0.5"),
        ("t,y\n0,1\n1,'1.2\n", "is no number: write numbers alone"),
        ("t,y\n0,1\n1,=\"1.2\"\n", "is no number: write numbers alone"),
        ("t,y\n0,1\n1,0.1114-\n", "is no number: write numbers alone"),
        ("t,y\n0,1\n1,200%\n", "the unit into the column's name"),
        ("timestamp,y\nSun Nov  1 08:00:00 2026,1\n", "is no number: write times as 2026-11-01"),
        ("t_us,y,Trigger\n0,1,0\n", "if it marks an instant, leave it out by --outputs"),
        (
            "t;y\n1.000;2,00000\n1.007;1,5\n",
            "line 2: \"1.000\" has three digits behind a point or comma, and \"2,00000\"",
        ),
        ("t\ty\n1,000\t2.00000\n1,007\t1.5\n", "line 2: \"1,000\" has three digits"),
        ("t_100ns,y\n0,1\n", "not a unit of time that is known: --time-unit"),
        ("Time,y\n(?s),(V)\n0,1\n", "is no number: nor is it a unit of time"),
        ("t,y\n0,5,1,5\n", "line 2: 4 cells where the header has 2: write points before decimals"),
        ("t,y\n00:00.0,1\n00:00.5,1\n", "minutes and seconds, as spreadsheets show times"),
        ("t,y\n0,4.0D+02\n", "write e instead of D"),
        ("t,y\n", "no rows"),
        ("", "is empty: a line of column names"),
        ("0,1\n1,2\n", "must name the columns"),
        ("# t,y\n0,1\n1,2\n", "must name the columns, without a # before them"),
        ("0,OL\n1,2\n2,3\n3,4\n", "must name the columns"),
        (",400.5,437.8\n,357.2,374.2\n,261.3,256.1\n", "the first line holds numbers"),
        (",400\n,357\n,261\n", "the first line holds numbers"),
        ("t,y\n0,CLIPPED\n1,2\n2,3\n3,4\n", "line 2: column \"y\": \"CLIPPED\" is no number"),
        ("t;y\n0;1'300.5\n1;2\n2;3\n3;4\n", "line 2: column \"y\": \"1'300.5\" is no number"),
        ("t\n0\n", "\"t\" has no comma, semicolon or tab"),
        ("t_us|y\n0|1\n", "a line sep=| above it"),
        ("t_us y\n0 1\n", "tr -s ' ' , makes commas of blanks"),
        ("t,y,y\n0,1,2\n", "several columns \"y\""),
        ("Time1 (us),a,Time2 (us),b\n0,1,0,1\n", "\"Time2 (us)\" looks like the times of"),
        ("Time (us),y\n(ms),V\n0,1\n", "says microseconds, and \"(ms)\" below it milliseconds"),
        ("t,y\nTS,mV\n0,1\n", "\"TS\" is no number: nor is it a unit of time that is known"),
        ("t,y\n\"0,5\",\"1,5\"\n\"1,5\",\"2,5\"\n", "write a point before decimals"),
        ("t,y\n0,1\nSum,1\n", "line 3: column \"t\": \"Sum\" is no number: remove the line"),
        ("t,head,y\n0,K1,1\n", "--printhead head divides"),
        (
            "t;y\n0,5;-1.400,00\n1,5;20,00\n2,5;3,00\n3,5;1,00\n",
            "line 2: column \"y\": \"-1.400,00\"",
        ),
    ] {
        assert_refused(plain(text), &[says]);
    }
    for (columns, says) in [
        (columns("u", "", ""), "no column \"u\"; there are t, y"),
        (columns("t", "y,y", ""), "asked for twice"),
        (columns("t", "t", ""), "asked for twice"),
        (columns("", "t", ""), "unless --time names another"),
    ] {
        assert_refused(table(b"t,y\n0,1\n", &columns), &[says]);
    }
    let of_heads = Columns { printhead: Some("head".into()), ..columns("t", "y", "") };
    for columns in [of_heads, columns("t", "y", "head")] {
        let merged = table(b"head,t,y\nK1,0,1\n,1,2\n", &columns);
        assert_refused(
            merged,
            &["line 3: column \"head\": an empty cell", "cells that were merged"],
        );
    }
}

#[test]
fn dates_are_in_the_unit_of_their_column() {
    for (time, second) in [("t", 1.0), ("t_s", 1.0), ("t_ms", 1e3), ("t_us", 1e6), ("t_ns", 1e9)] {
        let second_row = ["1970-01-01 00:00:01.5", "1.1.1970 0:00:01.5", "19700101T000001.5"];
        for row in second_row {
            let text = format!("{time},y\n1970-01-01T00:00:01Z,1\n{row},2\n");
            let (_, decays) = plain(&text).unwrap();
            let found = [0, 1].map(|k| decays[0].time(k));
            assert_eq!(found, [Some(second), Some(1.5 * second)], "{time}");
        }
    }
}

#[test]
fn times_keep_their_digits_however_long_ago_they_count_from() {
    let ns = [0, 781, 1_563, 1_000_000_000];
    for (time, written) in [
        ("time_ns", ns.map(|ns| format!("{}", 1_772_536_953_000_000_000_i64 + ns))),
        (
            "t",
            ns.map(|ns| {
                format!("{}.{:09}", 1_772_536_953 + ns / 1_000_000_000, ns % 1_000_000_000)
            }),
        ),
        (
            "t_s",
            ns.map(|ns| {
                format!("2026-03-03 11:22:{}.{:09}", 33 + ns / 1_000_000_000, ns % 1_000_000_000)
            }),
        ),
    ] {
        let rows: String = written.iter().map(|time| format!("{time},1\n")).collect();
        let (_, decays) = plain(&format!("{time},y\n{rows}")).unwrap();
        let unit = if time == "time_ns" { 1.0 } else { 1e9 };
        for (t, ns) in decays[0].times.iter().zip(ns) {
            assert!((t * unit - ns as f64).abs() < 1e-3, "{time}: {t}");
        }
        assert_eq!(decays[0].base as f64 * unit, 1_772_536_953e9);
    }
}

#[test]
fn with_a_period_times_say_when_a_burst_began_where_they_can_be_read() {
    let columns = Columns { rows_are_samples: true, ..Columns::default() };
    for (text, times, outputs) in [
        ("elapsed,y\n5,1\n6,2\n", vec![5.0, 6.0], 1),
        ("Time,y\n08:00:00,1\n08:00:01,2\n", vec![0.0, 1.0], 1),
        ("Time,y\nSample,V\n0,1\n1,2\n", vec![0.0, 1.0], 1),
        ("a,b\n5,1\n6,2\n", vec![0.0, 1.0], 2),
        (",0,1\n5,1,2\n6,2,3\n", vec![0.0, 1.0], 2),
    ] {
        let (t, decays) = table(text.as_bytes(), &columns).unwrap();
        assert_eq!((&decays[0].times, t.outputs.len()), (&times, outputs), "{text}");
    }
}

#[test]
fn what_stands_among_the_names_or_signs_is_read_as_it_is_meant() {
    for text in [
        "t,y,,\n0,1,,\n1,-2,,\n",
        "t,y,t0 = -2e-05, tInc = 1,\n0,1,,\n1,-2,,\n",
        "t,y\n0,1\n1,\u{2212}2\n",
        // each channel with its own times, of which the second ones are the first
        "A X,y,B X\n12.3,1,12.3\n1e9,-2,1000000000.0\n",
    ] {
        let (t, decays) = plain(text).unwrap();
        assert_eq!((t.outputs, &decays[0].outputs), (vec!["y".into()], &vec![vec![1.0, -2.0]]));
    }
}

#[test]
fn what_counts_rows_from_any_number_is_no_output_and_units_below_names_are_of_the_outputs() {
    let rows = |first: i32| -> String {
        (0..5).map(|k| format!("{}e-3,{},{}\n", k, first + k, k * k)).collect()
    };
    for first in [0, 1, 1000] {
        let (t, _) = plain(&format!("t,RECORD,y\n{}", rows(first))).unwrap();
        assert_eq!((t.outputs, t.left_out), (vec!["y".to_owned()], vec!["RECORD".to_owned()]));
    }
    let (t, _) = plain(&format!("t,a,b\n(us),(mV),(mV)\n{}", rows(1))).unwrap();
    assert_eq!(t.outputs, ["b (mV)"]);
}

#[test]
fn who_names_a_printhead_has_not_chosen_wrong_columns() {
    let read = |columns: &Columns| table(b"0,1\n1,2\n", columns);
    let printhead = Columns { printhead: Some("K1".into()), ..Columns::default() };
    assert!(matches!(read(&printhead), Err(FileError::Failed { .. })));
    assert!(matches!(read(&columns("t", "", "")), Err(FileError::Mistaken { .. })));
}

#[test]
fn text_that_is_not_utf_8_is_an_error() {
    let read = table(b"t,y\n0,1\n1,\xff\n", &Columns::default());
    assert_refused(read, &["line 3: is not UTF-8"]);
}
