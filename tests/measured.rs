//! Critique on real ring-downs: those in `tests/measured`, and those beside the project, which may not be copied into it.

use crate::house::{House, root};
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

/// Of all causes of this name, the strongest first.
fn values(c: &Value, id: &str) -> Vec<f64> {
    let causes = c["causes"].as_array().unwrap().iter();
    causes.filter(|c| c["id"] == id).map(|c| c["value"].as_f64().unwrap()).collect()
}

fn value(c: &Value, id: &str) -> f64 {
    values(c, id)[0]
}

/// Held-out misfit of the extended model, percent of the movement.
fn misses(c: &Value) -> f64 {
    c["gain"]["after"]["nrmse_percent"].as_f64().unwrap()
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
    // its half periods fall by a quarter, with the amplitude or with time: that is a tie at most
    assert!(c["verdict"] == "unknown" || c["verdict"] == "tie", "{}", c["sentence"]);
    assert!(names(&c).is_empty() || names(&c) == ["cubic_stiffness"], "{:?}", names(&c));
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
    let tones: Vec<f64> = values(&c, "tone");
    assert!(
        matches!(&tones[..], [p, q] if (p - 150.0).abs() < 0.5 && (q - 50.0).abs() < 0.5),
        "{tones:?}"
    );
    // a drag as small as a damping that changes with time may be told beside them
    let mut others = names(&c);
    others.retain(|name| *name != "tone" && *name != "quadratic_drag");
    assert_eq!(others, ["cubic_stiffness", "offset"]);
    assert!(says(&c, "still unexplained"), "{}", c["remarks"]);
}

#[test]
#[cfg_attr(not(measured), ignore = "no measured ring-downs in ../shared/measured")]
fn carts_and_beam_have_more_modes_and_offsets() {
    let [carts, beam] = ["air_track_two_masses", "beam_aluminium"].map(|name| shared(name, ""));
    for c in [&carts, &beam] {
        assert_eq!(c["verdict"], "named");
        assert!(names(c).iter().all(|name| ["offset", "second_mode"].contains(name)));
        assert_eq!(c["plant"]["onset_s"], 0.0);
        let modes = c["plant"]["modes"].as_array().unwrap().len();
        assert_eq!(modes, 1 + values(c, "second_mode").len());
    }
    assert_eq!(values(&carts, "second_mode").len(), 1);
    assert!((value(&carts, "second_mode") - 1.714).abs() < 0.01);
    assert!((value(&carts, "offset") - 63.0).abs() < 1.0 && misses(&carts) < 1.2);
    // 6.85 and 46 Hz and 130 Hz; others lie about these
    for hz in [45.9, 130.0] {
        assert!(values(&beam, "second_mode").iter().any(|f| (f - hz).abs() < 0.5), "{hz}");
    }
    assert!(misses(&beam) < 6.0 && says(&beam, "still unexplained"));
}

/// Swings that were let go after their records begin: a sine and dry friction from there on.
#[test]
#[cfg_attr(not(measured), ignore = "no measured ring-downs in ../shared/measured")]
fn swings_are_free_from_where_they_were_let_go() {
    for (degrees, onset_s, change) in [(45, 0.1..0.21, -0.07), (135, 0.30..0.40, -0.286)] {
        let c = shared(&format!("swing_{degrees}_degrees"), "");
        assert_eq!(c["verdict"], "named", "{degrees}: {}", c["sentence"]);
        let onset = c["plant"]["onset_s"].as_f64().unwrap();
        assert!(onset_s.contains(&onset), "{degrees}: {onset}");
        assert!(
            (value(&c, "cubic_stiffness") - change).abs() < 0.015 + 0.03 * f64::from(degrees > 90)
        );
        assert!(value(&c, "dry_friction") < 0.0 && misses(&c) < 1.6);
        let known = ["cubic_stiffness", "dry_friction", "offset"];
        assert!(names(&c).iter().all(|name| known.contains(name)), "{:?}", names(&c));
    }
}

/// Boards that are still driven while they are recorded: whatever fits them is no free decay, and has no name.
#[test]
#[cfg_attr(not(measured), ignore = "no measured ring-downs in ../shared/measured")]
fn boards_that_are_still_driven_have_no_names() {
    let c = shared("board_impacts", "--time time_s --burst decay --outputs acc1");
    assert_eq!(c["verdict"], "unknown");
    assert!(names(&c).is_empty(), "{:?}", names(&c));
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
