#!/usr/bin/env python3
"""What half and twice of the numbers that nobody derived do, from outside: each is changed in the whole product, from training on.

    cargo build --release --features ablation
    python3 tests/outside/prices.py --inkling target/release/inkling [--of isolate] [--jobs 2] [--seed 7]

The numbers are those of every table (`numbers!`) in the rooms. A row is printed for each: half / twice of it, and the figures that
change; `-`: it is as before. What is measured, by designs of labels (L) and of healthy labels alone (C), all on one seed:

named    share of signals of the nine classes that are named at a certainty of .8, and of these right (foreign.py)
foreign  of signals that are of no class, the share that is named all the same
few      as `named`, by designs of three and ten labels of six classes, by the thesis's names and by own ones
sized    named right and sized, of 3,600, and the share of 95 % intervals that hold the truth, the worst of three worlds (sizes.py)
false    false alarms on healthy signals over the stated rate, and slight faults found, by the design and by windows (run.py 1 4)"""
import argparse, concurrent.futures, json, os, pathlib, re, shutil, subprocess, sys
HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import numpy as np
import run as O
from rec import CACHE


def numbers(of):
    """table::name of all that start so, of tables as they stand in the source"""
    found = []
    for path in sorted((HERE / "../../crates").resolve().glob("*/src/**/*.rs")):
        text = path.read_text()
        if table := re.search(r"^ *(?:crate|inkling_core)::numbers! \{(.*?)^ *\}", text, re.M | re.S):
            name = "numbers::tuned" if path.stem == "numbers" else f"{path.parent.name}::{path.stem}"
            found += [f"{name}::{n}" for n in re.findall(r"^ +(\w+)(?:: [^=]+)? = ", table[1], re.M)]
    return [n for n in found if n.startswith(of)]


def measured(a, changed):
    """figures by name, where a number is changed (\"table::name=times\")"""
    env = {**os.environ, "INKLING_NUMBER": changed}

    def said(script, *args):
        run = [sys.executable, HERE / script, *args, "--inkling", a.inkling, "--seed", str(a.seed)]
        done = subprocess.run(list(map(str, run)), env=env, capture_output=True, text=True)
        return done.stdout.splitlines() if done.returncode == 0 else []

    cell = lambda row, k: row[20 + 50 * k:70 + 50 * k].split()
    all_classes = lambda rows, k: next((cell(r, k) for r in rows if r.startswith("all classes")), ["fails"] * 2)
    figures = {}
    rows = said("foreign.py", "--modes", "labels,cold")
    known = ["all classes", *(k for k, *_ in O.CLASSES)]
    for k, design in enumerate("LC"):
        figures[f"named {design}"], figures[f"right {design}"] = all_classes(rows, k)[:2]
        other = [float(cell(r, k)[0]) for r in rows[2:] if r[:20].strip() not in known]
        figures[f"foreign {design}"] = f"{np.mean(other):.3f}" if other else "fails"
    if "few" not in a.without:
        rows = said("foreign.py", "--few")
        for k, design in enumerate(("3", "10", "3 own", "10 own")):
            figures[f"few {design}"] = " ".join(all_classes(rows, k)[:2])
    if "sizes" not in a.without:
        rows = [re.findall(r"sized (\d+) hold ([.\d]+|nan)", r) for r in said("sizes.py", "--white")[1:]]
        for k, design in ((0, "L"), (2, "C")):
            figures[f"sized {design}"] = str(min((int(r[k][0]) for r in rows), default="fails"))
            figures[f"hold {design}"] = str(min((float(r[k][1]) for r in rows), default="fails"))
    digest = O.digest_of(pathlib.Path(a.inkling), changed)
    if "run" not in a.without:
        out = CACHE / f"prices-{digest}.json"
        said("run.py", "1", "4", "--seeds", "1", "--json", out)
        got = json.loads(out.read_text()) if out.exists() else []
        for mode in ("design", "windows"):
            of = [(r["scen"], r["s"]) for r in got if r["mode"] == mode]
            share = lambda n, all_of, of: sum(s.get(n, 0) for s in of) / max(sum(s.get(all_of, 0) for s in of), 1)
            figures[f"false {mode}"] = f"{share('fa', 'healthy', [s for _, s in of]) / O.STATED:.2f}"
            figures[f"found {mode}"] = f"{share('hit', 'faulty', [s for scen, s in of if scen == 4]):.3f}"
    for left in (f"prices-{digest}.json", f"said-{digest}.txt"):
        (CACHE / left).unlink(missing_ok=True)
    for work in (CACHE / "work" / f"{digest}-{O.BASE}", CACHE / "sizes" / digest):
        shutil.rmtree(work, ignore_errors=True)
    return figures


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--inkling", required=True)
    ap.add_argument("--of", default="", help="numbers that begin so")
    ap.add_argument("--seed", type=int, default=2)
    ap.add_argument("--without", nargs="*", default=[], choices=["few", "sizes", "run"], help="parts that are left out")
    ap.add_argument("--jobs", type=int, default=2)
    a = ap.parse_args()
    a.inkling = str(pathlib.Path(a.inkling).resolve())
    as_is = measured(a, "")
    print("as it is:", "; ".join(f"{k} {v}" for k, v in as_is.items()), flush=True)
    print("\n| half / twice of | what changes |\n|---|---|", flush=True)
    with concurrent.futures.ThreadPoolExecutor(a.jobs) as pool:
        names = numbers(a.of)
        pairs = [(pool.submit(measured, a, f"{n}=0.5"), pool.submit(measured, a, f"{n}=2")) for n in names]
        for name, (half, twice) in zip(names, pairs):
            half, twice = half.result(), twice.result()
            change = lambda k: " / ".join(v if v != as_is[k] else "-" for v in (half[k], twice[k]))
            moved = [f"{k} {change(k)}" for k in as_is if {half[k], twice[k]} != {as_is[k]}]
            print(f"| `{name}` | {'; '.join(moved) or 'nothing'} |", flush=True)


if __name__ == "__main__":
    main()
