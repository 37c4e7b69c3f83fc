"""How fast a recording is judged from a store, over how fast from a file: alternately, several times, the best of each.
The store is a plain server of ranges on loopback that knows as much of S3 as reading takes, so that the client's rate
is measured and not moto's. `object_store_rate.py INKLING RECORDING DESIGN WORKDIR [ROUNDS]`."""

import http.server
import json
import os
import pathlib
import re
import subprocess
import sys
import threading

inkling, recording, design, work = sys.argv[1:5]
rounds = int(sys.argv[5]) if len(sys.argv) > 5 else 5
work = pathlib.Path(work)
size = os.stat(recording).st_size


class Ranges(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def log_message(self, *_):
        pass

    def head(self, status, length):
        self.send_response(status)
        self.send_header("content-length", str(length))
        self.send_header("etag", '"1"')
        self.send_header("last-modified", "Sun, 01 Nov 2026 08:00:00 GMT")

    def do_HEAD(self):
        self.head(200, size)
        self.end_headers()

    def do_GET(self):
        first, last = re.match(r"bytes=(\d+)-(\d+)", self.headers["range"]).groups()
        first, last = int(first), min(int(last), size - 1)
        self.head(206, last - first + 1)
        self.send_header("content-range", f"bytes {first}-{last}/{size}")
        self.end_headers()
        self.wfile.flush()
        with open(recording, "rb") as file:
            self.connection.sendfile(file, first, last - first + 1)


server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Ranges)
server.daemon_threads = True
threading.Thread(target=server.serve_forever, daemon=True).start()
environment = os.environ | {
    "AWS_ENDPOINT_URL": f"http://127.0.0.1:{server.server_port}",
    "AWS_ACCESS_KEY_ID": "a",
    "AWS_SECRET_ACCESS_KEY": "b",
    "NO_PROXY": "*",
}


def rate(name, out):
    command = [inkling, "replay", name, "--design", design, "--out", str(work / out), "--force", "--quiet"]
    subprocess.run(command, env=environment, check=True)
    stem = pathlib.Path(recording).stem
    return json.loads((work / out / f"{stem}.summary.json").read_text())["rates"]["bytes_per_s"]


rates = {"file": [], "store": []}
for _ in range(rounds):
    rates["file"].append(rate(recording, "file"))
    rates["store"].append(rate(f"s3://bucket/{pathlib.Path(recording).name}", "store"))
best = {of: max(all) / 1e6 for of, all in rates.items()}
for of, all in rates.items():
    print(f"{of:<6} MB/s  best {best[of]:.0f}  all {' '.join(f'{r / 1e6:.0f}' for r in all)}")
print(f"store / file  {best['store'] / best['file']:.2f}")
