"""The live view in headless Chromium, while a recording is written burst by burst, killed, and taken up again.

Usage: live_page.py INKLING SAMPLE_LOGS DIR; screenshots go into DIR."""

import base64
import csv
import fcntl
import json
import os
import shutil
import subprocess
import sys
import time
from datetime import datetime

import pyarrow.parquet as pq
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_protobuf.decoder import DecoderFactory

#: Whose bursts are written, one by one.
HEAD = "black-2"
#: Nothing is asserted of times; what hangs fails instead.
HANGS = 300


class Browser:
    """Chromium, driven over a pipe by its DevTools protocol."""

    def __init__(self, profile):
        # it reads commands from 3 and writes to 4
        commands, self.commands = os.pipe()
        self.answers, answers = os.pipe()

        def its_pipes():
            # first out of the way, as they may have these numbers themselves
            high = [fcntl.fcntl(pipe, fcntl.F_DUPFD, 10) for pipe in (commands, answers)]
            os.dup2(high[0], 3)
            os.dup2(high[1], 4)

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
        os.close(self.commands)
        os.close(self.answers)


#: What the page shows, as text; how many signals; channels with a fault; channels whose last signal was flagged, by the colour
#: of the first printhead's map, left of which stand the numbers of the rows.
SHOWN = """(() => {
  const status = document.getElementById("status"), map = document.querySelector("#heads canvas");
  const colour = (channel) => String(map.getContext("2d").getImageData(40 + (channel % 64) * 10 + 4, Math.floor(channel / 64) * 10 + 4, 1, 1).data);
  const drawn = map ? (map.width - 40) / 10 * map.height / 10 : 0;
  return {
    status: status?.textContent ?? "",
    lost: status?.className === "lost",
    signals: parseInt(status?.textContent ?? "") || 0,
    faults: [...document.querySelectorAll("#faults tr")].map((tr) => Number(tr.cells[1].textContent)),
    flagged: [...Array(drawn).keys()].filter((channel) => colour(channel) === "242,184,75,255"),
    drawn,
  };
})()"""


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
            if burst.printhead != HEAD:
                continue
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


def onsets(labels, bursts):
    """Of each channel that gets a fault, as the truth has it: the number of the first burst that has it."""
    found = {}
    for row in csv.DictReader(open(labels)):
        if row["printhead"] == HEAD and row["from"] and row["state"] not in ("healthy", "ignore"):
            start = datetime.fromisoformat(row["from"]).timestamp()
            number = next((number for number, (ns, *_) in enumerate(bursts) if ns / 1e9 >= start), None)
            if number is not None:
                found.setdefault(int(row["channel"]), number)
    return found


class Watched:
    """A recording that is written burst by burst, judged meanwhile, and looked at."""

    def __init__(self, inkling, recording, design, directory):
        self.bursts, self.end = written(recording, f"{directory}/whole.mcap")
        self.recording = open(f"{directory}/now.mcap", "wb", buffering=0)
        self.written = self.signals = 0
        self.command = [inkling, "replay", f"{directory}/now.mcap", "--follow", "--json", "--force", "--design", design,
                        "--identify", "design", "--out", f"{directory}/out"]
        self.follower = Follower(self.command, "127.0.0.1:0")
        self.browser = Browser(f"{directory}/profile")
        self.browser.open(f"http://{self.follower.address}/")

    def burst(self):
        """Writes the next one; what the page shows of it, once it does."""
        self.write()
        return self.shows_all(f"after burst {self.written}")

    def write(self):
        _, _, channels, piece = self.bursts[self.written]
        self.recording.write(piece)
        self.written += 1
        self.signals += channels

    def shows_all(self, when):
        return until(self.browser, lambda shown: not shown["lost"] and shown["signals"] == self.signals,
                     f"{when} the page shows {self.signals} signals")

    def kill(self):
        self.follower.kill()
        self.browser.kill()


def evidence(directory, bursts, channel, onset):
    """Of a channel's episode: in which burst it was raised, and in which its signals were flagged from `onset` on."""
    number = {ns: number for number, (ns, *_) in enumerate(bursts)}
    rows = pq.read_table(f"{directory}/out/now.verdicts.parquet", filters=[("channel", "=", channel)])
    times = rows["acquired_at"].cast("int64").to_pylist()
    flagged = [number[ns] for ns, outcome in zip(times, rows["outcome"].to_pylist()) if outcome in ("faulty", "undecided")]
    episodes = pq.read_table(f"{directory}/out/now.episodes.parquet", filters=[("channel", "=", channel)])
    raised = [number[ns] for ns in episodes["raised_at"].cast("int64").to_pylist()]
    return raised[0], [of for of in flagged if of >= onset]


def begins(watched):
    """Half of the recording: in which bursts each channel was drawn as flagged, and with which its fault was on the page."""
    drawn, shown_at = {}, {}
    # which channels the head has is known once a second moment begins
    watched.write()
    while watched.written < len(watched.bursts) // 2:
        shown = watched.burst()
        assert shown["drawn"] == watched.bursts[0][2], shown
        for channel in shown["faults"]:
            shown_at.setdefault(channel, watched.written - 1)
        for channel in shown["flagged"]:
            drawn.setdefault(channel, []).append(watched.written - 1)
    return drawn, shown_at


def is_taken_up_again(watched, directory):
    """The program is killed, then the browser; whoever comes again shows what was shown."""
    before = watched.browser.value(SHOWN)["faults"]
    assert before
    watched.follower.kill()
    until(watched.browser, lambda shown: shown["lost"], "the page says that it is not connected")
    watched.follower = Follower(watched.command, watched.follower.address)
    assert watched.shows_all("taken up again")["faults"] == before
    watched.browser.kill()
    watched.browser = Browser(f"{directory}/profile2")
    watched.browser.open(f"http://{watched.follower.address}/")
    assert watched.shows_all("opened anew")["faults"] == before


def check(watched, labels, directory):
    drawn, shown_at = begins(watched)
    watched.browser.screenshot(f"{directory}/live.png")
    is_taken_up_again(watched, directory)
    while watched.written < len(watched.bursts):
        watched.burst()
    watched.recording.write(watched.end)
    until(watched.browser, lambda shown: "the recording is closed" in shown["status"], "the page says that it is closed")
    assert watched.follower.process.wait(HANGS) == 0
    truth = onsets(labels, watched.bursts)
    seen = {channel: onset for channel, onset in truth.items() if channel in shown_at}
    assert len(seen) >= 3, (truth, shown_at)
    for channel, onset in sorted(seen.items()):
        raised, flagged = evidence(directory, watched.bursts, channel, onset)
        print(f"{HEAD}, channel {channel}: faulty from burst {onset}, flagged from {flagged[0]}, raised in {raised}, "
              f"on the page with {shown_at[channel]}")
        # flagged signals at once, a fault within two bursts of the first
        assert flagged[0] in drawn[channel]
        assert shown_at[channel] == raised <= flagged[2]


if __name__ == "__main__":
    inkling, samples, directory = sys.argv[1:]
    recording, labels, design = f"{samples}/print_run.mcap", f"{samples}/labels.csv", f"{directory}/design.json"
    shutil.rmtree(directory, ignore_errors=True)
    os.makedirs(directory)
    # of a head that a design does not know the first window would come first
    subprocess.run([inkling, "train", f"{samples}/train.mcap", recording, "--labels", labels, "-o", design],
                   check=True, stdout=subprocess.DEVNULL)
    watched = Watched(inkling, recording, design, directory)
    try:
        check(watched, labels, directory)
    finally:
        watched.kill()
