"""What a fleet costs. `fleet.py INKLING INKLING_FLEET DESIGN LARGE TINY WORKDIR`: of LARGE, a directory of recordings of
50 MB and more, two executors of one slot against one process with two threads, in turn; of TINY, one small recording
under many names, what a recording costs beyond being judged."""

import json
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import time

inkling, inkling_fleet = (str(pathlib.Path(p).resolve()) for p in sys.argv[1:3])
design, large, tiny, work = (pathlib.Path(p).resolve() for p in sys.argv[3:7])
TURNS = 5
work.mkdir(parents=True, exist_ok=True)


def start(*arguments):
    return subprocess.Popen([inkling_fleet, *map(str, arguments)], stdout=subprocess.PIPE, text=True, cwd="/")


scheduler = start("scheduler", "--bind", "127.0.0.1:0")
at = scheduler.stdout.readline().split()[-1]
executors = [start("executor", "--scheduler", at, "--slots", 1, "--threads", 1, "--root", "/") for _ in range(2)]
for executor in executors:
    executor.stdout.readline()


def cpu(process):
    """s of it so far."""
    user, system = pathlib.Path(f"/proc/{process.pid}/stat").read_text().rsplit(") ", 1)[1].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def timed(program, *arguments):
    """Wall and CPU seconds of a run into a directory of its own; its journal."""
    out = work / "out"
    shutil.rmtree(out, ignore_errors=True)
    fleet = [scheduler, *executors]
    before, began, children = sum(map(cpu, fleet)), time.monotonic(), os.times()
    command = [*program, *map(str, arguments), "--design", str(design), "--out", str(out)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    wall, after = time.monotonic() - began, os.times()
    of_client = after.children_user + after.children_system - children.children_user - children.children_system
    lines = [json.loads(line) for line in (out / "journal.jsonl").read_text().splitlines()]
    return wall, of_client + sum(map(cpu, fleet)) - before, lines


alone = [inkling, "--quiet", "replay"]
submit = [inkling_fleet, "--quiet", "submit", "--scheduler", at]
try:
    recordings = sorted(large.rglob("*.mcap"))
    megabytes = sum(f.stat().st_size for f in recordings) / 1e6
    print(f"{len(recordings)} recordings, {megabytes / len(recordings):.0f} MB each; wall s (CPU s)")
    print(f"{'one process, 2 threads':>24} {'two executors':>16} {'rate over rate':>15}")
    ratios = []
    for _ in range(TURNS):
        wall, of, _ = timed(alone, large, "--threads", 2)
        wall_fleet, of_fleet, _ = timed(submit, large)
        ratios.append(wall / wall_fleet)
        print(f"{wall:>15.1f} ({of:>5.1f}) {wall_fleet:>8.1f} ({of_fleet:>5.1f}) {ratios[-1]:>15.2f}", flush=True)
    print(f"median {statistics.median(ratios):.2f}, {megabytes / wall_fleet:.0f} MB/s")
    print(f"{'tiny recordings':>16} {'here s':>7} {'fleet s':>8} {'judging s':>10} {'ms a recording beyond judging':>30} {'CPU ms':>7}")
    for many in (1, 200, 2000):
        names = work / f"tiny-{many}"
        for k in range(many):
            name = names / f"{k % 20:02}" / f"{k}.mcap"
            name.parent.mkdir(parents=True, exist_ok=True)
            name.exists() or shutil.copy(tiny, name)
        here, of, _ = timed(alone, names, "--threads", 2)
        wall, of_fleet, lines = timed(submit, names)
        judging = sum(line["seconds"] for line in lines)
        beyond = 1000 * (wall - judging / 2) / many
        print(f"{many:>16} {here:>7.1f} {wall:>8.1f} {judging:>10.1f} {beyond:>30.1f} {1000 * (of_fleet - of) / many:>7.1f}", flush=True)
finally:
    for process in [scheduler, *executors]:
        process.kill()
        process.wait()
