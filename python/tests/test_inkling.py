"""`import inkling` against the command: the same rows, the same sentences. Wants the packages of `.ci/run`."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import inkling
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

ROOT = Path(__file__).resolve().parents[2]
RECORDING = ROOT / "sample_logs" / "print_run.mcap"
TRAINING = ROOT / "sample_logs" / "train.mcap"
LABELS = ROOT / "sample_logs" / "labels.csv"
DESIGN = ROOT / "sample_logs" / "design.json"
HEAD = "cyan-1"


def bursts_of(recording, printhead):
    """Samples, times in ns, temperatures and voltages of a printhead, as another reader finds them."""
    kinds = {0: "<i2", 1: "<f4"}
    found = []
    reader = make_reader(open(recording, "rb"), decoder_factories=[DecoderFactory()])
    for *_, burst in reader.iter_decoded_messages(log_time_order=False):
        if burst.printhead == printhead:
            rows = np.frombuffer(burst.samples, kinds[burst.format])
            shape = (burst.channels, burst.samples_per_channel)
            samples = rows.reshape(shape) if burst.layout == 0 else rows.reshape(shape[::-1]).T
            t = burst.timestamp
            beside = [burst.temperature_c if burst.HasField("temperature_c") else np.nan]
            beside += [burst.drive_voltage_v if burst.HasField("drive_voltage_v") else np.nan]
            found.append((samples, t.seconds * 10**9 + t.nanos, *beside, burst.sample_period_s))
    samples, times, temperature, voltage, period = map(np.array, zip(*found))
    return samples, dict(time=times, temperature_c=temperature, voltage_v=voltage, period_s=period[0])


def training():
    """The samples of the library, whose bursts are parts of a head, as one burst."""
    reader = make_reader(open(TRAINING, "rb"), decoder_factories=[DecoderFactory()])
    bursts = sorted((burst for *_, burst in reader.iter_decoded_messages()), key=lambda burst: burst.first_channel)
    assert all(burst.format == 0 and burst.layout == 0 for burst in bursts)
    rows = [np.frombuffer(burst.samples, "<i2").reshape(burst.channels, -1) for burst in bursts]
    beside = dict(period_s=bursts[0].sample_period_s, voltage_v=bursts[0].drive_voltage_v)
    return np.concatenate(rows), beside


def recording_of(head, path):
    """A recording of one printhead's bursts alone."""
    topic = f"/printhead/{head}/bursts"
    with open(RECORDING, "rb") as all_heads, open(path, "wb") as out:
        writer = Writer(out)
        writer.start()
        channel = None
        for schema, of, message in make_reader(all_heads).iter_messages(topics=[topic], log_time_order=False):
            if channel is None:
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                channel = writer.register_channel(topic, of.message_encoding, known)
            writer.add_message(channel, message.log_time, message.data, message.publish_time, message.sequence)
        writer.finish()
    return path


@pytest.fixture(scope="module")
def head():
    return bursts_of(RECORDING, HEAD)


@pytest.fixture(scope="module")
def design():
    return inkling.Design.load(DESIGN)


@pytest.fixture(scope="module")
def replayed(tmp_path_factory):
    here = tmp_path_factory.mktemp("run")
    return inkling.replay(recording_of(HEAD, here / "one.mcap"), DESIGN, here / "verdicts")


def command(*words):
    program = Path(sys.executable).with_name("inkling")
    return subprocess.run([program, *map(str, words)], capture_output=True, text=True)


def test_arrays_get_the_rows_that_replay_writes(design, head, replayed):
    samples, beside = head
    judged = design.judge(samples, printhead=HEAD, **beside)
    written = pq.read_table(replayed.out / "one.verdicts.parquet")
    assert judged.schema.remove_metadata().equals(written.schema.remove_metadata())
    assert b"inkling" in judged.schema.metadata
    assert judged.num_rows == written.num_rows == samples.shape[0] * samples.shape[1] > 1000
    assert "faulty" in judged["outcome"].to_pylist()
    plain = lambda table, name: table[name].cast(pa.string()) if pa.types.is_dictionary(table[name].type) else table[name]
    for name in set(written.column_names) - {"recording"}:
        assert plain(judged, name).combine_chunks().equals(plain(written, name).combine_chunks()), name
    assert set(plain(judged, "recording").to_pylist()) == {"array"}


def test_how_samples_lie_makes_no_difference(design, head):
    samples, beside = head
    expected = design.judge(samples, printhead=HEAD, **beside)
    float32 = np.asarray(samples, np.float32)
    for same in [float32, np.asarray(samples, np.float64), np.asfortranarray(samples), samples.astype(">i2"), samples[:, ::-1][:, ::-1]]:
        assert design.judge(same, printhead=HEAD, **beside)["outcome"].equals(expected["outcome"])
    one = design.judge(samples[0], printhead=HEAD, **{k: v if k == "period_s" else v[:1] for k, v in beside.items()})
    assert one.num_rows == samples.shape[1]


def test_a_design_learned_from_an_array_is_saved_and_found_again(tmp_path):
    samples, beside = training()
    rows = [dict(zip(("printhead", "channel", "from", "to", "state", "severity"), line.split(",")))
            for line in LABELS.read_text().splitlines()[1:]]
    learned = inkling.Design.train(samples, rows, printhead="dataset", **beside)
    assert learned.printheads == ["dataset"] and learned.samples == samples.shape[1] and len(learned.classes) == 9
    assert {of["class"] for of in learned.promise()["classes"]} == set(learned.classes)
    learned.save(tmp_path / "design.json")
    again = inkling.Design.load(tmp_path / "design.json")
    assert again.digest == learned.digest
    assert again.judge(samples).equals(learned.judge(samples))


def test_states_by_channel_are_labels(head):
    samples, beside = head
    healthy = np.full(samples.shape[1], "healthy")
    cold = inkling.Design.cold(samples, printhead=HEAD, **beside)
    by_states = inkling.Design.train(samples, healthy, printhead=HEAD, **beside)
    assert cold.digest == by_states.digest
    with pytest.raises(inkling.UsageError, match="did you mean healthy"):
        inkling.Design.train(samples, np.full(samples.shape[1], "helthy"), printhead=HEAD, **beside)
    with pytest.raises(inkling.UsageError, match="labels: states of shape"):
        inkling.Design.train(samples, healthy[:-1], printhead=HEAD, **beside)


def test_a_design_learned_from_recordings_is_the_commands(tmp_path):
    learned = inkling.Design.train(TRAINING, LABELS)
    ended = command("train", TRAINING, "--labels", LABELS, "-o", tmp_path / "design.json")
    assert ended.returncode == 0, ended.stderr
    assert inkling.Design.load(tmp_path / "design.json").digest == learned.digest


def test_a_state_follows_a_head_and_outlives_the_process(design, head, tmp_path):
    samples, beside = head
    half = len(samples) // 2
    part = lambda which: (samples[which], {k: v if k == "period_s" else v[which] for k, v in beside.items()})
    state = inkling.State(design)
    for which in (slice(0, half), slice(half, None)):
        given, said = part(which)
        table = design.judge(given, printhead=HEAD, state=state, **said)
        assert table.num_rows == given.shape[0] * given.shape[1]
    assert state.channels == samples.shape[1]
    state.save(tmp_path / "state.json")
    assert inkling.State.load(tmp_path / "state.json", design).channels == state.channels
    other = inkling.Design.cold(samples, printhead=HEAD, **beside)
    with pytest.raises(inkling.Error, match="another design"):
        inkling.State.load(tmp_path / "state.json", other)


def test_errors_say_what_the_command_says(design, head, tmp_path):
    wrong = tmp_path / "wrong.json"
    wrong.write_text("{}")
    with pytest.raises(inkling.UsageError) as error:
        inkling.Design.load(wrong)
    ended = command("replay", RECORDING, "--design", wrong, "--out", tmp_path / "out")
    assert ended.returncode == 2 and ended.stderr == f"inkling: {error.value}\n"
    missing = tmp_path / "missing.mcap"
    with pytest.raises(inkling.Error) as error:
        inkling.replay(missing, DESIGN, tmp_path / "out")
    ended = command("replay", missing, "--design", DESIGN, "--out", tmp_path / "out")
    assert ended.returncode == 2 and ended.stderr == f"inkling: {error.value}\n"
    for given, message in [
        (np.zeros(5), "channels x samples"),
        (np.zeros((2, 0)), "none of them 0"),
        (np.full((2, 3), "x"), "whole or real"),
    ]:
        with pytest.raises(inkling.UsageError, match=message):
            design.judge(given)
    samples, _ = head
    for keywords in [dict(time=[0]), dict(time="yesterday"), dict(temperature_c=[1.0, 2.0]), dict(set={"no.such": 1})]:
        with pytest.raises(inkling.UsageError):
            design.judge(samples[:3], **keywords)


def test_what_the_design_does_not_fit_is_rejected_with_a_warning(design, head):
    with pytest.warns(inkling.InklingWarning, match="sample"):
        table = design.judge(head[0][:3], period_s=2e-6)
    assert set(table["outcome"].to_pylist()) == {"rejected"}
    assert set(table["reason"].to_pylist()) == {"design_mismatch"}


def test_times_are_understood(design, head):
    samples = head[0][:2]
    from datetime import datetime, timezone

    ns = 1_700_000_000_000_000_000
    for time_ in [ns, np.datetime64(ns, "ns"), "2023-11-14T22:13:20", datetime.fromtimestamp(ns / 1e9, timezone.utc)]:
        table = design.judge(samples, time=time_, every_s=0.5)
        found = sorted(set(table["acquired_at"].cast(pa.int64()).to_pylist()))
        assert found == [ns, ns + 500_000_000], time_


def test_results_are_read_lazily(replayed):
    assert replayed.exit == 0 and replayed.run["recordings"]
    tables = replayed.read()
    import polars as pl

    rows = tables.verdicts.select(pl.len()).collect().item()
    assert rows == pq.read_metadata(replayed.out / "one.verdicts.parquet").num_rows
    assert tables.episodes.collect().height > 0 and tables.faults is None
    with pytest.raises(inkling.UsageError, match="not a directory"):
        inkling.read(replayed.out / "nowhere")


def test_a_hive_is_read_as_one_data_set(tmp_path):
    import polars as pl
    import pyarrow.dataset as ds

    run = inkling.replay(RECORDING, DESIGN, tmp_path / "out", layout="hive")
    table = ds.dataset(tmp_path / "out" / "verdicts", partitioning="hive").to_table()
    assert table.num_rows == 8640 and set(table["day"].to_pylist()) == {"2025-01-01"}
    assert pl.read_parquet(tmp_path / "out" / "verdicts").height == 8640
    assert run.read().verdicts.select(pl.len()).collect().item() == 8640


def test_a_critique_of_an_array_has_a_page_and_plots(tmp_path):
    t = np.arange(128) * 1e-6
    noise = np.random.default_rng(5).normal(size=(40, 8, 128))
    ring = 1000 * np.exp(-2.5e4 * t) * np.cos(2 * np.pi * 6.5e4 * t)
    result = inkling.critique((ring + noise).astype(np.float32), tmp_path / "critique", period_s=1e-6, plant="oscillator")
    assert result.verdict in {"none", "named", "tie", "unknown"}
    assert "<svg" in result.html and "iframe" in result._repr_html_()
    assert result.evidence.num_rows >= 0 and (tmp_path / "critique" / "report.html").is_file()


def test_other_threads_run_while_it_judges(design, head):
    samples, beside = head
    many = np.concatenate([samples] * 20)
    ticks, stop = [], threading.Event()

    def tick():
        while not stop.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.001)

    ticking = threading.Thread(target=tick)
    ticking.start()
    began = time.monotonic()
    design.judge(many, period_s=beside["period_s"])
    took = time.monotonic() - began
    stop.set()
    ticking.join()
    within = [t for t in ticks if began <= t <= began + took]
    assert len(within) > 10 * took, (len(within), took)


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_ctrl_c_ends_it_and_the_interpreter_lives():
    script = f"""
import inkling, numpy as np, time
design = inkling.Design.load({str(DESIGN)!r})
samples = np.random.default_rng(1).normal(scale=500, size=(4000, 256, design.samples)).astype(np.int16)
print("go", flush=True)
began = time.monotonic()
try:
    design.judge(samples)
    print("done", flush=True)
except KeyboardInterrupt:
    print("interrupted", time.monotonic() - began, design.judge(samples[:2]).num_rows, flush=True)
"""
    run = subprocess.Popen([sys.executable, "-W", "ignore", "-c", script], stdout=subprocess.PIPE, text=True)
    assert run.stdout.readline() == "go\n"
    time.sleep(0.3)
    run.send_signal(signal.SIGINT)
    said, _ = run.communicate(timeout=60)
    assert said.startswith("interrupted") and said.split()[-1] == "512", said


def test_the_command_is_the_wheels(tmp_path):
    ended = command("--version")
    assert ended.returncode == 0 and ended.stdout == f"inkling {inkling.__version__}\n"
    assert command("nonsense").returncode == 2
