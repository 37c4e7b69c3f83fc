//! The README, CONTRIBUTING.md and the book in docs/: their commands run as printed, in what a clone has, and their links
//! and paths lead to what is there.

use crate::house::{House, root, shipped};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The pages whose blocks marked `sh` run, in their order, each page in a fresh copy of what a clone has. Blocks that
/// need more than that are marked otherwise there.
const RUN: [&str; 10] = [
    "README.md",
    "docs/first_ten_minutes.md",
    "docs/your_recordings.md",
    "docs/labels.md",
    "docs/every_night.md",
    "docs/report.md",
    "docs/live.md",
    "docs/formats.md",
    "docs/critique.md",
    "docs/design/measured.md",
];

/// A fenced block of a page: what it is marked as, the line it begins at, its text.
struct Block {
    language: String,
    line: usize,
    text: String,
}

/// A line of a page that is in no fenced block.
struct Line<'a> {
    number: usize,
    text: &'a str,
}

/// A page taken apart.
#[derive(Default)]
struct Page<'a> {
    blocks: Vec<Block>,
    lines: Vec<Line<'a>>,
}

fn parts(markdown: &str) -> Page<'_> {
    let mut page = Page::default();
    let mut is_open = false;
    for (at, text) in markdown.lines().enumerate() {
        match text.strip_prefix("```") {
            Some(_) if is_open => is_open = false,
            Some(language) => {
                is_open = true;
                let block = Block { language: language.into(), line: at + 1, text: String::new() };
                page.blocks.push(block);
            }
            None if is_open => {
                let block = page.blocks.last_mut().expect("an open block");
                block.text += text;
                block.text.push('\n');
            }
            None => page.lines.push(Line { number: at + 1, text }),
        }
    }
    page
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

/// Runs the page's blocks in a fresh copy of what a clone has, and says how many there were.
fn run(page: &str) -> usize {
    let house = House::new();
    for name in ["sample_logs", "pipeline.toml"] {
        copied(&root().join(name), &house.path(name));
    }
    let path = with_cargo(&house);
    let (mut run, mut forms) = (0, BTreeSet::new());
    for Block { language, line, text } in parts(&shipped(page)).blocks {
        if language != "sh" {
            let first = text.lines().next().unwrap_or_default().trim();
            println!("{page}:{line}: skipped, marked {language}: {first}");
            continue;
        }
        let text = with_one_seed(&text);
        let form: String = text.lines().filter_map(|line| line.split(" #").next()).collect();
        if !forms.insert(form.replace(|c: char| c.is_ascii_digit(), "").trim_end().to_owned()) {
            println!("{page}:{line}: an earlier command with other numbers");
            continue;
        }
        let began = std::time::Instant::now();
        let ended = Command::new("sh")
            .args(["-e", "-c", &text])
            .current_dir(house.path("."))
            .env("PATH", &path)
            .output()
            .expect("sh runs");
        let said = String::from_utf8_lossy(&ended.stderr);
        println!("{page}:{line}: {:.1} s", began.elapsed().as_secs_f64());
        assert!(ended.status.success(), "{page}:{line}, {}:\n{text}\n{said}", ended.status);
        run += 1;
    }
    run
}

#[test]
fn commands_of_readme_and_book_run_as_printed_in_a_clone() {
    let blocks = RUN.map(|page| (page, run(page)));
    assert!(blocks.iter().all(|(_, run)| *run > 0), "a page without commands: {blocks:?}");
}

/// The paths below `docs/` of the book's pages, without the table of contents.
fn pages_of_book() -> Vec<String> {
    let of = |below: &str| -> Vec<String> {
        let files = std::fs::read_dir(root().join("docs").join(below)).expect("a directory");
        let names =
            files.map(|file| file.expect("an entry").file_name().into_string().expect("UTF-8"));
        let pages = names.filter(|name| name.ends_with(".md") && name != "SUMMARY.md");
        pages.map(|name| format!("{below}{name}")).collect()
    };
    let mut pages = of("");
    pages.extend(of("design/"));
    pages.sort();
    pages
}

/// A link or image: the line it is in, where it leads.
struct Link<'a> {
    line: usize,
    target: &'a str,
}

/// Links and images of a page, but for those to other sites.
fn links<'a>(page: &Page<'a>) -> Vec<Link<'a>> {
    let mut links = Vec::new();
    for &Line { number, text } in &page.lines {
        for after in text.split("](").skip(1) {
            let target = after.split(')').next().unwrap_or_default();
            if !target.contains("://") {
                links.push(Link { line: number, target });
            }
        }
    }
    links
}

/// What a heading is called in a link to it.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().to_lowercase();
    let kept = kept.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

fn anchors(markdown: &str) -> Vec<String> {
    let page = parts(markdown);
    let headings = page.lines.iter().filter(|line| line.text.starts_with('#'));
    headings.map(|line| anchor(line.text.trim_start_matches('#'))).collect()
}

#[test]
fn every_link_of_readme_and_book_leads_somewhere() {
    let mut pages =
        vec!["README.md".to_owned(), "CONTRIBUTING.md".into(), "docs/SUMMARY.md".into()];
    pages.extend(pages_of_book().iter().map(|page| format!("docs/{page}")));
    let mut followed = 0;
    for page in &pages {
        let text = shipped(page);
        for Link { line, target } in links(&parts(&text)) {
            let (path, heading) = target.split_once('#').unwrap_or((target, ""));
            let beside = root().join(page);
            let directory = beside.parent().expect("a directory");
            let file: PathBuf = if path.is_empty() { beside.clone() } else { directory.join(path) };
            assert!(file.exists(), "{page}:{line}: there is no {target}");
            if !heading.is_empty() {
                let there = std::fs::read_to_string(&file).expect("a page");
                let known = anchors(&there);
                assert!(known.iter().any(|a| a == heading), "{page}:{line}: {target}: {known:?}");
            }
            followed += 1;
        }
    }
    assert!(followed > 100, "only {followed} links were found");
}

#[test]
fn the_books_contents_list_every_page_once() {
    let contents = shipped("docs/SUMMARY.md");
    let mut listed: Vec<String> =
        links(&parts(&contents)).iter().map(|link| link.target.to_owned()).collect();
    listed.sort();
    assert_eq!(listed, pages_of_book());
}

#[test]
fn every_path_that_contributors_are_sent_to_exists() {
    let text = shipped("CONTRIBUTING.md");
    let words = text.split(|c: char| c.is_whitespace() || "`()[],;:".contains(c));
    let folders = ["crates/", "src/", "tests/", "schemas/", "docs/", "benches/"];
    let mut found = 0;
    for path in words.map(|word| word.trim_end_matches('.')) {
        if folders.iter().any(|folder| path.starts_with(folder)) {
            assert!(root().join(path).exists(), "CONTRIBUTING.md: there is no {path}");
            found += 1;
        }
    }
    assert!(found > 30, "only {found} paths were found");
}
