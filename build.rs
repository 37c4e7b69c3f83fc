//! Compiles `schemas/burst.proto` without an installed protoc, and keeps its FileDescriptorSet:
//! recordings carry it as their schema data.

use prost::Message as _;
use std::{env, error::Error, fs, path::PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=schemas/burst.proto");
    let descriptors = protox::compile(["schemas/burst.proto"], ["schemas"])?;
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::write(out.join("burst.fds"), descriptors.encode_to_vec())?;
    prost_build::Config::new()
        .bytes(["."]) // samples stay in the decompressed chunk, no copy per burst
        .compile_fds(descriptors)?;
    Ok(())
}
