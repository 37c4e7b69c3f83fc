"""The same bursts under another schema's name, message by message the same bytes, and the dialect that reads them:
what a dialect costs. `foreign.py OURS.mcap THEIRS.mcap THEIRS.toml`."""

import sys

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

ours, theirs, settings = sys.argv[1:]
with open(ours, "rb") as file, open(theirs, "wb") as out:
    reader = make_reader(file)
    writer = Writer(out, compression=CompressionType.NONE, chunk_size=256 << 10)
    writer.start()
    channels = {}
    for schema, channel, message in reader.iter_messages(log_time_order=False):
        if channel.topic not in channels:
            files = FileDescriptorSet.FromString(schema.data)
            for described in files.file:
                if described.package == "inkling":
                    described.package = "acme"
                for of in described.message_type:
                    for field in of.field:
                        field.type_name = field.type_name.replace(".inkling.", ".acme.")
            theirs_id = writer.register_schema("acme.Burst", "protobuf", files.SerializeToString())
            channels[channel.topic] = writer.register_channel(channel.topic, "protobuf", theirs_id)
        writer.add_message(channels[channel.topic], message.log_time, message.data, message.publish_time)
    writer.finish()
with open(settings, "w") as file:
    file.write(
        '[[input.dialect]]\ntopic = "**"\nschema = "acme.Burst"\nsamples = "samples"\nformat = "s16le"\n'
        'channels = "channels"\nsamples_per_channel = "samples_per_channel"\nfirst_channel = "first_channel"\n'
        'period_s = "sample_period_s"\nprinthead = "{printhead}"\ntime = "timestamp"\ntemperature = "temperature_c"\n'
        'voltage = "drive_voltage_v"\nidle = "idle_time_s"\nneighbours = "neighbours_fired"\n'
    )
