#!/usr/bin/env python3
"""Certainties and sizes against the truth, in worlds that share inkling's physics or do not.

    python3 tests/outside/calibrated.py --inkling target/release/inkling [--seed 1] [--worlds shared,loss] [--modes labels,3]

Channels by thesis (2-2), integrated here. Worlds: `shared`; `loss`, a fault adds 15 % to what (2-2) loses; `meniscus`, a
spring of 5 % of b; `powers`, a blockage goes with other powers of the cross-section; `sizes`, faults do .8 of what their
sizes say; `pulse`, 11 us instead of 9; `beside`, a slow decay beside the ring; `pink`, as shared, with pink noise. Modes:
`labels`, twenty channels a class with sizes; `3`, `10`, as many signals; `cold`, healthy labels alone; `own`, as
`labels` under names of one's own; `6/9`, of six classes alone. Of each: signals of faults named at .8 or more and right
of these; of those whose best category is right the share that is sized, and the share of 95 % intervals that hold.
"""
import numpy as np
from scipy.linalg import expm
from lab import CATEGORIES, DAY, EPOCH, HEADER, Lab, Rec, asked, written

N, DT, NOISE, CHANNELS, BURSTS = 128, .78125, 17.6, 60, 400
RATES, HALF = np.array([.056, .111, .016, .080]), np.array([.004, .004, .03, .04])  # a, b, g, d; half-widths, relative
RANGES = {"EC": (.1, .5), "AB1": (.05, .4), "AB2": (.1, .8), "AB3": (1.2, 5), "PBN": (.05, .7), "BN": (.82, .98),
          "SDN": (1.1, 1.4), "IDN": (1.5, 1.95), "DDN": (2.1, 5)}
KINDS, UNLABELLED = list(RANGES), ["AB2", "BN", "IDN"]


def faulty(rates, kind, s, world):
    a, b, g, d = rates
    if world == "sizes":
        s = 1 + .8 * (s - 1) if kind in ("SDN", "IDN", "DDN") else .8 * s
    q = 1 - s
    if world == "powers" and kind in ("PBN", "BN"):
        return np.array([a, b * q ** .85, g, d / q ** 1.25])
    law = dict(EC=(a / q, b / q, .3 * g, .3 * d), AB1=(a, b / q, g, d), AB2=(a / (1 + s), b / (1 + s), g, d),
               PBN=(a, b * q, g, d / q), SDN=(a, b, g, d * s))
    return np.array(law[dict(AB3="AB2", BN="PBN", IDN="SDN", DDN="SDN").get(kind, kind)])


class World:
    def __init__(self, name, lab):
        self.name, self.lab, self.rng = name, lab, np.random.default_rng([lab.seed, 5])
        self.own = RATES * (1 + self.rng.uniform(-1, 1, (CHANNELS, 4)) * HALF)
        self.gain = 400 / np.abs(self.ring(RATES)).max() * (1 + .025 * self.rng.uniform(-1, 1, CHANNELS))

    def ring(self, rates):
        (a, b, g, d), spring, pulse = rates, .05 * (self.name == "meniscus"), 11. if self.name == "pulse" else 9.
        # volume in the chamber, flows through restrictor and nozzle, volume at the meniscus
        A = np.array([[0, 1, 1, 0], [-a, -g, 0, 0], [-b, 0, -d, -spring * b], [0, 0, 1, 0]])
        x = np.array([1., 0, 0, 0])
        x = expm(A * 6.) @ (x - expm(A * pulse) @ x)
        step, y = expm(A * DT), np.empty(N)
        for k in range(N):
            y[k] = x[1] + x[2]
            x = step @ x
        return y + (self.name == "beside") * .08 * np.abs(y).max() * np.exp(-.012 * DT * np.arange(N))

    def noise(self, shape):
        white = self.rng.standard_normal(shape) * NOISE
        if self.name != "pink":
            return white
        f = np.fft.rfftfreq(2 * N)
        f[0] = f[1]
        long = np.fft.irfft(np.fft.rfft(self.rng.standard_normal(shape[:-1] + (2 * N,))) / np.sqrt(f))[..., :N]
        return long * NOISE / long.std()

    def recording(self, night, faults):
        """`faults`: (channel, bursts, class, size)"""
        y = np.repeat((np.stack([self.ring(own) for own in self.own]) * self.gain[:, None])[None], BURSTS, 0)
        for channel, at, kind, size in faults:
            rates = faulty(self.own[channel], kind, size, self.name)
            lost = np.tanh(np.abs(np.log(rates / self.own[channel])).max() / .3) * (self.name == "loss")
            y[at, channel] = self.ring(rates * (1 + .15 * lost * np.array([0, 0, 1, 1]))) * self.gain[channel]
        y = y * (1 + .004 * self.rng.standard_normal((BURSTS, CHANNELS, 1)))
        rec = Rec(self.lab.work / f"{self.name}-{night}.mcap", EPOCH + night * DAY + np.arange(BURSTS) * 100_000_000, None)
        written(rec.path, rec.t, np.rint(y + self.noise(y.shape)).astype("<i2"), DT)
        return rec

    def faults(self, step):
        """Each class on two channels, another size every `step` bursts of the second half."""
        out = []
        for j, at in enumerate(np.arange(BURSTS // 2, BURSTS, step)):
            for i, kind in enumerate(KINDS * 2):
                low, high = RANGES[kind]
                out.append(((3 * i + 1 + 7 * j) % CHANNELS, slice(at, at + step), kind, low + (high - low) * self.rng.random()))
        return out


def labels(taught, t, mode):
    """The rows of a mode for the faults that are taught."""
    few, seen, rows = int(mode) if mode.isdigit() else None, dict.fromkeys(KINDS, 0), []
    for channel, at, kind, size in taught if mode != "cold" else ():
        seen[kind] += 1
        first, end = t[at.start], t[at.stop - 1] + 1
        is_taught = seen[kind] <= few if few else mode != "6/9" or kind not in UNLABELLED
        state = f"{'my-' * (mode == 'own')}{kind},{size:.4f}" if is_taught else "ignore,"
        if few and is_taught:  # one signal of it
            rows.append(f"black-1,{channel},{first + 1},{end},ignore,\n")
            end = first + 1
        rows.append(f"black-1,{channel},{first},{end},{state}\n")
    return HEADER + "*,*,,,healthy,\n" + "".join(rows)


def figures(v, t, asked_for, own):
    """Shares named, right, sized, held."""
    kind, size = np.full((BURSTS, CHANNELS), "", object), np.full((BURSTS, CHANNELS), np.nan)
    for channel, at, name, s in asked_for:
        kind[at, channel], size[at, channel] = "my-" * own + name, s
    at = np.searchsorted(t, v["acquired_at"]), v["channel"]
    category = np.vectorize(lambda kind: kind if own or not kind else CATEGORIES.get(kind[0], "dried_nozzle"), otypes=[object])
    is_fault, true = kind[at] != "", category(kind[at])
    named = is_fault & (v["outcome"] == "faulty")
    right = np.where(v["fault"] == None, v["category"] == true, v["fault"] == kind[at])  # noqa: E711, of each element
    candidate = category(np.where(v["candidate"] == None, "", v["candidate"]))  # noqa: E711
    best = is_fault & np.isin(v["outcome"], ["faulty", "undecided"]) & (candidate == true)
    off = (v["severity"].astype(float) - size[at])[best] / v["severity_sd"].astype(float)[best]
    sized = np.isfinite(off)
    return named.sum() / is_fault.sum(), right[named].mean(), sized.mean(), (np.abs(off[sized]) <= 1.96).mean()


def main():
    worlds, modes = "shared,loss,meniscus,powers,sizes,pulse,beside,pink", "labels,10,3,own,6/9,cold"
    a = asked(__doc__, worlds=worlds, modes=modes).parse_args()
    print(f"{'world':<10}{'mode':<8}  named  right  sized  holds")
    for name in a.worlds.split(","):
        lab = Lab(a.inkling, a.seed)
        world = World(name, lab)
        taught, judged = world.faults(20), world.faults(10)
        healthy, of_faults, rec = world.recording(0, []), world.recording(1, taught), world.recording(2, judged)
        for mode in a.modes.split(","):
            csv = lab.work / "labels.csv"
            csv.write_text(labels(taught, of_faults.t, mode))
            own = [word for kind in KINDS if mode == "own" for word in ("--new-class", "my-" + kind)]
            recordings = [healthy.path] if mode == "cold" else [healthy.path, of_faults.path]
            lab.call("train", *recordings, "--labels", csv, *own, "-o", lab.work / "labels.json")
            lab.replay([rec], "labels", "design")
            told = figures(lab.verdicts(rec), rec.t, judged, mode == "own")
            print(f"{name:<10}{mode:<8}" + "".join(f"{share:>7.3f}" for share in told), flush=True)


if __name__ == "__main__":
    main()
