//! Says whether measured ring-downs lie beside the project: tests that want them count as ignored where there are none.

use std::path::Path;

/// Real ring-downs as tables, which may not be copied into the project.
const MEASURED: &str = "../shared/measured";

fn main() {
    println!("cargo::rustc-check-cfg=cfg(measured)");
    if Path::new(MEASURED).is_dir() {
        println!("cargo::rerun-if-changed={MEASURED}");
        println!("cargo::rustc-cfg=measured");
    }
}
