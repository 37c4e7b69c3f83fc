#!/usr/bin/env python3
"""Names of what no class stands for, and of faults as labelled, on single channels of a healthy head.

    python3 tests/outside/foreign.py --inkling target/release/inkling [--seed 1] [--modes labels,labels+b,cold,cold+b]

By a design of labels, by one of healthy labels alone, and by both with the state after one healthy night (`+b`): the
share of signals that is named at a certainty of .8 or more, with the commonest name and the number of episodes with a
name whose sentence says "or" what is no class; of classes the share of the named ones that has the right category, and
both shares at .99.
"""
from collections import Counter
import numpy as np
import head as H
from lab import CATEGORIES, CLASSES, Lab, asked

BLOCKS, EACH, AT_ONCE = 20, 40, 6
T = np.arange(H.N) * H.DT


def scaled(**ranges):
    """A channel whose elements are multiplied by a number of each range."""
    return lambda p, u: H.waves(H.scaled(p, **{name: low + (high - low) * u for name, (low, high) in ranges.items()}))[0]


def turned(how):
    """The healthy channel's wave, altered."""
    return lambda p, u: how(H.waves(p)[0], u)


def clocked(times):
    return lambda p, u: H.waves(p, H.DT * times)[0]


def late(y, samples):
    return np.concatenate([np.zeros(samples, np.float32), y[:H.N - samples]])


def low_pass(y, corner):
    out, x = np.empty_like(y), 0.0
    for i, v in enumerate(y):
        x += (1 - np.exp(-2 * np.pi * corner * H.DT)) * (v - x)
        out[i] = x
    return out


FOREIGN = {
    "gain 1.25": turned(lambda y, _: 1.25 * y), "gain 1.3": turned(lambda y, _: 1.3 * y), "gain .8": turned(lambda y, _: .8 * y),
    "gain .5 to .9": turned(lambda y, u: (.5 + .4 * u) * y), "gain 1.1 to 2": turned(lambda y, u: (1.1 + .9 * u) * y),
    "inverted": turned(lambda y, _: -y),
    "piezo .7 stiffer": scaled(gain=(.7, .7), B=(.97, .97)),
    "clock 10 % slow": clocked(1 / 1.1), "clock 10 % fast": clocked(1.1), "clock 3 % fast": clocked(1.03),
    "high-pass 20 kHz": turned(lambda y, _: y - late(low_pass(y, .02), 1)),
    "a sample late": turned(lambda y, _: late(y, 1)), "two samples late": turned(lambda y, _: late(y, 2)),
    "wetting": scaled(In=(1.1, 1.4)),
    "wider 15 %": scaled(In=(1 / 1.15, 1 / 1.15), Rn=(1.15 ** -2, 1.15 ** -2), Rs=(1.15 ** -1.5, 1.15 ** -1.5)),
    "stiffer 8 to 20 %": scaled(B=(.8, .92)), "heavier restrictor": scaled(Ir=(1.2, 1.5)),
    "clipped": turned(lambda y, _: np.clip(y, -600, 600)), "echo .3": turned(lambda y, _: y + .3 * late(y, 26)),
    "smoothed": turned(lambda y, _: sum(late(y, j) for j in range(4)) / 4),
    "110 kHz beside": turned(lambda y, _: y + 200 * np.exp(-.015 * T) * np.sin(2 * np.pi * .11 * T)),
    "low-pass 60 kHz": turned(lambda y, _: low_pass(y, .06)),
    "18 samples lost": turned(lambda y, _: np.where((T > 20) & (T < 34), 0, y)),
    "coded in 64s": turned(lambda y, _: np.round(y / 64) * 64),
    "a ramp beside": turned(lambda y, u: y + (100 + 200 * u) * T / T[-1]),
    "neighbour's ring .4": turned(lambda y, _: y + .4 * late(y, 9)), "half the pulse": scaled(act=(.4, .6)),
    "piezo's mode x 5": scaled(k=(5, 5)), "stiff meniscus": scaled(Cm=(.2, .4)),
    "thin ink": scaled(Rr=(.4, .8), Rn=(.4, .8), Rs=(.4, .8), Rc=(.4, .8)), "thin restrictor ink": scaled(Rr=(.3, .6)),
    "wider restrictor": scaled(Ir=(.7, .85), Rr=(.5, .75)), "longer nozzle": scaled(In=(1.1, 1.3), Rn=(1.1, 1.3), Rs=(1.1, 1.3)),
    "stiffer, thicker": scaled(B=(.88, .88), Rr=(1.3, 1.3), Rn=(1.3, 1.3), Rs=(1.3, 1.3)),
    "thick ink": scaled(Rr=(1.15, 1.8), Rn=(1.15, 1.8), Rs=(1.15, 1.8), Rc=(1.15, 1.8)),
    "restrictor, both": scaled(Ir=(1.1, 1.5), Rr=(1.2, 2.2)),
}


def of_class(kind, low, high):
    return lambda p, u: H.waves(H.fault(p, kind, low + (high - low) * u))[0]


KNOWN = {kind: of_class(kind, low, high) for kind, low, high in CLASSES}


def place(block, i, kinds):
    """The channel that the i-th kind is on in a block."""
    return (60 // len(kinds) * i + 3 * block) % 60


def night(lab, kinds, n):
    """A recording in which each of these kinds is on one channel at a time."""
    name = f"foreign{n}"
    rng = lab.rng(name)

    def altered(y):
        for block in range(BLOCKS):
            for i, wave in enumerate(kinds.values()):
                channel = place(block, i, kinds)
                for part in np.array_split(np.arange(EACH * block, EACH * (block + 1)), 4):
                    ring = wave(lab.channels[channel:channel + 1], rng.random())
                    y[part, channel] = ring * (1 + .01 * rng.standard_normal((len(part), 1)).astype(np.float32))
        return y
    return lab.record(name, BLOCKS * EACH, altered=altered, rng=rng)


def told(lab, rec, kinds, mode):
    """Of each kind: its verdicts, and of its episodes with a name whether they tell what it may be as well."""
    design = mode.removesuffix("+b")
    lab.replay([rec], design, "design", lab.state(design, "design") if mode != design else None)
    v, e = lab.verdicts(rec), lab.episodes(rec)
    has_name = (e["fault"] != None) | (e["category"] != None)  # noqa: E711, of each element
    block, began = (np.searchsorted(rec.t, times) // EACH for times in (v["acquired_at"], e["began_at"]))
    for i, kind in enumerate(kinds):
        rows = v["channel"] == place(block, i, kinds)
        own = has_name & (e["channel"] == place(began, i, kinds))
        yield kind, {name: column[rows] for name, column in v.items()}, [" or " in said for said in e["explanation"][own]]


def cell(kind, v, both):
    sure = (v["outcome"] == "faulty") * v["certainty"].astype(float)
    named, certain = sure >= .8, sure >= .99
    if kind not in KNOWN:
        names = Counter(fault or category for fault, category in zip(v["fault"][named], v["category"][named]))
        return f"{named.mean():.3f} {max(names, key=names.get, default='-'):<16}or {sum(both)}/{len(both)}", named, None
    right = v["category"] == CATEGORIES.get(kind[0], "dried_nozzle")
    share = lambda of: f"{of.mean():.3f} {right[of].mean() if of.any() else np.nan:.3f}"
    return f"{share(named)}  at .99 {share(certain)}", named, right


def main():
    a = asked(__doc__, modes="labels,labels+b,cold,cold+b").parse_args()
    lab, modes = Lab(a.inkling, a.seed), a.modes.split(",")
    print(f"{'':<20}" + "".join(f"{mode:<32}" for mode in modes))
    names = list(FOREIGN)
    groups = [{name: FOREIGN[name] for name in names[k:k + AT_ONCE]} for k in range(0, len(names), AT_ONCE)]
    all_named = {mode: [] for mode in modes}
    for n, kinds in [*enumerate(groups), ("known", KNOWN)]:
        rec = night(lab, kinds, n)
        for of_modes in zip(*(told(lab, rec, kinds, mode) for mode in modes)):
            cells = [cell(*of) for of in of_modes]
            print(f"{of_modes[0][0]:<20}" + "".join(f"{text:<32}" for text, _, _ in cells), flush=True)
            for mode, (_, named, right) in zip(modes, cells):
                all_named[mode].append((right is not None, named.mean(), (named & right).mean() if right is not None else 0))
    for what, is_class in (("all foreign", False), ("all classes", True)):
        means = [np.mean([of[1:] for of in all_named[mode] if of[0] == is_class], 0) for mode in modes]
        cells = [f"{named:.3f}" + is_class * f" {right / named:.3f}" for named, right in means]
        print(f"{what:<20}" + "".join(f"{text:<32}" for text in cells))


if __name__ == "__main__":
    main()
