"""Moments as users give them, turned into ns since 1970.

A whole number does not say its unit. A wrong guess would put a recording into another century, so numbers
that can only be meant in another unit than ns are refused.
"""

from __future__ import annotations

import re
from datetime import date, datetime, timezone
from typing import TYPE_CHECKING, Any

from . import _checked
from ._inkling import UsageError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

_GIVE = (
    "datetime64, datetime or ISO 8601 (UTC) of the years 1970 to 2199, or whole ns since 1970 (of seconds, multiply by 10**9)"
)
#: The beginning of the year 2200, s since 1970.
_END_S = 7_258_118_400
#: Whole numbers below this are times that count from 0, up to 11 days of ns, and have no date.
_MOST_COUNTED_NS = 10**15
#: The beginning of the year 1971. The times from 11 days on to here are refused: us since 1970 lie there.
_1971_NS = 31_536_000 * 10**9
#: Whole numbers from here to the year 2200 are s since 1970, if none of them counts from 0.
_LEAST_S = 10**8
_WITH_ZONE = re.compile(r"(\d{4}-\d\d-\d\d[T ][\d:.]+)(?:[Zz]|([+-])(\d\d):?(\d\d)?)")


def of_bursts(given: Any, count: int, every_s: float) -> npt.NDArray[np.int64]:
    """The time of each of `count` bursts, ns since 1970. If `given` is one time, it is that of the first
    burst, and the others follow every `every_s` s. If it is None, the first burst is at 0."""
    import numpy as np

    every_ns = _checked.seconds("every_s", every_s) * 1e9
    times = since_1970("time", 0 if given is None else given)
    if times.ndim == 0:
        if not (every_ns >= 1 and int(times) + (count - 1) * every_ns < _END_S * 1e9):
            raise _checked.wrong("every_s", f"s from burst to burst, so that all {count} lie before the year 2200", every_s)
        spread: npt.NDArray[np.int64] = times + np.rint(np.arange(count) * every_ns).astype("<i8")
        return spread
    if times.shape != (count,):
        raise UsageError(f"time: {times.shape} of {count} bursts: give one, or one per burst")
    return np.ascontiguousarray(times)


def is_moment(given: object) -> bool:
    """Whether its type says that it is a time."""
    import numpy as np

    return isinstance(given, (date, np.datetime64)) or hasattr(given, "to_datetime64")


def since_1970(name: str, given: Any) -> npt.NDArray[np.int64]:
    """Times as ns since 1970, in the shape in which they are given. `name` is what errors call them."""
    import numpy as np

    try:
        times = np.asarray(given)
    except ValueError:  # ragged
        raise _checked.wrong(name, _GIVE, given) from None
    if np.ma.is_masked(given):
        raise _checked.wrong(name, _GIVE, "a masked array")
    if times.dtype.kind in "iu":
        return _counted(name, times)
    if times.dtype.kind == "M":
        return _dated(name, times)
    if times.dtype.kind in "OU":
        flat = [_moment(_at(name, times, at), one) for at, one in enumerate(times.ravel().tolist())]
        return np.array(flat, dtype="<i8").reshape(times.shape)
    raise _checked.wrong(name, _GIVE, given)


def _at(name: str, times: npt.NDArray[Any], at: int) -> str:
    """What errors call the time with this place among several."""
    return f"{name}[{at}]" if times.ndim else name


def _refuse(name: str, times: npt.NDArray[Any], bad: Any) -> None:
    """Raises an error about the first time for which `bad` is true."""
    import numpy as np

    for at in np.flatnonzero(bad)[:1]:
        raise UsageError(f"{_at(name, times, at)}: give {_GIVE}, not {times.flat[at]}")


def _dated(name: str, times: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    """datetime64 as ns. The years are compared, because ns of far years wrap around."""
    import numpy as np

    years = times.astype("datetime64[Y]").astype(np.int64) + 1970
    _refuse(name, times, np.isnat(times) | (years < 1970) | (years > 2199))
    return times.astype("datetime64[ns]").astype("<i8")


def _counted(name: str, times: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    """Whole numbers as ns. Refused are numbers of 11 days to one year, which us since 1970 would be, and
    arrays whose numbers all can be s since 1970."""
    import numpy as np

    most = np.iinfo(np.int64).max
    ns = (np.minimum(times, np.uint64(most)) if times.dtype == np.uint64 else times).astype("<i8")
    _refuse(name, times, (ns < 0) | (ns >= _END_S * 10**9) | ((ns >= _MOST_COUNTED_NS) & (ns < _1971_NS)))
    if ns.size and ns.min() >= _LEAST_S and ns.max() < _END_S:
        _refuse(name, times, np.ones(ns.shape, bool))
    return ns


def _moment(name: str, given: Any) -> int:
    """One time of any type as ns since 1970."""
    import numpy as np

    try:
        if isinstance(given, str):
            moment = _iso(given)
        elif hasattr(given, "to_datetime64"):  # of pandas
            moment = given.to_datetime64()
        elif isinstance(given, datetime):
            utc = given.astimezone(timezone.utc).replace(tzinfo=None) if given.tzinfo else given
            moment = np.datetime64(utc, "us")
        elif isinstance(given, (date, np.datetime64)):
            moment = np.datetime64(given)
        elif isinstance(given, (int, np.integer)) and not isinstance(given, bool):
            return int(_counted(name, np.asarray(given)))
        else:
            raise ValueError
        return int(_dated(name, np.asarray(moment)))
    except (ValueError, OverflowError):
        raise _checked.wrong(name, _GIVE, given) from None


def _iso(given: str) -> np.datetime64:
    """A text of ISO 8601. The zone is read here, because NumPy does not read zones, and warns of them."""
    import numpy as np

    zone = _WITH_ZONE.fullmatch(given.strip())
    base = zone[1] if zone else given.strip()
    if not 1970 <= int(base[:4]) < 2200:  # or is no number: `now`
        raise ValueError
    moment = np.datetime64(base)
    if not zone or not zone[2]:
        return moment
    east = int(zone[2] + "1") * (60 * int(zone[3]) + int(zone[4] or 0))
    return moment - np.timedelta64(east, "m")
