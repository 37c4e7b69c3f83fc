#!/usr/bin/env python3
"""inkling from outside: issue 33's first table. See README.md."""
import os
os.environ.setdefault("OMP_NUM_THREADS", "1"); os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import argparse, collections, hashlib, inspect, json, pathlib, shutil, subprocess, sys, time
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import numpy as np
import pyarrow.parquet as pq
import head as H
import rec as R
from rec import record, write, truth_of, FAULTY, HEALTHY, OTHER, CACHE

STATED = 7e-4
HERE = pathlib.Path(__file__).resolve().parent
BASE = hashlib.sha256((HERE / "head.py").read_bytes() + (HERE / "rec.py").read_bytes()).hexdigest()[:8]
# labelled faults: each on two channels, its size stepping through the class's range
CLASSES = [("EC", .05, .4), ("BN", .35, .9), ("PBN", .05, .35), ("SDN", 1.1, 1.6), ("IDN", 1.6, 2.5), ("DDN", 2.5, 5.0),
           ("AB1", .05, .5), ("AB2", .05, .6), ("AB3", .6, 3.0)] * 2
STEPS = 10
GROSS = [("BN", .6), ("DDN", 2.5), ("AB2", .25), ("EC", .25)]
NAMED = collections.defaultdict(collections.Counter)


class Ctx:
    def __init__(self, seed, binary, work, threads, timeout):
        self.seed, self.bin, self.work, self.threads, self.timeout = seed, str(binary), work / f"s{seed}", threads, timeout
        self.rows, self.said, self.spent = [], [], collections.Counter()
        self.scen = 0

    def rng(self, *salt):
        return np.random.default_rng([self.seed, zsum(salt)])

    @property
    def P(self):
        """the printhead black-1 of this seed: 60 channels that differ for good"""
        return H.healthy(self.rng("head"), 60)

    def gen(self, fn, name, source):
        """the recording `name`, made by fn(rng) -> Rec | [Rec] (or (recs, keywords of write))"""
        key = hashlib.sha256((BASE + source).encode()).hexdigest()[:8]
        path = CACHE / f"s{self.seed}-{key}" / f"{name}.mcap"
        if not path.with_suffix(".npz").exists():
            t0 = time.time()
            got = fn(self.rng(name))
            recs, kw = got if isinstance(got, tuple) else (got, {})
            write(path, recs, **kw)
            self.spent["generate"] += time.time() - t0
        return path

    # ---- what all scenarios share: training, a first night, its state
    def training(self, offset=0.0):
        src = inspect.getsource(Ctx.training) + repr(CLASSES)
        tag = f"-o{offset:g}" if offset else ""

        def run1(rng):
            return record(self.rng("train1"), self.P, 400, .1, night=-9, offset=offset)

        def faults():
            part = (np.arange(400) - 200) // (200 // STEPS)       # -10..9: the first half is healthy
            return [(3 * i + 1, part == j, k, lo + (hi - lo) * ((j + .25 + .5 * (i > 8)) / STEPS))
                    for i, (k, lo, hi) in enumerate(CLASSES) for j in range(STEPS)]

        def run2(rng):
            return record(self.rng("train2"), self.P, 400, .1, night=-8, offset=offset, faults=faults())
        a, b = self.gen(run1, "train1" + tag, src), self.gen(run2, "train2" + tag, src)
        t = truth_of(b)["black-1"][0]
        rows = ["printhead,channel,from,to,state,severity", "black-1,*,,,healthy,"]
        rows += [f"black-1,{c},{t[m][0]},{t[m][-1] + 1},{k},{s:.4f}" for c, m, k, s in faults()]
        csv = b.with_name("labels.csv")
        csv.write_text("\n".join(rows) + "\n")
        return [a, b], csv

    def design(self, offset=0.0):
        out = self.work / f"design{offset:g}.json"
        if not out.exists():
            recs, csv = self.training(offset)
            out.parent.mkdir(parents=True, exist_ok=True)
            code, _, err, _ = self.call("train", *recs, "--labels", csv, "-o", out)
            (self.work / f"train{offset:g}.txt").write_text(f"exit {code}\n{err}")
            if code and not offset:
                raise RuntimeError(f"train failed ({code}): {err}")
        return out

    def night0(self):
        def fn(rng):
            return record(rng, self.P, 300, .1, night=0)
        return self.gen(fn, "night0", inspect.getsource(Ctx.night0))

    def state(self, mode):
        """the baseline file after a healthy first night, in that mode; a copy to be used up"""
        kept = self.work / f"state-{mode}.json"
        if not kept.exists():
            tmp = self.work / f"state-{mode}.new"
            tmp.unlink(missing_ok=True)
            out = self.work / f"out-state-{mode}"
            shutil.rmtree(out, ignore_errors=True)
            code, so, err, _ = self.replay([self.night0()], mode, out, baseline=tmp)
            (self.work / f"state-{mode}.txt").write_text(f"exit {code}\n{so}\n{err}")
            if not tmp.exists():
                return None
            tmp.rename(kept)
        return kept

    # ---- running inkling
    def call(self, *args):
        t0 = time.time()
        try:
            p = subprocess.run(["nice", "-n", "10", self.bin, *map(str, args)], capture_output=True, text=True,
                               timeout=self.timeout, cwd=self.work if self.work.exists() else ".",
                               env={**os.environ, "NO_COLOR": "1"})
            r = p.returncode, p.stdout, p.stderr
        except subprocess.TimeoutExpired:
            r = "time", "", "timeout"
        self.spent["inkling " + str(args[0])] += time.time() - t0
        return *r, time.time() - t0

    def replay(self, paths, mode, out, baseline=None, extra=()):
        args = ["replay", *paths, "--out", out, "--threads", self.threads, "--layout", "flat"]
        if mode in ("design", "windows"):
            args += ["--design", self.design(), "--identify", mode]
        if baseline:
            args += ["--baseline", baseline]
        return self.call(*args, *extra)

    def judge(self, kind, paths, modes, later=None, fresh=False, extra=(), note=None, only=None):
        """replay paths in each mode ('design', 'windows', 'none', each + '+b') and add a line each.
        +b: with the state after night0 (fresh: from no file). later: count bursts from this index on only.
        note(ctx, stats, out) -> text. only: channels that count."""
        paths = paths if isinstance(paths, list) else [paths]
        outs = {}
        for mode in modes:
            m, b = mode.removesuffix("+b"), mode.endswith("+b")
            out = self.work / f"out-{self.scen}-{kind}-{mode}".replace(" ", "_").replace("/", "_")
            shutil.rmtree(out, ignore_errors=True)
            state = None
            if b:
                out.mkdir(parents=True)
                state = out / "state.json"
                if not fresh:
                    kept = self.state(m)
                    if kept:
                        shutil.copy(kept, state)
            code, so, err, took = self.replay(paths, m, out, baseline=state, extra=extra)
            st = evaluate(paths, out, later, only)
            st.update(scen=self.scen, kind=kind, mode=mode, exit=[code], warnings=len([l for l in err.splitlines() if l.strip()]), seconds=took)
            if note:
                st["note"] = [note(st, out)]
            self.said.append(f"### {self.scen} | {kind} | {mode} | seed {self.seed} | exit {code}\n{so}\n--- stderr\n{err}\n")
            self.rows.append(st)
            outs[mode] = out
        return outs


def zsum(parts):
    return int.from_bytes(hashlib.sha256(repr(parts).encode()).digest()[:6], "little")


def col(t, name):
    if name not in t.column_names:
        return np.full(t.num_rows, None, object)
    c = t.column(name).combine_chunks()
    if hasattr(c, "dictionary_decode"):
        c = c.dictionary_decode()
    if str(c.type).startswith("timestamp"):
        ns = 1000 if "us" in str(c.type) else 1
        a = c.cast("int64").to_numpy(zero_copy_only=False)
        return a if c.null_count else a.astype(np.int64) * ns
    return c.to_numpy(zero_copy_only=False)


def verdicts(out, stem):
    f = list(out.rglob(f"{stem}.verdicts.parquet"))
    return pq.read_table(f[0]) if f else None


def episodes(out, stem):
    f = list(out.rglob(f"{stem}.episodes.parquet"))
    if not f:
        return []
    t = pq.read_table(f[0])
    return [dict(head=h, ch=int(c), raised=int(r), fault=fa, cat=ca, reason=re, size=s, sd=sd) for h, c, r, fa, ca, re, s, sd in zip(
        col(t, "printhead"), col(t, "channel"), col(t, "raised_at"), col(t, "fault"), col(t, "category"), col(t, "reason"),
        col(t, "severity_last"), col(t, "severity_sd"))]


def evaluate(paths, out, later=None, only=None):
    s = collections.Counter()
    reasons, names, other = collections.Counter(), collections.Counter(), collections.Counter()
    for p in paths:
        truth = truth_of(p)
        v = verdicts(out, p.stem)
        if v is None:
            s["missing"] += 1
            continue
        t, ch = col(v, "acquired_at"), col(v, "channel").astype(int)
        hd, oc = col(v, "printhead").astype(str), col(v, "outcome").astype(str)
        fa, rs = col(v, "fault"), col(v, "reason")
        for name, (bt, tr, _) in truth.items():
            i = hd == name
            b = np.searchsorted(bt, t[i])
            if not len(b):
                s["missing"] += 1
                continue
            ok = (b < len(bt)) & (bt[np.minimum(b, len(bt) - 1)] == t[i])
            assert ok.all(), "burst times differ"
            y, o = tr[b, ch[i]], oc[i]
            n = fa[i]
            r = rs[i]
            keep = np.ones(len(b), bool) if later is None else b >= later
            if only is not None:
                keep &= np.isin(ch[i], only)
            flag = (o == "faulty") | (o == "undecided")
            s["signals"] += int(keep.sum())
            h, f = keep & (y == HEALTHY), keep & (y == FAULTY)
            s["healthy"] += int(h.sum()); s["fa"] += int((h & flag).sum()); s["fanamed"] += int((h & (o == "faulty")).sum())
            s["rejected"] += int((h & (o == "rejected")).sum())
            s["faulty"] += int(f.sum()); s["hit"] += int((f & flag).sum()); s["frejected"] += int((f & (o == "rejected")).sum())
            s["hitnamed"] += int((f & (o == "faulty")).sum())
            a = keep & (y == OTHER)
            for k in np.unique(o[a]):
                other[str(k)] += int((a & (o == k)).sum())
            for k in [x for x in set(r[keep]) if x is not None]:
                reasons[str(k)] += int((r[keep] == k).sum())
            for k in [x for x in set(n[h]) if x is not None]:
                names[str(k)] += int((n[h] == k).sum())
            late = later or 0
            seen = set()
            for e in episodes(out, p.stem):
                if e["head"] != name or e["raised"] < bt[min(late, len(bt) - 1)] or (only is not None and e["ch"] not in only):
                    continue
                k = min(int(np.searchsorted(bt, e["raised"])), len(bt) - 1)
                state = tr[max(0, k - 60):k + 1, e["ch"]]
                if (state == FAULTY).any():
                    seen.add(e["ch"])
                elif (state == OTHER).any():
                    s["otherepisodes"] += 1
                else:
                    s["falseepisodes"] += 1
            s["faultychannels"] += int((tr[late:] == FAULTY).any(0).sum()) if only is None else int((tr[late:, only] == FAULTY).any(0).sum())
            s["foundchannels"] += len(seen)
    return dict(s=dict(s), reasons=dict(reasons), names=dict(names), other=dict(other), note=[])


def other_note(st, out):
    n = sum(st["other"].values())
    return "altered: " + ", ".join(f"{k} {v / n:.2f}" for k, v in sorted(st["other"].items())) if n else ""


# ------------------------------------------------------------------ scenarios
MODES4 = ["design", "design+b", "windows", "windows+b"]


def s0(c):
    "sanity: another night of faults of the labelled kinds and sizes"
    src = inspect.getsource(s0) + repr(CLASSES)

    def fn(rng):
        b = np.arange(400)
        f = [(3 * i + 2, b >= 200, k, rng.uniform(lo, hi, 400)) for i, (k, lo, hi) in enumerate(CLASSES)]
        return record(rng, c.P, 400, .1, night=1, faults=f)
    p = c.gen(fn, "s0", src)
    who = {3 * i + 2: k for i, (k, _, _) in enumerate(CLASSES)}
    cat = dict(EC="empty_channel", BN="blocked_nozzle", PBN="blocked_nozzle", SDN="dried_nozzle", IDN="dried_nozzle", DDN="dried_nozzle", AB1="air_bubble", AB2="air_bubble", AB3="air_bubble")

    def note(st, out):
        v = verdicts(out, p.stem)
        bt, tr, size = truth_of(p)["black-1"]
        b, ch = np.searchsorted(bt, col(v, "acquired_at")), col(v, "channel").astype(int)
        txt = []
        for k in cat:
            i = np.array([who.get(x) == k for x in ch]) & (tr[b, ch] == FAULTY)
            true, one = size[b[i], ch[i]], float(k in ("SDN", "IDN", "DDN"))
            ca, se, sd = col(v, "category")[i], col(v, "severity")[i].astype(float), col(v, "severity_sd")[i].astype(float)
            ok = (ca == cat[k]) & np.isfinite(se)
            x = (se[ok] - one) / (true[ok] - one)
            wrong = np.mean([q is not None and q != cat[k] for q in ca])
            txt.append(f"{k} cat {np.mean(ca == cat[k]):.2f} wrong {wrong:.2f} sized {np.mean(ok):.2f} size x{np.median(x) if len(x) else float('nan'):.2f} in95 {np.mean(np.abs(se[ok] - true[ok]) <= 1.96 * sd[ok]) if len(x) else float('nan'):.2f}")
        return ", ".join(txt)
    c.judge("library", p, ["design", "windows", "design+b"], note=note)


def s1(c):
    "next night at another temperature or drive, unrecorded"
    src = inspect.getsource(s1)
    for kind, dT, g in [("same", 0, 1), ("+4 K", 4, 1), ("+10 K", 10, 1), ("-6 K", -6, 1), ("gain .9", 0, .9), ("gain 1.1", 0, 1.1)]:
        def fn(rng):
            on = np.arange(300) >= 150
            return record(rng, c.P, 300, .1, night=1, T=np.full(300, dT), gain=np.full(300, g),
                          faults=[(12, on, "SDN", 1.3), (32, on, "BN", .5), (52, on, "AB2", .2)])
        c.judge(kind, c.gen(fn, f"s1{kind}".replace(" ", ""), src), MODES4)


def s2(c):
    "60 short nights, four slow faults: two gross at the end, two to 14 and 16 sds of one signal's noise"
    src = inspect.getsource(s2)
    nights, B = 60, 40
    # per night: from night 10 on; sizes as inkling's units
    grow = {7: ("SDN", lambda n: 1 + .018 * n), 23: ("SDN", lambda n: 1 + .002 * n), 41: ("PBN", lambda n: .0004 * n), 50: ("PBN", lambda n: .0016 * n)}
    paths = []
    for k in range(nights):
        def fn(rng):
            n = max(0, k - 9)
            return record(rng, c.P, B, .2, night=k, faults=[(ch, n > 0, kind, f(n)) for ch, (kind, f) in grow.items()] if n else [])
        paths.append(c.gen(fn, f"s2n{k:02}", src))

    def note(st, out):
        txt = []
        spread = {}
        for ch, (kind, f) in grow.items():
            raised, ratio, inside, num, cls = None, [], 0, 0, collections.Counter()
            for k, p in enumerate(paths):
                if any(e["ch"] == ch for e in episodes(out, p.stem)) and raised is None and k > 9:
                    raised = k - 9
                if k < nights - 10:
                    continue
                v = verdicts(out, p.stem)
                if v is None:
                    continue
                i = (col(v, "channel").astype(int) == ch) & (col(v, "outcome").astype(str) == "faulty")
                se, sd = col(v, "severity")[i].astype(float), col(v, "severity_sd")[i].astype(float)
                fl = col(v, "fault")[i]
                true = f(k - 9)
                base = 1 if kind == "SDN" else 0
                for x, d, q in zip(se, sd, fl):
                    cls[q] += 1
                    if q is None or (q in ("SDN", "IDN", "DDN")) != (kind == "SDN"):
                        continue
                    if np.isfinite(x):
                        ratio.append((x - base) / (true - base)); num += 1; inside += abs(x - true) <= 1.96 * d
            txt.append(f"{kind}{f(50):.3g}: night {raised}, size x{np.mean(ratio) if ratio else float('nan'):.2f}, in 95% {inside / num if num else float('nan'):.2f} of {num}, {'/'.join(f'{a} {b}' for a, b in cls.most_common(2))}")
        rep = out / "r.html"
        c.call("report", out, "-o", rep)
        q = out / "r.faults.parquet"
        if q.exists():
            t = pq.read_table(q)
            t = t.select([n for n in ('channel', 'fault', 'severity_per_day') if n in t.column_names])
            for row in t.to_pylist():
                if row["channel"] in grow and row.get("severity_per_day") is not None:
                    txt.append(f"trend ch{row['channel']} {row['fault']} {row['severity_per_day']:.4f}")
        return "; ".join(txt)
    c.judge("growing", paths, ["design", "design+b", "windows", "windows+b"], fresh=True, note=note)


def s3(c):
    "three channels replaced by other healthy ones between nights (night 6: one of them is faulty in its second half)"
    src = inspect.getsource(s3)
    who = [10, 11, 12]
    new = H.healthy(c.rng("replacement"), 3)
    gone = c.P.copy(); gone[who] = new
    paths = []
    for k in range(1, 7):
        def fn(rng):
            return record(rng, c.P if k < 3 else gone, 200, .1, night=k, faults=[(11, np.arange(200) >= 100, "SDN", 1.25)] if k == 6 else [])
        paths.append(c.gen(fn, f"s3n{k}", src))

    def note(st, out):
        per = []
        for p in paths:
            v = verdicts(out, p.stem)
            if v is None:
                per.append("-"); continue
            i = np.isin(col(v, "channel").astype(int), who)
            per.append(f"{np.isin(col(v, 'outcome')[i].astype(str), ['faulty', 'undecided']).mean():.2f}/{len([e for e in episodes(out, p.stem) if e['ch'] in who])}ep")
        return "replaced' flagged by night: " + " ".join(per)
    c.judge("replaced n3", paths, ["design", "design+b", "windows+b"], note=note)


def s4(c):
    "slight faults in 5 % of a baseline's first 20 s; the same kind later"
    src = inspect.getsource(s4)
    late = [5, 15, 25, 35, 45, 55]
    for kind in ("clean", "5% signals", "5% channels"):
        def fn(rng):
            B = 600
            b = np.arange(B)
            f = [(ch, b >= 300, "SDN", 1.10) for ch in late]
            if kind == "5% signals":
                f += [(ch, (b < 200) & (rng.random(B) < .05), "SDN", 1.10) for ch in range(60)]
            if kind == "5% channels":
                f += [(ch, b < 200, "SDN", 1.10) for ch in late[:3]]
            return record(rng, c.P, B, .1, night=1, faults=f)
        c.judge(kind, c.gen(fn, f"s4{kind[:2]}{kind[3:5]}", src), ["design", "design+b", "windows", "windows+b"], later=210, fresh=True)


def s5(c):
    "drive changes each minute, unrecorded"
    src = inspect.getsource(s5)

    def fn(rng):
        B = 1200
        level = np.repeat(rng.permutation([1, .88, 1.08, .94, 1.15])[:4], 300)
        b = np.arange(B)
        return record(rng, c.P, B, .2, night=1, gain=level, faults=[(8, b > 700, "BN", .5), (30, b > 500, "IDN", 1.8), (50, b > 800, "AB2", .2)])
    c.judge("minutes", c.gen(fn, "s5", src), MODES4 + ["none"])


def aged(c, amount):
    rng = c.rng("ageing")
    P = c.P.copy()
    k = lambda n, mean, sd: P.__setitem__((slice(None), H.IX[n]), P[:, H.IX[n]] * np.exp(amount * (mean + sd * rng.standard_normal(60))))
    k("gain", -.17, .06); k("Rn", .05, .06); k("B", .01, .012); k("Rr", .0, .08); k("In", 0, .008)
    return P


def s6(c):
    "strong ageing of all channels, each its own way"
    src = inspect.getsource(s6) + inspect.getsource(aged)
    B = 300
    gross = [(9, np.arange(B) >= 150, "BN", .6), (44, np.arange(B) >= 150, "AB2", .3)]

    def fn(rng):
        return record(rng, aged(c, 1.0), B, .1, night=300, faults=gross)
    c.judge("at once", c.gen(fn, "s6once", src), ["design", "windows", "design+b", "windows+b"])
    paths = []
    for k in range(1, 17):
        def fn(rng):
            return record(rng, aged(c, k / 16), 100, .1, night=20 * k, faults=[(ch, m[:100] | (np.arange(100) >= 50), a, s) for ch, m, a, s in gross] if k == 16 else [])
        paths.append(c.gen(fn, f"s6n{k:02}", src))
    c.judge("16 nights", paths, ["design", "windows", "design+b", "windows+b"])


def s7(c):
    "head inverted, or at half or .15 of the drive, from a burst on"
    src = inspect.getsource(s7)
    for kind, g in [("inverted", -1), ("x .5", .5), ("x .15", .15)]:
        def fn(rng):
            B = 1000
            on = np.arange(B) >= 300
            return record(rng, c.P, B, .1, night=1, gain=np.where(on, g, 1.0), truth=lambda tr: np.where(on[:, None], OTHER, tr).astype(np.int8))
        # counted from 70 s on: the window of 60 to 80 s has ended or is being learned
        c.judge(kind, c.gen(fn, f"s7{g}", src), ["design", "windows", "none", "design+b", "windows+b"], later=300,
                note=lambda st, out: other_note(st, out) + f"; episodes {st['s'].get('otherepisodes', 0)}")


def s8(c):
    "same bits each burst"
    src = inspect.getsource(s8)
    for kind, who in [("3 channels", [10, 30, 50]), ("head", list(range(60)))]:
        def fn(rng):
            r = record(rng, c.P, 600, .1, night=1)
            r.raw[200:, who] = r.raw[200, who]
            r.truth[201:, who] = OTHER
            return r
        c.judge(kind, c.gen(fn, f"s8{kind[0]}", src), ["design", "windows", "none", "design+b"],
                note=lambda st, out: other_note(st, out) + f"; episodes {st['s'].get('otherepisodes', 0)}")


def s9(c):
    "small heads of other names"
    src = inspect.getsource(s9)
    for n in (1, 2, 4, 8, 16):
        def fn(rng):
            B = {1: 8000, 2: 4000, 4: 3000, 8: 2000, 16: 1000}[n]
            return record(rng, H.healthy(rng, n), B, .1, night=1, name=f"blue-{n}")
        c.judge(f"{n} channels", c.gen(fn, f"s9-{n}", src), ["design", "windows", "none", "none+b"], fresh=True)

        def walk(rng):
            B = {1: 4000, 2: 2000, 4: 1500, 8: 1000, 16: 600}[n]
            T, g = np.cumsum(rng.standard_normal(B)) * .1, np.exp(np.cumsum(rng.standard_normal(B)) * .003)
            return record(rng, H.healthy(rng, n), B, .15, night=1, name=f"blue-{n}", T=T, gain=g)
        c.judge(f"{n} channels, walk", c.gen(walk, f"s9-{n}w", src), ["design", "windows", "none"])


def s10(c):
    "known by name, clock 4 % off"
    src = inspect.getsource(s10)

    def fn(rng):
        return record(rng, c.P, 300, .1, night=1, dt=H.DT * 1.04, period=H.DT)
    c.judge("clock", c.gen(fn, "s10", src), ["design", "windows", "none", "design+b", "windows+b"])


def s11(c):
    "a gross fault in every 10th (50th) burst of 1600"
    src = inspect.getsource(s11)
    for every in (10, 50):
        def fn(rng):
            b = np.arange(1600)
            return record(rng, c.P[:30], 1600, .1, night=1, faults=[(5 * i + 3, b % every == i, k, s) for i, (k, s) in enumerate(GROSS)])
        c.judge(f"1 in {every}", c.gen(fn, f"s11-{every}", src), ["design", "windows", "design+b", "none"])


def s12(c):
    "faults that last for nights"
    src = inspect.getsource(s12)
    what = {4: ("SDN", 1.12), 14: ("SDN", 1.2), 24: ("PBN", .05), 34: ("BN", .6), 44: ("AB2", .25)}
    paths = []
    for k in range(1, 6):
        def fn(rng):
            on = (np.arange(200) >= 100) | (k > 1)
            return record(rng, c.P, 200, .1, night=k, faults=[(ch, on, a, s) for ch, (a, s) in what.items()])
        paths.append(c.gen(fn, f"s12n{k}", src))

    def note(st, out):
        vs = [verdicts(out, p.stem) for p in paths]
        fl = {}
        for ch in what:
            x = [np.isin(col(v, "outcome").astype(str)[col(v, "channel").astype(int) == ch], ["faulty", "undecided"]).mean() for v in vs[1:] if v is not None]
            fl[ch] = np.mean(x) if x else float("nan")
        return "nights with episode (flagged) " + ", ".join(f"{a}{s:g}: {sum(any(e['ch'] == ch for e in episodes(out, p.stem)) for p in paths)}/5 ({fl[ch]:.2f})" for ch, (a, s) in what.items())
    c.judge("lasting", paths, ["design", "design+b", "windows", "windows+b"], note=note)


def s13(c):
    "the same signals in bursts of 60, 5, 1 channels"
    src = inspect.getsource(s13)

    def base():
        b = np.arange(300)
        return record(c.rng("s13"), c.P, 300, .1, night=1, T=np.linspace(0, 3, 300), gain=np.where(b > 220, .95, 1),
                      faults=[(6, b > 150, "SDN", 1.2), (26, b > 100, "BN", .6), (46, b > 60, "AB1", .2)])
    kinds = {"60": {}, "5": dict(split=5), "1": dict(split=1), "5 shuffled": 5, "1 shuffled": 1}
    tables = {}
    for kind, kw in kinds.items():
        def fn(rng):
            return base(), kw if isinstance(kw, dict) else dict(split=kw, order=rng)
        p = c.gen(fn, "s13", src + kind)   # one stem: another directory each

        def note(st, out):
            v = verdicts(out, p.stem)
            if v is None:
                return "no table"
            names = [n for n in v.column_names if n not in ("recording",)]
            o = np.lexsort((col(v, "channel").astype(int), col(v, "acquired_at")))
            d = {n: col(v, n)[o] for n in names if n != "weights"}
            ep = sorted(map(repr, episodes(out, p.stem)))
            mode = out.name
            key = mode.split("-")[-1]
            if kind == "60":
                tables[key] = (d, ep)
                return "reference"
            ref, rep = tables[key]
            eq = lambda a, b: np.array([x == y or (x != x and y != y) for x, y in zip(a, b)])
            diff = {n: 1 - eq(ref[n], d[n]).mean() for n in d}
            few = {n: x for n, x in diff.items() if x}
            show = [f"{n} {few.pop(n):.3f}" for n in ("statistic", "outcome", "fault", "threshold") if n in few]
            return "rows that differ: " + (", ".join(show) + (f" +{len(few)} columns" if few else "") if show or few else "none") + ("; episodes differ" if ep != rep else "")
        c.judge(kind, p, MODES4 + ["none"], note=note)


def s14(c):
    "drifts within a recording"
    src = inspect.getsource(s14)
    B, dt = 750, .2
    for kind in ("ramp +8 K", "steps", "settling", "random walk"):
        for faulty in (False, True):
            def fn(rng):
                b = np.arange(B); t = b * dt
                T, g = np.zeros(B), np.ones(B)
                if kind == "ramp +8 K":
                    T = 8 * np.clip((t - 25) / 100, 0, 1)
                elif kind == "steps":
                    g = np.select([t < 40, t < 70, t < 110], [1, .93, 1.06], .9)
                elif kind == "settling":
                    T, g = 4 * (1 - np.exp(-t / 20)), 1 - .07 * (1 - np.exp(-t / 15))
                else:
                    T = np.cumsum(rng.standard_normal(B)) * .12; g = np.exp(np.cumsum(rng.standard_normal(B)) * .004)
                f = [(12, b >= 400, "SDN", 1.3), (32, b >= 250, "BN", .4), (52, b >= 500, "AB2", .1)] if faulty else []
                return record(rng, c.P, B, dt, night=1, T=T, gain=g, faults=f)
            c.judge(kind + (" faults" if faulty else ""), c.gen(fn, f"s14{kind[:3]}{faulty}", src), (MODES4 + ["none"]) if faulty else ["design", "windows", "windows+b"])


def s15(c):
    "an offset of 40 (150) counts in every signal"
    src = inspect.getsource(s15)
    plain = c.design
    for off in (40, 150):
        def fn(rng):
            b = np.arange(300)
            return record(rng, c.P, 300, .1, night=1, offset=off, faults=[(6, b > 150, "IDN", 1.8), (26, b > 100, "BN", .6)])
        p = c.gen(fn, f"s15-{off}", src)
        design = plain(off)
        f = c.work / f"train{off}.txt"
        txt = "train: " + f.read_text().replace("\n", " ")[:230]
        if design.exists():
            c.design = lambda *a: design
            c.judge(f"{off}, trained too", p, ["design", "windows"], note=lambda st, out: txt)
            c.design = plain
        else:
            c.rows.append(dict(s={}, reasons={}, names={}, other={}, note=[txt], scen=15, kind=f"{off}, trained too", mode="design", exit=["-"], warnings=1, seconds=0))
        c.judge(f"{off}, replay alone", p, ["design", "windows", "none", "design+b"])


def s16(c):
    "40, 60, 100 % of the channels faulty alike from a burst on"
    src = inspect.getsource(s16)
    for kind, size, share in [("SDN", 1.15, .4), ("SDN", 1.15, .6), ("SDN", 1.15, 1.0), ("SDN", 1.5, .4), ("SDN", 1.5, 1.0), ("BN", .4, .6), ("BN", .4, 1.0)]:
        def fn(rng):
            b = np.arange(600)
            who = rng.permutation(60)[:int(60 * share)]
            return record(rng, c.P, 600, .1, night=1, faults=[(int(ch), b >= 200, kind, size) for ch in who])
        c.judge(f"{kind}{size:g} {share:.0%}", c.gen(fn, f"s16{kind}{size}{share}", src), ["design", "windows", "none", "design+b", "windows+b"])


def s17(c):
    "ten nights in one run, or each in a run of its own, with --baseline: the same verdicts?"
    src = inspect.getsource(s17)
    paths = []
    for k in range(1, 11):
        def fn(rng):
            b = np.arange(100)
            return record(rng, c.P, 100, .2, night=k, T=np.full(100, .2 * k), faults=[(12, b >= 0, "SDN", 1 + .02 * k), (32, b >= 50, "BN", .4)] if k > 3 else [])
        paths.append(c.gen(fn, f"s17n{k:02}", src))
    for mode in ("design", "windows"):
        one = c.work / f"out-17-one-{mode}"
        c.judge("one run", paths, [mode + "+b"], fresh=True)
        whole = c.work / f"out-17-one_run-{mode}+b"
        each = c.work / f"out-17-each-{mode}"
        shutil.rmtree(each, ignore_errors=True); each.mkdir(parents=True)
        codes = [c.replay([p], mode, each, baseline=each / "state.json")[0] for p in paths]
        st = evaluate(paths, each)
        diff = eps = rows = 0
        for p in paths:
            v, w = verdicts(whole, p.stem), verdicts(each, p.stem)
            if v is None or w is None:
                diff = -1; break
            d = np.zeros(v.num_rows, bool)
            for n in ("outcome", "statistic", "fault", "severity"):
                d |= np.array([not (x == y or (x != x and y != y)) for x, y in zip(col(v, n), col(w, n))])
            diff += int(d.sum()); rows += len(d); eps += sorted(map(repr, episodes(whole, p.stem))) != sorted(map(repr, episodes(each, p.stem)))
        st.update(scen=17, kind="ten runs", mode=mode + "+b", exit=codes, warnings=0, seconds=0, note=[f"rows that differ from one run's: {diff} of {rows}, nights with other episodes {eps}"])
        c.rows.append(st)


SCEN = {i: globals()[f"s{i}"] for i in range(18)}


# ------------------------------------------------------------------ table
def merge(rows):
    out = {}
    for r in rows:
        k = (r["scen"], r["kind"], r["mode"])
        if k not in out:
            out[k] = json.loads(json.dumps(r))
            continue
        m = out[k]
        for part in ("s", "reasons", "names", "other"):
            for n, v in r[part].items():
                m[part][n] = m[part].get(n, 0) + v
        m["exit"] += r["exit"]; m["note"] += r["note"]; m["warnings"] += r["warnings"]; m["seconds"] += r["seconds"]
    return list(out.values())


HEAD = f"{'sc':>2} {'kind':<22}{'mode':<10}{'signals':>8} {'FA/std':>7} {'named':>7} {'rej':>5} {'recall':>6} {'falseEp':>7} {'found':>7} {'exit':<6}{'warn':>4}  reasons; names of healthy; note"


def digest_of(binary):
    """of a binary: what different ones make lies apart"""
    return hashlib.sha256(binary.read_bytes()).hexdigest()[:10]


def line(m):
    s = collections.Counter(m["s"])
    h, f = s["healthy"], s["faulty"]
    fa = f"{s['fa'] / h / STATED:7.2f}" if h else "      -"
    nm = f"{s['fanamed'] / h:7.0e}" if h and s["fanamed"] else ("      0" if h else "      -")
    rj = f"{s['rejected'] / h:5.2f}" if h else "    -"
    rc = f"{s['hit'] / f:6.3f}" if f else "     -"
    fd = f"{s['foundchannels']}/{s['faultychannels']}" if f else "-"
    short = lambda d: " ".join(f"{k}:{v}" for k, v in sorted(d.items(), key=lambda x: -x[1])[:4])
    ex = "/".join(str(e) for e in sorted(set(map(str, m["exit"]))))
    tail = "; ".join(x for x in ([short(m["reasons"])] if m["reasons"] else []) + (["NAMED " + short(m["names"])] if m["names"] else []) +
                     ([f"missing {s['missing']}"] if s["missing"] else []) + [" || ".join(dict.fromkeys(m["note"]))] if x)
    return f"{m['scen']:>2} {m['kind']:<22}{m['mode']:<10}{s['signals']:>8} {fa} {nm} {rj} {rc} {s['falseepisodes']:>7} {fd:>7} {ex:<6}{m['warnings']:>4}  {tail}"


def numbers(m):
    s = collections.Counter(m["s"])
    h, f, o = max(1, s["healthy"]), max(1, s["faulty"]), m["other"]
    return dict(fa=s["fa"] / h / STATED, named=s["fanamed"] / h, rejected=s["rejected"] / h, missed=1 - s["hit"] / f if s["faulty"] else 0.0,
                falseEp=s["falseepisodes"], notFound=s["faultychannels"] - s["foundchannels"],
                alteredHealthy=o.get("healthy", 0) / max(1, sum(o.values())))


def against(old, rows):
    """what moved by more than chance would: old -> new; the smaller the better, everywhere"""
    slack = dict(fa=1.0, named=2e-4, rejected=.005, missed=.01, falseEp=0, notFound=0, alteredHealthy=.005)
    print("\nAGAINST the earlier run (old -> new; beyond chance only)")
    n = collections.Counter()
    for m in rows:
        o = old.get((m["scen"], m["kind"], m["mode"]))
        if not o:
            continue
        x, y = numbers(o), numbers(m)
        far = {k: max(slack[k], (.1 if k in ("fa", "named", "falseEp") else 0) * x[k]) for k in x}
        bad = [f"{k} {x[k]:.3g} -> {y[k]:.3g}" for k in x if y[k] > x[k] + far[k]]
        good = [f"{k} {x[k]:.3g} -> {y[k]:.3g}" for k in x if y[k] < x[k] - far[k]]
        ex = "" if sorted(set(o["exit"]), key=str) == sorted(set(m["exit"]), key=str) else f" exit {sorted(set(o['exit']), key=str)} -> {sorted(set(m['exit']), key=str)}"
        n["worse"] += bool(bad); n["better"] += bool(good and not bad); n["as before"] += not (bad or good)
        if bad or good or ex:
            print(f"{m['scen']:>2} {m['kind']:<22}{m['mode']:<10}" + ("WORSE " + ", ".join(bad) + "  " if bad else "") + ("better " + ", ".join(good) if good else "") + ex)
    print(", ".join(f"{v} {k}" for k, v in n.items()))


def main():
    ap = argparse.ArgumentParser()
    ap.add_argument("scenarios", nargs="*", type=int)
    ap.add_argument("--inkling", required=True)
    ap.add_argument("--seeds", type=int, default=2)
    ap.add_argument("--seed", type=int, default=1, help="the first seed")
    ap.add_argument("--threads", type=int, default=1)
    ap.add_argument("--timeout", type=float, default=120)
    ap.add_argument("--json", help="write all numbers here")
    ap.add_argument("--against", help="a --json of an earlier run with the same seeds: what became better or worse")
    a = ap.parse_args()
    os.nice(10)
    binary = pathlib.Path(a.inkling).resolve()
    digest = digest_of(binary)
    work = CACHE / "work" / f"{digest}-{BASE}"
    for old in (CACHE / "work").glob("*/s*/out-*"):     # results of earlier runs: only what was learned stays
        shutil.rmtree(old, ignore_errors=True)
    t0 = time.time()
    rows, said, spent = [], [], collections.Counter()
    for n in a.scenarios or sorted(SCEN):
        mine = []
        for seed in range(a.seed, a.seed + a.seeds):
            c = Ctx(seed, binary, work, a.threads, a.timeout)
            c.work.mkdir(parents=True, exist_ok=True)
            c.scen = n
            try:
                SCEN[n](c)
            except Exception as e:                     # one scenario's error is not the others'
                import traceback; traceback.print_exc()
                c.rows.append(dict(s={}, reasons={}, names={}, other={}, note=[f"HARNESS {e!r}"], scen=n, kind="error", mode="", exit=["?"], warnings=0, seconds=0))
            mine += c.rows; said += c.said; spent.update(c.spent)
            for d in c.work.glob("out-*"):
                shutil.rmtree(d, ignore_errors=True)
        merged = merge(mine)
        print(f"\n{n}. {SCEN[n].__doc__}" + ("" if rows else f"\n{HEAD}"))
        for m in merged:
            print(line(m), flush=True)
        rows += merged
    print(f"\nCOMPACT  {binary} {digest}, seeds {a.seed}..{a.seed + a.seeds - 1}: worst false alarms over stated / share named of healthy / false episodes / exits")
    by = collections.defaultdict(list)
    for m in rows:
        by[m["scen"], m["mode"]].append(m)
    modes = ["design", "design+b", "windows", "windows+b", "none"]
    print(f"{'sc':>2} " + "".join(f"{m:<26}" for m in modes))
    for n in a.scenarios or sorted(SCEN):
        cells = []
        for mo in modes:
            ms = [m for m in by.get((n, mo), []) if m["s"].get("signals")]
            if not ms:
                cells.append(""); continue
            w = max((m["s"].get("fa", 0) / max(1, m["s"].get("healthy", 0)) / STATED for m in ms))
            nm = max((m["s"].get("fanamed", 0) / max(1, m["s"].get("healthy", 0)) for m in ms))
            ep = sum(m["s"].get("falseepisodes", 0) for m in ms)
            cells.append(f"{w:.3g}x {nm:.0e} {ep}ep {''.join(sorted({str(e) for m in ms for e in m['exit']}))}")
        print(f"{n:>2} " + "".join(f"{x:<26}" for x in cells))
    if a.against:
        against({(m["scen"], m["kind"], m["mode"]): m for m in json.loads(pathlib.Path(a.against).read_text())}, rows)
    print(f"\n{time.time() - t0:.0f} s in all: " + ", ".join(f"{k} {v:.0f} s" for k, v in spent.items()))
    (CACHE / f"said-{digest}.txt").write_text("\n".join(said))
    print(f"what was said: {CACHE}/said-{digest}.txt")
    if a.json:
        pathlib.Path(a.json).write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
