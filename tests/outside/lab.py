"""Recordings of the printhead `black-1` and what inkling makes of them, for the programmes beside it.

They measure and assert nothing; figures in docs/design come from them. They need numpy, scipy, pyarrow and mcap;
recordings lie in target/outside. All is a function of the seed; nothing that is unrecorded is in the messages.
One signal tells frequency to .044 %, damping to .55 %, amplitude to .97 %; channels differ for good by .38, 1.1, 1.2 %.
"""
import argparse, hashlib, pathlib, shutil, subprocess
from collections import namedtuple
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from google.protobuf import descriptor_pb2, message_factory
from mcap.writer import CompressionType, Writer
import head as H

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCHEMA = (ROOT / "crates/inkling-io/src/wire/burst.fds").read_bytes()
Burst = message_factory.GetMessages(descriptor_pb2.FileDescriptorSet.FromString(SCHEMA).file)["inkling.Burst"]
EPOCH, DAY = 1_767_643_200_000_000_000, 86_400_000_000_000  # 2026-01-05 20:00 UTC; ns
NOISE = 11.0
# labelled faults: each on two channels, its size going through its range
CLASSES = [("EC", .05, .4), ("BN", .35, .9), ("PBN", .05, .35), ("SDN", 1.1, 1.6), ("IDN", 1.6, 2.5), ("DDN", 2.5, 5.0),
           ("AB1", .05, .5), ("AB2", .05, .6), ("AB3", .6, 3.0)]
STEPS = 10
# by the first letter of a class; of the others dried nozzles
CATEGORIES = dict(E="empty_channel", B="blocked_nozzle", P="blocked_nozzle", A="air_bubble")
HEADER = "printhead,channel,from,to,state,severity\n"
# where a recording is, the times of its bursts, and whether each (burst, channel) is faulty
Rec = namedtuple("Rec", "path t faulty")


def asked(doc, **more):
    """The options that all programmes have, and more: a default for each name."""
    options = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in dict(inkling=str(ROOT / "target/release/inkling"), seed=1, **more).items():
        options.add_argument(f"--{name}", default=default, type=type(default))
    return options


def written(path, t, raw, period_us):
    """A recording of these bursts x channels x samples."""
    with open(path, "wb") as f:
        writer = Writer(f, compression=CompressionType.NONE)
        writer.start(profile="", library="outside")
        schema = writer.register_schema(name="inkling.Burst", encoding="protobuf", data=SCHEMA)
        channel = writer.register_channel("/printhead/black-1/bursts", "protobuf", schema)
        for ns, samples in zip(t.tolist(), raw):
            burst = Burst(printhead="black-1", channels=len(samples), samples_per_channel=samples.shape[1],
                          sample_period_s=period_us * 1e-6, samples=samples.tobytes())
            burst.timestamp.seconds, burst.timestamp.nanos = divmod(ns, 1_000_000_000)
            writer.add_message(channel, ns, burst.SerializeToString(), ns)
        writer.finish()


class Lab:
    """A head of 60 channels that differ for good, and the inkling that judges it."""

    def __init__(self, binary, seed):
        self.binary, self.seed = pathlib.Path(binary).resolve(), seed
        self.work = ROOT / f"target/outside/{seed}"
        shutil.rmtree(self.work, ignore_errors=True)
        self.work.mkdir(parents=True)
        self.channels = H.healthy(self.rng("head"), 60)

    def rng(self, name):
        """Independent numbers for each use of the seed."""
        salt = hashlib.sha256(repr((name,)).encode()).digest()[:6]
        return np.random.default_rng([self.seed, int.from_bytes(salt, "little")])

    def call(self, *args):
        ended = subprocess.run([self.binary, *map(str, args)], capture_output=True, text=True, cwd=self.work)
        assert ended.returncode in (0, 3, 4), f"{args}: {ended.stderr}"

    def record(self, name, bursts, every_s=.1, night=1, kelvin=0, gain=1.0, faults=(), channels=None, altered=None, rng=None):
        """`kelvin`: off nominal; `gain`: of all or each burst; `faults`: (channel, which bursts, class, size);
        `altered`: what becomes of the waves."""
        rng = self.rng(name) if rng is None else rng
        channels = self.channels if channels is None else channels
        # a printer is not a metronome
        t = np.arange(bursts) * int(every_s * 1e9) + rng.integers(0, int(every_s * 2e8), bursts) + EPOCH + night * DAY
        decay = lambda p: H.waves(H.warm(p, kelvin))
        y = np.repeat(decay(channels)[None], bursts, 0)
        faulty = np.zeros(y.shape[:2], bool)
        for channel, which, kind, size in faults:
            y[which, channel] = decay(H.fault(channels[channel:channel + 1], kind, size))
            faulty[which, channel] = True
        # drops differ in amplitude by a hundredth
        y *= (1 + .01 * rng.standard_normal(faulty.shape + (1,))).astype(np.float32)
        y *= np.broadcast_to(np.asarray(gain, np.float32), bursts)[:, None, None]
        y = altered(y) if altered else y
        y += NOISE * rng.standard_normal(y.shape, dtype=np.float32)
        path = self.work / f"{name}.mcap"
        written(path, t, np.rint(y).astype("<i2"), H.DT)
        return Rec(path, t, faulty)

    def design(self, kind):
        """Learned from labels: of faults, too, or (`cold`) of healthy signals alone."""
        path = self.work / f"{kind}.json"
        if not path.exists():
            healthy, rows = self.record("train1", 400, night=-9), []
            part = (np.arange(400) - 200) // (200 // STEPS)  # -10 to 9: the first half is healthy
            faults = [(3 * i + 1, part == j, kind, low + (high - low) * ((j + .25 + .5 * (i > 8)) / STEPS))
                      for i, (kind, low, high) in enumerate(2 * CLASSES) for j in range(STEPS)]
            faulty = self.record("train2", 400, night=-8, faults=faults)
            for channel, which, state, size in faults if kind == "labels" else ():
                t = faulty.t[which]
                rows.append(f"black-1,{channel},{t[0]},{t[-1] + 1},{state},{size:.4f}\n")
            labels = self.work / f"{kind}.csv"
            labels.write_text(HEADER + "black-1,*,,,healthy,\n" + "".join(rows))
            recordings = [healthy.path, faulty.path] if kind == "labels" else [healthy.path]
            self.call("train", *recordings, "--labels", labels, "-o", path)
        return path

    def state(self, kind, how):
        """A copy of the state after one healthy night."""
        kept = self.work / f"state-{kind}-{how}.json"
        if not kept.exists():
            self.replay([self.record("night0", 300, night=0)], kind, how, kept)
        return shutil.copy(kept, self.work / "state.json")

    def replay(self, recs, kind, how, state=None):
        shutil.rmtree(self.work / "out", ignore_errors=True)
        baseline = ["--baseline", state] if state else []
        self.call("replay", *(rec.path for rec in recs), "--design", self.design(kind), "--identify", how, *baseline,
                  "--out", self.work / "out")

    def verdicts(self, rec):
        names = ["acquired_at", "channel", "outcome", "fault", "category", "candidate", "certainty", "severity", "severity_sd"]
        return self.columns(rec, "verdicts", names)

    def episodes(self, rec):
        return self.columns(rec, "episodes", ["raised_at", "began_at", "channel", "fault", "category", "explanation"])

    def columns(self, rec, of, names):
        """Arrays of a recording's table by their names; times in ns."""
        table = pq.read_table(self.work / f"out/{rec.path.stem}.{of}.parquet", columns=names)
        plain = lambda c: c.cast("timestamp[ns]").cast("int64") if pa.types.is_timestamp(c.type) else c
        return {name: np.array(plain(table[name]).to_pylist()) for name in names}
