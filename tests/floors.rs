//! The table of floors in lib.rs holds: imports go down only, inside rooms too; each outside crate has one
//! door.

use crate::house::root;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

fn floor(room: &str) -> u8 {
    match room {
        "burst" | "fault" | "verdict" | "labels" | "promise" => 0,
        "numbers" | "processor" | "ranges" | "side_by_side" => 0,
        "model" | "plot" | "score" => 1,
        "identify" | "detect" | "isolate" | "episodes" | "state" => 2,
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

/// Where the sources of each crate are, and what it is called. Which crate may use which, cargo knows.
const CRATES: [(&str, &str); 4] = [
    ("src", "inkling"),
    ("crates/inkling-core/src", "inkling_core"),
    ("crates/inkling-io/src", "inkling_io"),
    ("crates/inkling-lab/src", "inkling_lab"),
];

/// Where a path into a crate begins: io is one room, the others hold rooms.
fn face(name: &str) -> Vec<String> {
    if name == "inkling_io" { vec!["io".to_owned()] } else { Vec::new() }
}

/// The crate that a path begins with, `from` a module, and where that leads; `None`: no crate of ours.
fn crate_of(first: &str, from: &[String]) -> Option<Vec<String>> {
    let in_io = from.first().is_some_and(|room| room == "io");
    match first {
        "crate" if in_io => Some(face("inkling_io")),
        "crate" => Some(Vec::new()),
        _ => CRATES.iter().any(|(_, name)| *name == first).then(|| face(first)),
    }
}

/// A source file.
struct Source {
    path: PathBuf,
    text: String,
    /// Its room and its path in there; nothing for the face of a crate that holds rooms.
    module: Vec<String>,
}

impl Source {
    fn room(&self) -> &str {
        self.module.first().map_or("lib", |room| room)
    }
}

/// All sources, in the order of their names.
fn all() -> Vec<Source> {
    let mut all = Vec::new();
    for (dir, name) in CRATES {
        let dir = root().join(dir);
        let mut files = Vec::new();
        sources(&dir, &mut files);
        files.sort();
        all.extend(files.into_iter().map(|path| {
            let below = path.strip_prefix(&dir).unwrap().with_extension("");
            let parts = below.iter().map(|part| part.to_str().unwrap().to_owned());
            let below = parts.filter(|part| !["mod", "lib"].contains(&part.as_str()));
            let module = face(name).into_iter().chain(below).collect();
            let text = std::fs::read_to_string(&path).unwrap();
            Source { path, text, module }
        }));
    }
    assert!(all.len() > 300, "sources found");
    all
}

/// Whole files: tests too.
#[test]
fn imports_go_down_only() {
    let mut between = 0;
    for file in all() {
        for name in CRATES.iter().map(|(_, name)| *name).chain(["crate"]) {
            let at = crate_of(name, &file.module).unwrap();
            for (i, start) in file.text.match_indices(&format!("{name}::")) {
                let below = file.text[i + start.len()..].chars();
                let first = below.take_while(|c| c.is_ascii_lowercase() || *c == '_');
                let to = at.first().cloned().unwrap_or_else(|| first.collect());
                if to.is_empty() {
                    continue; // `use crate::{...}` is not the house's style
                }
                let (from, path) = (file.room(), file.path.display());
                assert!(allowed(from, &to), "{path}: {from} may not use {to}");
                between += usize::from(name != "crate");
            }
        }
    }
    assert!(between > 300, "{between} paths between crates");
}

/// A module by its path, and its source.
type Modules = BTreeMap<Vec<String>, String>;

#[test]
fn no_file_imports_what_imports_it() {
    let mut modules = Modules::new();
    for file in all() {
        if !["lib", "main"].contains(&file.room()) {
            modules.insert(file.module, shipped(&file.text));
        }
    }
    let arrows = arrows(&modules);
    let drawn: usize = arrows.values().map(BTreeSet::len).sum();
    assert!(drawn > 2 * modules.len(), "{drawn} arrows between {} files", modules.len());
    assert_eq!(circles(arrows), Vec::<String>::new());
}

#[test]
fn a_circle_is_seen_through_faces_and_trees() {
    let circles_of = |sources: &[(&str, &str)]| {
        let path = |name: &str| name.split('/').map(str::to_owned).collect();
        circles(arrows(&sources.iter().map(|(name, text)| (path(name), shipped(text))).collect()))
    };
    let face = ("a", "mod b;\nmod c;\npub use c::Thing;\n");
    let open = [face, ("a/b", "use super::Thing;\n"), ("a/c", "use crate::d::{self, e};\n")];
    assert_eq!(circles_of(&open), Vec::<String>::new());
    let closed = [face, open[1], ("a/c", "use crate::{\n    x,\n    a::b::{E, F as G},\n};\n")];
    assert_eq!(circles_of(&closed), ["a/b -> a/c", "a/c -> a/b"]);
    let inline = [face, open[1], ("a/c", "fn f() {\n    super::b::g()\n}\n")];
    assert_eq!(circles_of(&inline), ["a/b -> a/c", "a/c -> a/b"]);
    let tested =
        [face, open[1], ("a/c", "#[cfg(test)]\nmod tests {\n    use super::super::b;\n}\n")];
    assert_eq!(circles_of(&tested), Vec::<String>::new());
    let after = [face, open[1], ("a/c", "#[cfg(test)]\nfn t() {\n}\nuse super::b::g;\n")];
    assert_eq!(circles_of(&after), ["a/b -> a/c", "a/c -> a/b"]);
    let own = [("a", "mod b;\npub use b::B;\npub struct A(B);\n"), ("a/b", "use super::A;\n")];
    assert_eq!(circles_of(&own), ["a -> a/b", "a/b -> a"]);
}

/// A source without comments and without what is compiled for tests alone, wherever that stands.
fn shipped(text: &str) -> String {
    let mut kept = String::new();
    let mut lines = text.lines().map(|line| line.split("//").next().unwrap().trim_end());
    while let Some(line) = lines.next() {
        if line.trim_start() != "#[cfg(test)]" {
            kept += line;
            kept.push('\n');
            continue;
        }
        // as rustfmt writes it, an item ends on its first line or where its indentation comes back
        let end = format!("{}}}", &line[..line.len() - line.trim_start().len()]);
        let mut item = lines.by_ref().skip_while(|line| line.trim_start().starts_with("#["));
        if item.next().is_some_and(|first| !first.ends_with(';')) {
            item.find(|line| *line == end);
        }
    }
    kept
}

/// Which files each file takes names from.
fn arrows(modules: &Modules) -> BTreeMap<Vec<String>, BTreeSet<Vec<String>>> {
    let mut handed_on: BTreeMap<&Vec<String>, BTreeMap<String, String>> = BTreeMap::new();
    let mut names: Vec<(&Vec<String>, String)> = Vec::new();
    for (module, text) in modules {
        let (uses, rest) = uses_and_rest(text);
        for (public, path) in uses {
            let name = path.rsplit("::").next().unwrap().to_owned();
            // a face that hands on a child's name does not use it, unless it says the name again
            let type_again = name.starts_with(|c: char| c.is_ascii_uppercase())
                && words(&rest).any(|word| word.split("::").next() == Some(&name));
            let of_child = modules.contains_key(&child(module, path.split("::").next().unwrap()));
            if !(public && of_child) || type_again {
                names.push((module, path.clone()));
            }
            if public {
                handed_on.entry(module).or_default().insert(name, path);
            }
        }
        let paths = words(&rest).filter(|word| word.contains("::"));
        names.extend(paths.map(|path| (module, path.to_owned())));
    }
    let mut arrows: BTreeMap<Vec<String>, BTreeSet<Vec<String>>> = BTreeMap::new();
    for (from, path) in names {
        let mut to = place(modules, from, &path);
        // through faces to where the name stands
        for _ in 0..4 {
            let Some((at, name)) = &to else { break };
            let Some(path) = handed_on.get(at).and_then(|names| names.get(name)) else { break };
            to = place(modules, at, path).or(to);
        }
        if let Some((to, _)) = to.filter(|(to, _)| to != from && modules.contains_key(to)) {
            arrows.entry(from.clone()).or_default().insert(to);
        }
    }
    arrows
}

/// Names and paths in a text.
fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':'))
        .map(|w| w.trim_matches(':'))
}

fn child(module: &[String], name: &str) -> Vec<String> {
    module.iter().cloned().chain([name.to_owned()]).collect()
}

/// The module that a path leads to, and the first name in it; `None`: nothing of this crate.
fn place(modules: &Modules, from: &[String], path: &str) -> Option<(Vec<String>, String)> {
    let mut at = from.to_vec();
    let mut parts = path.split("::").peekable();
    let first = *parts.peek()?;
    match crate_of(first, from) {
        Some(of_crate) => {
            parts.next();
            at = of_crate;
        }
        None if ["self", "super"].contains(&first) => {}
        None if modules.contains_key(&child(from, first)) => {}
        None => return None,
    }
    while let Some(step) = parts.next_if(|part| ["self", "super"].contains(part)) {
        if step == "super" {
            at.pop();
        }
    }
    while let Some(name) = parts.next_if(|part| modules.contains_key(&child(&at, part))) {
        at.push(name.to_owned());
    }
    Some((at, parts.next().unwrap_or_default().to_owned()))
}

/// Every path of every `use`, and whether it is public; and the text without them.
fn uses_and_rest(text: &str) -> (Vec<(bool, String)>, String) {
    let (mut uses, mut rest) = (Vec::new(), String::new());
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        let statement = line.trim_start();
        // a line of a text may begin with that word too
        let is_path = |tree: &str| {
            let head = tree.split(['{', ';']).next().unwrap().replace(" as ", "");
            !head.is_empty() && !head.contains(' ')
        };
        let (public, tree) = match statement.split_once("use ") {
            Some(("", tree)) if is_path(tree) => (false, tree),
            Some((before, tree)) if before.starts_with("pub") && is_path(tree) => (true, tree),
            _ => {
                rest += line;
                rest.push('\n');
                continue;
            }
        };
        let mut tree = tree.to_owned();
        while !tree.contains(';') {
            tree += lines.next().expect("a use ends");
        }
        let mut paths = Vec::new();
        expand("", tree.split(';').next().unwrap(), &mut paths);
        uses.extend(paths.into_iter().map(|path| (public, path)));
    }
    (uses, rest)
}

/// `a::{b, c::d as e}` to `a::b` and `a::c::d`.
fn expand(before: &str, tree: &str, paths: &mut Vec<String>) {
    let tree = tree.trim();
    let Some((head, inner)) = tree.split_once('{') else {
        let path = tree.split(" as ").next().unwrap().trim_end_matches("::self");
        if !path.is_empty() {
            paths.push(format!("{before}{path}"));
        }
        return;
    };
    let inner = inner.strip_suffix('}').unwrap_or_else(|| panic!("{tree} closes"));
    let (mut depth, mut from) = (0, 0);
    for (i, c) in inner.char_indices().chain([(inner.len(), ',')]) {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                expand(&format!("{before}{head}"), &inner[from..i], paths);
                from = i + 1;
            }
            _ => {}
        }
    }
}

/// The arrows that lie on circles, or between two.
fn circles(mut arrows: BTreeMap<Vec<String>, BTreeSet<Vec<String>>>) -> Vec<String> {
    loop {
        let before: usize = arrows.values().map(BTreeSet::len).sum();
        let from: BTreeSet<_> = arrows.keys().cloned().collect();
        let to: BTreeSet<_> = arrows.values().flatten().cloned().collect();
        arrows.retain(|module, _| to.contains(module));
        arrows.values_mut().for_each(|names| names.retain(|name| from.contains(name)));
        arrows.retain(|_, names| !names.is_empty());
        if arrows.values().map(BTreeSet::len).sum::<usize>() == before {
            break;
        }
    }
    let drawn = |(from, to): (&Vec<String>, &Vec<String>)| {
        format!("{} -> {}", from.join("/"), to.join("/"))
    };
    arrows.iter().flat_map(|(from, to)| to.iter().map(move |to| (from, to))).map(drawn).collect()
}

#[test]
fn each_outside_crate_has_one_door() {
    let doors = [
        ("clap", &["cli"][..]),
        ("clap_complete", &["cli"]),
        ("clap_mangen", &["cli"]),
        ("indicatif", &["cli"]),
        ("signal_hook", &["cli"]),
        ("mcap", &["io"]),
        ("parquet", &["io"]),
        ("arrow_array", &["io"]),
        ("crossbeam_channel", &["pipeline"]),
        ("plotters", &["plot"]),
        ("png", &["plot"]),
        ("base64", &["plot", "io"]),
        ("object_store", &["io"]),
        ("tokio", &["io"]),
        ("clarabel", &["model", "isolate"]),
    ];
    for file in all() {
        for (outside, rooms) in doors {
            let used = file.text.contains(&format!("use {outside}::"))
                || file.text.contains(&format!(" {outside}::"));
            assert!(
                !used || rooms.contains(&file.room()),
                "{}: {outside} is used outside {rooms:?}",
                file.path.display()
            );
        }
    }
}
