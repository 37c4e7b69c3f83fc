"""The live view in headless Chromium, while a recording is written burst by burst, killed, and taken up again.

Usage: live_page.py INKLING RECORDING DESIGN DIR; screenshots go into DIR."""

import base64
import json
import os
import shutil
import subprocess
import sys
import time

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_protobuf.decoder import DecoderFactory

#: Nothing is asserted of times; what hangs fails instead.
HANGS = 300


class Browser:
    """Chromium, driven over a pipe by its DevTools protocol."""

    def __init__(self, profile):
        # it reads commands from 3 and writes to 4
        commands, self.commands = os.pipe()
        self.answers, answers = os.pipe()

        def its_pipes():
            os.dup2(os.dup(answers), 4)
            os.dup2(os.dup(commands), 3)

        self.process = subprocess.Popen(
            # as root it has no sandbox; it resolves no host
            ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe",
             "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1", f"--user-data-dir={profile}"],
            close_fds=False, preexec_fn=its_pipes, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(commands)
        os.close(answers)
        self.number, self.rest, self.session = 0, b"", None
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        self.ask("Page.enable")

    def ask(self, method, **parameters):
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.commands, json.dumps(message).encode() + b"\0")
        while True:
            answer = self.hear()
            if answer.get("id") == self.number:
                assert "error" not in answer, answer
                return answer["result"]

    def hear(self):
        while b"\0" not in self.rest:
            piece = os.read(self.answers, 1 << 20)
            assert piece, "the browser has gone"
            self.rest += piece
        message, self.rest = self.rest.split(b"\0", 1)
        return json.loads(message)

    def open(self, address):
        self.ask("Page.navigate", url=address)

    def value(self, expression):
        of = self.ask("Runtime.evaluate", expression=expression, returnByValue=True)
        assert "exceptionDetails" not in of, of
        return of["result"].get("value")

    def screenshot(self, path):
        with open(path, "wb") as file:
            file.write(base64.b64decode(self.ask("Page.captureScreenshot")["data"]))

    def kill(self):
        self.process.kill()
        self.process.wait()


#: What the page shows, as text; how many signals; faults as [printhead, channel]; coloured maps.
SHOWN = """({
  status: document.getElementById("status")?.textContent ?? "",
  lost: document.getElementById("status")?.className === "lost",
  signals: parseInt(document.getElementById("status")?.textContent ?? "") || 0,
  faults: [...document.querySelectorAll("#faults tr")].map((tr) => [tr.cells[0].textContent, Number(tr.cells[1].textContent)]),
  maps: [...document.querySelectorAll("#heads canvas")].map((of) => of.width * of.height),
})"""


def until(browser, holds, what):
    since = time.monotonic()
    while time.monotonic() - since < HANGS:
        shown = browser.value(SHOWN)
        if holds(shown):
            return shown
        time.sleep(0.02)
    raise AssertionError(f"{what}: {shown}")


class Follower:
    """`inkling replay --follow --serve`, on its way."""

    def __init__(self, command, address):
        self.process = subprocess.Popen([*command, "--serve", address], stdout=subprocess.PIPE, text=True)
        self.address = self.next("serving")["address"]
        self.raised = {}

    def next(self, kind):
        for line in self.process.stdout:
            event = json.loads(line)
            if event.get("event") == kind:
                return event
        raise AssertionError(f"no {kind}")

    def kill(self):
        self.process.kill()
        self.process.wait()


def written(recording, path):
    """The recording's bursts in the order of time, each of them its own bytes of a file: time, printhead, signals, bytes."""
    bursts, ends = [], []
    with open(recording, "rb") as file, open(path, "wb") as out:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        writer = Writer(out, compression=CompressionType.NONE, use_chunking=False)
        writer.start()
        known = {}
        for schema, channel, message, burst in reader.iter_decoded_messages(log_time_order=True):
            if channel.id not in known:
                as_here = writer.register_schema(schema.name, schema.encoding, schema.data)
                known[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, as_here)
            writer.add_message(known[channel.id], message.log_time, message.data, message.publish_time)
            ends.append(out.tell())
            bursts.append((message.log_time, burst.printhead, burst.channels))
        writer.finish()
    data = open(path, "rb").read()
    begins = [0, *ends[:-1]]
    pieces = [data[a:b] for a, b in zip(begins, ends)]
    return [(*burst, piece) for burst, piece in zip(bursts, pieces)], data[ends[-1]:]


def main(inkling, recording, design, directory):
    shutil.rmtree(directory, ignore_errors=True)
    os.makedirs(directory)
    bursts, end = written(recording, f"{directory}/whole.mcap")
    now = open(f"{directory}/now.mcap", "wb", buffering=0)
    command = [inkling, "replay", f"{directory}/now.mcap", "--follow", "--json", "--force", "--design", design,
               "--identify", "design", "--set", "identify.common_change=false", "--out", f"{directory}/out"]
    follower = Follower(command, "127.0.0.1:0")
    browser = Browser(f"{directory}/profile")
    browser.open(f"http://{follower.address}/")
    signals, at = 0, {}
    for number, (_, head, count, piece) in enumerate(bursts):
        now.write(piece)
        signals += count
        shown = until(browser, lambda shown: shown["signals"] == signals, f"burst {number}: {signals} signals")
        for fault in shown["faults"]:
            at.setdefault(tuple(fault), number)
        print(number, head, len(shown["faults"]), shown["status"])
    print(at)


main(*sys.argv[1:])
