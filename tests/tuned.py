#!/usr/bin/env python3
"""How far each tuned number of the critique can be moved before an outcome of the tuning recordings changes.

    python3 tests/tuned.py [NAME ...] [--by 0.5 2] [--sets "400000 34 null" ...]

A crate of the critique alone is made in target/tuned, where its numbers (src/critique/tuned.rs) are multiplied by what
the environment says, and the tables of tests/foreign are drawn with them moved: all together first, and by halves
where an outcome changes. Without names: all. A factor of 0 shows what happens without a rule.
"""
import argparse, os, pathlib, re, shutil, subprocess, time

ROOT = pathlib.Path(__file__).resolve().parent.parent
CRATE = ROOT / "target/tuned"
SETS = ["400000 34 null", "500000 42 effects", "510000 10 outside"]
NUMBER = re.compile(r"pub const (\w+): (f64|usize) = ([^;]+);")
MODULES = ["processor.rs", "burst.rs", "fault.rs", "model", "critique"]
NEEDED = "nalgebra rand rand_chacha rand_distr serde serde_json thiserror bytes xxhash-rust".split()


def crate():
    """Writes the crate; names of the numbers in it."""
    source = CRATE / "src"
    shutil.rmtree(source, ignore_errors=True)
    (source / "score").mkdir(parents=True)
    for name in MODULES:
        copy = shutil.copytree if (ROOT / "src" / name).is_dir() else shutil.copy
        copy(ROOT / "src" / name, source / name)
    shutil.copy(ROOT / "src/score/blind.rs", source / "score")
    shutil.copytree(ROOT / "tests/foreign", source / "foreign")
    modules = "".join(f"pub mod {name.removesuffix('.rs')};\n" for name in MODULES)
    (source / "lib.rs").write_text(f"#![allow(unused)]\n{modules}pub mod score {{ pub mod blind; }}\n")
    (source / "main.rs").write_text("#[cfg(test)]\nmod foreign;\nfn main() {}\n")
    of_report = re.compile(r"^(pub )?mod report(_tests)?;\n", re.M)
    room = source / "critique/mod.rs"
    room.write_text(of_report.sub("", room.read_text()))
    lines = (ROOT / "Cargo.toml").read_text().splitlines()
    needed = [next(line for line in lines if re.match(rf"{name} = ", line)) for name in NEEDED]
    package = '[package]\nname = "tuned"\nversion = "0.1.0"\nedition = "2024"\n[lib]\nname = "inkling"\n'
    rest = "\n[workspace]\n[profile.release]\nopt-level = 2\nincremental = true\n"
    (CRATE / "Cargo.toml").write_text(package + "[dependencies]\n" + "\n".join(needed) + rest)
    shutil.copy(ROOT / "Cargo.lock", CRATE)
    return movable(source / "critique")


def movable(room):
    table = room / "tuned.rs"
    text = table.read_text()
    names = [m[0] for m in NUMBER.findall(text)]
    moved = (
        r"pub static \1: std::sync::LazyLock<\2> = "
        r'std::sync::LazyLock::new(|| ((\3) as f64 * factor("\1")) as \2);'
    )
    factor = "fn factor(name: &str) -> f64 { std::env::var(name).map_or(1.0, |v| v.parse().unwrap()) }\n"
    table.write_text(NUMBER.sub(moved, text) + factor)
    word = re.compile(r"\b(" + "|".join(names) + r")\b")
    for path in room.rglob("*.rs"):
        if path != table:
            # imports and comments stay
            parts = re.split(r"(use [^;]+;|//[^\n]*)", path.read_text())
            parts[::2] = [word.sub(r"(*\1)", part) for part in parts[::2]]
            path.write_text("".join(parts))
    return names


def outcomes(program, sets, by):
    """What is not right: recording, effect and word."""
    lines = set()
    for some in sets:
        moved = {name: str(factor) for name, factor in by.items()}
        told = subprocess.run(
            [program, "--ignored", "--nocapture", "foreign_table"],
            env={**os.environ, **moved, "INKLING_FOREIGN": some}, capture_output=True, text=True,
        )
        found = re.findall(r"^(\w[\w ]*?) [A-Z]\w+ (\w+) x\S+ seed (\d+)", told.stdout, re.M)
        lines.update((int(seed), effect, word) for word, effect, seed in found)
        if told.returncode:
            lines.add((0, "", "panic"))
    return lines


def main():
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("names", nargs="*")
    words.add_argument("--by", nargs="+", type=float, default=[0.5, 2.0])
    words.add_argument("--sets", nargs="+", default=SETS)
    asked = words.parse_args()
    names = crate()
    build = ["cargo", "test", "--release", "--bin", "tuned", "--no-run"]
    built = subprocess.run(build, cwd=CRATE, capture_output=True, text=True)
    program = re.search(r"src/main.rs \((.*?)\)", built.stderr)
    if not program:
        raise SystemExit(built.stderr)
    program = shutil.copy(CRATE / program[1], CRATE / "program")
    begun = time.time()
    as_it_is = outcomes(program, asked.sets, {})
    print(f"as it is: {sorted(as_it_is)}, {time.time() - begun:.0f} s", flush=True)

    def search(some, factor):
        changed = outcomes(program, asked.sets, {name: factor for name in some}) ^ as_it_is
        if changed and len(some) > 1:
            middle = len(some) // 2
            search(some[:middle], factor)
            search(some[middle:], factor)
        else:
            print(f"x {factor:g} {' '.join(some)}: {sorted(changed) or 'nothing changes'}", flush=True)

    for factor in asked.by:
        search(asked.names or names, factor)


main()
