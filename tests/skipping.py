"""How long a night takes of which every recording is finished: N tiny recordings of a logger's own JSON are judged once and
then skipped. `python3 tests/skipping.py target/release/inkling 10000`"""
import json, math, pathlib, struct, subprocess, sys, tempfile, time

SETTINGS = """[input]
recordings = ["rec"]
[[input.dialect]]
topic = "/heads/*/burst"
samples = "wave"
channels = 2
period_s = 1e-6
printhead = "{topic.1}"
time = "stamp"
[output]
dir = "out"
"""


def record(op, *fields):
    body = b"".join(fields)
    return struct.pack("<BQ", op, len(body)) + body


def text(of):
    return struct.pack("<I", len(of)) + of.encode()


def recording(number):
    """An MCAP file without chunks: two bursts of two channels."""
    parts = [record(1, text(""), text("skipping")),
             record(4, struct.pack("<HH", 1, 0), text(f"/heads/k{number % 7}/burst"), text("json"), struct.pack("<I", 0))]
    for burst in range(2):
        t_ns = 1_767_643_200_000_000_000 + (number * 60 + burst) * 1_000_000_000
        wave = [round(400 * math.exp(-.03 * i) * math.cos(.4 * i)) + (i * i * 31 + number + channel) % 7
                for channel in range(2) for i in range(64)]
        data = json.dumps({"stamp": t_ns, "wave": wave}).encode()
        parts.append(record(5, struct.pack("<HIQQ", 1, burst, t_ns, t_ns), data))
    parts += [record(15, struct.pack("<I", 0)), record(2, struct.pack("<QQI", 0, 0, 0))]
    return b"\x89MCAP0\r\n" + b"".join(parts) + b"\x89MCAP0\r\n"


def main(inkling, recordings):
    with tempfile.TemporaryDirectory() as where:
        where = pathlib.Path(where)
        (where / "settings.toml").write_text(SETTINGS)
        for number in range(recordings):
            path = where / "rec" / f"{number % 365:03}" / f"{number}.mcap"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(recording(number))
        for night in ("judged", "skipped"):
            began = time.time()
            ended = subprocess.run([pathlib.Path(inkling).resolve(), "replay", "--config", "settings.toml", "--quiet"],
                                   cwd=where, capture_output=True, text=True)
            took = time.time() - began
            totals = json.loads((where / "out" / "run.json").read_text())["totals"]
            print(f"{night}: {took:.2f} s, exit {ended.returncode}, {totals['judged']} judged, {totals['skipped']} skipped")
            assert totals["judged" if night == "judged" else "skipped"] == recordings, ended.stderr


main(sys.argv[1], int(sys.argv[2]))
