//! Compiles `schemas/*.proto` without an installed protoc, and keeps each FileDescriptorSet: recordings
//! carry it as their schema data. Says whether measured ring-downs lie beside the project: tests that want
//! them count as ignored where there are none.

use prost::Message as _;
use std::{env, error::Error, fs, path::PathBuf};

/// What recordings hold, and what annotations do: descriptors, a directory of generated code, sources.
const SETS: [(&str, &str, &[&str]); 2] = [
    ("burst.fds", "", &["burst.proto"]),
    (
        "annotations.fds",
        "annotations",
        &["channel_state.proto", "foxglove/Log.proto", "foxglove/CompressedImage.proto"],
    ),
];

/// Real ring-downs as tables, which may not be copied into the project.
const MEASURED: &str = "../shared/measured";

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rustc-check-cfg=cfg(measured)");
    if PathBuf::from(MEASURED).is_dir() {
        println!("cargo::rerun-if-changed={MEASURED}");
        println!("cargo::rustc-cfg=measured");
    }
    let out = PathBuf::from(env::var("OUT_DIR")?);
    for (name, dir, files) in SETS {
        files.iter().for_each(|file| println!("cargo::rerun-if-changed=schemas/{file}"));
        let paths: Vec<String> = files.iter().map(|file| format!("schemas/{file}")).collect();
        let descriptors = protox::compile(&paths, ["schemas"])?;
        fs::write(out.join(name), descriptors.encode_to_vec())?;
        let dir = out.join(dir);
        fs::create_dir_all(&dir)?;
        prost_build::Config::new()
            .bytes(["."]) // samples stay in the decompressed chunk, no copy per burst
            .out_dir(dir)
            .compile_fds(descriptors)?;
    }
    Ok(())
}
