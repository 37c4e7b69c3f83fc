"""Opens a verdict file with DuckDB, Polars and pyarrow, and its recording with the mcap package."""

import json
import sys

import duckdb
import polars
import pyarrow.parquet as pq
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

verdicts, recording = sys.argv[1:]

table = pq.read_table(verdicts)
document = json.loads(pq.read_metadata(verdicts).metadata[b"inkling"])
assert table.num_rows == document["counts"]["signals"], "pyarrow: rows"
assert str(table.schema.field("acquired_at").type) == "timestamp[ns, tz=UTC]", table.schema

frame = polars.read_parquet(verdicts)
assert frame.height == table.num_rows, "polars: rows"
by_outcome = dict(frame.group_by("outcome").len().iter_rows())

rows = duckdb.sql(
    f"select outcome, count(*) from '{verdicts}' group by outcome"
).fetchall()
assert dict(rows) == {str(k): v for k, v in by_outcome.items()}, (rows, by_outcome)
since = duckdb.sql(
    f"select printhead, channel, fault, min(acquired_at) from '{verdicts}' "
    "where outcome = 'faulty' group by all having count(*) > 5 order by all"
).fetchall()
assert since, "DuckDB finds no lasting fault in the sample"

episodes = verdicts.replace(".verdicts.", ".episodes.")
rows = pq.read_table(episodes)
assert json.loads(pq.read_metadata(episodes).metadata[b"inkling"])["recording"] == document["recording"]
assert polars.read_parquet(episodes).height == rows.num_rows > 0, "polars: episodes"
on = duckdb.sql(f"select count(*) from '{episodes}' where ended_at is null").fetchall()
assert on == [(rows["ended_at"].null_count,)], (on, rows["ended_at"].null_count)

signals = bursts = 0
with open(recording, "rb") as file:
    reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
    for schema, channel, message, burst in reader.iter_decoded_messages():
        assert schema.name == "inkling.Burst" and schema.encoding == "protobuf", schema
        assert channel.topic == f"/printhead/{burst.printhead}/bursts", channel.topic
        assert len(burst.samples) == 2 * burst.channels * burst.samples_per_channel
        signals += burst.channels
        bursts += 1
assert (bursts, signals) == (document["counts"]["bursts"], document["counts"]["signals"])

print(f"{signals} signals: DuckDB {duckdb.__version__}, Polars {polars.__version__}, "
      f"pyarrow {pq.__name__.split('.')[0]} and mcap agree; {by_outcome}")
