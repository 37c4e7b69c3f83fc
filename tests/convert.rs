//! Tables become recordings: regular ones as they are, others refused with what to do.

use crate::house::{House, root};
use crate::recorded::{bursts, signal};

#[test]
fn a_table_becomes_bursts_of_its_decays_and_outputs() {
    let house = House::new();
    let mut text = "run;t_ms;a;b\n".to_owned();
    for run in 0..3 {
        for k in 0..20 {
            text += &format!("{run};{k};{},5;{}\n", run * 100 + k, -k);
        }
    }
    house.write("t.csv", &text);
    house.run("convert t.csv --burst run --time t_ms -o sub/t.mcap").exits(0).says("channel 1: b");
    let bursts = bursts(&house.path("sub/t.mcap"));
    assert_eq!(bursts.len(), 3);
    for (run, burst) in bursts.iter().enumerate() {
        assert_eq!((burst.channels, burst.samples_per_channel), (2, 20));
        assert!((burst.sample_period_s - 1e-3).abs() < 1e-12 && &*burst.printhead == "t");
        assert_eq!(burst.t_acq_ns - bursts[0].t_acq_ns, run as i64 * 20_000_000);
        let expected: Vec<f64> = (0..20).map(|k| f64::from(run as i32 * 100 + k) + 0.5).collect();
        assert_eq!(signal(burst, 0), expected);
    }
    house.run("inspect sub/t.mcap").exits(0);
}

#[test]
fn bad_tables_are_refused_and_leave_no_recording() {
    let house = House::new();
    let regular: String = (0..50).map(|k| format!("{k},{}\n", k % 5)).collect();
    let cases = [
        ("t,y\n0,1\n".to_owned(), "1 samples"),
        ("t,y\n0,1\n1,2\n2,3\n2,4\n3,5\n".to_owned(), "does not increase at its row 4"),
        (format!("t,y\n{regular}51,1\n"), "--resample"),
        (format!("t,y\n{regular}50,x\n"), "line 52"),
        (format!("t,y,y\n{}", "0,1,2\n"), "several columns"),
        ("".to_owned(), "is empty"),
        ("\u{0}\u{1}\u{2}".to_owned(), "no column is left"),
    ];
    for (text, says) in cases {
        house.write("t.csv", &text);
        house.run("convert t.csv -o t.mcap").exits(1).says(says);
        let names = std::fs::read_dir(house.path(".")).unwrap().map(|e| e.unwrap().file_name());
        assert_eq!(names.filter(|n| n.to_string_lossy().contains("t.mcap")).count(), 0);
    }
    house.write("t.csv", "t,y\n0,1\n1,2\n2,1\n3,5\n");
    house
        .run("convert t.csv -o t.mcap")
        .exits(0)
        .says("nothing says when: the first burst is put at");
    let told = house.run("convert t.csv -o t.mcap --start 2026-11-01T08:00:00Z").exits(0);
    assert!(!told.stdout().contains("nothing says when"), "{}", told.stdout());
    house.run("convert t.csv -o t.mcap --start yesterday").exits(2).says("yesterday");
}

#[test]
fn missing_and_irregular_samples_are_interpolated_only_when_asked() {
    let house = House::new();
    let rows = (0..58).filter(|k| k % 9 != 4);
    let row = |k: i32| match k {
        20 => format!("{},\n", 0.5 * f64::from(k)),
        _ => format!("{},{}\n", 0.5 * f64::from(k), (0.2 * f64::from(k)).sin()),
    };
    house.write("t.csv", format!("t,y\n{}", rows.map(row).collect::<String>()));
    house.run("convert t.csv -o t.mcap").exits(1).says("samples missing after");
    house.run("convert t.csv --resample -o t.mcap").exits(0).says("7 of 58").says("1 cells");
    let y = signal(&bursts(&house.path("t.mcap"))[0], 0);
    let worst = y.iter().enumerate().map(|(k, y)| (y - (0.2 * k as f64).sin()).abs());
    assert!(worst.fold(0.0, f64::max) < 1e-3);
}

#[test]
fn times_of_any_unit_and_columns_of_printheads_are_read_as_they_are_and_what_is_missing_is_said() {
    let house = House::new();
    let head = |k: i32| if k < 20 { "K1" } else { "K2" };
    let row = |k: i32, t: String| {
        let y = if k == 25 { "NaN".to_owned() } else { (k % 7).to_string() };
        format!("{t},{},{y}\n", head(k))
    };
    // 2026-11-01T08:00:00Z and on, a sample every 10 ms
    let second = 1_793_520_000_i64;
    for (unit, per_s, said) in [
        ("t", 1.0, "seconds since 1970"),
        ("t", 1e3, "milliseconds since 1970"),
        ("t", 1e6, "microseconds since 1970"),
        ("t_ms", 1e3, "printheads by their column: 2"),
    ] {
        let time = |k: i32| ((second as f64 + f64::from(k) * 0.01) * per_s).to_string();
        let rows: String = (0..40).map(|k| row(k, time(k))).collect();
        house.write("t.csv", format!("{unit},head,y\n{rows}"));
        house
            .run("convert t.csv --printhead head -o t.mcap")
            .exits(0)
            .says(said)
            .says("1 cells have no value");
        let bursts = bursts(&house.path("t.mcap"));
        let heads: Vec<&str> = bursts.iter().map(|burst| &*burst.printhead).collect();
        assert_eq!(heads, ["K1", "K2"], "{unit} {per_s}");
        assert!((bursts[0].t_acq_ns - second * 1_000_000_000).abs() < 1_000_000, "{per_s}");
        assert!((bursts[0].sample_period_s - 0.01).abs() < 1e-4);
        assert!(signal(&bursts[1], 0)[5].is_nan());
    }
    house.run("inspect t.mcap").exits(0);
    let told = house.json("convert t.csv --printhead head -o t.mcap --json");
    assert_eq!(
        (&told["printheads"], &told["cells_missing"]),
        (&["K1", "K2"][..].into(), &1.into())
    );
    // the time of a burst in words, in a table of samples one after the other, of unequal lengths
    let clock = |k: i32| if k < 24 { "2026-11-01T08:00:00Z" } else { "2026-11-01 08:00:01.5" };
    let rows: String = (0..40).map(|k| format!("{},{},{k}\n", clock(k), k / 24)).collect();
    house.write("iso.csv", format!("when,drop,y\n{rows}"));
    house
        .run("convert iso.csv --time when --burst drop --period-s 1e-6 -o iso.mcap")
        .exits(0)
        .says("16 to 24 samples a channel");
    let times: Vec<i64> =
        bursts(&house.path("iso.mcap")).iter().map(|burst| burst.t_acq_ns).collect();
    assert_eq!(times, [second * 1_000_000_000, second * 1_000_000_000 + 1_500_000_000]);
}

/// Real ring-downs, where they are: they may not be copied into the project.
#[test]
#[cfg_attr(not(measured), ignore = "no measured ring-downs in ../shared/measured")]
fn measured_tables_become_recordings() {
    let measured = root().join("../shared/measured");
    let house = House::new();
    let silverbox = "--time time_s --outputs output_v --burst gap";
    for (name, options, bursts_channels_samples, period_s) in [
        ("air_track_one_mass", "", (1, 1, 870), 0.033378),
        ("air_track_two_masses", "", (1, 2, 495), 0.033378),
        ("beam_aluminium", "", (1, 2, 4096), 1.0 / 2048.0),
        ("pendulum_wooden_bob", "", (1, 1, 917), 1.0 / 30.0),
        ("silverbox_free_decays", silverbox, (5, 1, 88), 1.6384e-3),
        ("pendulum", "--resample", (1, 1, 568), 1.0 / 6.0),
    ] {
        let table = measured.join(format!("{name}.csv"));
        house.ok(&format!("convert {} {options} -o {name}.mcap", table.display()));
        let bursts = bursts(&house.path(&format!("{name}.mcap")));
        let (count, channels, samples) = bursts_channels_samples;
        assert_eq!(bursts.len(), count, "{name}");
        for burst in &bursts {
            assert_eq!((burst.channels, burst.samples_per_channel), (channels, samples), "{name}");
            assert!((burst.sample_period_s / period_s - 1.0).abs() < 1e-4, "{name}");
        }
    }
    let pendulum = measured.join("pendulum.csv");
    house
        .run(&format!("convert {} -o p.mcap", pendulum.display()))
        .exits(1)
        .says("samples missing after");
}
