"""`Design.judge` of an array against `inkling replay` of the same bursts, in turn: wall and CPU, medians of five.

    python benches/python.py sample_logs/design.json sample_logs/print_run.mcap --signals 2000000

1024 channels a burst: of the recording's healthiest printhead the mean healthy signal with its noise, and 2 % of its flagged signals.
Wants `pip install .`, `mcap` and `mcap-protobuf-support`; the command is the installed one.
"""

import argparse
import resource
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import inkling
import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_protobuf.decoder import DecoderFactory

CHANNELS = 1024


def recorded(path):
    """Bursts of a recording by printhead, the schema, and a message to write others by."""
    reader = make_reader(open(path, "rb"), decoder_factories=[DecoderFactory()])
    by_head = {}
    for schema, _, _, burst in reader.iter_decoded_messages():
        rows = np.frombuffer(burst.samples, "<i2").reshape(burst.channels, burst.samples_per_channel)
        by_head.setdefault(burst.printhead, []).append(rows)
    return {head: np.stack(of) for head, of in by_head.items()}, schema, burst


def made(design, by_head, signals):
    """Bursts x channels x samples."""
    rng = np.random.default_rng(3)
    judged = {head: design.judge(of, printhead=head)["outcome"].to_pylist() for head, of in by_head.items()}
    head = max(judged, key=lambda head: judged[head].count("healthy"))
    rows, is_healthy = by_head[head].reshape(-1, by_head[head].shape[2]), np.array(judged[head]) == "healthy"
    mean, flagged = np.median(rows[is_healthy], axis=0), rows[~is_healthy]
    noise = np.median(np.abs(rows[is_healthy] - mean)) / 0.6745
    samples = np.empty((signals // CHANNELS, CHANNELS, rows.shape[1]), np.int16)
    for burst in samples:
        burst[:] = np.rint(mean + noise * rng.standard_normal(burst.shape, dtype=np.float32))
        faulty = rng.random(CHANNELS) < 0.02
        burst[faulty] = flagged[rng.integers(0, len(flagged), faulty.sum())]
    return samples


def write(path, samples, schema, burst):
    with open(path, "wb") as out:
        writer = Writer(out, compression=CompressionType.NONE, chunk_size=1 << 20)
        writer.start()
        known = writer.register_schema(schema.name, schema.encoding, schema.data)
        channel = writer.register_channel("/printhead/array/bursts", "protobuf", known)
        for unsaid in ["idle_time_s", "neighbours_fired", "temperature_c"]:
            burst.ClearField(unsaid)
        burst.printhead, burst.first_channel, burst.channels = "array", 0, CHANNELS
        for second, of in enumerate(samples):
            burst.timestamp.seconds, burst.timestamp.nanos = second, 0
            burst.samples = of.tobytes()
            writer.add_message(channel, second * 10**9, burst.SerializeToString(), second * 10**9)
        writer.finish()


def timed(work, who):
    """Seconds of wall, and of the processor."""
    before, began = resource.getrusage(who), time.monotonic()
    work()
    took, after = time.monotonic() - began, resource.getrusage(who)
    return took, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("design")
    parser.add_argument("recording")
    parser.add_argument("--signals", type=int, default=2_000_000)
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    by_head, schema, burst = recorded(asked.recording)
    design = inkling.Design.load(asked.design)
    samples = made(design, by_head, asked.signals)
    beside = dict(printhead="array", voltage_v=burst.drive_voltage_v)
    command = Path(sys.executable).with_name("inkling")
    with tempfile.TemporaryDirectory() as here:
        recording = Path(here, "r.mcap")
        write(recording, samples, schema, burst)
        words = [command, "replay", recording, "--design", asked.design, "--out", Path(here, "out"), "--force", "--quiet"]
        replay = lambda: subprocess.run(words, stderr=subprocess.DEVNULL)
        judge = lambda: design.judge(samples, **beside)
        both = [(timed(replay, resource.RUSAGE_CHILDREN), timed(judge, resource.RUSAGE_SELF)) for _ in range(5)]
    flagged = 1 - judge()["outcome"].to_pylist().count("healthy") / (samples.shape[0] * CHANNELS)
    print(f"{flagged:.1%} flagged")
    signals = samples.shape[0] * samples.shape[1]
    for k, what in enumerate(["wall", "CPU"]):
        replayed, judged = (statistics.median(pair[which][k] for pair in both) for which in (0, 1))
        rates = [signals / seconds / 1e6 for seconds in (replayed, judged)]
        print(f"{what}: replay {rates[0]:.2f}, judge {rates[1]:.2f} million signals/s: {rates[1] / rates[0]:.2f}")


main()
