"""Designs, and what is known of heads and channels from one call to the next."""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Literal

from . import _arrays, _inkling
from ._arrays import Path, Settings, Time

if TYPE_CHECKING:
    import numpy.typing as npt
    import pyarrow as pa


class InklingWarning(UserWarning):
    """What makes a result less certain; the command says it on stderr."""


def _warn(said: Iterable[str]) -> None:
    for sentence in said:
        warnings.warn(sentence, InklingWarning, stacklevel=3)


class State:
    """What is known of heads and of each of their channels now: `inkling replay --baseline`.

    Give it to `Design.judge` of one stretch of bursts after the other, in the order of their times.
    """

    def __init__(self, design: Design) -> None:
        """Nothing is known yet; it belongs to that design."""
        self._native = _inkling.State(design.digest)

    @classmethod
    def load(cls, path: Path, design: Design) -> State:
        """From a file of baselines; nothing is known yet where there is none. `Error` where it is of another design."""
        state = cls.__new__(cls)
        state._native = _inkling.read_state(path, design.digest)
        return state

    def save(self, path: Path) -> None:
        """To a file that `State.load` and `inkling replay --baseline` read."""
        self._native.save(path)

    @property
    def channels(self) -> int:
        """How many channels it knows."""
        return self._native.channels

    def __repr__(self) -> str:
        return f"<inkling.State of {self.channels} channels>"


class Design:
    """What a printhead's healthy channels ring like, what is too far from it, and what faults look like. Immutable."""

    def __init__(self, native: _inkling.Design) -> None:
        self._native = native

    @classmethod
    def load(cls, path: Path) -> Design:
        """From a file, of `save` or `inkling train`."""
        return cls(_inkling.Design.load(path))

    def save(self, path: Path) -> None:
        """To a JSON file (`schemas/design.md`), complete or not at all."""
        self._native.save(path)

    def page(self, path: Path) -> None:
        """Writes what it promises before any data are judged, as a page: the smallest fault of each class that it finds, and the
        classes that it takes for each other. path: a name.html."""
        with tempfile.TemporaryDirectory() as beside:
            file = os.path.join(beside, "design.json")
            self.save(file)
            _inkling.verb(["score", "--design", file, "--report", os.fspath(path)])

    @classmethod
    def train(
        cls,
        recordings: Path | Iterable[Path] | npt.ArrayLike,
        labels: Any,
        *,
        new_class: Sequence[str] = (),
        set: Settings | None = None,
        **of_array: Any,
    ) -> Design:
        """Learns a design, as `inkling train` does.

        recordings: MCAP files, directories or glob patterns; or an array of samples in counts, bursts x channels x samples or
            channels x samples.
        labels: a CSV file; or its rows as dicts (`printhead`, `channel`, `from`, `to`, `state`, `severity`); or, of an array, the
            states of its channels: strings, one per channel or bursts x channels. `healthy`, `ignore`, a fault class, empty: unknown.
        new_class: names of one's own among the states.
        set: settings of `pipeline.toml` by their names.
        of_array: `period_s` in s, and what else is said of an array as in `judge`.
        """
        given = _arrays.given(recordings, of_array)
        of = given if isinstance(given, _arrays.Bursts) else None
        native = _inkling.Design.train(given, _arrays.labels(labels, of), list(new_class), _arrays.settings(set))
        _warn(native.warnings)
        return cls(native)

    @classmethod
    def cold(cls, healthy: Path | Iterable[Path] | npt.ArrayLike, **keywords: Any) -> Design:
        """A design of healthy signals alone: all of `healthy` is, and faults are named by what the physics says of them.

        healthy, keywords: as `recordings` and the keywords of `train`.
        """
        return cls.train(healthy, {"state": "healthy"}, **keywords)

    def judge(
        self,
        array: npt.ArrayLike,
        *,
        period_s: float | None = None,
        printhead: str = "array",
        time: Time | Sequence[Time] | None = None,
        every_s: float = 1.0,
        first_channel: int = 0,
        temperature_c: npt.ArrayLike | None = None,
        voltage_v: npt.ArrayLike | None = None,
        identify: Literal["design", "windows"] = "design",
        state: State | None = None,
        threads: int | None = None,
        set: Settings | None = None,
    ) -> pa.Table:
        """Verdicts, one row per channel and burst, as `inkling replay` writes them (`schemas/verdicts.md`).

        array: samples in counts, channels x samples or bursts x channels x samples. int16 and float32 in C order are read where
            they lie; anything else is copied to float32 first.
        period_s: of sampling, s; by default the design's.
        printhead: whose bursts they are; its own model judges, where the design has one.
        time: t_a of the first burst, or of each: datetime64 or datetime (UTC), ISO 8601, or integer ns since 1970. With one,
            bursts follow every `every_s` s; without, from 1970 on.
        first_channel: number of the first row.
        temperature_c, voltage_v: of the ink in degrees C, of the actuation in V; one, or one per burst.
        identify: by the design's models, or by models of the array's own healthy windows.
        state: what is known of each channel from before; it is brought up to date.
        threads: workers per parallel stage; by default the machine's cores.
        set: settings of `pipeline.toml` by their names.
        """
        import pyarrow as pa

        period_s = self.sample_period_s if period_s is None else period_s
        given = _arrays.bursts(array, period_s, printhead, time, every_s, first_channel, temperature_c, voltage_v)
        options = _arrays.options(set, identify=identify, threads=threads)
        rows, said = self._native.judge(given, options, state._native if state is not None else None)
        _warn(said)
        return pa.RecordBatchReader.from_stream(rows).read_all()

    @property
    def sample_period_s(self) -> float:
        """Of the signals that it judges, s."""
        return self._native.sample_period_s

    @property
    def samples(self) -> int:
        """Per signal."""
        return self._native.samples

    @property
    def classes(self) -> list[str]:
        """The faults that it names."""
        return self._native.classes

    @property
    def printheads(self) -> list[str]:
        """Those with a model of their own; the pooled one judges others."""
        return self._native.printheads

    @property
    def digest(self) -> str:
        """Of its file, as verdicts name it."""
        return self._native.digest

    def __repr__(self) -> str:
        return f"<inkling.Design of {self.samples} samples every {self.sample_period_s:g} s: {', '.join(self.classes)}>"
