"""What users give, as the library reads it: arrays of samples, times, labels, settings."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Union

from ._inkling import UsageError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

Path = Union[str, "os.PathLike[str]"]
#: One moment: datetime64 or datetime (UTC), ISO 8601 text, or integer ns since 1970.
Time = Any
Settings = Mapping[str, object]


@dataclass
class Bursts:
    """Bursts of one printhead."""

    #: Bursts x channels x samples, int16 or float32, C-contiguous; counts.
    samples: npt.NDArray[Any]
    #: t_a of each burst, ns since 1970, UTC.
    times_ns: npt.NDArray[np.int64]
    period_s: float
    printhead: str
    first_channel: int
    #: One per burst, or empty: not recorded.
    temperature_c: npt.NDArray[np.float64]
    voltage_v: npt.NDArray[np.float64]


@dataclass
class Labels:
    """A file, or the text of one."""

    file: str | None
    text: str


def is_array(given: object) -> bool:
    """Whether it holds samples, and no names of recordings."""
    return hasattr(given, "__array__") or hasattr(given, "__array_interface__")


def names(given: Path | Iterable[Path]) -> list[str]:
    """One name, or several."""
    return [os.fspath(given)] if isinstance(given, (str, os.PathLike)) else [os.fspath(one) for one in given]


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
    """int16 and float32 are taken as they lie, if they lie in rows; anything else becomes float32."""
    import numpy as np

    samples = np.asarray(array)
    if samples.ndim == 2:
        samples = samples[None]
    if samples.ndim != 3 or 0 in samples.shape:
        raise UsageError(
            f"an array of shape {np.shape(array)}: give channels x samples, or bursts x channels x samples, none of them 0"
        )
    if samples.dtype.kind not in "iuf":
        raise UsageError(f"samples of type {samples.dtype}: give whole or real numbers")
    kind = np.dtype("<i2" if np.can_cast(samples.dtype, np.int16) else "<f4")
    samples = np.ascontiguousarray(samples, dtype=kind)
    count = len(samples)
    return Bursts(
        samples=samples,
        times_ns=_times(time, count, every_s),
        period_s=float(period_s),
        printhead=str(printhead),
        first_channel=int(first_channel),
        temperature_c=_per_burst("temperature_c", temperature_c, count),
        voltage_v=_per_burst("voltage_v", voltage_v, count),
    )


def _times(time: Time | Sequence[Time] | None, count: int, every_s: float) -> npt.NDArray[np.int64]:
    import numpy as np

    times = np.asarray(0 if time is None else time)
    if times.dtype.kind == "O":  # datetime; with a zone it is not NumPy's
        from datetime import timezone

        flat = [t.astimezone(timezone.utc).replace(tzinfo=None) if getattr(t, "tzinfo", None) else t for t in times.flat]
        times = np.asarray(flat, dtype="datetime64[ns]").reshape(times.shape)
    try:
        if times.dtype.kind in "UM":
            times = times.astype("datetime64[ns]").astype(np.int64)
        if times.dtype.kind not in "iu":
            raise ValueError(f"times of type {times.dtype}")
        times = times.astype("<i8")
    except ValueError as error:
        raise UsageError(f"time: {error}: give datetime64, ISO 8601 (UTC) or integer ns since 1970") from None
    if times.ndim == 0:
        spread: npt.NDArray[np.int64] = times + np.rint(np.arange(count) * (every_s * 1e9)).astype("<i8")
        return spread
    if times.shape != (count,):
        raise UsageError(f"time: {times.shape} of {count} bursts: give one, or one per burst")
    return np.ascontiguousarray(times)


def _per_burst(name: str, given: npt.ArrayLike | None, count: int) -> npt.NDArray[np.float64]:
    import numpy as np

    if given is None:
        return np.empty(0)
    try:
        return np.ascontiguousarray(np.broadcast_to(np.asarray(given, "<f8"), (count,)))
    except ValueError:
        raise UsageError(f"{name}: {np.shape(given)} of {count} bursts: give one number, or one per burst") from None


def given(recordings: Any, of_array: Mapping[str, Any]) -> list[str] | Bursts:
    """Names of recordings, or an array's bursts, of which the keywords of `bursts` say the rest."""
    if is_array(recordings):
        if "period_s" not in of_array:
            raise UsageError("period_s: an array does not say how far apart its samples are; give s")
        return bursts(recordings, **of_array)
    if of_array:
        raise UsageError(f"{', '.join(of_array)}: of an array alone; recordings say it themselves")
    return names(recordings)


def settings(given: Settings | None) -> list[str]:
    """Keys and values of `pipeline.toml`, as `--set` takes them."""
    return [f"{key}={_in_toml(value)}" for key, value in (given or {}).items()]


def _in_toml(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_in_toml(one) for one in value) + "]"
    return str(value)


def options(set: Settings | None, **given: object) -> list[str]:
    """Words of a command line: `--name value` of what is given, and `--set` of settings."""
    words = []
    for name, value in given.items():
        flag = "--" + name.replace("_", "-")
        if value is True:
            words.append(flag)
        elif value is not None and value is not False:
            words += [flag, os.fspath(value) if isinstance(value, os.PathLike) else str(value)]
    for pair in settings(set):
        words += ["--set", pair]
    return words


def labels(given: Any, of: Bursts | None) -> Labels:
    """A file's name, rows of one, or the states of an array's channels."""
    if isinstance(given, (str, os.PathLike)):
        return Labels(file=os.fspath(given), text="")
    if isinstance(given, Mapping) or (isinstance(given, Sequence) and given and isinstance(given[0], Mapping)):
        rows = [given] if isinstance(given, Mapping) else given
        return Labels(file=None, text=_csv({"printhead": "*", "channel": "*", **row} for row in rows))
    if of is None:
        raise UsageError("labels: give the name of a CSV file, or rows as dicts; states by channel go with an array")
    return Labels(file=None, text=_csv(_of_states(given, of)))


def _csv(rows: Iterable[Mapping[str, object]]) -> str:
    text = io.StringIO()
    table = csv.DictWriter(text, ["printhead", "channel", "from", "to", "state", "severity"], extrasaction="ignore")
    table.writeheader()
    table.writerows(rows)
    return text.getvalue()


def _of_states(states: npt.ArrayLike, of: Bursts) -> Iterable[dict[str, object]]:
    """A row for each span of bursts in which a channel's state stays; empty states are unknown."""
    import numpy as np

    count, channels = of.samples.shape[:2]
    given = np.asarray(states)
    try:
        given = np.broadcast_to(given, (count, channels))
    except ValueError:
        raise UsageError(
            f"labels: states of shape {np.shape(states)} for {count} bursts of {channels} channels: give one per channel, or "
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
