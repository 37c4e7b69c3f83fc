//! Critique on real ring-downs: those in `tests/measured`, and those beside the project, which may not be copied into it.

use crate::house::{House, root};
use crate::recorded::bursts;
use serde_json::Value;

/// What the critique says of a table, beside the tests or beside the project.
fn critique(table: &str, options: &str) -> Value {
    let house = House::new();
    let table = root().join(table);
    house.ok(&format!("convert {} {options} -o r.mcap", table.display()));
    house.ok("critique r.mcap --plant oscillator -o c");
    house.read_json("c/critique.json")
}

/// The same of those beside the project.
fn shared(name: &str, options: &str) -> Value {
    critique(&format!("../shared/measured/{name}.csv"), options)
}

fn names(c: &Value) -> Vec<&str> {
    let mut names: Vec<&str> =
        c["causes"].as_array().unwrap().iter().map(|c| c["id"].as_str().unwrap()).collect();
    names.sort_unstable();
    names
}

fn value(c: &Value, id: &str) -> f64 {
    let mut causes = c["causes"].as_array().unwrap().iter();
    causes.find(|c| c["id"] == id).unwrap()["value"].as_f64().unwrap()
}

fn says(c: &Value, what: &str) -> bool {
    c["remarks"].as_array().unwrap().iter().any(|r| r.as_str().unwrap().contains(what))
}

/// Misfit on samples that nothing was fitted to, after over before.
fn left(c: &Value) -> f64 {
    let of = |when: &str| c["gain"][when]["nrmse_percent"].as_f64().unwrap();
    of("after") / of("before")
}

#[test]
fn wide_swings_have_a_sine_for_a_spring_and_drag_and_small_ones_an_offset_alone() {
    let of = |name| critique(&format!("tests/measured/pendulum_{name}.csv"), "--resample");
    let wide = of("large_angle");
    assert_eq!(names(&wide), ["cubic_stiffness", "offset", "quadratic_drag"]);
    let tracked = of("tracker");
    assert_eq!(names(&tracked), ["cubic_stiffness", "quadratic_drag"]);
    for pendulum in [&wide, &tracked] {
        assert_eq!(pendulum["verdict"], "named");
        // a pendulum's frequency is less by x²/16, .12 at 1.4 rad
        assert!((-0.15..-0.10).contains(&value(pendulum, "cubic_stiffness")));
        assert!(left(pendulum) < 0.1, "{}", left(pendulum));
    }
    let small = of("small_angle");
    assert_eq!(names(&small), ["offset"]);
    assert!((0.0065..0.0080).contains(&value(&small, "offset")), "it is .0072 rad");
}

/// What skews its wave rings at twice and three times its frequency, as wide as these lines: no modes of their own.
#[test]
fn a_skewed_wave_of_which_nobody_knows_the_cause_gets_no_name() {
    let c = critique("tests/measured/seismometer.csv", "--resample");
    assert_eq!(c["verdict"], "unknown");
    assert!(!names(&c).contains(&"second_mode"));
}

#[test]
#[cfg_attr(not(measured), ignore = "no measured ring-downs in ../shared/measured")]
fn pendulums_have_a_sine_for_a_spring_and_the_bob_meets_drag() {
    let pendulum = shared("pendulum", "--resample");
    assert_eq!(pendulum["verdict"], "named");
    // what else may be said is the camera's zero
    assert!(matches!(&names(&pendulum)[..], ["cubic_stiffness"] | ["cubic_stiffness", "offset"]));
    assert!((-0.16..-0.10).contains(&value(&pendulum, "cubic_stiffness")));
    assert!(left(&pendulum) < 0.1);
    let bob = shared("pendulum_wooden_bob", "");
    assert_eq!(bob["verdict"], "named");
    assert_eq!(names(&bob), ["cubic_stiffness", "offset", "quadratic_drag"]);
    assert!(value(&bob, "quadratic_drag") > 0.0 && left(&bob) < 0.2);
}

#[test]
#[cfg_attr(not(measured), ignore = "no measured ring-downs in ../shared/measured")]
fn silverbox_stiffens_and_its_input_leaks() {
    let options = "--time time_s --outputs output_v --burst gap";
    let c = shared("silverbox_free_decays", options);
    assert_eq!(c["verdict"], "named");
    assert!(value(&c, "cubic_stiffness") > 0.0);
    // of the leaking input the constant part is an offset, and what hums is what `input_v` holds most of besides: 150 Hz,
    // and 50 Hz; the critique looks at the output alone
    assert_eq!(names(&c), ["cubic_stiffness", "offset", "tone"]);
    assert!((value(&c, "tone") - 150.0).abs() < 0.5 && says(&c, "one more tone: frequency = 50."));
    assert!(says(&c, "still unexplained"), "{}", c["remarks"]);
}

#[test]
#[cfg_attr(not(measured), ignore = "no measured ring-downs in ../shared/measured")]
fn carts_and_beam_have_more_modes_and_offsets() {
    let [carts, beam] = ["air_track_two_masses", "beam_aluminium"].map(|name| shared(name, ""));
    for c in [&carts, &beam] {
        assert_eq!(c["verdict"], "named");
        assert_eq!(names(c), ["offset", "second_mode"]);
    }
    assert!((value(&carts, "second_mode") - 1.714).abs() < 0.01);
    assert!((value(&carts, "offset") - 63.0).abs() < 1.0 && left(&carts) < 0.02);
    assert!(left(&beam) < 0.15 && says(&beam, "still unexplained"));
}

#[test]
#[cfg_attr(not(measured), ignore = "no measured ring-downs in ../shared/measured")]
fn one_cart_is_close_to_linear() {
    let c = shared("air_track_one_mass", "");
    // its makers speak of a small term of even order, which has no name
    let even = ["spring of even order", "stiffer on one side"];
    assert!(names(&c).is_empty(), "{}", c["causes"]);
    assert!(c["verdict"] == "none" || even.iter().any(|like| says(&c, like)), "{}", c["remarks"]);
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
