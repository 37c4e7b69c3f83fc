"""Designs, and the state of heads and channels from one call to the next.

The classes check and arrange arguments, and call those of the same names in Rust (`python/src/design.rs`).
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Literal

from . import _arrays, _checked, _inkling, _words
from ._arrays import Time
from ._words import Path, Settings

if TYPE_CHECKING:
    import numpy.typing as npt
    import pyarrow as pa


class InklingWarning(UserWarning):
    """A warning of what makes a result less certain; the command says the same on stderr."""


def warn(said: Iterable[str]) -> None:
    """Gives warnings, as of the line of the user that calls the function that calls this one."""
    for sentence in said:
        warnings.warn(sentence, InklingWarning, stacklevel=3)


def _digest_of(design: object) -> str:
    """The digest of a design, which says what a state belongs to."""
    if not isinstance(design, Design):
        raise _checked.wrong("design", "an inkling.Design", design)
    return design.digest


class State:
    """What is known of heads and of each of their channels now, as `inkling replay --baseline` keeps it in a
    file.

    Give the same state to one call of `Design.judge` after the other, with bursts in the order of their
    times: each call begins with what the calls before have taught, and brings the state up to date.
    """

    def __init__(self, design: Design) -> None:
        """A state in which nothing is known yet. It belongs to this design."""
        self._native = _inkling.State(_digest_of(design))

    @classmethod
    def load(cls, path: Path, design: Design) -> State:
        """Reads a state from a file of baselines; if there is no such file, nothing is known yet.

        Raises `UsageError` if the file cannot be read, or if its state belongs to another design.
        """
        state = cls.__new__(cls)
        state._native = _inkling.read_state(_checked.path("path", path), _digest_of(design))
        return state

    def save(self, path: Path) -> None:
        """Writes the state to a file that `State.load` and `inkling replay --baseline` read.

        An existing file is replaced only if it is a state of the same design; otherwise this raises
        `UsageError`.
        """
        self._native.save(_checked.path("path", path))

    @property
    def channels(self) -> int:
        """How many channels it knows."""
        return self._native.channels

    def __repr__(self) -> str:
        return f"<inkling.State of {self.channels} channels>"


class Design:
    """What was learned of a printhead: how its healthy channels ring, which deviation is too large, and what
    faults look like.

    It is immutable, and can be pickled, for instance for processes of their own.
    """

    def __init__(self, native: _inkling.Design) -> None:
        self._native = native

    @classmethod
    def load(cls, path: Path) -> Design:
        """Reads a design from a file that `save` or `inkling train` wrote.

        Raises `UsageError` if the file cannot be read, or is no design of this version.
        """
        return cls(_inkling.Design.load(_checked.path("path", path)))

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpickled, (self._native.text,)

    def save(self, path: Path) -> None:
        """Writes the design to a JSON file (`schemas/design.md`), complete or not at all.

        A design that was loaded is written byte for byte, so that its digest stays. An existing file is
        replaced only if it is a design; otherwise this raises `UsageError`.
        """
        self._native.save(_checked.path("path", path))

    def promise(self) -> dict[str, Any]:
        """What the design promises before any data are judged: the smallest fault of each class that it finds
        (`classes`), and how often it takes two classes for each other (`pairs`), as `inkling score --design
        FILE --json` tells it.

        Raises `Error` if it was trained by methods that promise nothing.
        """
        promise: dict[str, Any] = json.loads(self._native.promise())
        return promise

    @classmethod
    def train(
        cls,
        recordings: Path | Iterable[Path] | npt.ArrayLike,
        labels: Any,
        *,
        new_class: str | Sequence[str] = (),
        set: Settings | None = None,
        **of_array: Any,
    ) -> Design:
        """Learns a design from labelled recordings, as `inkling train` does. Raises `UsageError` for wrong
        arguments, and `Error` if nothing can be learned.

        recordings: MCAP files, directories or glob patterns; or an array of samples in counts, bursts x
            channels x samples or channels x samples; or a list of such parts. Masked samples are NaN.
        labels: a CSV file; or its rows as dicts (`printhead`, `channel`, `from`, `to`, `state`, `severity`);
            or, of an array, the states of its channels: strings, one per channel or bursts x channels.
            `healthy`, `ignore`, a fault class, empty: unknown. In a row, `from` and `to` are datetime64 or
            datetime (UTC), ns since 1970, or RFC 3339; keys that it leaves out do not restrict it.
        new_class: the states that are classes of your own: one name, or several.
        set: settings of `pipeline.toml` by their names.
        of_array: `period_s` in s, and what else is said of an array as in `judge`.
        """
        given = _arrays.given(recordings, of_array, ("labels", "new_class", "set"))
        of = given if isinstance(given, _arrays.Bursts) else None
        own = _words.texts("new_class", new_class)
        native = _inkling.Design.train(given, _arrays.labels(labels, of), own, _words.settings(set))
        warn(native.warnings)
        return cls(native)

    @classmethod
    def cold(cls, healthy: Path | Iterable[Path] | npt.ArrayLike, **keywords: Any) -> Design:
        """Learns a design from healthy signals alone: everything in `healthy` must be healthy. Faults are
        then named by what the physics says of them.

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
        identify: Literal["design", "windows"] | None = None,
        state: State | None = None,
        threads: int | None = None,
        set: Settings | None = None,
    ) -> pa.Table:
        """Judges bursts. Gives one row per channel and burst, as `inkling replay` writes them
        (`schemas/verdicts.md`). Raises `UsageError` for wrong arguments.

        array: samples in counts, channels x samples or bursts x channels x samples. int16 and float32 in C
            order are read where they lie; anything else is copied first, to int16 if its type fits into that,
            else to float32. Masked samples are NaN, and a signal that has one is rejected.
        period_s: sample period in s; by default the design's.
        printhead: whose bursts they are; its own model judges, where the design has one.
        time: t_a of the first burst, or of each: datetime64 or datetime (UTC), ISO 8601 (UTC, or with a
            zone), or whole ns since 1970; from 1970 to 2199. With one, bursts follow every `every_s` s;
            without, from 1970 on. Whole numbers below 10**15 (11 days) count from 0 and have no date. Those
            that can only be another unit are refused: the rest of 1970, and 10**8 to 7258118399 alone, which
            are s of 1973 to 2199. Give such counted ns as `np.datetime64(ns, "ns")`.
        first_channel: number of the array's first channel.
        temperature_c, voltage_v: temperature of the ink in degrees C, drive voltage in V; one number, or one
            per burst.
        identify: by the design's models (the default), or by models of the array's own healthy windows.
        state: what is known of each channel from earlier bursts, by this design; it is brought up to date.
        threads: workers per parallel stage, 1 to 1024; by default the machine's cores.
        set: settings of `pipeline.toml` by their names.
        """
        import pyarrow as pa

        period_s = self.sample_period_s if period_s is None else period_s
        given = _arrays.bursts(array, period_s, printhead, time, every_s, first_channel, temperature_c, voltage_v)
        options = _words.options(set, identify=identify or "design", threads=_words.threads(threads))
        rows, said = self._native.judge(given, options, None if state is None else self._own(state))
        warn(said)
        return pa.RecordBatchReader.from_stream(rows).read_all()

    def _own(self, state: object) -> _inkling.State:
        """The state in Rust; it must belong to this design."""
        if not isinstance(state, State):
            raise _checked.wrong("state", "an inkling.State", state)
        if state._native.design != self.digest:
            raise _inkling.UsageError(
                f"state: of another design ({state._native.design}, not {self.digest}): give this one's, or begin anew by "
                "inkling.State(design)"
            )
        return state._native

    @property
    def sample_period_s(self) -> float:
        """Sample period in s of the signals that it judges."""
        return self._native.sample_period_s

    @property
    def samples(self) -> int:
        """Number of samples of a signal."""
        return self._native.samples

    @property
    def classes(self) -> list[str]:
        """The fault classes that it names."""
        return self._native.classes

    @property
    def printheads(self) -> list[str]:
        """The printheads that have a model of their own; the pooled model judges all others."""
        return self._native.printheads

    @property
    def digest(self) -> str:
        """Digest of its file, by which verdicts name the design: `xxh3:` and 32 hexadecimal digits."""
        return self._native.digest

    def __repr__(self) -> str:
        return f"<inkling.Design of {self.samples} samples every {self.sample_period_s:g} s: {', '.join(self.classes)}>"


def _unpickled(text: bytes) -> Design:
    """The design that was pickled as this text."""
    return Design(_inkling.Design.unpickled(text))
