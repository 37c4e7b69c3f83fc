"""A fleet judges as one machine does, each recording once, whatever ends in the middle. Scheduler and executors on
loopback. `fleet.py INKLING INKLING_FLEET RECORDING DESIGN WORKDIR [RUNS]`; with RUNS only the faults, so many times."""

import hashlib
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import time

import pyarrow.parquet as pq
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

inkling, inkling_fleet = (str(pathlib.Path(p).resolve()) for p in sys.argv[1:3])
recording, design = (pathlib.Path(p).resolve() for p in sys.argv[3:5])
work = pathlib.Path(sys.argv[5]).resolve()
runs = int(sys.argv[6]) if len(sys.argv) > 6 else 0
shutil.rmtree(work, ignore_errors=True)
work.mkdir(parents=True)
repository = pathlib.Path(__file__).resolve().parent.parent

MOST_S = 120  # of a run; one that hangs fails here
SLICES = 16  # in time, of each of the recording's three printheads
TIMEOUT_S = 6  # after which an executor that is not heard of is taken for lost


def write(path, messages, compression=CompressionType.ZSTD):
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "wb") as out:
        writer = Writer(out, compression=compression)
        writer.start()
        ids = {}
        for schema, channel, message in messages:
            if channel.topic not in ids:
                of = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, of)
            writer.add_message(ids[channel.topic], message.log_time, message.data, message.publish_time)
        writer.finish()


with open(recording, "rb") as file:
    messages = list(make_reader(file).iter_messages())
topics = sorted({channel.topic for _, channel, _ in messages})
start, end = messages[0][2].log_time, messages[-1][2].log_time + 1


def slices(directory, many=SLICES):
    """A recording for each printhead and span of time, a directory for each span."""
    for at in range(many):
        lo, hi = (start + (end - start) * k // many for k in (at, at + 1))
        for topic in topics:
            of_slice = [m for m in messages if m[1].topic == topic and lo <= m[2].log_time < hi]
            write(directory / f"{at:03}" / (topic.split("/")[2] + ".mcap"), of_slice)


class Process:
    """Of the fleet; what it says goes to a file."""

    everyone = []

    def __init__(self, *arguments, log, cwd=work):
        self.log = work / log
        env = os.environ | {"RUST_LOG": "warn,ballista_executor=info"}
        with open(self.log, "ab") as out:
            self.process = subprocess.Popen(
                [inkling_fleet, *map(str, arguments)], cwd=cwd, env=env, stdout=out, stderr=subprocess.STDOUT
            )
        Process.everyone.append(self)

    def says(self, words, seconds=60):
        """The line with these words."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            for line in self.log.read_text().splitlines():
                if words in line:
                    return line
            assert self.process.poll() is None, self.log.read_text()
            time.sleep(0.02)
        raise AssertionError(f"{words!r} is not in:\n{self.log.read_text()}")

    def send(self, number):
        self.process.send_signal(number)
        if number == signal.SIGKILL:
            self.process.wait()

    def end(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)
            self.process.kill()
            self.process.wait()


class Fleet:
    """A scheduler and its executors."""

    count = 0

    def __init__(self, executors=2, port=0, tls=()):
        Fleet.count += 1
        self.tls = tls
        self.start_scheduler(port)
        self.executors = [self.executor() for _ in range(executors)]

    def start_scheduler(self, port):
        log = f"scheduler-{Fleet.count}-{time.monotonic_ns()}.log"
        bind = ["--bind", f"127.0.0.1:{port}", "--executor-timeout", TIMEOUT_S]
        self.scheduler = Process("scheduler", *bind, *self.tls, log=log)
        self.at = self.scheduler.says("listening on ").split()[-1]
        if self.tls:
            self.at = "localhost:" + self.at.split(":")[1]

    def executor(self, *more):
        log = f"executor-{Fleet.count}-{time.monotonic_ns()}.log"
        asked = ["--scheduler", self.at, "--slots", 1, *(more or ["--root", work])]
        return Process("executor", *asked, *self.tls, log=log)

    def submit(self, *arguments, log=None):
        log = log or f"submit-{time.monotonic_ns()}.log"
        return Process("submit", "--scheduler", self.at, "--design", design, *self.tls, *arguments, log=log)

    def judges(self, *arguments, exits=0, says=()):
        return ends(self.submit(*arguments), exits, says)

    def tasks(self):
        """That executors were given so far."""
        return sum(e.log.read_text().count("Received task") for e in self.executors)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for process in [self.scheduler, *self.executors]:
            process.end()


def ends(process, exits=0, says=()):
    """What it said."""
    code = process.process.wait(timeout=MOST_S)
    said = process.log.read_text()
    assert code == exits, f"exit {code}, not {exits}:\n{said}"
    for words in [says] if isinstance(says, str) else says:
        assert words in said, f"{words!r} is not in:\n{said}"
    assert "panicked" not in said, said
    return said


def here(*arguments, exits=0):
    """One machine's."""
    command = [inkling, "replay", "--design", str(design), *map(str, arguments)]
    ended = subprocess.run(command, cwd=work, capture_output=True, text=True, timeout=MOST_S)
    assert ended.returncode == exits, ended.stdout + ended.stderr


def content(file):
    """Of a result: its bytes, where there are no times in it."""
    if file.suffix in (".parquet", ".counts"):
        return hashlib.sha256(file.read_bytes()).hexdigest()
    of = json.loads(file.read_text())
    if file.name == "run.json":
        for key in ("began", "ended"):
            of.pop(key)
        for key in ("seconds", "signals_per_s"):
            of["totals"].pop(key)
        for row in of["recordings"]:
            row["why"] = "" if row["skipped"] else row["why"]  # when it was finished
            row.pop("judged_at")
    elif file.name != "account.json":
        of.pop("rates"), of.pop("phases"), of.pop("timings")
    return of


def journal(out):
    """Its lines but for times; a summary holds times, and so its size differs by a digit or two."""
    lines = [json.loads(line) for line in (out / "journal.jsonl").read_text().splitlines()]
    for line in lines:
        line.pop("at"), line.pop("seconds")
        if line["results"] and line["results"]["bytes"]:
            line["results"]["bytes"].pop()
    return lines


def results(out):
    """All files, but for the lock, the journal and what is about the run."""
    return {
        str(file.relative_to(out)): content(file)
        for file in sorted(out.rglob("*"))
        if file.is_file() and file.name not in (".inkling.lock", "journal.jsonl", "run.json")
    }


def same(out, wanted, run_too=True):
    """Each recording once, each result as from one machine; nothing else is left."""
    now, then = results(out), results(wanted)
    assert now == then, sorted(name for name in now.keys() | then.keys() if now.get(name) != then.get(name))
    lines, of_wanted = journal(out), journal(wanted)
    assert lines == of_wanted, f"{len(lines)} lines, {len(of_wanted)} are wanted"
    paths = [line["recording"]["path"] for line in lines]
    assert len(set(paths)) == len(paths), "a recording is in the journal twice"
    rows = lambda of: sum(pq.read_metadata(f).num_rows for f in of.rglob("*.verdicts.parquet"))
    assert rows(out) == rows(wanted) > 0
    assert not (out / ".fleet").exists(), "work of the fleet is left"
    if run_too:
        assert content(out / "run.json") == content(wanted / "run.json")


def finished(out):
    """Recordings that the running fleet has finished."""
    return [f for f in out.glob(".fleet/*/[0-9]*.json")]


def until_finished(out, many, process):
    until = time.monotonic() + MOST_S
    while len(finished(out)) < many:
        assert process.process.poll() is None, process.log.read_text()
        assert time.monotonic() < until, process.log.read_text()
        time.sleep(0.005)


night = work / "night"
slices(night)
many = len(list(night.rglob("*.mcap")))
wanted = work / "wanted"
here(night, "--out", wanted)


def kill_an_executor(out):
    with Fleet() as fleet:
        client = fleet.submit(night, "--out", out)
        until_finished(out, many // 4, client)
        fleet.executors[0].send(signal.SIGKILL)
        ends(client)
        same(out, wanted)
        # resumed: nothing is given to anybody
        before = fleet.tasks()
        fleet.judges(night, "--out", out, says=f"{many} skipped")
        assert fleet.tasks() == before
        assert results(out) == results(wanted)


def stop_an_executor(out):
    """It hangs; others take over, and what it does when it wakes changes nothing."""
    with Fleet() as fleet:
        client = fleet.submit(night, "--out", out)
        until_finished(out, many // 4, client)
        fleet.executors[0].send(signal.SIGSTOP)
        ends(client)
        same(out, wanted)
        before = {f: f.stat().st_mtime_ns for f in out.rglob("*")}
        fleet.executors[0].send(signal.SIGCONT)
        time.sleep(2)
        assert {f: f.stat().st_mtime_ns for f in out.rglob("*")} == before


def restart_the_scheduler(out):
    with Fleet() as fleet:
        client = fleet.submit(night, "--out", out)
        until_finished(out, many // 4, client)
        fleet.scheduler.send(signal.SIGKILL)
        client.says("waiting for it")
        fleet.start_scheduler(fleet.at.split(":")[1])
        ends(client, says="submitted again")
        same(out, wanted)


def kill_the_client(out):
    """What was finished is not done again."""
    with Fleet() as fleet:
        client = fleet.submit(night, "--out", out)
        until_finished(out, many // 3, client)
        client.send(signal.SIGKILL)
        time.sleep(1)
        rows = [json.loads(row.read_text()) for row in finished(out)]
        files = [out / row["item"]["verdicts"] for row in rows]
        before = [f.stat().st_mtime_ns for f in files]
        fleet.judges(night, "--out", out, says="finished by a run that did not end")
        assert [f.stat().st_mtime_ns for f in files] == before and files
        same(out, wanted, run_too=False)  # why each was judged differs


def lose_all_executors(out):
    """The watchdog submits again; an executor that comes late does the rest."""
    with Fleet() as fleet:
        client = fleet.submit(night, "--out", out, "--patience", 4)
        until_finished(out, many // 4, client)
        for executor in fleet.executors:
            executor.send(signal.SIGSTOP)
        client.says("submitted again: nothing moved in it for 4 s")
        fleet.executors.append(fleet.executor())
        ends(client)
        same(out, wanted)


FAULTS = [kill_an_executor, stop_an_executor, restart_the_scheduler, kill_the_client, lose_all_executors]


def faults(times):
    for run in range(times):
        for fault in FAULTS:
            out = work / f"{fault.__name__}-{run}"
            began = time.monotonic()
            fault(out)
            print(f"{run + 1}: {fault.__name__}: as one machine, {time.monotonic() - began:.1f} s", flush=True)
            shutil.rmtree(out)


def without_faults():
    """The canary for work that is done twice: as many tasks as recordings."""
    with Fleet() as fleet:
        fleet.judges(night, "--out", work / "plain")
        same(work / "plain", wanted)
        assert fleet.tasks() == many, (fleet.tasks(), many)
        # one recording alone is reported as one machine does, below another layout
        one = night / "000" / "cyan-1.mcap"
        said = fleet.judges(one, "--out", work / "one", "--layout", "date", says="verdicts: ")
        assert "printhead" in said and list((work / "one").glob("2*/cyan-1.verdicts.parquet"))


def settings_and_means():
    """Settings, labels and presets go along; what cannot take effect, or is not there, is told."""
    with Fleet() as fleet:
        some = [night / "000", "--set", "output.weights=true", "--set", "isolate.certainty=0.5"]
        here(*some, "--out", work / "set-here")
        fleet.judges(*some, "--out", work / "set")
        same(work / "set", work / "set-here")
        fleet.judges(*some, "--out", work / "set", "--threads", 3, exits=2, says="--threads: has no effect here")
        fleet.judges(*some, "--out", work / "set", "--set", "detect.nothing=1", exits=2)
        fleet.judges(*some, "--out", work / "dry", "--dry-run", says="would judge 3")
        assert not (work / "dry").exists()


def poison():
    """What is damaged, no recording, or gone costs itself alone, and is told as one machine tells it."""
    ward = work / "ward"
    for name in ("000", "001", "002"):
        shutil.copytree(night / name, ward / name)
    cut = ward / "001" / "cyan-1.mcap"
    cut.write_bytes(cut.read_bytes()[: cut.stat().st_size * 2 // 3])
    (ward / "000" / "magenta-1.mcap").write_bytes(os.urandom(5000))
    (ward / "002" / "black-2.mcap").write_bytes(b"")
    here(ward, work / "gone.mcap", "--out", work / "ward-here", exits=3)
    with Fleet() as fleet:
        fleet.judges(ward, work / "gone.mcap", "--out", work / "ward-out", exits=3, says="damaged")
        same(work / "ward-out", work / "ward-here")
        fleet.judges(ward / "000" / "magenta-1.mcap", "--out", work / "alone", exits=1)
        # a name that no job can hold
        unnamed = work / "unnamed"
        shutil.copytree(night / "000", unnamed)
        shutil.copy(unnamed / "cyan-1.mcap", os.fsencode(unnamed) + b"/bad\xff.mcap")
        fleet.judges(unnamed, "--out", work / "unnamed-out", exits=3, says=["3 judged", "no UTF-8"])


def baselines():
    """Recordings of a printhead follow each other, printheads go side by side; the file and the journal's chain of
    digests are one machine's."""
    few = work / "few"
    for name in ("000", "001", "002", "003"):
        shutil.copytree(night / name, few / name)
    here(few, "--out", work / "own-here", "--baseline", work / "here.json")
    with Fleet() as fleet:
        fleet.judges(few, "--out", work / "own", "--baseline", work / "own.json")
        assert (work / "own.json").read_bytes() == (work / "here.json").read_bytes()
        same(work / "own", work / "own-here")
        assert fleet.tasks() == len(topics), "a task for each printhead"
        shutil.copytree(night / "004", few / "004")
        here(few, "--out", work / "own-here", "--baseline", work / "here.json")
        fleet.judges(few, "--out", work / "own", "--baseline", work / "own.json", says="12 skipped")
        assert (work / "own.json").read_bytes() == (work / "here.json").read_bytes()
        same(work / "own", work / "own-here")


def roots():
    """An executor reads and writes below its roots alone."""
    inside, outside = work / "inside", work / "outside"
    for place, name in ((inside, "000"), (outside, "001")):
        shutil.copytree(night / name, place / name)
    (inside / "link.mcap").symlink_to(outside / "001" / "cyan-1.mcap")
    with Fleet(executors=0) as fleet:
        fleet.executors.append(fleet.executor("--root", inside))
        asked = [inside, outside]
        said = fleet.judges(*asked, "--out", inside / "out", exits=3, says="is outside of this executor's roots")
        assert "3 judged" in said and "3 failed" in said, said
        said = fleet.judges(inside / "000", "--out", outside / "out", exits=1, says="is outside of")
        assert not list((outside / "out").rglob("*.parquet")), said


def nobody():
    """No scheduler, no executors: a clean error, soon."""
    lonely = Process("executor", "--scheduler", "127.0.0.1:1", "--wait", 1, log="lonely.log")
    ends(lonely, exits=1, says="no scheduler at 127.0.0.1:1")
    with Fleet(executors=0) as fleet:
        asked = [night / "000", "--out", work / "nobody", "--patience", 1, "--wait", 1]
        fleet.judges(*asked, exits=1, says="Are there executors")
        fleet.scheduler.end()
        fleet.judges(*asked, exits=1, says="no scheduler at")
        fleet.start_scheduler(0)
        fleet.executors.append(fleet.executor())
        fleet.judges(night / "000", "--out", work / "nobody", says="3 recordings: 3 judged")


def services(keys):
    """What systemd would start, started here: the units' own commands, but for places."""
    plant = work / "plant"
    shutil.copytree(night / "000", plant / "archive")
    shutil.copy(design, plant / "design.json")

    def command(unit, at):
        text = (repository / f"fleet/deploy/inkling-fleet-{unit}.service").read_text().replace("\\\n", " ")
        start = next(line for line in text.splitlines() if line.startswith("ExecStart="))
        for there, here in (("/etc/inkling", keys), ("/srv/printer", plant), ("scheduler.plant:50050", at),
                            ("0.0.0.0:50050", "127.0.0.1:0")):
            start = start.replace(there, str(here))
        return start.split()[1:]

    started = [Process(*command("scheduler", ""), log="unit-scheduler.log")]
    at = "localhost:" + started[0].says("listening on ").split(":")[-1]
    started.append(Process(*command("executor", at), log="unit-executor.log"))
    ends(Process(*command("night", at), log="unit-night.log", cwd=plant))
    assert len(list((plant / "verdicts").glob("2*/*.verdicts.parquet"))) == 3
    for process in started:
        process.end()


def array_job():
    """The plain command line, a directory of results for each directory of recordings; `xargs -P` stands in for the
    tasks of an array job."""
    task = f"{repository}/fleet/deploy/array_task.sh {{}} 3 {night} {design} {work}/array"
    for _ in range(2):  # the second time nothing is done again
        command = f"seq 0 2 | xargs -P 2 -I {{}} {task}"
        subprocess.run(command, shell=True, check=True, timeout=MOST_S, env=os.environ | {"INKLING": inkling})
    out, alone = work / "array", work / "array-here"
    for directory in sorted(night.iterdir()):
        here(directory, "--out", alone / directory.name)
    assert results(out) == results(alone)
    entries = [line for of in sorted(out.glob("*/journal.jsonl")) for line in of.read_text().splitlines()]
    assert len(entries) == many == len({json.loads(line)["recording"]["path"] for line in entries})


def documented():
    """The three commands of the docs, as printed, but for the build."""
    text = (repository / "docs" / "fleet.md").read_text()
    build, *rest = text.split("```text\ncargo build --release -p inkling-fleet")[1].split("```")[0].splitlines()
    port = "127.0.0.1:" + str(50_000 + os.getpid() % 10_000)
    commands = "\n".join(rest).replace("inkling-fleet scheduler", f"inkling-fleet scheduler --bind {port}")
    commands = commands.replace("127.0.0.1:50050", port).replace("target/fleet/verdicts", str(work / "documented"))
    shutil.copytree(repository / "sample_logs", work / "sample_logs")
    script = f"{commands}\nstatus=$?; kill $(jobs -p); wait; exit $status"
    env = os.environ | {"PATH": f"{pathlib.Path(inkling_fleet).parent}:{os.environ['PATH']}"}
    ended = subprocess.run(["bash", "-c", script], cwd=work, env=env, capture_output=True, text=True, timeout=MOST_S)
    assert ended.returncode == 0 and "2 recordings: 2 judged" in ended.stdout, ended.stdout + ended.stderr


def certificates():
    """Who has none of the fleet's is not spoken to; off loopback there is no scheduler without."""
    refused = Process("scheduler", "--bind", "0.0.0.0:0", log="refused.log")
    ends(refused, 2, "--tls-ca")
    warned = Process("scheduler", "--bind", "0.0.0.0:0", "--insecure", log="warned.log")
    warned.says("warning: 0.0.0.0:0 can be reached from other machines")
    warned.end()
    if not shutil.which("openssl"):
        print("skipped: certificates, as there is no openssl")
        return
    keys = work / "keys"
    keys.mkdir()

    def openssl(*arguments):
        subprocess.run(["openssl", *arguments], cwd=keys, check=True, capture_output=True)

    def new_key(name):
        return ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-keyout", f"{name}.key"]

    def authority(name):
        openssl("req", "-x509", *new_key(name), "-out", f"{name}.pem", "-subj", "/CN=fleet", "-days", "2")

    def signed(name, by):
        openssl("req", *new_key(name), "-out", f"{name}.csr", "-subj", f"/CN={name}", "-addext", "subjectAltName=DNS:localhost")
        ca = ["-CA", f"{by}.pem", "-CAkey", f"{by}.key", "-copy_extensions", "copy", "-days", "2"]
        openssl("x509", "-req", "-in", f"{name}.csr", *ca, "-out", f"{name}.pem")
        return ["--tls-ca", keys / f"{by}.pem", "--tls-cert", keys / f"{name}.pem", "--tls-key", keys / f"{name}.key"]

    authority("ours"), authority("theirs")
    ours, theirs = signed("member", "ours"), signed("stranger", "theirs")
    shutil.copy(keys / "ours.pem", keys / "ca.pem")
    services(keys)
    with Fleet(executors=1, tls=ours) as fleet:
        asked = [night / "000", "--out", work / "tls", "--wait", 2]
        for stranger in ([], ["--tls-ca", keys / "ours.pem", *theirs[2:]]):
            fleet.tls = stranger
            fleet.judges(*asked, exits=1, says="no scheduler at")
        fleet.tls = ours
        fleet.judges(*asked)
        here(night / "000", "--out", work / "tls-here")
        assert results(work / "tls") == results(work / "tls-here")


try:
    if runs:
        faults(runs)
    else:
        for test in (without_faults, settings_and_means, poison, baselines, roots, nobody, certificates, array_job, documented):
            began = time.monotonic()
            test()
            print(f"{test.__name__}: {time.monotonic() - began:.1f} s", flush=True)
        faults(1)
    print("a fleet judges as one machine does, each recording once")
finally:
    for process in Process.everyone:
        process.end()
