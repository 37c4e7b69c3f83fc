#!/usr/bin/env python3
"""How far each tuned number of the critique can be moved before an outcome of the tuning recordings changes.

    python3 tests/tuned.py [NAME ...] [--by 0.5 0.71 1.41 2] [--sets "400000 34 null" ...] [--build DIRECTORY]

The library is copied beside the target directory, its numbers (src/critique/tuned.rs) made to be read from the
environment there, and the tables of tests/foreign drawn with each of them moved. Numbers are moved together first and
one by one only where an outcome changes. Without names: all of them.
"""
import argparse, os, pathlib, re, shutil, subprocess, time

ROOT = pathlib.Path(__file__).resolve().parent.parent
SETS = ["400000 34 null", "500000 42 effects", "510000 10 outside"]
CONST = re.compile(r"pub const (\w+): (f64|usize) = ([^;]+);")


def prepared(copy):
    """A copy of the tree whose numbers are read from the environment; their names."""
    kept = [p for p in ROOT.iterdir() if p.name not in ("target", ".git")]
    for path in kept:
        to = copy / path.name
        if path.is_dir():
            shutil.copytree(path, to, dirs_exist_ok=True)
        else:
            shutil.copy2(path, to)
    room = copy / "src/critique"
    table = room / "tuned.rs"
    text = table.read_text()
    names = [m[0] for m in CONST.findall(text)]
    moved = lambda m: (
        f"pub static {m[1]}: std::sync::LazyLock<{m[2]}> = "
        f"std::sync::LazyLock::new(|| (({m[3]}) as f64 * factor(\"{m[1]}\")) as {m[2]});"
    )
    text = CONST.sub(moved, text)
    text += '\nfn factor(name: &str) -> f64 { std::env::var(name).map_or(1.0, |v| v.parse().unwrap()) }\n'
    table.write_text(text)
    word = re.compile(r"\b(" + "|".join(names) + r")\b")
    for path in room.rglob("*.rs"):
        if path != table:
            # names in lists of imports stay
            parts = re.split(r"(use [^;]+;|//[^\n]*)", path.read_text())
            parts[::2] = [word.sub(r"(*\1)", part) for part in parts[::2]]
            path.write_text("".join(parts))
    return names


def main():
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("names", nargs="*")
    words.add_argument("--by", nargs="+", type=float, default=[0.5, 0.71, 1.41, 2.0])
    words.add_argument("--sets", nargs="+", default=SETS)
    words.add_argument("--build", default=str(ROOT / "target"))
    asked = words.parse_args()
    copy = pathlib.Path(asked.build) / "tuned"
    names = asked.names or prepared(copy)
    if asked.names:
        prepared(copy)
    command = ["cargo", "test", "--release", "-p", "inkling-printhead", "-p", "inkling-fleet", "--features", "object-store"]
    environment = {**os.environ, "CARGO_TARGET_DIR": asked.build}
    found = subprocess.run([*command, "--test", "inkling", "--no-run"], cwd=copy, env=environment, capture_output=True, text=True)
    program = re.search(r"tests/main.rs \((.*?)\)", found.stderr)
    if not program:
        raise SystemExit(found.stderr)
    program = copy / program[1]

    def outcomes(by):
        """What is not right: recording and word."""
        lines = set()
        for some in asked.sets:
            here = {**environment, **{name: str(factor) for name, factor in by.items()}, "INKLING_FOREIGN": some}
            told = subprocess.run([program, "--ignored", "--nocapture", "foreign_table"], cwd=copy, env=here, capture_output=True, text=True)
            for line in told.stdout.splitlines():
                if m := re.match(r"(?:test .* )?(\w[\w ]*?) \w+ (\w+) x\S+ seed (\d+)", line):
                    lines.add((m[3], m[2], m[1]))
        return lines

    begun = time.time()
    as_it_is = outcomes({})
    print(f"as it is: {sorted(as_it_is)}, {time.time() - begun:.0f} s", flush=True)

    def search(some, factor):
        changed = outcomes({name: factor for name in some}) ^ as_it_is
        if changed and len(some) > 1:
            middle = len(some) // 2
            search(some[:middle], factor)
            search(some[middle:], factor)
        else:
            print(f"x {factor}: {' '.join(some)}: {sorted(changed) or 'nothing changes'}", flush=True)

    for factor in asked.by:
        search(names, factor)


main()
