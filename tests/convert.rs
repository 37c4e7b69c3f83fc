//! `convert` gives each acquisition of a table the values beside its own rows.

use crate::house::House;
use crate::recorded::bursts;
use std::fmt::Write as _;

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
