"""What users give: what is taken, and what is refused with a sentence that says what to give."""

import gc
import multiprocessing
import pickle
import warnings
from concurrent.futures import ProcessPoolExecutor
from datetime import date, datetime, timedelta, timezone
from pathlib import Path

import inkling
import numpy as np
import pyarrow as pa
import pytest
from inkling import _arrays, _times, _words

ROOT = Path(__file__).resolve().parents[2]
RECORDING = ROOT / "sample_logs" / "print_run.mcap"
DESIGN = ROOT / "sample_logs" / "design.json"
NS = 1_700_000_000_000_000_000


@pytest.fixture(scope="module")
def design():
    return inkling.Design.load(DESIGN)


@pytest.fixture(scope="module")
def samples(design):
    """Bursts x channels x samples of a ring and noise; what it is judged to be makes no difference here."""
    t = np.arange(design.samples) * design.sample_period_s
    ring = 1000 * np.exp(-2.92e4 * t) * np.cos(2 * np.pi * 6.5e4 * t)
    noise = np.random.default_rng(7).normal(scale=5, size=(20, 8, design.samples))
    return (ring + noise).astype(np.float32)


def refused(words, given, *args, **keywords):
    with pytest.raises(inkling.UsageError) as error:
        given(*args, **keywords)
    assert words in str(error.value), error.value


def test_times_are_taken_in_any_form():
    east = timezone(timedelta(hours=5, minutes=30))
    for same in [
        NS, np.uint64(NS), np.datetime64(NS, "ns"), np.datetime64("2023-11-14T22:13:20"), "2023-11-14T22:13:20",
        "2023-11-14T22:13:20Z", "2023-11-14 22:13:20+00:00", "2023-11-15T03:43:20+0530", "2023-11-14T17:13:20-05",
        datetime(2023, 11, 14, 22, 13, 20), datetime(2023, 11, 15, 3, 43, 20, tzinfo=east),
    ]:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert _times.since_1970("time", same) == NS, same
            assert _times.since_1970("time", [same] * 3).tolist() == [NS] * 3, same
    assert _times.since_1970("time", "2023-11-14T22:13:20.000000001Z") == NS + 1
    assert _times.since_1970("time", [date(1970, 1, 2), "1970-01-02", np.datetime64("1970-01-02")]).tolist() == [864 * 10**11] * 3
    assert _times.of_bursts(NS, 3, 0.5).tolist() == [NS, NS + 5 * 10**8, NS + 10**9]
    assert _times.of_bursts(None, 2, 1).tolist() == [0, 10**9]


@pytest.mark.parametrize("counted", [0, 5, np.arange(4), np.arange(4) * 10**9, np.int8(3), 10**12, 10**15 - 1])
def test_whole_numbers_may_count_from_0(counted):
    assert np.array_equal(_times.since_1970("time", counted), counted)


@pytest.mark.parametrize(
    "time",
    [
        np.datetime64("2300-01-01"), np.datetime64("9999-12-31T23:59"), np.datetime64("1969-12-31"), np.datetime64("NaT"),
        datetime(3000, 1, 1), datetime(1, 1, 1), datetime(1, 1, 1, tzinfo=timezone(timedelta(hours=5))), date(2200, 1, 1),
        "", "NaT", "now", "yesterday", "2300-01-01", "9999-01-01T00:00:00.123456789", "2023-02-30", "1700000000000000000",
        -1, 2**63, 2**64, np.uint64(2**64 - 1), 1_700_000_000, 1_700_000_000_000_000, 10**16, 1.7e9, True, None, {"a": 1}, b"2023",
    ],
)
def test_other_times_are_refused_and_named(time):
    whole = "10**9"
    refused(whole, _times.since_1970, "time", time)
    refused(whole, _times.since_1970, "time", [time] * 3)
    if not isinstance(time, (dict, bytes, bool, float, int, np.uint64)):
        refused("time[1]", _times.since_1970, "time", ["2023-11-14", time])


def test_seconds_since_1970_are_known_where_none_of_them_counts_from_0():
    assert _times.since_1970("time", [0, 10**9]).tolist() == [0, 10**9]
    assert _times.since_1970("time", np.datetime64(10**9, "ns")) == 10**9
    refused("time[0]: give datetime64", _times.since_1970, "time", [10**9, 2 * 10**9])


@pytest.mark.parametrize("every_s", [np.nan, np.inf, 1e300, 0, -1, 1e-12, "x", None])
def test_bursts_follow_each_other(every_s):
    refused("every_s: give s", _times.of_bursts, NS, 3, every_s)


def test_rows_of_labels_say_what_is_misspelt():
    rows = lambda *given: _arrays.labels(list(given), None).text.splitlines()[1:]
    refused("did you mean channel?", rows, {"chanel": 3, "state": "healthy"})
    refused("rows as dicts", rows, {"state": "healthy"}, "EC")
    moment = datetime(2023, 11, 14, 22, 13, 20)
    for same in [moment, moment.replace(tzinfo=timezone.utc), np.datetime64(moment)]:
        assert rows({"from": same, "state": "EC"}) == [f"*,*,{NS},,EC,"]
    refused("labels: to", rows, {"to": datetime(3000, 1, 1), "state": "EC"})
    assert rows({"from": "2023-11-14T22:13:20Z", "to": 5, "state": "EC", "severity": None}) == ["*,*,2023-11-14T22:13:20Z,5,EC,"]


def test_masked_samples_are_not_numbers():
    plain = np.arange(12, dtype=np.int16).reshape(2, 6)
    masked = np.ma.array(plain, mask=plain == 4)
    for given in (masked, [masked[0], masked[1]]):
        read = _arrays.bursts(given, 1e-6).samples
        assert read.dtype == np.float32 and np.flatnonzero(np.isnan(read)).tolist() == [4]
    assert _arrays.bursts(np.ma.array(plain), 1e-6).samples.dtype == np.int16
    beside = _arrays.bursts(plain, 1e-6, temperature_c=np.ma.array([20.0], mask=[True]))
    assert np.isnan(beside.temperature_c).all()


def test_a_masked_sample_costs_its_signal(design, samples):
    masked = np.ma.array(samples, mask=np.zeros(samples.shape, bool))
    masked[0, 3, 5] = np.ma.masked
    table = design.judge(masked)
    reasons = zip(table["acquired_at"].cast(pa.int64()).to_pylist(), table["channel"].to_pylist(), table["reason"].to_pylist())
    assert [(time, channel) for time, channel, reason in reasons if reason == "non_finite"] == [(0, 3)]


def test_settings_are_written_as_toml():
    given = {"a": {"EC": 2.0, "b c": [1, True]}, "b": np.True_, "c": np.array([1.5, 2.0]), "d": ["x", "y"], "e": "5 min", "f": np.int8(3)}
    assert _words.settings(given) == [
        'a={"EC" = 2.0, "b c" = [1, true]}', "b=true", "c=[1.5, 2.0]", 'd=["x", "y"]', "e=5 min", "f=3",
    ]
    refused('set: give a dict, as {"detect.mu": 2}', _words.settings, "a=1")
    refused("set: a: give a number", _words.settings, {"a": None})
    refused("set: give a text", _words.settings, {1: 2})


def test_priors_are_a_dict(design, samples):
    assert design.judge(samples, set={"isolate.priors": {"EC": 2.0}, "identify.common_change": np.True_}).num_rows == 160


def test_arguments_of_other_types_are_refused(design, samples, tmp_path):
    for keywords, words in [
        (dict(first_channel=-1), "first_channel: give 0 to 4294967288, not -1"),
        (dict(first_channel=2**32 - 1), "first_channel: give 0 to 4294967288, not 4294967295"),
        (dict(first_channel=1.5), "first_channel: give 0 to"),
        (dict(printhead="\udc80"), "printhead: give a text that UTF-8 can write"),
        (dict(printhead=None), "printhead: give a text"),
        (dict(period_s="x"), "period_s: give s, above 0"),
        (dict(period_s=0), "period_s: give s, above 0, not 0"),
        (dict(period_s=-1), "period_s: give s, above 0, not -1"),
        (dict(period_s=np.nan), "period_s: give s, above 0"),
        (dict(state=5), "state: give an inkling.State"),
        (dict(set="a=1"), "set: give a dict"),
        (dict(time={"a": 1}), "time: give datetime64"),
        (dict(temperature_c="x"), "temperature_c: give one number"),
        (dict(threads=-1), "threads: give 1 to 1024, not -1"),
        (dict(identify="x"), "design, windows"),
    ]:
        refused(words, design.judge, samples, **keywords)
    refused("inkling.replay judges recordings", design.judge, "x.mcap")
    refused("inkling.replay judges recordings", design.judge, [Path("x.mcap")])
    refused("array: give channels x samples", design.judge, [[1, 2], [3]])
    refused("an array of shape", design.judge, {"a": 1})
    refused("an inkling.Design", inkling.State, 5)
    refused("an inkling.Design", inkling.State.load, tmp_path / "state.json", DESIGN)
    refused("design: give the name of a file", inkling.replay, RECORDING, 5, tmp_path)
    refused("out: give the name of a file", inkling.replay, RECORDING, DESIGN, 5)
    refused("threads: give 1 to 1024", inkling.replay, RECORDING, DESIGN, tmp_path, threads=0)
    refused("recordings: give names", inkling.replay, [], DESIGN, tmp_path)
    refused("recordings: give names", inkling.replay, 5, DESIGN, tmp_path)
    refused("path: give the name of a file", inkling.Design.load, 5)
    refused("path: give the name of a file", design.save, 5)
    refused("directory: give the name of a file", inkling.read, 5)
    healthy = {"state": "healthy"}
    refused("did you mean period_s?", inkling.Design.train, samples, healthy, perid_s=1e-6)
    refused("did you mean new_class?", inkling.Design.train, RECORDING, healthy, new_clas="Foo")
    refused("period_s: give s, above 0", inkling.Design.train, samples, healthy, period_s=0)
    refused("no finite number", inkling.Design.cold, samples * np.nan, period_s=1e-6)
    refused("labels: give the name of a CSV file", inkling.Design.train, samples, None, period_s=1e-6)
    refused("new_class: give a text, or several", inkling.Design.train, samples, healthy, period_s=1e-6, new_class=None)
    refused("new_class: give a text", inkling.Design.train, samples, healthy, period_s=1e-6, new_class=[5])
    refused("labels: give the name of a file", inkling.critique, RECORDING, labels=healthy)
    refused("baseline: give the name of a file", inkling.replay, RECORDING, DESIGN, tmp_path, baseline=5)
    refused("did you mean plant?", inkling.critique, samples, plants="oscillator")


def test_the_default_may_be_said(design, samples):
    assert design.judge(samples, identify=None, threads=np.int8(2)).equals(design.judge(samples))


def test_lists_of_arrays_are_learned_from(samples):
    beside = dict(period_s=1e-6, set={"detect.false_alarm_rate": 0.01})
    expected = inkling.Design.cold(samples, **beside).digest
    assert inkling.Design.cold(list(samples), **beside).digest == expected
    assert inkling.Design.cold(samples.tolist(), **beside).digest == expected


def test_one_new_class_is_one_name(samples):
    states = np.full(samples.shape[1], "healthy", dtype=object)
    states[0] = "Foo"
    try:
        inkling.Design.train(samples, states, period_s=1e-6, new_class="Foo")
    except inkling.Error as error:
        assert "Foo" in str(error) and "nobody has declared" not in str(error)


def test_a_state_belongs_to_a_design(design, samples):
    other = inkling.Design.cold(samples, period_s=design.sample_period_s)
    refused("state: of another design", design.judge, samples, state=inkling.State(other))
    assert design.judge(samples, state=inkling.State(design)).num_rows == 160


def test_files_of_others_are_not_replaced(design, tmp_path):
    theirs = "printhead,channel,from,to,state,severity\n"
    at = lambda name: tmp_path / name
    for name, save, what in [
        ("labels.csv", design.save, "is no design"),
        ("state.json", inkling.State(design).save, "is no file of baselines"),
    ]:
        at(name).write_text(theirs)
        refused(what, save, at(name))
        assert at(name).read_text() == theirs
        at(name).unlink()
        save(at(name))
        ours = at(name).read_bytes()
        save(at(name))
        assert at(name).read_bytes() == ours != theirs.encode()
    refused("is no design", design.save, at("state.json"))


def test_a_loaded_design_stays_its_file(design, tmp_path):
    # a file may say what this version would not write, if only a space
    text = DESIGN.read_bytes().replace(b"{", b"{ ", 1)
    (tmp_path / "a.json").write_bytes(text)
    loaded = inkling.Design.load(tmp_path / "a.json")
    loaded.save(tmp_path / "b.json")
    assert (tmp_path / "b.json").read_bytes() == text
    assert inkling.Design.load(tmp_path / "b.json").digest == loaded.digest != design.digest
    out = tmp_path / "out"
    inkling.replay(RECORDING, tmp_path / "a.json", out)
    written = next(out.rglob("*.verdicts.parquet")).stat().st_mtime_ns
    inkling.replay(RECORDING, loaded, out)
    assert next(out.rglob("*.verdicts.parquet")).stat().st_mtime_ns == written


def test_designs_and_errors_are_pickled(design, samples):
    for error in (inkling.Error("x"), inkling.UsageError("x"), inkling.InklingWarning("x")):
        again = pickle.loads(pickle.dumps(error))
        assert type(again) is type(error) and again.args == ("x",)
    assert pickle.loads(pickle.dumps(design)).digest == design.digest
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        tables = list(pool.map(design.judge, [samples, samples[:1]]))
    assert tables[0].equals(design.judge(samples)) and tables[1].num_rows == 8


def test_names_may_begin_with_a_minus(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("-night.mcap").write_bytes(RECORDING.read_bytes())
    run = inkling.replay("-night.mcap", DESIGN, "-out")
    assert run.exit == 0 and Path("-out", "-night.verdicts.parquet").is_file()


def test_what_replay_says_is_a_warning(tmp_path, capfd):
    (tmp_path / "torn.mcap").write_bytes(RECORDING.read_bytes()[:-20_000])
    with pytest.warns(inkling.InklingWarning, match="torn.mcap: bytes") as said:
        run = inkling.replay(tmp_path / "torn.mcap", DESIGN, tmp_path / "out")
    assert run.exit == 3 and {warning.filename for warning in said} == {__file__}
    (tmp_path / "none.mcap").write_bytes(b"")
    with pytest.warns(inkling.InklingWarning, match="none.mcap"):
        inkling.replay([tmp_path / "none.mcap", RECORDING], DESIGN, tmp_path / "out")
    with pytest.raises(inkling.Error, match="none of 2 recordings could be judged\n.*none.mcap"):
        (tmp_path / "nothing.mcap").write_bytes(b"")
        inkling.replay([tmp_path / "none.mcap", tmp_path / "nothing.mcap"], DESIGN, tmp_path / "failed")
    assert capfd.readouterr().err == ""


def test_a_critique_that_fails_leaves_nothing(samples, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with warnings.catch_warnings():
        warnings.simplefilter("error", ResourceWarning)
        with pytest.raises(inkling.Error):
            inkling.critique(tmp_path / "missing.mcap")
        gc.collect()
        assert list(tmp_path.iterdir()) == []
        result = inkling.critique(samples[:4, :, :64], period_s=1e-6, plant="oscillator")
        assert result.directory.parent == tmp_path and "<svg" in result.html
        del result
        gc.collect()
        assert list(tmp_path.iterdir()) == []
