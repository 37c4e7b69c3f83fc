"""Recordings and truth. Everything is a function of its arguments and seed; cached by name."""
import os, pathlib, sys
import numpy as np
sys.path.insert(0, str(pathlib.Path(__file__).parent / "pb"))
from burst_pb2 import Burst
from mcap.writer import Writer, CompressionType
from mcap_protobuf.schema import build_file_descriptor_set
import head as H

EPOCH = 1_767_643_200_000_000_000  # 2026-01-05 20:00 UTC, ns
DAY = 86_400_000_000_000
NOISE = 11.0
CACHE = pathlib.Path(os.environ.get("OUTSIDE_CACHE", "target/outside")).resolve()
HEALTHY, FAULTY, OTHER = 0, 1, 2   # OTHER: altered (inverted, frozen, replaced...): counted apart


class Rec:
    """raw (B, C, N) int16, t (B) ns, truth (B, C), size (B, C) true severity"""

    def __init__(self, name, raw, t, truth, size=None, extra=None):
        self.name, self.raw, self.t, self.truth = name, raw, t, truth
        self.size = np.zeros(truth.shape, np.float32) if size is None else size
        self.extra = extra or {}


def times(bursts, every_s, night=0, rng=None):
    t = np.arange(bursts) * int(every_s * 1e9)
    if rng is not None:  # a printer is not a metronome
        t = t + rng.integers(0, int(every_s * 2e8), bursts)
    return EPOCH + night * DAY + t


def record(rng, params, bursts, every=.1, night=0, name="black-1", T=None, gain=None, faults=(), dt=H.DT,
           period=None, offset=0.0, jitter=.01, noise=NOISE, post=None, truth=None):
    """params (C, P) or (B-less); T (B) kelvin off nominal; gain (B) or (B, C);
    faults: (channel, mask (B), kind, size scalar or (B))."""
    C = len(params)
    t = times(bursts, every, night, rng)
    T = np.zeros(bursts) if T is None else np.asarray(T, float)
    lo = np.floor(T.min() * 2) / 2
    nodes = lo + .5 * np.arange(int(np.ceil((T.max() - lo) * 2 + 1e-9)) + 1)
    at = np.clip(((T - lo) * 2).astype(int), 0, max(len(nodes) - 2, 0))
    w = ((T - lo) * 2 - at).astype(np.float32)

    def decays(p):  # (B, rows, N) for constant parameters
        W = np.stack([H.waves(H.warm(p, k), dt) for k in nodes])
        if len(nodes) == 1:
            return np.broadcast_to(W[0], (bursts,) + W[0].shape)
        return (1 - w)[:, None, None] * W[at] + w[:, None, None] * W[at + 1]

    y = np.array(decays(params), np.float32)
    tr = np.zeros((bursts, C), np.int8)
    size = np.zeros((bursts, C), np.float32)
    for ch, mask, kind, s in faults:
        mask = np.broadcast_to(mask, bursts)
        if np.ndim(s) == 0:
            y[mask, ch] = decays(H.fault(params[ch:ch + 1], kind, s))[mask, 0]
        else:
            i = np.flatnonzero(mask)
            rows = np.concatenate([H.warm(H.fault(params[ch:ch + 1], kind, s[b]), T[b]) for b in i])
            y[i, ch] = H.waves(rows, dt)
        tr[mask, ch] = FAULTY
        size[mask, ch] = s if np.ndim(s) == 0 else np.asarray(s)[mask]
    y *= (1 + jitter * rng.standard_normal((bursts, C, 1))).astype(np.float32)
    if gain is not None:
        gain = np.asarray(gain, np.float32)
        y *= gain[:, None, None] if gain.ndim == 1 else gain[:, :, None]
    if post is not None:
        y = post(y)
    y += noise * rng.standard_normal(y.shape, dtype=np.float32)
    y += offset
    raw = np.clip(np.rint(y), -32768, 32767).astype("<i2")
    if truth is not None:
        tr = truth(tr)
    r = Rec(name, raw, t, tr, size)
    r.period = (H.DT if period is None else period) * 1e-6
    return r


_FDS = build_file_descriptor_set(Burst).SerializeToString()


def write(path, recs, split=None, order=None):
    """recs: Rec or list (several heads); split: channels a message; order: rng to shuffle equal times."""
    recs = recs if isinstance(recs, list) else [recs]
    path.parent.mkdir(parents=True, exist_ok=True)
    tmp = path.with_suffix(".part")
    with open(tmp, "wb") as f:
        wr = Writer(f, compression=CompressionType.NONE, chunk_size=1 << 20)
        wr.start(profile="", library="outside")
        sid = wr.register_schema(name="inkling.Burst", encoding="protobuf", data=_FDS)
        msgs = []
        for r in recs:
            cid = wr.register_channel(topic=f"/printhead/{r.name}/bursts", message_encoding="protobuf", schema_id=sid)
            C = r.raw.shape[1]
            s = split or C
            for b in range(len(r.t)):
                firsts = np.arange(0, C, s)
                if order is not None:
                    order.shuffle(firsts)
                for c in firsts:
                    msgs.append((int(r.t[b]), cid, r, b, int(c), min(s, C - int(c))))
        msgs.sort(key=lambda m: m[0])
        for n, (t, cid, r, b, c, k) in enumerate(msgs):
            m = Burst(printhead=r.name, first_channel=c, channels=k, samples_per_channel=r.raw.shape[2],
                      sample_period_s=r.period, samples=r.raw[b, c:c + k].tobytes())
            m.timestamp.seconds, m.timestamp.nanos = divmod(t, 1_000_000_000)
            wr.add_message(channel_id=cid, log_time=t, publish_time=t, sequence=n, data=m.SerializeToString())
        wr.finish()
    os.replace(tmp, path)
    np.savez(path.with_suffix(".npz"), names=np.array([r.name for r in recs]),
             **{f"t{i}": r.t for i, r in enumerate(recs)}, **{f"truth{i}": r.truth for i, r in enumerate(recs)},
             **{f"size{i}": r.size for i, r in enumerate(recs)})


def truth_of(path):
    z = np.load(path.with_suffix(".npz"))
    return {str(n): (z[f"t{i}"], z[f"truth{i}"], z[f"size{i}"]) for i, n in enumerate(z["names"])}
