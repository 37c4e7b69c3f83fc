//! Critique on real ring-downs beside the project (they may not be copied into it).

use crate::house::{House, root};
use serde_json::Value;

fn critique(name: &str, options: &str) -> Value {
    let measured = root().join("../shared/measured");
    let house = House::new();
    let table = measured.join(format!("{name}.csv"));
    house.ok(&format!("convert {} {options} -o r.mcap", table.display()));
    house.ok("critique r.mcap --plant oscillator -o c");
    let text = std::fs::read_to_string(house.path("c/critique.json")).unwrap();
    serde_json::from_str(&text).unwrap()
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
#[cfg_attr(not(measured), ignore = "no measured ring-downs in ../shared/measured")]
fn pendulums_have_a_sine_for_a_spring_and_the_bob_meets_drag() {
    let pendulum = critique("pendulum", "--resample");
    assert_eq!(pendulum["verdict"], "named");
    // what else may be said is the camera's zero
    assert!(matches!(&names(&pendulum)[..], ["cubic_stiffness"] | ["cubic_stiffness", "offset"]));
    assert!((-0.16..-0.10).contains(&value(&pendulum, "cubic_stiffness")));
    assert!(left(&pendulum) < 0.1);
    let bob = critique("pendulum_wooden_bob", "");
    assert_eq!(bob["verdict"], "named");
    assert_eq!(names(&bob), ["cubic_stiffness", "offset", "quadratic_drag"]);
    assert!(value(&bob, "quadratic_drag") > 0.0 && left(&bob) < 0.2);
}

#[test]
#[cfg_attr(not(measured), ignore = "no measured ring-downs in ../shared/measured")]
fn silverbox_stiffens_and_the_leak_stays_unexplained() {
    let options = "--time time_s --outputs output_v --burst gap";
    let c = critique("silverbox_free_decays", options);
    assert_eq!(c["verdict"], "named");
    // the constant part of the leaking input is an offset
    assert_eq!(names(&c), ["cubic_stiffness", "offset"]);
    assert!(value(&c, "cubic_stiffness") > 0.0);
    assert!(says(&c, "still unexplained"), "{}", c["remarks"]);
}

#[test]
#[cfg_attr(not(measured), ignore = "no measured ring-downs in ../shared/measured")]
fn carts_and_beam_have_more_modes_and_offsets() {
    let carts = critique("air_track_two_masses", "");
    assert_eq!(
        (carts["verdict"].as_str(), names(&carts)),
        (Some("named"), vec!["offset", "second_mode"])
    );
    assert!((value(&carts, "second_mode") - 1.714).abs() < 0.01);
    assert!((value(&carts, "offset") - 63.0).abs() < 1.0 && left(&carts) < 0.02);
    let beam = critique("beam_aluminium", "");
    assert_eq!(
        (beam["verdict"].as_str(), names(&beam)),
        (Some("named"), vec!["offset", "second_mode"])
    );
    assert!(left(&beam) < 0.15 && says(&beam, "still unexplained"));
}

#[test]
#[cfg_attr(not(measured), ignore = "no measured ring-downs in ../shared/measured")]
fn one_cart_is_close_to_linear() {
    let c = critique("air_track_one_mass", "");
    // its makers speak of a small term of even order, which has no name
    let even = ["spring of even order", "stiffer on one side"];
    assert!(names(&c).is_empty(), "{}", c["causes"]);
    assert!(c["verdict"] == "none" || even.iter().any(|like| says(&c, like)), "{}", c["remarks"]);
}
