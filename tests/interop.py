"""Opens a verdict file with DuckDB, Polars and pyarrow, its recording and annotations with the mcap
package, and runs the queries of the docs (`docs/formats.md`)."""

import json
import os
import re
import sys

import duckdb
import polars
import pyarrow.parquet as pq
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

verdicts, recording, annotations, page = sys.argv[1:]

page_text = open(page).read()
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

# what viewers of annotated recordings read
found = {}
with open(annotations, "rb") as file:
    for schema, channel, message, decoded in make_reader(
        file, validate_crcs=True, decoder_factories=[DecoderFactory()]
    ).iter_decoded_messages():
        found.setdefault(schema.name, []).append(decoded)
assert set(found) == {"foxglove.Log", "foxglove.CompressedImage", "inkling.ChannelState"}, set(found)
assert all(image.format == "png" and image.data[:4] == b"\x89PNG" for image in found["foxglove.CompressedImage"])
raised = [line for line in found["foxglove.Log"] if line.level == 3]  # WARNING
assert len(raised) == rows.num_rows and all(line.message for line in raised)

# the page's queries, as printed, where the sample's verdicts and report lie
os.chdir(os.path.dirname(os.path.dirname(os.path.abspath(verdicts))))
queries = [q for block in re.findall(r"```sql\n(.*?)```", page_text, re.S) for q in block.split(";") if q.strip()]
assert len(queries) >= 4, queries
for query in queries:
    found = duckdb.sql(query)
    # a view is made; everything else finds rows
    assert "create view" in query or found.fetchall(), query

print(f"{signals} signals: DuckDB {duckdb.__version__}, Polars {polars.__version__}, "
      f"pyarrow {pq.__name__.split('.')[0]} and mcap agree; {by_outcome}")
