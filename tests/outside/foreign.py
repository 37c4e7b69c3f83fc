#!/usr/bin/env python3
"""Names from outside: what no class stands for, and faults as labelled, on single channels of a head whose others are
healthy. See README.md.

    python3 tests/outside/foreign.py --inkling target/release/inkling [--seeds 1] [--seed 1] [--head 0] [--few]

Signals named at a certainty of .8 or more (and "both": of episodes with a name, those whose sentence says "or" what is no class), by a design of labels, by a design of healthy labels alone, and by both with the
state after one healthy night (`+b`). `--head N`: another head, its elements off by some 25 % each, other channels than the
nominal one's. `--few`: of faults alone, by designs of few labels of six of the nine classes, by the thesis's names and by own ones."""
import argparse, pathlib, sys
import numpy as np
import pyarrow.parquet as pq
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import head as H
import run as O
from rec import record, truth_of, CACHE

BLOCKS, EACH = 20, 40
N = H.N


def scaled(**by):
    """a channel whose elements are multiplied"""
    def waves(p, u):
        q = p.copy()
        for name, (low, high) in by.items():
            q[:, H.IX[name]] *= low + (high - low) * u
        return H.waves(q)[0]
    return waves


def turned(how):
    """the healthy channel's wave, altered"""
    return lambda p, u: how(H.waves(p)[0], u)


def late(y, j):
    return np.concatenate([np.zeros(j, np.float32), y[:N - j]])


def high_pass(y, _):
    out, x = np.empty_like(y), 0.0
    k = 1 - np.exp(-2 * np.pi * .02 * H.DT)
    for i, v in enumerate(y):
        out[i] = v - x
        x += k * (v - x)
    return out


def low_pass(y, corner):
    out, x = np.empty_like(y), 0.0
    for i, v in enumerate(y):
        x += (1 - np.exp(-2 * np.pi * corner * H.DT)) * (v - x)
        out[i] = x
    return out


T = np.arange(N) * H.DT
FOREIGN = {
    "gain 1.25": turned(lambda y, _: 1.25 * y), "gain 1.3": turned(lambda y, _: 1.3 * y), "gain .8": turned(lambda y, _: .8 * y),
    "gain .5 to .9": turned(lambda y, u: (.5 + .4 * u) * y), "gain 1.1 to 2": turned(lambda y, u: (1.1 + .9 * u) * y),
    "inverted": turned(lambda y, _: -y),
    "piezo .7 stiffer": scaled(gain=(.7, .7), B=(.97, .97)),
    "clock 10 % slow": lambda p, u: H.waves(p, H.DT / 1.1)[0], "clock 10 % fast": lambda p, u: H.waves(p, H.DT * 1.1)[0],
    "clock 3 % fast": lambda p, u: H.waves(p, H.DT * 1.03)[0],
    "high-pass 20 kHz": turned(high_pass), "a sample late": turned(lambda y, _: late(y, 1)),
    "two samples late": turned(lambda y, _: late(y, 2)),
    "wetting": scaled(In=(1.1, 1.4)), "wider 15 %": scaled(In=(1 / 1.15, 1 / 1.15), Rn=(1.15 ** -2, 1.15 ** -2), Rs=(1.15 ** -1.5, 1.15 ** -1.5)),
    "stiffer 8 to 20 %": scaled(B=(.8, .92)), "softer supply": scaled(Ir=(1.2, 1.5)),
    "clipped": turned(lambda y, _: np.clip(y, -600, 600)), "echo .3": turned(lambda y, _: y + .3 * late(y, 26)),
    "smoothed": turned(lambda y, _: sum(late(y, j) for j in range(4)) / 4),
    "110 kHz beside": turned(lambda y, _: y + 200 * np.exp(-.015 * T) * np.sin(2 * np.pi * .11 * T)),
    "low-pass 60 kHz": turned(lambda y, _: low_pass(y, .06)), "18 samples lost": turned(lambda y, _: np.where((T > 20) & (T < 34), 0, y)),
    "coded in 64s": turned(lambda y, _: np.round(y / 64) * 64), "a ramp beside": turned(lambda y, u: y + (100 + 200 * u) * T / T[-1]),
    "neighbour's ring .4": turned(lambda y, _: y + .4 * late(y, 9)), "half the pulse": scaled(act=(.4, .6)),
    "piezo's mode x 5": scaled(k=(5, 5)), "stiffer meniscus": scaled(Cm=(.2, .4)), "thin ink": scaled(Rr=(.4, .8), Rn=(.4, .8), Rs=(.4, .8), Rc=(.4, .8)),
    "thin restrictor ink": scaled(Rr=(.3, .6)), "wider restrictor": scaled(Ir=(.7, .85), Rr=(.5, .75)), "longer nozzle": scaled(In=(1.1, 1.3), Rn=(1.1, 1.3), Rs=(1.1, 1.3)),
    "stiffer, thicker": scaled(B=(.88, .88), Rr=(1.3, 1.3), Rn=(1.3, 1.3), Rs=(1.3, 1.3)),
    "twin: thick ink": scaled(Rr=(1.15, 1.8), Rn=(1.15, 1.8), Rs=(1.15, 1.8), Rc=(1.15, 1.8)),
    "twin: restrictor": scaled(Ir=(1.1, 1.5), Rr=(1.2, 2.2)),
}
CLASSES = {k: (lo, hi) for k, lo, hi in O.CLASSES}
KNOWN = {k: (lambda k, lo, hi: lambda p, u: H.waves(H.fault(p, k, lo + (hi - lo) * u))[0])(k, lo, hi) for k, (lo, hi) in CLASSES.items()}
AT_ONCE = 6


def night(c, kinds, n):
    """a recording in which each of `kinds` is on one channel at a time; who is on which, (block, kind) -> channel"""
    names = list(kinds)
    place = lambda j, i: (60 // len(names) * i + 3 * j) % 60

    def fn(rng):
        def post(y):
            for j in range(BLOCKS):
                for i, name in enumerate(names):
                    ch, b = place(j, i), np.arange(EACH * j, EACH * (j + 1))
                    for part in np.array_split(b, 4):
                        wave = kinds[name](c.P[ch:ch + 1], rng.random())
                        y[part, ch] = wave * (1 + .01 * rng.standard_normal((len(part), 1)).astype(np.float32))
            return y
        return record(rng, c.P, BLOCKS * EACH, .1, night=1, post=post)
    source = pathlib.Path(__file__).read_text()
    path = c.gen(fn, f"foreign{n}", source)
    return path, {(j, place(j, i)): name for j in range(BLOCKS) for i, name in enumerate(names)}


def cold(c):
    """a design of healthy labels alone"""
    out = c.work / "cold.json"
    if not out.exists():
        recs, _ = c.training()
        csv = recs[0].with_name("healthy.csv")
        csv.write_text("printhead,channel,from,to,state,severity\nblack-1,*,,,healthy,\n")
        code, _, err, _ = c.call("train", recs[0], "--labels", csv, "-o", out)
        assert code == 0, err
    return out


FEW_CLASSES = ["EC", "PBN", "SDN", "DDN", "AB1", "AB3"]


def few(c, n, own):
    """a design of `n` labelled signals of each of six classes; `own`: by names that nobody knows"""
    out = c.work / f"few{n}{'-own' if own else ''}.json"
    name = (lambda k: "my-" + k) if own else (lambda k: k)
    if not out.exists():
        recs, csv = c.training()
        t = truth_of(recs[1])["black-1"][0]
        rows = []
        for line in csv.read_text().splitlines()[2:]:
            head, ch, start, end, k, s = line.split(",")
            rows.append(f"{head},{ch},{start},{end},ignore,")
            if k in FEW_CLASSES:
                # one signal of each of the first steps of its size, alternately on both channels
                of = [r for r in rows if r.split(",")[4] == name(k)]
                if len(of) < n:
                    first = int(start)
                    rows.append(f"{head},{ch},{first},{first + 1},{name(k)},")
        few_csv = csv.with_name(out.stem + ".csv")
        few_csv.write_text("\n".join(csv.read_text().splitlines()[:2] + rows) + "\n")
        new = [a for k in FEW_CLASSES if own for a in ("--new-class", name(k))]
        code, _, err, _ = c.call("train", *recs, "--labels", few_csv, *new, "-o", out)
        assert code == 0, err
    return out


def judged(c, path, design, state, tag):
    """verdicts of a recording; with the state after a healthy night of the same design, if asked for"""
    out = c.work / f"out-foreign-{tag}"
    args = ["--design", design, "--identify", "design", "--threads", c.threads, "--layout", "flat", "--force"]
    if state:
        kept = c.work / f"kept-{pathlib.Path(design).stem}.json"
        if not kept.exists():
            c.call("replay", c.night0(), "--out", c.work / "out-kept", *args, "--baseline", kept)
        copy = c.work / "copy.json"
        copy.write_bytes(kept.read_bytes())
        args += ["--baseline", copy]
    code, _, err, _ = c.call("replay", path, "--out", out, *args)
    assert code in (0, 3), err
    return O.verdicts(out, path.stem), episodes(out, path.stem)


def episodes(out, stem):
    """(began at, ns; channel; whether it has a name; whether its sentence says what else it may be)"""
    t = pq.read_table(out / f"{stem}.episodes.parquet", columns=["began_at", "channel", "fault", "category", "explanation"])
    began = t["began_at"].cast("int64").to_pylist()
    rest = zip(*(t[c].to_pylist() for c in ("channel", "fault", "category", "explanation")))
    return [(ns, ch, bool(fault or category), " or " in said) for ns, (ch, fault, category, said) in zip(began, rest)]


def main():
    ap = argparse.ArgumentParser()
    ap.add_argument("--inkling", required=True)
    ap.add_argument("--seed", type=int, default=1)
    ap.add_argument("--seeds", type=int, default=1)
    ap.add_argument("--head", type=int, default=0)
    ap.add_argument("--few", action="store_true")
    ap.add_argument("--modes", default="labels,labels+b,cold,cold+b")
    a = ap.parse_args()
    if a.head:
        other = np.random.default_rng(a.head)
        for name in ("Ir", "Rr", "In", "Rn", "Rs", "Ic", "Rc", "Cm", "k"):
            H.NOMINAL[name] *= float(np.exp(.25 * np.clip(other.standard_normal(), -2, 2)))
        O.BASE += f"-h{a.head}"
    binary = pathlib.Path(a.inkling).resolve()
    digest = O.digest_of(binary)
    found, told = {}, {}
    modes = ["few3", "few10", "few3-own", "few10-own"] if a.few else a.modes.split(",")
    groups = [KNOWN] if a.few else [dict(list(FOREIGN.items())[k:k + AT_ONCE]) for k in range(0, len(FOREIGN), AT_ONCE)] + [KNOWN]
    for seed in range(a.seed, a.seed + a.seeds):
        c = O.Ctx(seed, binary, CACHE / "work" / f"{digest}-{O.BASE}", 1, 200)
        c.work.mkdir(parents=True, exist_ok=True)
        if a.few:
            designs = {f"few{n}{'-own' if own else ''}": few(c, n, own) for own in (False, True) for n in (3, 10)}
        else:
            designs = {"labels": c.design(), "cold": cold(c)}
        for n, kinds in enumerate(groups):
            path, who = night(c, kinds, "known" if kinds is KNOWN else n)
            bt, _, _ = truth_of(path)["black-1"]
            for mode in modes:
                v, raised = judged(c, path, designs[mode.removesuffix("+b")], mode.endswith("+b"), f"{n}-{mode}")
                block = np.searchsorted(bt, O.col(v, "acquired_at")) // EACH
                kind = np.array([who.get(at) for at in zip(block.tolist(), O.col(v, "channel").astype(int).tolist())])
                for ns, ch, named, both in raised:
                    name = who.get((int(np.searchsorted(bt, ns)) // EACH, ch))
                    if named and name:
                        told.setdefault((name, mode), []).append(both)
                for name in kinds:
                    i = kind == name
                    outcome, sure = O.col(v, "outcome")[i].astype(str), O.col(v, "certainty")[i].astype(float)
                    fault, reason = O.col(v, "fault")[i], O.col(v, "reason")[i]
                    category = O.col(v, "category")[i]
                    row = found.setdefault((name, mode), [])
                    row += list(zip(outcome, sure, fault, category, reason))
    print(f"{'share named at >= .8 (of classes: named / right of these / >= .99 right)':<24}")
    print(f"{'kind':<20}" + "".join(f"{m:<50}" for m in modes))
    total = {mode: np.zeros(5) for mode in modes}
    for name in [k for g in groups for k in g]:
        cells = []
        for mode in modes:
            rows, said = found[name, mode], told.get((name, mode), [])
            both = f"both {sum(said)}/{len(said)}" if said else ""
            named = [r for r in rows if r[0] == "faulty" and r[1] >= .8]
            healthy = np.mean([r[0] == "healthy" for r in rows])
            if name in CLASSES:
                cat = dict(E="empty_channel", B="blocked_nozzle", P="blocked_nozzle", A="air_bubble")
                want = cat.get(name[0], "dried_nozzle")
                is_right = lambda r: cat.get(str(r[3]).removeprefix("my-")[0], "dried_nozzle") == want if str(r[3]).startswith("my-") else r[3] == want
                right = np.mean([is_right(r) for r in named]) if named else np.nan
                sure = [r for r in named if r[1] >= .99]
                certain = np.mean([is_right(r) for r in sure]) if sure else np.nan
                total[mode] += [len(named), sum(map(is_right, named)), len(sure), sum(map(is_right, sure)), len(rows)]
                cells.append(f"{len(named) / len(rows):.3f} {right:.3f} {len(sure) / len(rows):.2f} {certain:.3f} healthy {healthy:.2f} {both}")
            else:
                names = [str(r[2] or r[3]) for r in named]
                most = max(set(names), key=names.count) if names else ""
                cells.append(f"{len(named) / len(rows):.3f} {most:<14} healthy {healthy:.2f} {both}")
        print(f"{name:<20}" + "".join(f"{x:<50}" for x in cells), flush=True)
    share = lambda p, q: p / q if q else np.nan
    cells = [f"{share(t[0], t[4]):.3f} {share(t[1], t[0]):.3f} {share(t[2], t[4]):.2f} {share(t[3], t[2]):.3f}" for t in total.values()]
    print(f"{'all classes':<20}" + "".join(f"{x:<50}" for x in cells))


if __name__ == "__main__":
    main()
