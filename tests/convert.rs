//! Tables as people and instruments write them: read, with what was taken for what; or refused, with what to do.

use crate::house::House;
use crate::recorded::bursts;
use std::fmt::Write as _;

/// Rows of a time, which begins 12 µs before 0 and goes on by 1 µs, in this unit, and of two outputs.
fn rows(unit_us: f64, comma: char) -> String {
    rows_from(-12.0, unit_us, comma)
}

fn rows_from(begin_us: f64, unit_us: f64, comma: char) -> String {
    let mut text = String::new();
    for k in 0..40 {
        let t = (begin_us + f64::from(k)) / unit_us;
        let y = 400.0 * (-0.1 * f64::from(k)).exp() * (0.4 * f64::from(k)).cos();
        writeln!(text, "{t:.12}{comma}{y:.3}{comma}{:.3}", y / 2.0).unwrap();
    }
    text
}

/// The sample period and the channels of each burst that is made.
fn made(house: &House) -> Vec<(f64, u32)> {
    let of = |burst: &inkling::burst::Burst| {
        ((burst.sample_period_s * 1e12).round() / 1e12, burst.channels)
    };
    bursts(&house.path("t.mcap")).iter().map(of).collect()
}

#[test]
fn a_unit_that_is_not_understood_is_refused_and_an_option_gives_it() {
    let house = House::new();
    for name in
        ["Time (shakes)", "t [10 us]", "time_ticks", "Time in samples", "t/1e-6 s", "t_100ns"]
    {
        house.write("t.csv", format!("{name},a,b\n{}", rows(1.0, ',')));
        house
            .run("convert t.csv -o t.mcap")
            .exits(1)
            .says("not a unit of time")
            .says("--time-unit");
        house.ok("convert t.csv -o t.mcap --time-unit us");
        assert_eq!(made(&house), [(1e-6, 2)], "{name}");
    }
    house.run("convert t.csv -o t.mcap --time-unit shakes").exits(2).says("give s, ms, us");
    house.run("convert t.csv -o t.mcap --time-unit s --period-s 1e-6").exits(2).says("no effect");
    // days of a spreadsheet, and seconds of half a day, are the same numbers
    let days: String = (0..40)
        .map(|k| format!("{:.12},{}\n", 46_327.5 + f64::from(k) / 86_400.0, k % 7))
        .collect();
    house.write("days.csv", format!("time,a\n{days}"));
    house.run("convert days.csv -o t.mcap").exits(1).says("days, as spreadsheets count them");
    house.ok("convert days.csv -o t.mcap --time-unit d");
    let burst = &bursts(&house.path("t.mcap"))[0];
    // LabVIEW counts from 1904
    let labview: String = (0..40)
        .map(|k| format!("{:.3},{}\n", 3_701_239_200.0 + f64::from(k) / 1e3, k % 7))
        .collect();
    house.write("labview.csv", format!("time,a\n{labview}"));
    let told = house.ok("convert labview.csv -o t.mcap");
    assert!(told.contains("2087-04-15") && told.contains("that is 2021-04-14T"), "{told}");
    // 2026-11-01T12:00:00Z
    assert!((burst.t_acq_ns - 1_793_534_400_000_000_000).abs() < 1_000_000, "{}", burst.t_acq_ns);
    assert!((burst.sample_period_s - 1.0).abs() < 1e-6);
}

#[test]
fn exports_of_instruments_are_read() {
    let us = || rows(1.0, ',');
    let s = || rows(1e6, ',');
    let tab = rows(1e6, '\t');
    let numbered: String =
        us().lines().enumerate().map(|(n, row)| format!("{n},{row}\n")).collect();
    let counted: String = numbered
        .lines()
        .map(|row| {
            let cells: Vec<&str> = row.split(',').collect();
            format!("{},{},{},\n", cells[0], cells[2], cells[3])
        })
        .collect();
    let commas = rows(1e6, ';').replace('.', ",");
    let preamble = "Model,MSO4\nVersion,1.28\n\nSample Interval,1e-06,\nRecord Length,40,\n";
    let latin = |text: &str| text.chars().map(|c| c as u8).collect::<Vec<u8>>();
    let utf16 = |text: &str| text.encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<u8>>();
    let lvm =
        "LabVIEW Measurement\t\nWriter_Version\t2\n***End_of_Header***\t\n\t\nChannels\t2\t\n";
    let segment =
        "Unit,X,40\nSegments,1,SegmentSize,40\nSegment,TrigTime,Time\n#1,01-Nov-2026 08:00:00,0\n";
    let all: [(Vec<u8>, &str); 14] = [
        (format!("x-axis,1,2\nsecond,Volt,Volt\n{}", s()).into(), ""),
        (format!("Time,Channel A,Channel B\n(\u{b5}s),(mV),(mV)\n\n{}", us()).into(), ""),
        (latin(&format!("Time,Channel A,Channel B\r\n(\u{b5}s),(mV),(mV)\r\n\r\n{}", us())), ""),
        (format!("{preamble}TIME,CH1,CH2\n{}", s()).into(), "--skip-lines 5"),
        (
            format!("Record Length,40\nSource,C1,C2\nSecond,Volt,Volt\n{}", s()).into(),
            "--skip-lines 1",
        ),
        (format!("{segment}Time,Ampl,B\n{}", s()).into(), "--skip-lines 4"),
        (
            format!(";Tool,Scope,,\n;Rate,1000000,,\nSample,Time(us),A,B\n{numbered}").into(),
            "--skip-lines 2",
        ),
        (
            format!("{lvm}X_Value\tA\tB\tComment\n{}", tab.replace('\n', "\t\n")).into(),
            "--skip-lines 5",
        ),
        (
            format!("X,CH1,CH2,Start,Increment\nSequence,Volt,Volt,-1.2e-05,1e-06\n{counted}")
                .into(),
            "--period-s 1e-6",
        ),
        (format!(",t_us,a,b\n{numbered}").into(), ""),
        (format!("Index,a,b,time_us\n{}", swapped(&numbered)).into(), ""),
        (format!("sep=;\nt_s;a;b\n{commas}").into(), ""),
        (utf16(&format!("\u{feff}t_s\ta\tb\r\n{}", tab.replace('\n', "\r\n"))), ""),
        (format!("TIME (us),CH1,CH2,\n{}", us().replace('\n', ",\n")).into(), ""),
    ];
    for (n, (table, options)) in all.into_iter().enumerate() {
        let house = House::new();
        house.write("t.csv", table);
        if !options.is_empty() {
            let advice = options.replace("1e-6", "");
            house.run("convert t.csv -o t.mcap").exits(1).says(advice.trim());
        }
        house.ok(&format!("convert t.csv -o t.mcap {options}"));
        assert_eq!(made(&house), [(1e-6, 2)], "table {n}");
    }
}

/// Rows of a number, a time and two outputs with the time last.
fn swapped(rows: &str) -> String {
    let swap = |row: &str| {
        let cells: Vec<&str> = row.split(',').collect();
        format!("{},{},{},{}\n", cells[0], cells[2], cells[3], cells[1])
    };
    rows.lines().map(swap).collect()
}

#[test]
fn what_is_no_table_or_leaves_a_choice_is_refused_with_what_to_do() {
    let once = |k: i32| format!("1.0463{k},{k}\n");
    let coarse: String = (0..200).map(|k| once(k / 40)).collect();
    let rounded: String = (0..200).map(|k| format!("{:.2},{k}\n", f64::from(k) * 0.014)).collect();
    let magic = "export it as CSV or Parquet";
    for (table, says) in [
        (
            format!("a_s,Time (us),time_ms\n{}", rows(1.0, ',')),
            "several columns are called time (Time (us), time_ms): --time",
        ),
        (
            format!(",a,b\n{}", rows(1.0, ',')),
            "no column is called time, and \"\" numbers the rows: --time",
        ),
        (format!("t_s,a\n{coarse}"), "\"t_s\" has too few digits: 195 of its 200 times"),
        (format!("t_s,a\n{rounded}"), "too few digits: steps from 0.01 to 0.02; --period-s"),
        ("t,y\r\n0,1\r\n\r\n# a\r\n1,bad\r\n".into(), "line 5: column \"y\": \"bad\" is no number"),
        (
            "X,CH1,Inc\nSequence,Volt,1e-6\n0,1,\n1,2,\n".into(),
            "counts samples: --period-s says how far apart they are (there are Inc 1e-6)",
        ),
    ] {
        let house = House::new();
        house.write("t.csv", table);
        house.run("convert t.csv -o t.mcap").exits(1).says(says);
    }
    let house = House::new();
    for (start, says) in [
        (&b"\x89HDF\r\n\x1a\n\0\0"[..], "HDF5"),
        (b"MATLAB 5.0 MAT-file, Platform: GLNXA64", "MAT file"),
        (b"RIFF\x24\0\0\0WAVEfmt ", "WAV"),
        (b"TDSm\x0e\0\0\0", "TDMS"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1", "workbook"),
        (b"\x1f\x8b\x08\0\0", "gzip"),
        (b"<!DOCTYPE html><html>", "an HTML page"),
        (b"version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
    ] {
        house.write("t.bin", start);
        house.run("convert t.bin -o t.mcap").exits(2).says(says).says(magic).says("import inkling");
    }
}

#[test]
fn what_instruments_write_for_no_value_costs_its_channel_alone() {
    for word in
        ["Infinity", "-inf", "NaN", "9.9E+37", "-9.91e37", "1e60", "OL", "\u{221e}", "#N/A", ""]
    {
        let house = House::new();
        let mut table: Vec<String> = rows(1.0, ',').lines().map(str::to_owned).collect();
        let time = table[7].split(',').next().unwrap().to_owned();
        table[7] = format!("{time},{word},1.5");
        house.write("t.csv", format!("t_us,a,b\n{}\n", table.join("\n")));
        let told = house.ok("convert t.csv -o t.mcap");
        assert!(told.contains("1 cells have no value"), "{word}: {told}");
        let burst = &bursts(&house.path("t.mcap"))[0];
        let finite = crate::recorded::rows(burst)
            .iter()
            .map(|y| y.iter().all(|y| y.is_finite()))
            .collect::<Vec<_>>();
        assert_eq!(finite, [false, true], "{word}");
    }
}

#[test]
fn segments_and_several_tables_are_bursts() {
    let house = House::new();
    let segments: String = [0.0, 10_000.0, 20_000.0].map(|at| rows_from(at, 1.0, ',')).concat();
    let again = rows(1.0, ',').repeat(3);
    for (table, begins_us) in [(segments, [0, 10_000, 20_000]), (again, [0, 40, 80])] {
        house.write("t.csv", format!("t_us,a,b\n{table}"));
        let told = house.ok("convert t.csv -o t.mcap");
        assert!(told.contains("3 bursts are segments"), "{told}");
        let made = bursts(&house.path("t.mcap"));
        let after = |n: usize| (made[n].t_acq_ns - made[0].t_acq_ns) / 1000;
        assert_eq!([0, 1, 2].map(after), begins_us);
    }
    for n in 0..3 {
        house.write(&format!("s_2026110{n}T080000.csv"), format!("t_us,a,b\n{}", rows(1.0, ',')));
    }
    house.write("other.csv", format!("t_us,a,c\n{}", rows(1.0, ',')));
    let tables = "s_20261100T080000.csv s_20261101T080000.csv s_20261102T080000.csv";
    house.ok(&format!("convert {tables} --every 0.5 -o t.mcap --printhead K"));
    let made = bursts(&house.path("t.mcap"));
    assert_eq!((made.len(), made[2].t_acq_ns - made[0].t_acq_ns), (3, 1_000_000_000));
    let named = "s_20261101T080000.csv s_20261102T080000.csv";
    house.ok(&format!("convert {named} --start name -o t.mcap"));
    let made = bursts(&house.path("t.mcap"));
    assert_eq!(made[1].t_acq_ns - made[0].t_acq_ns, 86_400_000_000_000);
    house
        .run(&format!("convert {named} other.csv -o t.mcap"))
        .exits(1)
        .says("its outputs are a, c");
}

#[test]
fn several_tables_are_of_the_printheads_that_their_names_say() {
    let house = House::new();
    for (names, options, heads) in [
        ("K1_20261101T0800 K2_20261101T0800 K1_20261101T0801", "--start name", "K1 K2 K1"),
        ("K1_20261101T080000.250 K1_20261101T080000.500", "--start name", "K1 K1"),
        ("K1 K2", "", "K1 K1"),
        ("K1 K2", "--printhead name", "K1 K2"),
        ("K1 K2", "--printhead K3", "K3 K3"),
        ("one two", "", "one two"),
        ("scope scope2 scope10", "", "scope scope scope"),
        ("20261101T0800 20261102T0800", "--start name", "20261101T0800 20261101T0800"),
    ] {
        let files: Vec<String> = names.split(' ').map(|name| format!("{name}.csv")).collect();
        for file in &files {
            house.write(file, format!("t_us,a,b\n{}", rows(1.0, ',')));
        }
        let told = house.ok(&format!("convert {} -o t.mcap {options}", files.join(" ")));
        let made = bursts(&house.path("t.mcap"));
        let found: Vec<&str> = made.iter().map(|burst| &*burst.printhead).collect();
        assert_eq!(found.join(" "), heads, "{names} {options}");
        for head in found {
            assert!(told.contains(head), "{told}");
        }
    }
}

#[test]
fn tables_that_are_no_more_of_the_same_and_periods_that_times_contradict_are_refused() {
    let house = House::new();
    let us = || rows(1.0, ',');
    let of_1970: String = (0..40).map(|k| format!("{}.{k:06},1,2\n", 1_793_520_000)).collect();
    house.write("relative.csv", format!("t_s,a,b\n{}", rows(1e6, ',')));
    house.write("epoch.csv", format!("t_s,a,b\n{of_1970}"));
    house.write("volts.csv", format!("t,a,b\n(us),(V),(V)\n{}", us()));
    house.write("millivolts.csv", format!("t,a,b\n(us),(mV),(mV)\n{}", us()));
    house.write("unsaid.csv", format!("t_us,a,b\n{}", us()));
    for (tables, says) in [
        ("relative.csv epoch.csv", "only one kind counts from 1970"),
        ("epoch.csv relative.csv", "only one kind counts from 1970"),
        (
            "volts.csv millivolts.csv",
            "its outputs are a (mV), b (mV), those of the table before a (V), b (V)",
        ),
        ("unsaid.csv volts.csv", "its outputs are a (V), b (V), those"),
    ] {
        house.run(&format!("convert {tables} -o t.mcap")).exits(1).says(says);
    }
    house.ok("convert relative.csv epoch.csv -o t.mcap --every 0.5");
    let dt: String = us().lines().map(|row| format!("{row},1\n")).collect();
    house.write("dt.csv", format!("t_us,a,b,dt\n{dt}"));
    for period in ["5e-7", "1.05e-6", "2e-6", "dt"] {
        let told = house.run(&format!("convert dt.csv -o t.mcap --outputs a --period-s {period}"));
        told.exits(1).says("its times say one sample every 1.000e-6 s");
    }
    house.ok("convert dt.csv -o t.mcap --outputs a --period-s 1.01e-6");
}

/// Three acquisitions of each of these printheads, 20 ms apart, each with a temperature of its own.
fn acquisitions(heads: &[&str], begin_us: u64) -> String {
    let mut text = String::from("t_us,head,ink_C,y\n");
    for head in heads {
        for n in 0..3 {
            for k in 0..20 {
                let t = begin_us + n * 20_000 + k;
                writeln!(text, "{t},{head},{},{}", 25 + n, k % 7).unwrap();
            }
        }
    }
    text
}

#[test]
fn each_acquisition_of_a_table_has_its_own_temperature_and_printheads_overlap() {
    let house = House::new();
    for begin_us in [0, 1_793_516_400_000_000] {
        for heads in [&["K1"][..], &["K1", "K2"]] {
            house.write("t.csv", acquisitions(heads, begin_us));
            let options = "--printhead head --temperature ink_C -o t.mcap";
            let told = house.ok(&format!("convert t.csv {options}"));
            assert!(!told.contains("put after it"), "{told}");
            let made = bursts(&house.path("t.mcap"));
            let of_head = |name: &str| -> Vec<(i64, Option<f64>)> {
                let of = made.iter().filter(|burst| &*burst.printhead == name);
                let began = made[0].t_acq_ns;
                of.map(|burst| (burst.t_acq_ns - began, burst.temperature_c)).collect()
            };
            for name in heads {
                let expected = [0, 1, 2].map(|n| (n * 20_000_000, Some(25.0 + n as f64)));
                assert_eq!(of_head(name), expected, "{name}");
            }
        }
    }
}

#[test]
fn the_begin_of_a_table_is_named_as_text_whatever_separates_its_cells() {
    let house = House::new();
    house.write("t.txt", format!("Exported by X\nt_s\ta\tb\n{}", rows(1e6, '\t')));
    house.run("convert t.txt -o t.mcap").exits(1).says("at line 2 (t_s a b): --skip-lines 1");
}
