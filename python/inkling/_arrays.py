"""Turns what users give into what the library reads: arrays of samples, and labels.

Whatever is wrong with an argument is a `UsageError` here, so that Rust (`python/src/array.rs`) meets only
valid arrays.
"""

from __future__ import annotations

import csv
import inspect
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from . import _checked, _times, _words
from ._inkling import UsageError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

#: One moment: datetime64 or datetime (UTC), ISO 8601 text, or integer ns since 1970.
Time = Any
#: Columns of a CSV of labels.
_COLUMNS = ["printhead", "channel", "from", "to", "state", "severity"]
#: Channels are numbered from 0 to one below this: their numbers are u32 in a recording.
_CHANNELS = 2**32


@dataclass
class Bursts:
    """Bursts of one printhead."""

    #: Bursts x channels x samples, int16 or float32, C-contiguous; counts.
    samples: npt.NDArray[Any]
    #: Time of the first sample of each burst (t_a), ns since 1970, UTC.
    times_ns: npt.NDArray[np.int64]
    period_s: float
    printhead: str
    first_channel: int
    #: Temperature in degrees C and drive voltage in V, one per burst; empty: not recorded.
    temperature_c: npt.NDArray[np.float64]
    voltage_v: npt.NDArray[np.float64]


@dataclass
class Labels:
    """Labels: the name of a file, or the text of one."""

    file: str | None
    text: str


def _first(given: object) -> object:
    """The first thing in nested lists that is no list."""
    while isinstance(given, (list, tuple)) and given:
        given = given[0]
    return given


def is_array(given: object) -> bool:
    """Whether an argument holds samples, and not names of recordings."""
    first = _first(given)
    return not _words.is_name(first) and (hasattr(first, "__array__") or isinstance(first, (int, float)))


def _filled(given: Any, dtype: str) -> npt.NDArray[Any]:
    """An array of real numbers, NaN where they are masked."""
    import numpy as np

    masked: Any = np.ma.asarray(given).astype(dtype)
    return np.asarray(masked.filled(np.nan))


def _samples(array: Any) -> npt.NDArray[Any]:
    """The samples as an array of any shape; masked ones are NaN. A file's name is refused, since only
    `replay` takes one."""
    import numpy as np

    if _words.is_name(_first(array)):
        raise UsageError(f"{_first(array)!r}: a file's name: inkling.replay judges recordings")
    parts = array if isinstance(array, (list, tuple)) else [array]
    try:
        if any(np.ma.is_masked(part) for part in parts):
            return _filled(array, "<f4")
        return np.asarray(array)
    except (TypeError, ValueError):  # ragged, or no numbers
        raise _checked.wrong("array", "channels x samples, or bursts x channels x samples, of numbers", array) from None


def bursts(
    array: npt.ArrayLike,
    period_s: float,
    printhead: str = "array",
    time: Time | Sequence[Time] | None = None,
    every_s: float = 1.0,
    first_channel: int = 0,
    temperature_c: npt.ArrayLike | None = None,
    voltage_v: npt.ArrayLike | None = None,
) -> Bursts:
    """The bursts of an array, checked. int16 and float32 in C order are taken where they lie; anything else
    is copied, to int16 if its type fits into that, else to float32."""
    import numpy as np

    samples = _samples(array)
    if samples.ndim == 2:
        samples = samples[None]
    if samples.ndim != 3 or 0 in samples.shape:
        raise UsageError(
            f"an array of shape {np.shape(samples)}: give channels x samples, or bursts x channels x samples, none of them 0"
        )
    if samples.dtype.kind not in "iuf":
        raise UsageError(f"samples of type {samples.dtype}: give whole or real numbers")
    kind = np.dtype("<i2" if np.can_cast(samples.dtype, np.int16) else "<f4")
    samples = np.ascontiguousarray(samples, dtype=kind)
    count = len(samples)
    return Bursts(
        samples=samples,
        times_ns=_times.of_bursts(time, count, every_s),
        period_s=_checked.seconds("period_s", period_s),
        printhead=_checked.text("printhead", printhead),
        first_channel=_checked.whole("first_channel", first_channel, 0, _CHANNELS - samples.shape[1]),
        temperature_c=_per_burst("temperature_c", temperature_c, count),
        voltage_v=_per_burst("voltage_v", voltage_v, count),
    )


#: The keywords that go with an array.
_OF_ARRAY = list(inspect.signature(bursts).parameters)[1:]


def _per_burst(name: str, given: npt.ArrayLike | None, count: int) -> npt.NDArray[np.float64]:
    """A number for each burst, NaN where it was not recorded; an empty array if nothing is given."""
    import numpy as np

    if given is None:
        return np.empty(0)
    try:
        numbers = _filled(given, "<f8")
    except (TypeError, ValueError):
        raise _checked.wrong(name, "one number, or one per burst", given) from None
    try:
        return np.ascontiguousarray(np.broadcast_to(numbers, (count,)))
    except ValueError:
        raise UsageError(f"{name}: {numbers.shape} of {count} bursts: give one number, or one per burst") from None


def given(recordings: Any, of_array: Mapping[str, Any], others: Sequence[str]) -> list[str] | Bursts:
    """Names of recordings, or the bursts of an array, of which the keywords `of_array` say the rest. `others`
    are keywords that may have been meant by a misspelt one."""
    import numpy as np

    for name in of_array:
        if name not in _OF_ARRAY:
            raise _checked.misspelt("keywords", name, [*others, *_OF_ARRAY])
    if not is_array(recordings):
        if of_array:
            raise UsageError(f"{', '.join(of_array)}: of an array alone; recordings say it themselves")
        return _words.names(recordings)
    if "period_s" not in of_array:
        raise UsageError("period_s: an array does not say how far apart its samples are; give s")
    array = bursts(recordings, **of_array)
    if array.samples.dtype.kind == "f" and not np.isfinite(array.samples).any():
        raise UsageError("the array holds no finite number: there is nothing to learn from")
    return array


def labels(given: Any, of: Bursts | None) -> Labels:
    """Labels from a file's name, from rows as dicts, or from the states of an array's channels."""
    if _words.is_name(given):
        return Labels(file=_checked.path("labels", given), text="")
    if isinstance(given, Mapping) or (isinstance(given, Sequence) and given and isinstance(given[0], Mapping)):
        rows = [given] if isinstance(given, Mapping) else given
        return Labels(file=None, text=_csv(_row(row) for row in rows))
    if of is None or given is None:
        raise UsageError("labels: give the name of a CSV file, or rows as dicts; states by channel go with an array")
    return Labels(file=None, text=_csv(_of_states(given, of)))


def _row(given: Any) -> dict[str, object]:
    """A row of labels, checked. It holds for all printheads or channels if it names none. Times become ns
    since 1970."""
    if not isinstance(given, Mapping):
        raise _checked.wrong("labels", "rows as dicts", given)
    for key in given:
        if key not in _COLUMNS:
            raise _checked.misspelt("labels: a row's key", key, _COLUMNS)
    row = {"printhead": "*", "channel": "*", **given}
    for key in ("from", "to"):
        if _times.is_moment(row.get(key)):
            row[key] = int(_times.since_1970(f"labels: {key}", row[key]))
    return row


def _csv(rows: Iterable[Mapping[str, object]]) -> str:
    """Rows of labels as the text of a CSV."""
    text = io.StringIO()
    table = csv.DictWriter(text, _COLUMNS)
    table.writeheader()
    table.writerows(rows)
    return _checked.text("labels", text.getvalue())


def _of_states(states: npt.ArrayLike, of: Bursts) -> Iterable[dict[str, object]]:
    """A row of labels for each span of bursts in which a channel's state stays the same. Empty states are
    unknown: no row.

    A span ends where the next one begins, at the time of that burst; the last one has no end.
    """
    import numpy as np

    count, channels = of.samples.shape[:2]
    try:
        given = np.asarray(states)
    except ValueError:  # ragged
        raise _checked.wrong("labels", "states, one per channel, or bursts x channels", states) from None
    try:
        given = np.broadcast_to(given, (count, channels))
    except ValueError:
        raise UsageError(
            f"labels: states of shape {given.shape} for {count} bursts of {channels} channels: give one per channel, or "
            "bursts x channels"
        ) from None
    order = np.argsort(of.times_ns, kind="stable")
    times = of.times_ns[order]
    for channel in range(channels):
        column = given[order, channel]
        begins = np.flatnonzero(np.r_[True, column[1:] != column[:-1]])
        for begin, end in zip(begins, np.r_[begins[1:], count]):
            if str(column[begin]):
                yield {
                    "printhead": of.printhead,
                    "channel": of.first_channel + channel,
                    "from": int(times[begin]),
                    "to": int(times[end]) if end < count else "",
                    "state": str(column[begin]),
                }
