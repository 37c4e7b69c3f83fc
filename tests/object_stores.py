"""Recordings, designs, baselines and results in an object store are those of files; a store that fails is told, and
nothing half done is left in it. Against moto's S3 server on loopback, through a proxy that cuts, slows, refuses and
changes. `object_stores.py INKLING RECORDING DESIGN LABELS WORKDIR`; INKLING built with the feature object-store."""

import http.client
import http.server
import json
import logging
import os
import pathlib
import shutil
import subprocess
import sys
import threading
import time

import boto3
import numpy
import pyarrow
import pyarrow.parquet as pq
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_protobuf.decoder import DecoderFactory
from moto.server import ThreadedMotoServer

inkling, recording, design, labels, work = sys.argv[1:]
inkling = str(pathlib.Path(inkling).resolve())
work = pathlib.Path(work)
shutil.rmtree(work, ignore_errors=True)
work.mkdir(parents=True)

KEY, SECRET, BUCKET = "AKIAINKLINGTEST", "s3cr3t/of+inkling", "nights"
logging.getLogger("werkzeug").setLevel(logging.ERROR)
server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
server.start()
host, port = server.get_host_and_port()


class Proxy(http.server.BaseHTTPRequestHandler):
    """Passes on what it is asked; `fault(request)` may answer first: bytes of the body to be sent before the
    connection ends, or a status."""

    protocol_version = "HTTP/1.1"
    fault = staticmethod(lambda request: None)
    seen = []

    def log_message(self, *_):
        pass

    def answer(self):
        body = self.rfile.read(int(self.headers.get("content-length", 0)))
        Proxy.seen.append((self.command, self.path, self.headers.get("range")))
        fault = Proxy.fault(self)
        if isinstance(fault, int):
            said = b"" if self.command == "HEAD" else b"<Error><Code>Refused</Code><Key>" + KEY.encode() + b"</Key></Error>"
            self.send_response(fault)
            self.send_header("content-length", str(len(said)))
            self.end_headers()
            self.wfile.write(said)
            return
        there = http.client.HTTPConnection(host, port)
        there.request(self.command, self.path, body, dict(self.headers))
        answer = there.getresponse()
        said = answer.read()
        self.send_response_only(answer.status)
        for name, value in answer.getheaders():
            if name.lower() not in ("transfer-encoding", "content-length", "connection"):
                self.send_header(name, value)
        length = answer.getheader("content-length") if self.command == "HEAD" else len(said)
        self.send_header("content-length", str(length or 0))
        self.end_headers()
        if fault == "cut":
            self.wfile.write(said[: len(said) // 2])
            self.close_connection = True
            return
        self.wfile.write(said)

    do_GET = do_PUT = do_POST = do_HEAD = do_DELETE = answer


proxy = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Proxy)
proxy.daemon_threads = True
threading.Thread(target=proxy.serve_forever, daemon=True).start()

s3 = boto3.client(
    "s3",
    endpoint_url=f"http://{host}:{port}",
    aws_access_key_id=KEY,
    aws_secret_access_key=SECRET,
    region_name="us-east-1",
)
s3.create_bucket(Bucket=BUCKET)


def environment(**more):
    """Nothing of whoever runs this."""
    plain = {k: v for k, v in os.environ.items() if not k.startswith(("AWS_", "GOOGLE_", "AZURE_"))}
    of_test = {"HOME": str(work / "home"), "NO_PROXY": "*", "no_proxy": "*"}
    return plain | of_test | more


KNOWN = environment(
    AWS_ACCESS_KEY_ID=KEY,
    AWS_SECRET_ACCESS_KEY=SECRET,
    AWS_REGION="us-east-1",
    AWS_ENDPOINT_URL=f"http://127.0.0.1:{proxy.server_port}",
)


def run(*arguments, exits=0, says=(), env=KNOWN):
    """What it says, on both streams; a run that hangs fails here."""
    command = [inkling, *map(str, arguments)]
    ended = subprocess.run(command, env=env, capture_output=True, text=True, timeout=300)
    said = ended.stdout + ended.stderr
    assert ended.returncode == exits, f"{arguments}: exit {ended.returncode}, not {exits}:\n{said}"
    for words in [says] if isinstance(says, str) else says:
        assert words in said, f"{arguments}: {words!r} is not in:\n{said}"
    for secret in (SECRET, KEY):
        assert secret not in said, f"{arguments}: a credential in a message:\n{said}"
    assert "panicked" not in said, said
    return said


def keys(prefix=""):
    return [o["Key"] for o in s3.list_objects_v2(Bucket=BUCKET, Prefix=prefix).get("Contents", [])]


def get(key):
    return s3.get_object(Bucket=BUCKET, Key=key)["Body"].read()


def table(path):
    return pq.read_table(path).to_pydict()


def table_of(key):
    path = work / "fetched.parquet"
    path.write_bytes(get(key))
    return table(path)


def longer(path, times):
    """A recording of several parts: the same bursts several times, each time an hour later, not compressed."""
    hour = 3600 * 10**9
    with open(recording, "rb") as file, open(path, "wb") as out:
        messages = list(make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages())
        writer = Writer(out, compression=CompressionType.NONE, chunk_size=256 << 10)
        writer.start()
        schema = messages[0].schema
        schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
        channels = {}
        for later in range(times):
            for _, channel, message, burst in messages:
                if channel.topic not in channels:
                    id = writer.register_channel(channel.topic, channel.message_encoding, schema_id)
                    channels[channel.topic] = id
                at = burst.timestamp.seconds * 10**9 + burst.timestamp.nanos + (hour if later else 0)
                burst.timestamp.seconds, burst.timestamp.nanos = divmod(at, 10**9)
                logged, published = (t + later * hour for t in (message.log_time, message.publish_time))
                writer.add_message(channels[channel.topic], logged, burst.SerializeToString(), published)
        writer.finish()


def passing(_):
    return None


def part(request):
    """A request for part of a recording."""
    return request.command == "GET" and ".mcap" in request.path


# -- the same from files and from the store
name = pathlib.Path(recording).name
night = work / "night"
(night / "deeper").mkdir(parents=True)
shutil.copy(recording, night / name)
longer(night / "deeper/long.mcap", 6)
assert (night / "deeper/long.mcap").stat().st_size > 3 * (4 << 20), "several parts"
for file in night.rglob("*.mcap"):
    s3.upload_file(str(file), BUCKET, f"night/{file.relative_to(night)}")
s3.upload_file(design, BUCKET, "design.json")
s3.upload_file(labels, BUCKET, "labels.csv")
root = f"s3://{BUCKET}"

run("replay", night, "--design", design, "--baseline", work / "b.json", "--out", work / "out", "--quiet")
from_store = ["replay", f"{root}/night/", "--design", f"{root}/design.json", "--baseline", f"{root}/b.json"]
Proxy.seen.clear()
run(*from_store, "--out", f"{root}/out", "--quiet")
files = sorted(str(f.relative_to(work / "out")) for f in (work / "out").rglob("*") if not f.name.startswith("."))
files = [f for f in files if (work / "out" / f).is_file()]
assert sorted(k.removeprefix("out/") for k in keys("out/")) == files, (keys("out/"), files)
for file in files:
    if file.endswith(".parquet"):
        assert table(work / "out" / file) == table_of(f"out/{file}"), f"{file}: not as from files"
for key in keys():
    assert SECRET.encode() not in get(key) or key.endswith(".mcap"), key
puts = [path.split("?")[0].rsplit("/", 1)[1] for method, path, _ in Proxy.seen if method == "PUT"]
ends = [p.split(".", 1)[1] for p in puts if "long." in p]
assert sorted(ends[:2]) == ["episodes.parquet", "verdicts.parquet"] and ends[2:] == ["summary.json"], puts
assert not any(".part" in path for _, path, _ in Proxy.seen)
whole = [r for m, p, r in Proxy.seen if m == "GET" and ".mcap" in p and not r]
assert not whole, "recordings are read by ranges"
run(*from_store, "--out", f"{root}/out", says="2 skipped")
run("replay", f"{root}/night/**/*.mcap", "--design", design, "--out", work / "glob", "--quiet")
run("inspect", f"{root}/night/{name}", says="whole")
run("score", f"{root}/out", "--labels", f"{root}/labels.csv", exits=0)
run("report", f"{root}/out", "-o", f"{root}/report.html")
assert get("report.html").startswith(b"<!")

# -- a whole file by several requests, or none of it
rng = numpy.random.default_rng(19)
samples = rng.integers(-1000, 1000, (300, 64, 512)).astype("<i2")
lists = pyarrow.list_(pyarrow.list_(pyarrow.int16()))
pq.write_table(pyarrow.table({"samples": pyarrow.array(samples.tolist(), lists)}), work / "a.parquet")
convert = ["convert", work / "a.parquet", "--period-s", "1e-6", "--every", "0.1", "-o"]
run(*convert, work / "a.mcap")
run(*convert, f"{root}/a.mcap")
assert get("a.mcap") == (work / "a.mcap").read_bytes(), "sent in parts"
assert any("partNumber" in path for _, path, _ in Proxy.seen)
Proxy.fault = lambda request: 403 if "partNumber=2" in request.path else None
run(*convert, f"{root}/none.mcap", exits=1, says="403")
Proxy.fault = passing
assert "none.mcap" not in keys(), "half a file"
assert not s3.list_multipart_uploads(Bucket=BUCKET).get("Uploads"), "parts left behind"

# -- what is not there, or not allowed
judge = lambda out: ["replay", f"{root}/night/deeper/long.mcap", "--design", design, "--out", work / out]
run("replay", f"{root}/nobody.mcap", "--out", work / "o", exits=2, says="nobody.mcap")
run("replay", f"{root}/night/", "--design", f"{root}/no.json", "--out", work / "o", exits=2, says="no such file")
run("replay", "s3://no-such-bucket/x/", "--out", work / "o", exits=1, says="no-such-bucket")
Proxy.fault = lambda request: 403
run(*judge("denied"), exits=1, says=["403", "credentials do not allow"])
Proxy.fault = passing
run(*judge("nobody"), exits=1, says=["no credentials for S3", "AWS_ACCESS_KEY_ID"], env=environment())
for scheme, says in [("gs", "GOOGLE_APPLICATION_CREDENTIALS"), ("az", "AZURE_STORAGE_ACCOUNT_KEY")]:
    run("inspect", f"{scheme}://bucket/x.mcap", exits=1, says=says, env=environment())
run("thesis", "-o", f"{root}/chapter4", exits=2, says="a directory of files")


# -- connections that end, answers that take their time
def first(times, fault):
    """A fault of the first so many parts."""
    left = iter(range(times))
    return lambda request: fault if part(request) and next(left, None) is not None else None


alone = work / "alone"
run("replay", night / "deeper/long.mcap", "--design", design, "--out", alone, "--quiet")
expected = table(alone / "long.verdicts.parquet")
for fault in ("cut", 500):
    Proxy.fault = first(3, fault)
    run(*judge(f"after_{fault}"), "--quiet")
    assert table(work / f"after_{fault}/long.verdicts.parquet") == expected, fault


def slow(request):
    time.sleep(0.2)


Proxy.fault = slow
run(*judge("slow"), "--quiet")
assert table(work / "slow/long.verdicts.parquet") == expected
Proxy.fault = lambda request: "cut" if part(request) else None
run(*judge("always"), exits=1, says="cannot be read")
assert not list((work / "always").glob("*.parquet")), "verdicts of what could not be read"

# -- changed half-way: parts of two states are never put together
changed = threading.Event()


def change(request):
    if part(request) and "bytes=4194304-" in (request.headers.get("range") or "") and not changed.is_set():
        changed.set()
        bytes = bytearray(get("night/deeper/long.mcap"))
        bytes[6 << 20] ^= 1
        s3.put_object(Bucket=BUCKET, Key="night/deeper/long.mcap", Body=bytes)


Proxy.fault = change
run(*judge("changed"), exits=1, says="changed while it was read")
assert changed.is_set() and not list((work / "changed").glob("*.parquet"))
Proxy.fault = passing
said = json.loads((work / "changed/run.json").read_text())
assert said["recordings"][0]["outcome"] == "failed", said

server.stop()
print("object stores: as from files; faults told, nothing half done")
