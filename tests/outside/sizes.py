#!/usr/bin/env python3
"""Sizes from outside: how many 95 % intervals hold, where the physics is shared and where it is not, and what noise does.

    python3 tests/outside/sizes.py --inkling target/release/inkling [--seed 1]

Channels by thesis (2-2), integrated here. A design of labelled faults with sizes, or of healthy labels alone (`cold`); judged by the
design or by windows. Worlds: `shared`; `loss`, a fault adds 15 % to what (2-2) loses; `meniscus`, a spring of 5 % of b. Noise: white;
`pink`, of the same variance, in training, too; `doubled`, white, twice as much as in training. Of each: signals named right, of these
sized, and the share of 95 % intervals that hold the truth, over all classes and in the worst."""
import argparse, pathlib, subprocess, sys
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
WORLDS, NOISES = ["shared", "loss", "meniscus"], ["white", "pink", "doubled"]


def faulty(rates, kind, s):
    a, b, g, d = rates.T
    q = 1 - s
    return np.stack({"EC": (a / q, b / q, .3 * g, .3 * d), "AB1": (a, b / q, g, d), "AB2": (a / (1 + s), b / (1 + s), g, d),
                     "PBN": (a, b * q, g, d / q), "SDN": (a, b, g, d * s)}[dict(AB3="AB2", BN="PBN", IDN="SDN", DDN="SDN").get(kind, kind)], 1)


def decays(rates, spring):
    a, b, g, d = rates.T
    A = np.zeros((len(a), 4, 4))
    A[:, 0, 1] = A[:, 0, 2] = A[:, 3, 2] = 1
    A[:, 1, 0], A[:, 1, 1], A[:, 2, 0], A[:, 2, 2], A[:, 2, 3] = -a, -g, -b, -d, -spring * b
    x = np.zeros((len(a), 4, 1))
    x[:, 0] = 1
    x = expm(A * 6.) @ (x - expm(A * 9.) @ x)
    step, y = expm(A * DT), np.empty((len(a), N))
    for k in range(N):
        y[:, k] = (x[:, 1] + x[:, 2])[:, 0]
        x = step @ x
    return y


class World:
    def __init__(self, name, seed):
        self.rng, self.loss, self.spring = np.random.default_rng([seed, 5]), .15 * (name == "loss"), .05 * (name == "meniscus")
        self.own = RATES * (1 + self.rng.uniform(-1, 1, (CHANNELS, 4)) * HALF)
        self.gain = 400 / np.abs(decays(RATES[None], self.spring)).max() * (1 + .025 * self.rng.uniform(-1, 1, CHANNELS))

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
        y = np.repeat((decays(self.own, self.spring) * self.gain[:, None])[None], BURSTS, 0)
        for ch, at, name, s in faults:
            rates = faulty(self.own[ch:ch + 1], name, s)
            lost = np.tanh(np.abs(np.log(rates / self.own[ch])).max() / .3)
            rates = rates * (1 + self.loss * lost * np.array([0, 0, 1, 1]))
            y[at, ch] = decays(rates, self.spring)[0] * self.gain[ch]
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


def main():
    ap = argparse.ArgumentParser()
    ap.add_argument("--inkling", required=True)
    ap.add_argument("--seed", type=int, default=1)
    ap.add_argument("--white", action="store_true", help="white noise alone")
    a = ap.parse_args()
    binary = pathlib.Path(a.inkling).resolve()
    work = CACHE / "sizes" / O.digest_of(binary)
    work.mkdir(parents=True, exist_ok=True)
    call = lambda *args: subprocess.run(["nice", str(binary), *map(str, args)], capture_output=True, text=True)
    print(f"{'world, noise':<20}" + "".join(f"{m:<44}" for m in ("labels", "labels, windows", "cold")))
    for world in WORLDS:
        for noise in NOISES:
            if noise != "white" and (world != "shared" or a.white):
                continue
            w = World(world, a.seed)
            taught, asked = w.faults(20), w.faults(10)
            trained = "white" if noise == "doubled" else noise
            recs = [work / f"{world}-{noise}-{k}.mcap" for k in ("healthy", "faults", "asked")]
            made = [w.recording(0, trained, []), w.recording(1, trained, taught), w.recording(2, noise, asked)]
            for path, rec in zip(recs, made):
                write(path, rec)
            t = made[1].t
            span = lambda at: f"{t[at.start]},{t[at.stop - 1] + 1}"
            rows = [f"p,{ch},{span(at)},{name},{s:.4f}" for ch, at, name, s in taught]
            head = "printhead,channel,from,to,state,severity\n*,*,,,healthy,\n"
            cells = []
            for mode in ("labels", "windows", "cold"):
                csv, design = work / f"{mode}.csv", work / f"{world}-{noise}-{'cold' if mode == 'cold' else 'labels'}.json"
                if mode != "windows":
                    csv.write_text(head + ("" if mode == "cold" else "\n".join(rows) + "\n"))
                    done = call("train", *(recs[:1] if mode == "cold" else recs[:2]), "--labels", csv, "-o", design)
                    assert done.returncode == 0, done.stderr
                how = "windows" if mode == "windows" else "design"
                done = call("replay", recs[2], "--design", design, "--identify", how, "--out", work / "out", "--layout", "flat", "--force")
                assert done.returncode in (0, 3), done.stderr
                cells.append(told(O.verdicts(work / "out", recs[2].stem), made[2].t, asked))
            print(f"{world + ', ' + noise:<20}" + "".join(f"{c:<44}" for c in cells), flush=True)


def told(v, t, asked):
    burst, channel = np.searchsorted(t, O.col(v, "acquired_at")), O.col(v, "channel").astype(int)
    name, size = np.empty((BURSTS, CHANNELS), object), np.full((BURSTS, CHANNELS), np.nan)
    for ch, at, k, s in asked:
        name[at, ch], size[at, ch] = k, s
    name, size = name[burst, channel], size[burst, channel]
    of = lambda c: O.col(v, c).astype(float)
    outcome, category, found, sd = O.col(v, "outcome").astype(str), O.col(v, "category"), of("severity"), of("severity_sd")
    named = right = sized = held = 0
    worst = (1.0, "")
    for k in KINDS:
        i = (name == k) & (outcome == "faulty")
        r = i & (category == CATEGORY.get(k[0], "dried_nozzle"))
        z = r & np.isfinite(found)
        holds = np.abs(found - size)[z] <= 1.96 * sd[z]
        named, right, sized, held = named + i.sum(), right + r.sum(), sized + z.sum(), held + holds.sum()
        if z.sum() >= 50:
            worst = min(worst, (holds.mean(), k))
    share = lambda p, q: p / q if q else np.nan
    return f"right {share(right, named):.3f} sized {sized} hold {share(held, sized):.3f} worst {worst[0]:.2f} {worst[1]}"


if __name__ == "__main__":
    main()
