#!/usr/bin/env python3
"""Calibration from outside, by simulation: where the truth ranks in what is stated of it, in worlds that share inkling's physics or do not.

    python3 tests/outside/calibrated.py --inkling target/release/inkling [--seed 1] [--worlds shared,loss] [--modes labels,3] [--classes]

Channels by thesis (2-2), integrated here. Worlds: `shared`; `loss`, a fault adds 15 % to what (2-2) loses; `meniscus`, a spring of 5 % of
b; `powers`, a blockage goes with other powers of the cross-section; `sizes`, faults do .8 of what their sizes say; `pulse`, 11 us instead of 9;
`beside`, a slow decay beside the ring; `pink` and `doubled`, as shared, with pink noise (in training, too) or twice that of training. Modes: `labels`, twenty channels a class with sizes;
`3`, `10`, as many signals; `cold`, healthy labels alone; `own`, as `labels` under names of one's own; `6/9`, of six classes alone.
Of each: signals of faults named at .8 or more and right of these, expected calibration error of certainties; of those with the right category the share
that is sized, the share of 50, 80 and 95 % intervals that hold, by which factor all would have to be wider for 95 % to hold, and chi-square over its degrees of freedom
of the truth's rank in tenths of its stated distribution (of independent signals about 1; these share sizes and channels). `--classes`: each class, too."""
import argparse, pathlib, subprocess, sys
from math import erf
import numpy as np
from scipy.linalg import expm
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import run as O
from rec import Rec, write, times, CACHE

N, DT, NOISE, CHANNELS, BURSTS = 128, .78125, 17.6, 60, 400
RATES, HALF = np.array([.056, .111, .016, .080]), np.array([.004, .004, .03, .04])
RANGES = {"EC": (.1, .5), "AB1": (.05, .4), "AB2": (.1, .8), "AB3": (1.2, 5), "PBN": (.05, .7), "BN": (.82, .98),
          "SDN": (1.1, 1.4), "IDN": (1.5, 1.95), "DDN": (2.1, 5)}
KINDS = list(RANGES)
CATEGORY = dict(E="empty_channel", B="blocked_nozzle", P="blocked_nozzle", A="air_bubble")
WORLDS = ["shared", "loss", "meniscus", "powers", "sizes", "pulse", "beside", "pink", "doubled"]
MODES = ["labels", "10", "3", "cold", "own", "6/9"]
UNLABELLED = ["AB2", "BN", "IDN"]


def faulty(rates, kind, s, world):
    a, b, g, d = rates.T
    if world == "sizes":
        s = 1 + .8 * (s - 1) if kind in ("SDN", "IDN", "DDN") else .8 * s
    q = 1 - s
    if world == "powers" and kind in ("PBN", "BN"):
        return np.stack((a, b * q ** .85, g, d / q ** 1.25), 1)
    return np.stack({"EC": (a / q, b / q, .3 * g, .3 * d), "AB1": (a, b / q, g, d), "AB2": (a / (1 + s), b / (1 + s), g, d),
                     "PBN": (a, b * q, g, d / q), "SDN": (a, b, g, d * s)}[dict(AB3="AB2", BN="PBN", IDN="SDN", DDN="SDN").get(kind, kind)], 1)


def decays(rates, spring, pulse=9.):
    a, b, g, d = rates.T
    A = np.zeros((len(a), 4, 4))
    A[:, 0, 1] = A[:, 0, 2] = A[:, 3, 2] = 1
    A[:, 1, 0], A[:, 1, 1], A[:, 2, 0], A[:, 2, 2], A[:, 2, 3] = -a, -g, -b, -d, -spring * b
    x = np.zeros((len(a), 4, 1))
    x[:, 0] = 1
    x = expm(A * 6.) @ (x - expm(A * pulse) @ x)
    step, y = expm(A * DT), np.empty((len(a), N))
    for k in range(N):
        y[:, k] = (x[:, 1] + x[:, 2])[:, 0]
        x = step @ x
    return y


class World:
    def __init__(self, name, seed):
        self.name, self.rng = name, np.random.default_rng([seed, 5])
        self.own = RATES * (1 + self.rng.uniform(-1, 1, (CHANNELS, 4)) * HALF)
        self.gain = 400 / np.abs(self.rings(RATES[None])).max() * (1 + .025 * self.rng.uniform(-1, 1, CHANNELS))

    def rings(self, rates):
        y = decays(rates, .05 * (self.name == "meniscus"), 11. if self.name == "pulse" else 9.)
        slow = np.exp(-.012 * DT * np.arange(N)) * np.abs(y).max(1, keepdims=True)
        return y + .08 * slow * (self.name == "beside")

    def noise(self, shape, kind):
        white = self.rng.standard_normal(shape) * NOISE * (2 if kind == "doubled" else 1)
        if kind != "pink":
            return white
        f = np.fft.rfftfreq(2 * N)
        f[0] = f[1]
        long = np.fft.irfft(np.fft.rfft(self.rng.standard_normal(shape[:-1] + (2 * N,))) / np.sqrt(f))[..., :N]
        return long * NOISE / long.std()

    def recording(self, night, kind, faults):
        """`faults`: (channel, bursts, class, size)"""
        y = np.repeat((self.rings(self.own) * self.gain[:, None])[None], BURSTS, 0)
        for ch, at, name, s in faults:
            rates = faulty(self.own[ch:ch + 1], name, s, self.name)
            lost = np.tanh(np.abs(np.log(rates / self.own[ch])).max() / .3) * (self.name == "loss")
            y[at, ch] = self.rings(rates * (1 + .15 * lost * np.array([0, 0, 1, 1])))[0] * self.gain[ch]
        y = y * (1 + .004 * self.rng.standard_normal((BURSTS, CHANNELS, 1)))
        raw = np.rint(y + self.noise(y.shape, kind)).astype("<i2")
        r = Rec("p", raw, times(BURSTS, .1, night), np.zeros(raw.shape[:2], np.int8))
        r.period = DT * 1e-6
        return r

    def faults(self, step):
        """each class on two channels, another size every `step` bursts of the second half"""
        out = []
        for j, at in enumerate(np.arange(BURSTS // 2, BURSTS, step)):
            for i, name in enumerate(KINDS * 2):
                low, high = RANGES[name]
                out.append(((3 * i + 1 + 7 * j) % CHANNELS, slice(at, at + step), name, low + (high - low) * self.rng.random()))
        return out


def rows(taught, t, mode):
    """labels of a mode, one row per fault that was taught"""
    few, seen, out = int(mode) if mode.isdigit() else None, {}, []
    for ch, at, name, s in taught:
        seen[name] = seen.get(name, 0) + 1
        first, end = t[at.start], t[at.stop - 1] + 1
        known = few is None or seen[name] <= few
        label = f"{'my-' * (mode == 'own')}{name},{s:.4f}" if known and not (mode == "6/9" and name in UNLABELLED) else "ignore,"
        if few and known:  # one signal of it
            out.append(f"p,{ch},{first + 1},{end},ignore,")
            end = first + 1
        out.append(f"p,{ch},{first},{end},{label}")
    return [] if mode == "cold" else out


def main():
    ap = argparse.ArgumentParser()
    ap.add_argument("--inkling", required=True)
    ap.add_argument("--seed", type=int, default=1)
    ap.add_argument("--worlds", default=",".join(WORLDS))
    ap.add_argument("--modes", default=",".join(MODES))
    ap.add_argument("--classes", action="store_true")
    a = ap.parse_args()
    binary = pathlib.Path(a.inkling).resolve()
    work = CACHE / "calibrated" / O.digest_of(binary)
    work.mkdir(parents=True, exist_ok=True)
    call = lambda *args: subprocess.run(["nice", str(binary), *map(str, args)], capture_output=True, text=True)
    print(f"{'world':<10}{'mode':<8}{'named':>7}{'right':>7}{'ece':>7}{'sized':>7}{'.50':>7}{'.80':>7}{'.95':>7}{'wider':>7}{'chi2':>7}")
    for world in a.worlds.split(","):
        w = World(world, a.seed)
        taught, asked = w.faults(20), w.faults(10)
        recs = [work / f"{world}-{k}.mcap" for k in ("healthy", "faults", "asked")]
        noise = "pink" if world == "pink" else "white"
        made = [w.recording(0, noise, []), w.recording(1, noise, taught), w.recording(2, world if world == "doubled" else noise, asked)]
        for path, rec in zip(recs, made):
            write(path, rec)
        for mode in a.modes.split(","):
            csv, design = work / "labels.csv", work / "design.json"
            csv.write_text("\n".join(["printhead,channel,from,to,state,severity", "*,*,,,healthy,", *rows(taught, made[1].t, mode), ""]))
            new = [x for k in KINDS if mode == "own" for x in ("--new-class", "my-" + k)]
            done = call("train", *(recs[:1] if mode == "cold" else recs[:2]), "--labels", csv, *new, "-o", design)
            assert done.returncode == 0, done.stderr
            done = call("replay", recs[2], "--design", design, "--identify", "design", "--out", work / "out", "--layout", "flat", "--force")
            assert done.returncode in (0, 3), done.stderr
            told(f"{world:<10}{mode:<8}", O.verdicts(work / "out", recs[2].stem), made[2].t, asked, mode == "own", a.classes)


def told(head, v, t, asked, own, classes):
    burst, channel = np.searchsorted(t, O.col(v, "acquired_at")), O.col(v, "channel").astype(int)
    name, size = np.full((BURSTS, CHANNELS), "", object), np.full((BURSTS, CHANNELS), np.nan)
    for ch, at, k, s in asked:
        name[at, ch], size[at, ch] = "my-" * own + k, s
    name, size = name[burst, channel], size[burst, channel]
    of = lambda c: O.col(v, c).astype(float)
    text = lambda c: np.array([x or "" for x in O.col(v, c)], object)
    category = lambda k: k if own else CATEGORY.get(k[:1], "dried_nozzle")
    true, faulty = np.array([category(k) for k in name], object), text("outcome") == "faulty"
    flagged = faulty | (text("outcome") == "undecided")
    sure, z = of("certainty"), (of("severity") - size) / of("severity_sd")
    hit = np.where(text("fault") == "", text("category") == true, text("fault") == name)
    best = flagged & (np.array([category(k) for k in text("candidate")], object) == true)
    for kind in sorted(set(name) - {""}) if classes else [""]:
        line(f"{head}{kind}\n{'':<18}" if kind else head, (name == kind) if kind else name != "", faulty, sure, hit, best, z)
    if classes:
        line(head, name != "", faulty, sure, hit, best, z)


def line(head, of, faulty, sure, hit, best, z):
    named = of & faulty
    bins = np.clip((15 * sure[named]).astype(int), 0, 14)
    off = [(bins == b).sum() * abs((sure - hit)[named][bins == b].mean()) for b in set(bins)]
    right = of & best
    z = z[right & np.isfinite(z)]
    holds = [(np.abs(z) <= q).mean() for q in (.6745, 1.2816, 1.96)] + [np.quantile(np.abs(z), .95) / 1.96] if len(z) else [np.nan] * 4
    ranks = np.histogram(.5 * (1 + np.vectorize(erf)(z / 2 ** .5)), 10, (0, 1))[0] if len(z) else np.zeros(10)
    chi2 = ((ranks - len(z) / 10) ** 2).sum() / (len(z) / 10) / 9 if len(z) else np.nan
    figures = [named.sum() / of.sum(), hit[named].mean() if named.any() else np.nan, sum(off) / max(1, named.sum()), len(z) / max(1, right.sum()), *holds]
    print(head + "".join(f"{x:>7.3f}" for x in figures) + f"{chi2:>7.1f}", flush=True)


if __name__ == "__main__":
    main()
