"""Recordings made by other people's tools from the sample's bursts: judged by a dialect or after a
conversion, their verdicts are those of the sample itself. `others.py INKLING RECORDING DESIGN WORKDIR`."""

import csv
import json
import pathlib
import subprocess
import sys

import numpy
import pyarrow
import pyarrow.parquet as pq
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter
from mcap_protobuf.decoder import DecoderFactory
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros2.writer import Writer as Ros2Writer

inkling, recording, design, work = sys.argv[1:]
work = pathlib.Path(work)
work.mkdir(parents=True, exist_ok=True)


def bursts():
    with open(recording, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, _, message, burst in reader.iter_decoded_messages(log_time_order=False):
            yield message.log_time, burst


def verdicts(name, *options):
    """Judged into a directory of its own, so that the same name is no other recording's."""
    out = work / "out" / pathlib.Path(name).stem
    command = [inkling, "replay", str(name), "--design", design, "--out", str(out), "--force", "--quiet"]
    subprocess.run(command + list(options), check=True)
    return pq.read_table(out / f"{pathlib.Path(name).stem}.verdicts.parquet")


def said(table):
    """Every column but the model's number and the recording's name, as plain values."""
    return table.drop(["model", "recording"]).to_pydict()


# -- the same bursts by other writers

FIELDS = [
    ("head", "string", "TYPE_STRING", "LABEL_OPTIONAL"),
    ("sec", "int32", "TYPE_INT64", "LABEL_OPTIONAL"),
    ("nanosec", "uint32", "TYPE_UINT32", "LABEL_OPTIONAL"),
    ("first", "uint32", "TYPE_UINT32", "LABEL_OPTIONAL"),
    ("channels", "uint32", "TYPE_UINT32", "LABEL_OPTIONAL"),
    ("period", "float64", "TYPE_DOUBLE", "LABEL_OPTIONAL"),
    ("temp_c", "float64", "TYPE_DOUBLE", "LABEL_OPTIONAL"),
    ("volts", "float64", "TYPE_DOUBLE", "LABEL_OPTIONAL"),
    ("idle", "float32[]", "TYPE_FLOAT", "LABEL_REPEATED"),
    ("near", "uint8[]", "TYPE_BYTES", "LABEL_OPTIONAL"),
    ("data", "int16[]", "TYPE_BYTES", "LABEL_OPTIONAL"),
]


def values(burst):
    return {
        "head": burst.printhead,
        "stamp": {"sec": burst.timestamp.seconds, "nanosec": burst.timestamp.nanos},
        "first": burst.first_channel,
        "channels": burst.channels,
        "period": burst.sample_period_s,
        "temp_c": burst.temperature_c,
        "volts": burst.drive_voltage_v,
        "idle": list(burst.idle_time_s),
        "near": burst.neighbours_fired,
        "data": burst.samples,
    }


def samples(burst):
    return numpy.frombuffer(burst.samples, "<i2")


def protobuf(path):
    file = descriptor_pb2.FileDescriptorProto(name="acme.proto", package="acme", syntax="proto3")
    stamp = file.message_type.add(name="Stamp")
    stamp.field.add(name="sec", number=1, type="TYPE_INT64", label="LABEL_OPTIONAL")
    stamp.field.add(name="nanosec", number=2, type="TYPE_UINT32", label="LABEL_OPTIONAL")
    wave = file.message_type.add(name="Wave")
    for number, (name, _, kind, label) in enumerate(FIELDS, 1):
        wave.field.add(name=name, number=number, type=kind, label=label)
    wave.field.add(name="stamp", number=50, type="TYPE_MESSAGE", label="LABEL_OPTIONAL", type_name=".acme.Stamp")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    Wave = message_factory.GetMessageClass(pool.FindMessageTypeByName("acme.Wave"))
    with open(path, "wb") as out:
        writer = ProtobufWriter(out)
        for log_time, burst in bursts():
            message = Wave(**values(burst))
            writer.write_message(f"/heads/{burst.printhead}/burst", message, log_time)
        writer.finish()


def as_json(path):
    with open(path, "wb") as out:
        writer = McapWriter(out)
        writer.start()
        schema = writer.register_schema("acme.Wave", "jsonschema", b'{"type": "object"}')
        channels = {}
        for log_time, burst in bursts():
            topic = f"/heads/{burst.printhead}/burst"
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "json", schema)
            message = values(burst)
            message["data"] = samples(burst).reshape(burst.channels, -1).tolist()
            message["near"] = list(burst.neighbours_fired)
            message["idle"] = [None if numpy.isnan(s) else s for s in burst.idle_time_s]
            data = json.dumps(message).encode()
            writer.add_message(channels[topic], log_time, data, log_time)
        writer.finish()


LINE = "\n" + "=" * 80 + "\n"
TEXT = "\n".join(f"{ros} {name}" for name, ros, _, _ in FIELDS if name not in ("sec", "nanosec"))


def ros2(path):
    text = "builtin_interfaces/Time stamp\n" + TEXT
    text += LINE + "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    with open(path, "wb") as out:
        writer = Ros2Writer(out)
        schema = writer.register_msgdef("acme_msgs/msg/Wave", text)
        for log_time, burst in bursts():
            message = values(burst)
            message["data"] = samples(burst).tolist()
            message["near"] = list(burst.neighbours_fired)
            writer.write_message(f"/heads/{burst.printhead}/burst", schema, message, log_time)
        writer.finish()


DIALECT = """
[[input.dialect]]
topic = "/heads/*/burst"
samples = "data"
channels = "channels"
first_channel = "first"
period_s = "period"
printhead = "{head}"
time = "stamp"
temperature = "temp_c"
voltage = "volts"
idle = "idle"
neighbours = "near"
"""

native = said(verdicts(recording))
flagged = sum(outcome == "faulty" for outcome in native["outcome"])
assert flagged > 100, f"{flagged} faulty signals: nothing to compare"
for write, more in [(protobuf, 'format = "s16le"\n'), (as_json, ""), (ros2, "")]:
    name = write.__name__
    path, settings = work / f"{name}.mcap", work / f"{name}.toml"
    write(path)
    settings.write_text(DIALECT + more)
    inspected = subprocess.run([inkling, "inspect", path, "--json"], check=True, capture_output=True)
    topics = json.loads(inspected.stdout)["topics"]
    assert all(topic["messages"] > 0 for topic in topics) and len(topics) > 1, topics
    found = said(verdicts(path, "--config", str(settings)))
    for column, expected in native.items():
        assert found[column] == expected, f"{name}: {column} differs"

# -- tables of one printhead

first = next(burst for _, burst in bursts())
same = lambda b: (b.printhead, b.first_channel, b.channels) == (first.printhead, first.first_channel, first.channels)
chosen = [burst for _, burst in bursts() if same(burst)]
matrix = numpy.stack([samples(b).reshape(b.channels, -1) for b in chosen])
times = numpy.array([b.timestamp.seconds * 10**9 + b.timestamp.nanos for b in chosen])
table = pyarrow.table({
    "t": pyarrow.array((times - times[0]) * 1e-9),
    "samples": pyarrow.array([m.tolist() for m in matrix], pyarrow.list_(pyarrow.list_(pyarrow.int16()))),
})
pq.write_table(table, work / "table.parquet")
with open(work / "table.csv", "w", newline="") as file:
    rows = csv.writer(file)
    rows.writerow(["burst", "t_ns", *range(first.channels)])
    rows.writerows([t, t, *row] for t, m in zip(times - times[0], matrix) for row in m.T)
results = []
for name, options in [
    ("table.parquet", ["--time", "t"]),
    ("table.csv", ["--time", "t_ns", "--burst", "burst"]),
]:
    out = work / f"{name.replace('.', '_')}.mcap"
    command = [inkling, "convert", work / name, "-o", out, "--printhead", first.printhead]
    command += ["--first-channel", str(first.first_channel), "--period-s", str(first.sample_period_s)]
    subprocess.run(command + options, check=True, stdout=subprocess.DEVNULL)
    results.append(said(verdicts(out)))
assert results[0]["outcome"].count("faulty") > 20, "nothing faulty in the tables"
for column, expected in results[0].items():
    if column != "acquired_at":
        assert all(result[column] == expected for result in results), f"tables: {column} differs"

print(f"{len(native['outcome'])} verdicts of recordings by mcap, mcap-protobuf-support, mcap-ros2-support and "
      f"pyarrow {pyarrow.__version__} are the sample's own")
