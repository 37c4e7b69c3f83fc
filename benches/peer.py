"""What a user would write instead: mcap, a numpy matrix product and pyarrow; detection only.

    python benches/peer.py DESIGN RECORDING OUT.parquet

Prints one line: signals, CPU-seconds, signals per CPU-second, signals above the threshold. The filter
is the matrix F of r = F d (float32, as numpy is fastest), the energy dt |F d|^2.
"""

import json
import sys
import time

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

design_path, recording, out = sys.argv[1:]
design = json.load(open(design_path))
models = {m["printhead"]: m for m in design["models"]}
n, reference_v = design["samples"], design["drive_voltage_v"]


def filter_matrix(generator):
    b, a = generator["numerator"], generator["denominator"]
    h = np.zeros(n)
    for k in range(n):
        h[k] = (b[k] if k < len(b) else 0.0) - sum(
            a[j] * h[k - j] for j in range(1, min(k, len(a) - 1) + 1)
        )
    return np.array([[h[i - j] if i >= j else 0.0 for j in range(n)] for i in range(n)])


for m in models.values():
    m["F_T"] = filter_matrix(m["generator"]).T.astype(np.float32)
    m["y"] = np.array(m["expected"], dtype=np.float32)

schema = pa.schema([
    ("acquired_at", pa.timestamp("ns", "UTC")), ("printhead", pa.dictionary(pa.int32(), pa.string())),
    ("channel", pa.uint32()), ("outcome", pa.dictionary(pa.int32(), pa.string())),
    ("statistic", pa.float32()), ("threshold", pa.float32()), ("model", pa.uint16()),
])
started, wall = time.process_time(), time.perf_counter()
signals = passed = 0
rows = []
with open(recording, "rb") as file, pq.ParquetWriter(out, schema, compression="zstd") as writer:

    def flush():
        t, name, first, energies, thresholds = zip(*rows)
        lengths = [len(e) for e in energies]
        energy = np.concatenate(energies)
        threshold = np.repeat(np.array(thresholds, np.float32), lengths)
        names, codes = np.unique(np.array(name), return_inverse=True)
        channel = np.concatenate([np.arange(f, f + k, dtype=np.uint32) for f, k in zip(first, lengths)])
        faulty = energy > threshold
        writer.write_table(pa.table([
            pa.array(np.repeat(np.array(t, np.int64), lengths)).cast(pa.timestamp("ns", "UTC")),
            pa.DictionaryArray.from_arrays(np.repeat(codes, lengths).astype(np.int32), names.tolist()),
            channel,
            pa.DictionaryArray.from_arrays(faulty.astype(np.int32), ["healthy", "undecided"]),
            energy, threshold, np.zeros(len(energy), np.uint16),
        ], schema=schema))
        rows.clear()
        return int(faulty.sum())

    waiting = 0
    reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
    for _, _, _, burst in reader.iter_decoded_messages(log_time_order=False):
        model = models[burst.printhead]
        y = np.frombuffer(burst.samples, "<f4" if burst.format else "<i2")
        y = y.reshape(n, -1).T if burst.layout else y.reshape(-1, n)
        drive = np.float32(burst.drive_voltage_v / reference_v if reference_v else 1.0)
        r = (y - drive * model["y"]) @ model["F_T"]
        energy = np.float32(design["sample_period_s"]) * np.einsum("ij,ij->i", r, r)
        t = burst.timestamp
        rows.append((t.seconds * 10**9 + t.nanos, burst.printhead, burst.first_channel, energy,
                     model["threshold"]["value"]))
        signals += burst.channels
        waiting += burst.channels
        if waiting >= 1 << 18:
            passed += flush()
            waiting = 0
    if rows:
        passed += flush()
cpu, wall = time.process_time() - started, time.perf_counter() - wall
print(f"peer: {signals} signals, {cpu:.2f} CPU-s, {wall:.2f} s, {signals / cpu / 1e6:.3f} M/CPU-s, "
      f"{passed} above the threshold")
