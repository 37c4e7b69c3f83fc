//! The map in `src/lib.rs` is true: every room stands in it, and imports go down only, from floor to floor. Which crate may
//! use which, cargo knows.

use crate::house::{between, root, shipped};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// Where the sources of each crate are, and what it is called.
const CRATES: [(&str, &str); 4] = [
    ("src", "inkling"),
    ("crates/inkling-core/src", "inkling_core"),
    ("crates/inkling-io/src", "inkling_io"),
    ("crates/inkling-lab/src", "inkling_lab"),
];

/// The floor of each room, as the map has it: names two spaces apart, then what is in them.
fn floors() -> BTreeMap<String, u8> {
    let text = shipped("src/lib.rs");
    let table = between(&text, "# The rooms", "\n//!\n//! `docs/");
    let of_line = |line: &str| {
        let (floor, rooms) = line.strip_prefix("//! ")?.split_once("  ")?;
        let (floor, rooms) = (floor.parse().ok()?, rooms.split("   ").next()?);
        Some(rooms.split("  ").map(|room| (room.to_owned(), floor)).collect::<Vec<_>>())
    };
    table.lines().filter_map(of_line).flatten().collect()
}

/// The source files that are in rooms, each with its room: io is one, the other crates hold several.
fn sources() -> Vec<(String, PathBuf)> {
    let (mut found, mut dirs) = (Vec::new(), Vec::new());
    for (dir, name) in CRATES {
        let top = root().join(dir);
        dirs.push(top.clone());
        while let Some(dir) = dirs.pop() {
            for path in std::fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().path()) {
                let below = path.strip_prefix(&top).unwrap().with_extension("");
                let first = below.iter().next().unwrap().to_str().unwrap();
                let room = if name == "inkling_io" { "io" } else { first };
                if path.is_dir() {
                    dirs.push(path);
                } else if path.extension().is_some_and(|end| end == "rs") && room != "lib" {
                    found.push((room.to_owned(), path)); // no room: the face of a crate
                }
            }
        }
    }
    assert!(found.len() > 300, "sources found");
    found
}

/// What a room may use of its own floor or above, beyond itself.
fn may_use(floors: &BTreeMap<String, u8>, from: &str, to: &str) -> bool {
    let floor = |room: &str| *floors.get(room).unwrap_or_else(|| panic!("no room {room}"));
    from == to
        || floor(to) < floor(from)
        || (floor(from), floor(to)) == (0, 0) // nouns are made of nouns
        || floor(from) == 5
        // the stages read their settings; settings are the sum of the rooms' own
        || (from, to) == ("pipeline", "io") || (from, to) == ("pipeline", "settings")
}

#[test]
fn every_room_stands_in_the_map_and_imports_go_down_only() {
    let (floors, sources) = (floors(), sources());
    let rooms: BTreeSet<&String> = sources.iter().map(|(room, _)| room).collect();
    assert_eq!(rooms, floors.keys().collect());
    for (from, path) in &sources {
        let text = std::fs::read_to_string(path).unwrap();
        for name in CRATES.map(|(_, name)| name).into_iter().chain(["crate"]) {
            let is_io = name == "inkling_io" || (name == "crate" && from == "io");
            for after in text.split(&format!("{name}::")).skip(1) {
                let end = after.find(|c: char| !c.is_ascii_lowercase() && c != '_');
                let to = if is_io { "io" } else { &after[..end.unwrap_or(0)] };
                // `crate::{...}` is not the house's style
                let is_right = to.is_empty() || may_use(&floors, from, to);
                assert!(is_right, "{}: {from} may not use {to}", path.display());
            }
        }
    }
}
