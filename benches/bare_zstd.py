"""CPU-seconds of nothing but decompressing a recording's chunks: what zstd alone costs.

    python benches/bare_zstd.py RECORDING
"""

import sys
import time

import zstandard
from mcap.stream_reader import StreamReader
from mcap.records import Chunk

with open(sys.argv[1], "rb") as file:
    chunks = [
        (r.data, r.uncompressed_size)
        for r in StreamReader(file, emit_chunks=True).records
        if isinstance(r, Chunk) and r.compression == "zstd"
    ]
decoder = zstandard.ZstdDecompressor()
started, size = time.process_time(), 0
for data, uncompressed_size in chunks:
    size += len(decoder.decompress(data, max_output_size=uncompressed_size))
spent = time.process_time() - started
print(f"bare zstd: {size} bytes in {spent:.2f} CPU-s, {size / spent / 1e6:.0f} MB/CPU-s")
