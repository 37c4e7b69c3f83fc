//! The README's command blocks run as printed, in order, in what a clone has.

use crate::house::{House, root};
use std::path::Path;
use std::process::Command;

/// A fenced block of the README: what it is marked as, the line it begins at, its text.
struct Block {
    language: String,
    line: usize,
    text: String,
}

fn blocks(markdown: &str) -> Vec<Block> {
    let mut blocks: Vec<Block> = Vec::new();
    let mut is_open = false;
    for (at, line) in markdown.lines().enumerate() {
        match line.strip_prefix("```") {
            Some(_) if is_open => is_open = false,
            Some(language) => {
                is_open = true;
                blocks.push(Block { language: language.into(), line: at + 1, text: String::new() });
            }
            None if is_open => {
                let block = blocks.last_mut().expect("an open block");
                block.text += line;
                block.text.push('\n');
            }
            None => {}
        }
    }
    blocks
}

fn copied(from: &Path, to: &Path) {
    let status = Command::new("cp").arg("-r").arg(from).arg(to).status().expect("cp runs");
    assert!(status.success(), "{} copied", from.display());
}

/// `cargo run --release --` is the command under test; there is nothing else to build.
fn with_cargo(house: &House) -> String {
    let inkling = Path::new(env!("CARGO_BIN_EXE_inkling"));
    let script = "#!/bin/sh\n[ \"$1 $2 $3\" = 'run --release --' ] || exit 9\nshift 3\nexec inkling \"$@\"\n";
    let cargo = house.write("bin/cargo", script);
    let status = Command::new("chmod").arg("+x").arg(&cargo).status().expect("chmod runs");
    assert!(status.success());
    let shims = cargo.parent().expect("bin").display().to_string();
    let built = inkling.parent().expect("a directory").display().to_string();
    format!("{shims}:{built}:{}", std::env::var("PATH").unwrap_or_default())
}

/// One seed says that the command runs; what twenty say is measured, not tested.
fn with_one_seed(text: &str) -> String {
    let mut words: Vec<&str> = text.split(' ').collect();
    for at in 1..words.len() {
        if words[at - 1] == "--seeds" {
            words[at] = "1";
        }
    }
    words.join(" ")
}

#[test]
fn the_readmes_commands_run_as_printed_in_a_clone() {
    let house = House::new();
    for name in ["sample_logs", "pipeline.toml"] {
        copied(&root().join(name), &house.path(name));
    }
    let path = with_cargo(&house);
    let readme = std::fs::read_to_string(root().join("README.md")).expect("README.md");
    let mut run = 0;
    for block in blocks(&readme) {
        let (language, line) = (&block.language, block.line);
        if language != "sh" {
            let first = block.text.lines().next().unwrap_or_default().trim();
            println!("README.md:{line}: skipped, marked {language}: {first}");
            continue;
        }
        let text = with_one_seed(&block.text);
        if text != block.text {
            println!("README.md:{line}: with one seed");
        }
        let began = std::time::Instant::now();
        let ended = Command::new("sh")
            .args(["-e", "-c", &text])
            .current_dir(house.path("."))
            .env("PATH", &path)
            .output()
            .expect("sh runs");
        let said = String::from_utf8_lossy(&ended.stderr);
        println!("README.md:{line}: {:.1} s", began.elapsed().as_secs_f64());
        assert!(ended.status.success(), "README.md:{line}, {}:\n{text}\n{said}", ended.status);
        run += 1;
    }
    assert!(run >= 10, "only {run} blocks were found");
}
