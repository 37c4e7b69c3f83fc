"""Runs `inkling replay` on recordings and prints what docs/design/streaming.md holds, one line each.

    python benches/run.py INKLING DESIGN RECORDING... [-- replay options]

Per recording the median of three runs: wall and CPU-seconds, signals per CPU-second, times production
rate on all cores (1,000,000 signals/s), peak anonymous memory (RssAnon), size per million rows.
"""

import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

args = sys.argv[1:]
options = args[args.index("--") + 1:] if "--" in args else []
inkling, design, *recordings = args[:args.index("--")] if "--" in args else args
RUNS = 3


def rss_anon_kb(pid):
    try:
        with open(f"/proc/{pid}/status") as status:
            return next((int(l.split()[1]) for l in status if l.startswith("RssAnon")), 0)
    except FileNotFoundError:
        return 0


def run(recording, out):
    started = time.perf_counter()
    command = [inkling, "replay", recording, "--design", design, "--out", out, "--force", *options]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    peak = 0
    while True:
        peak = max(peak, rss_anon_kb(process.pid))
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            break
        time.sleep(0.01)
    assert os.waitstatus_to_exitcode(status) in (0, 3), f"{recording}: status {status}"
    return time.perf_counter() - started, usage.ru_utime + usage.ru_stime, peak



print(f"{'recording':16} {'signals':>9} {'wall s':>7} {'CPU s':>7} {'M/CPU-s':>8} {'x prod.':>8} "
      f"{'RssAnon MB':>10} {'MB/Mrow':>8}")
for recording in recordings:
    with tempfile.TemporaryDirectory() as out:
        runs = [run(recording, out) for _ in range(RUNS)]
        stem = pathlib.Path(recording).stem
        summary = json.load(open(f"{out}/{stem}.summary.json"))
        size = os.path.getsize(f"{out}/{stem}.verdicts.parquet")
    signals = summary["counts"]["signals"]
    wall, cpu, peak = (statistics.median(r[i] for r in runs) for i in range(3))
    print(f"{stem:16} {signals:9} {wall:7.2f} {cpu:7.2f} {signals / cpu / 1e6:8.2f} "
          f"{signals / wall / 1e6:8.2f} {peak / 1024:10.0f} {size / signals:8.2f}", flush=True)
