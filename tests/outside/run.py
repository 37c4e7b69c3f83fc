#!/usr/bin/env python3
"""Nights and heads that are not what they were: found, and not alarmed at.

    python3 tests/outside/run.py [scenario numbers] --inkling target/release/inkling [--seed 1] [--seeds 2]

By the design of labels and by windows; `+b`: with the state after one healthy night, in 2 and 4 with one that begins with
no file. FA/std: flagged share of healthy signals over the stated one; recall: of faulty ones; falseEp: episodes of a
channel that was healthy for the 60 bursts before; found: faulty channels (per recording) with an episode that was raised
while they were faulty.
"""
from collections import Counter
import numpy as np
import head as H
from lab import Lab, asked

STATED = 7e-4
MODES = ["design", "design+b", "windows", "windows+b"]


def judged(lab, kind, recs, later=0, fresh=False, note=None):
    """A row for each mode. `later`: bursts count from this one on; `fresh`: a state begins with these recordings."""
    for mode in MODES:
        how, has_state = mode.removesuffix("+b"), mode.endswith("+b")
        state = lab.state("labels", how) if has_state and not fresh else None
        if has_state and fresh:
            state = lab.work / "state.json"
            state.unlink(missing_ok=True)
        lab.replay(recs, "labels", how, state)
        yield kind, mode, sum((counted(lab, rec, later) for rec in recs), Counter()), note() if note else ""


def counted(lab, rec, later):
    """Signals, healthy and faulty ones that are flagged, faulty channels with an episode that was raised while they were
    faulty, and episodes of channels that had been healthy for 60 bursts."""
    v, e = lab.verdicts(rec), lab.episodes(rec)
    burst = np.searchsorted(rec.t, v["acquired_at"])
    counts, found = burst >= later, set()
    faulty, flagged = rec.faulty[burst, v["channel"]][counts], np.isin(v["outcome"], ["faulty", "undecided"])[counts]
    n = Counter(healthy=(~faulty).sum(), alarms=(~faulty & flagged).sum(), faulty=faulty.sum(), hits=(faulty & flagged).sum(),
                channels=rec.faulty[later:].any(0).sum())
    for at, channel in zip(np.searchsorted(rec.t, e["raised_at"]), e["channel"]):
        if rec.faulty[max(0, at - 60):at + 1, channel].any():
            found.update({channel} if at >= later else {})
        else:
            n["false"] += at >= later
    n["found"] = len(found)
    return n


def s1(lab):
    "next night at another temperature or drive, unrecorded"
    on = np.arange(300) >= 150
    for kind, kelvin, gain in [("same", 0, 1), ("+4 K", 4, 1), ("+10 K", 10, 1), ("-6 K", -6, 1),
                               ("gain .9", 0, .9), ("gain 1.1", 0, 1.1)]:
        faults = [(12, on, "SDN", 1.3), (32, on, "BN", .5), (52, on, "AB2", .2)]
        name = f"s1{kind}".replace(" ", "")
        yield from judged(lab, kind, [lab.record(name, 300, kelvin=kelvin, gain=gain, faults=faults)])


def s2(lab):
    "60 short nights, four slow faults from the tenth on: two gross at the end, two to 14 and 16 sds of one signal's noise"
    grow = {7: ("SDN", 1, .018), 23: ("SDN", 1, .002), 41: ("PBN", 0, .0004), 50: ("PBN", 0, .0016)}
    faults = lambda n: [(channel, slice(None), kind, none + slope * n) for channel, (kind, none, slope) in grow.items()]
    recs = [lab.record(f"s2n{k:02}", 40, .2, night=k, faults=faults(k - 9) if k > 9 else []) for k in range(60)]

    def note():
        told = [set(lab.episodes(rec)["channel"]) for rec in recs]
        nights = [next((k - 9 for k in range(10, 60) if channel in told[k]), None) for channel in grow]
        sizes = [f"{kind} {none + 50 * slope:g}" for kind, none, slope in grow.values()]
        return "raised in night " + ", ".join(f"{night} ({size})" for night, size in zip(nights, sizes))
    yield from judged(lab, "growing", recs, fresh=True, note=note)


def s4(lab):
    "slight faults in 5 % of a baseline's first 20 s; the same kind later"
    late, b = [5, 15, 25, 35, 45, 55], np.arange(600)
    for kind in ("clean", "5% signals", "5% channels"):
        name = f"s4{kind[:2]}{kind[3:5]}"
        rng = lab.rng(name)
        faults = [(channel, b >= 300, "SDN", 1.10) for channel in late]
        if kind == "5% signals":
            faults += [(channel, (b < 200) & (rng.random(600) < .05), "SDN", 1.10) for channel in range(60)]
        if kind == "5% channels":
            faults += [(channel, b < 200, "SDN", 1.10) for channel in late[:3]]
        yield from judged(lab, kind, [lab.record(name, 600, faults=faults, rng=rng)], later=210, fresh=True)


def s5(lab):
    "drive changes each minute, unrecorded"
    rng, b = lab.rng("s5"), np.arange(1200)
    gain = np.repeat(rng.permutation([1, .88, 1.08, .94, 1.15])[:4], 300)
    faults = [(8, b > 700, "BN", .5), (30, b > 500, "IDN", 1.8), (50, b > 800, "AB2", .2)]
    yield from judged(lab, "minutes", [lab.record("s5", 1200, .2, gain=gain, faults=faults, rng=rng)])


def aged(lab, amount):
    rng = lab.rng("ageing")
    moves = dict(gain=(-.17, .06), Rn=(.05, .06), B=(.01, .012), Rr=(.0, .08), In=(0, .008))
    factors = {name: np.exp(amount * (mean + sd * rng.standard_normal(60))) for name, (mean, sd) in moves.items()}
    return H.scaled(lab.channels, **factors)


def s6(lab):
    "strong ageing of all channels, each its own way"
    gross = lambda bursts, begin: [(9, np.arange(bursts) >= begin, "BN", .6), (44, np.arange(bursts) >= begin, "AB2", .3)]
    yield from judged(lab, "at once", [lab.record("s6once", 300, night=300, faults=gross(300, 150), channels=aged(lab, 1.0))])
    of_night = lambda k: dict(night=20 * k, faults=gross(100, 50) if k == 16 else [], channels=aged(lab, k / 16))
    yield from judged(lab, "16 nights", [lab.record(f"s6n{k:02}", 100, **of_night(k)) for k in range(1, 17)])


def s16(lab):
    "40, 60, 100 % of the channels faulty alike from a burst on"
    for kind, size, share in [("SDN", 1.15, .4), ("SDN", 1.15, .6), ("SDN", 1.15, 1.0), ("SDN", 1.5, .4),
                              ("SDN", 1.5, 1.0), ("BN", .4, .6), ("BN", .4, 1.0)]:
        name = f"s16{kind}{size}{share}"
        rng = lab.rng(name)
        faults = [(int(channel), np.arange(600) >= 200, kind, size) for channel in rng.permutation(60)[:int(60 * share)]]
        yield from judged(lab, f"{kind} {size:g} {share:.0%}", [lab.record(name, 600, faults=faults, rng=rng)])


SCENARIOS = {int(name[1:]): of for name, of in list(globals().items()) if name[0] == "s" and name[1:].isdigit()}


def main():
    options = asked(__doc__, seeds=2)
    options.add_argument("scenarios", nargs="*", type=int, default=list(SCENARIOS))
    a = options.parse_args()
    for number in a.scenarios:
        print(f"\n{number}. {SCENARIOS[number].__doc__}\n{'kind':<16}{'mode':<11}FA/std  recall falseEp   found")
        counts, notes = {}, {}
        for seed in range(a.seed, a.seed + a.seeds):
            for kind, mode, n, note in SCENARIOS[number](Lab(a.inkling, seed)):
                counts[kind, mode] = counts.get((kind, mode), Counter()) + n
                notes[kind, mode] = notes.get((kind, mode), []) + [note]
        for (kind, mode), n in counts.items():
            share = lambda k, of: n[k] / n[of] if n[of] else np.nan
            rates = f"{share('alarms', 'healthy') / STATED:>6.2f} {share('hits', 'faulty'):>7.3f}{n['false']:>8}"
            print(f"{kind:<16}{mode:<11}{rates}{n['found']:>5}/{n['channels']:<5} {' || '.join(filter(None, notes[kind, mode]))}", flush=True)


if __name__ == "__main__":
    main()
