//! `crates/inkling-io/src/wire` is what the compilers of `schemas/*.proto` make of them. It is kept beside the code, so that a build
//! needs neither them nor the forty crates that they stand on.
//!
//! `INKLING_WRITE_WIRE=1 cargo test --release wire_code` writes it anew after a schema has changed.

use prost::Message as _;
use std::path::Path;

/// The FileDescriptorSet that recordings carry as their schema data, its sources, and the code of each package.
type Set = (&'static str, &'static [&'static str], &'static [(&'static str, &'static str)]);

/// What recordings hold, and what annotations do.
const SETS: [Set; 2] = [
    ("burst.fds", &["burst.proto"], &[("inkling.rs", "burst.rs")]),
    (
        "annotations.fds",
        &["channel_state.proto", "foxglove/Log.proto", "foxglove/CompressedImage.proto"],
        &[("inkling.rs", "channel_state.rs"), ("foxglove.rs", "foxglove.rs")],
    ),
];

#[test]
fn wire_code_is_what_its_schemas_compile_to() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let wire = root.join("crates/inkling-io/src/wire");
    for (set, files, packages) in SETS {
        let paths = files.iter().map(|file| root.join("schemas").join(file));
        let descriptors = protox::compile(paths, [root.join("schemas")]).unwrap();
        let generated = tempfile::tempdir().unwrap();
        let mut of = vec![(set, descriptors.encode_to_vec())];
        prost_build::Config::new()
            .bytes(["."]) // samples stay in the decompressed chunk, no copy per burst
            // enumerations of which the code has its own
            .extern_path(".inkling.Burst.Format", "::inkling_core::burst::Format")
            .extern_path(".inkling.Burst.Layout", "::inkling_core::burst::Layout")
            .extern_path(".foxglove.Log.Level", "crate::annotation_writer::Level")
            .out_dir(generated.path())
            .compile_fds(descriptors)
            .unwrap();
        for (made, kept) in packages {
            of.push((kept, std::fs::read(generated.path().join(made)).unwrap()));
        }
        for (name, expected) in of {
            if std::env::var_os("INKLING_WRITE_WIRE").is_some() {
                std::fs::write(wire.join(name), &expected).unwrap();
            }
            let kept = std::fs::read(wire.join(name)).unwrap();
            let same = match name.ends_with(".rs") {
                true => code(&kept) == code(&expected),
                false => kept == expected,
            };
            assert!(same, "{name}: INKLING_WRITE_WIRE=1 cargo test --release wire_code");
        }
    }
}

/// Without comments and white space: whether the compiler breaks lines hangs on what else is built with it.
fn code(of: &[u8]) -> String {
    let text = String::from_utf8_lossy(of);
    let lines = text.lines().filter(|line| !line.trim_start().starts_with("//"));
    let dense: String = lines.flat_map(str::chars).filter(|c| !c.is_whitespace()).collect();
    dense.replace(",)", ")")
}
