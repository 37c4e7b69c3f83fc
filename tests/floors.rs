//! The table of floors in lib.rs holds: imports go down only, each outside crate has one door.

use crate::house::root;
use std::path::{Path, PathBuf};

fn floor(room: &str) -> u8 {
    match room {
        "burst" | "fault" | "verdict" | "labels" | "processor" => 0,
        "model" | "plot" | "score" => 1,
        "identify" | "detect" | "isolate" | "episodes" => 2,
        "design" | "critique" | "simulate" | "report" => 3,
        "pipeline" | "io" | "thesis" => 4,
        "main" | "cli" | "settings" => 5,
        "lib" => 9,
        other => panic!("room {other} has no floor: add it to lib.rs and here"),
    }
}

/// What a room may use of its own floor or above, beyond itself.
fn allowed(from: &str, to: &str) -> bool {
    from == to
        || floor(to) < floor(from)
        || (floor(from), floor(to)) == (0, 0) // nouns are made of nouns
        || (from, to) == ("pipeline", "io")
        // the stages read their settings; settings are the sum of the rooms' own
        || (from, to) == ("pipeline", "settings")
        || floor(from) == 5
        || from == "lib"
}

fn sources(dir: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(dir).unwrap().map(|e| e.unwrap().path()) {
        if entry.is_dir() {
            sources(&entry, found);
        } else if entry.extension().is_some_and(|e| e == "rs") {
            found.push(entry);
        }
    }
}

fn room_of(path: &Path) -> String {
    let below = path.strip_prefix(root().join("src")).unwrap();
    let first = below.components().next().unwrap().as_os_str().to_string_lossy().into_owned();
    first.trim_end_matches(".rs").to_owned()
}

#[test]
fn imports_go_down_only() {
    let mut files = Vec::new();
    sources(&root().join("src"), &mut files);
    assert!(files.len() > 30, "sources found");
    for file in files {
        let text = std::fs::read_to_string(&file).unwrap();
        let shipped = text.split("#[cfg(test)]").next().unwrap();
        let room = room_of(&file);
        for (i, _) in shipped.match_indices("crate::") {
            let to: String = shipped[i + 7..]
                .chars()
                .take_while(|c| c.is_ascii_lowercase() || *c == '_')
                .collect();
            if to.is_empty() || shipped[..i].ends_with("inkling::") {
                continue; // `use crate::{...}` is not the house's style
            }
            assert!(allowed(&room, &to), "{}: {room} may not use {to}", file.display());
        }
    }
}

#[test]
fn each_outside_crate_has_one_door() {
    let doors = [
        ("clap", &["cli"][..]),
        ("clap_complete", &["cli"]),
        ("clap_mangen", &["cli"]),
        ("indicatif", &["cli"]),
        ("ctrlc", &["cli"]),
        ("mcap", &["io"]),
        ("parquet", &["io"]),
        ("arrow_array", &["io"]),
        ("crossbeam_channel", &["pipeline"]),
        ("plotters", &["plot"]),
        ("png", &["plot"]),
        ("base64", &["plot", "io"]),
        ("object_store", &["io"]),
        ("tokio", &["io"]),
        ("clarabel", &["identify", "isolate", "detect"]),
    ];
    let mut files = Vec::new();
    sources(&root().join("src"), &mut files);
    for file in files {
        let text = std::fs::read_to_string(&file).unwrap();
        let room = room_of(&file);
        for (outside, rooms) in doors {
            let used = text.contains(&format!("use {outside}::"))
                || text.contains(&format!(" {outside}::"));
            assert!(
                !used || rooms.contains(&room.as_str()),
                "{}: {outside} is used outside {rooms:?}",
                file.display()
            );
        }
    }
}
