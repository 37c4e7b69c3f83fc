"""Simulates how long a night's recordings take on a fleet that is larger than any that was measured, and
prints it for several numbers of executors: `plan.py [--figure FILE.svg] [--recordings N] [--seconds S] ...`.
It needs nothing but Python. fleet/README.md tells what was measured, and what is assumed."""

import argparse
import heapq
import random
import statistics

parser = argparse.ArgumentParser()
parser.add_argument("--recordings", type=int, default=24_000, help="1,000 printers, an hour each")
parser.add_argument("--seconds", type=float, default=119.0, help="of computing a recording takes, on one slot")
parser.add_argument("--spread", type=float, default=0.2, help="of a recording's seconds: sd of their logarithm")
parser.add_argument("--slots", type=int, default=8, help="of an executor")
parser.add_argument("--dispatch", type=float, default=0.005, help="s of the scheduler for a recording; one after another")
parser.add_argument("--stragglers", type=float, default=0.02, help="share of executors that are slow")
parser.add_argument("--slowness", type=float, default=4.0, help="how many times slower they are")
parser.add_argument("--mtbf", type=float, default=24.0, help="h between an executor's failures")
parser.add_argument("--away", type=float, default=300.0, help="s until a failed executor is back")
parser.add_argument("--timeout", type=float, default=30.0, help="s until it is missed")
parser.add_argument("--runs", type=int, default=5)
parser.add_argument("--figure", metavar="FILE.svg")
asked = parser.parse_args()
EXECUTORS = [1, 2, 4, 8, 16, 32, 64, 128, 256, 512]


def hours(executors, stragglers, failures, seed):
    """Hours until the last recording is finished.

    A slot takes the next recording when it is free; nobody knows which recordings take long. If an executor
    fails, its recordings are missed after the timeout, and others take them. The scheduler hands out one
    recording at a time."""
    rng = random.Random(seed)
    slow = [asked.slowness if stragglers and rng.random() < asked.stragglers else 1.0 for _ in range(executors)]
    fails = [rng.expovariate(1 / (asked.mtbf * 3600)) if failures else float("inf") for _ in range(executors)]
    # when each slot is free next, the earliest first
    free = [(0.0, executor, slot) for executor in range(executors) for slot in range(asked.slots)]
    heapq.heapify(free)
    waiting = [(0.0, asked.seconds * rng.lognormvariate(0, asked.spread)) for _ in range(asked.recordings)]
    waiting = waiting[::-1]  # they are taken from the end
    missed = []  # lost recordings: when each is missed, and its seconds; the earliest first
    scheduler, last = 0.0, 0.0
    while waiting or missed:
        now, executor, slot = heapq.heappop(free)
        if missed and (missed[0][0] <= now or not waiting):
            since, seconds = heapq.heappop(missed)
        else:
            since, seconds = waiting.pop()
        scheduler = max(scheduler, now, since) + asked.dispatch
        begun, ends = scheduler, scheduler + seconds * slow[executor]
        back = fails[executor] + asked.away
        if begun > back:  # its last failure is over: draw the next one that is not
            while fails[executor] + asked.away < begun:
                fails[executor] += asked.away + rng.expovariate(1 / (asked.mtbf * 3600))
            back = fails[executor] + asked.away
        if ends > fails[executor]:
            heapq.heappush(missed, (max(begun, fails[executor]) + asked.timeout, seconds))
            heapq.heappush(free, (max(back, begun), executor, slot))
            continue
        last = max(last, ends)
        heapq.heappush(free, (ends, executor, slot))
    return last / 3600


def median(executors, stragglers, failures):
    """Median hours over several runs, each with a seed of its own."""
    return statistics.median(hours(executors, stragglers, failures, seed) for seed in range(asked.runs))


print(f"{asked.recordings} recordings of {asked.seconds:g} s, executors of {asked.slots} slots; hours, median of {asked.runs}")
print(f"{'executors':>9} {'work alone':>11} {'scheduled':>10} {'stragglers':>11} {'and failures':>13} {'efficiency':>11}")
rows = []
for executors in EXECUTORS:
    # work alone: nothing waits, nothing fails; the factor is the mean of the lognormal distribution
    ideal = asked.recordings * asked.seconds * 2.718281828 ** (asked.spread**2 / 2) / (executors * asked.slots) / 3600
    three = [median(executors, *faults) for faults in ((False, False), (True, False), (True, True))]
    rows.append((executors, ideal, *three))
    plain, stragglers, failures = three
    print(f"{executors:>9} {ideal:>11.2f} {plain:>10.2f} {stragglers:>11.2f} {failures:>13.2f} {ideal / failures:>11.2f}")


def figure(path):
    """Finishing time against executors, both on logarithmic axes."""
    import math

    width, height, left, bottom, top, right = 720, 440, 70, 60, 56, 150
    times = [t for row in rows for t in row[1:]]
    low, high = 10 ** math.floor(math.log10(min(times))), 10 ** math.ceil(math.log10(max(times)))
    x = lambda n: left + (width - left - right) * math.log2(n) / math.log2(EXECUTORS[-1])
    y = lambda t: height - bottom - (height - bottom - top) * math.log(t / low) / math.log(high / low)
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="13">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
    ]
    best = next((row[0] for row in rows if row[4] <= 8), None)
    found = f"{best} executors finish the day in a night of 8 h" if best else "no number of executors finishes in 8 h"
    out.append(f'<text x="{left}" y="22" font-size="14" font-weight="bold">{found}, stragglers and failures included</text>')
    of = f"{asked.recordings} recordings of {asked.seconds:g} s, {asked.slots} slots an executor"
    out.append(f'<text x="{left}" y="41" fill="#555">{of}; {asked.stragglers:.0%} of executors {asked.slowness:g} times slower, '
               f"one failure in {asked.mtbf:g} h</text>")
    t = low
    while t <= high:
        out.append(f'<path d="M{left} {y(t):.1f}H{width - right}" stroke="#ddd"/>')
        out.append(f'<text x="{left - 8}" y="{y(t) + 4:.1f}" text-anchor="end">{t:g}</text>')
        t *= 10
    for n in EXECUTORS:
        out.append(f'<text x="{x(n):.1f}" y="{height - bottom + 20}" text-anchor="middle">{n}</text>')
    out.append(f'<path d="M{left} {y(8):.1f}H{width - right}" stroke="#999" stroke-dasharray="4 4"/>')
    out.append(f'<text x="{width - right + 6}" y="{y(8) + 4:.1f}" fill="#555">8 h</text>')
    labels = []
    for column, name, color in ((1, "work alone", "#999"), (2, "scheduled", "#0072b2"), (3, "with stragglers", "#e69f00"),
                                (4, "and failures", "#d55e00")):
        points = " ".join(f"{x(row[0]):.1f},{y(row[column]):.1f}" for row in rows)
        dash = ' stroke-dasharray="2 3"' if column == 1 else ""
        out.append(f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="2"{dash}/>')
        labels.append((y(rows[-1][column]), name, color))
    # labels at the ends of the lines, from the top, at least 16 units apart
    at = float("inf")
    for wanted, name, color in sorted(labels, reverse=True):
        at = min(wanted + 4, at - 16)
        out.append(f'<text x="{width - right + 6}" y="{at:.1f}" fill="{color}">{name}</text>')
    middle = (left + width - right) / 2
    out.append(f'<text x="{middle}" y="{height - 14}" text-anchor="middle">executors</text>')
    out.append(f'<text transform="translate(20 {height / 2}) rotate(-90)" text-anchor="middle">hours until the last recording is finished</text>')
    out.append("</svg>")
    with open(path, "w") as file:
        file.write("\n".join(out) + "\n")


if asked.figure:
    figure(asked.figure)
