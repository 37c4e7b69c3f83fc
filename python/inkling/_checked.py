"""Checks of single arguments. Each gives the argument back, or raises a `UsageError` that says what to give
instead.

`name` is always what the error calls the argument.
"""

from __future__ import annotations

import difflib
import math
import operator
import os
import reprlib
from collections.abc import Sequence

from ._inkling import UsageError


def wrong(name: str, give: str, given: object) -> UsageError:
    """The error for a wrong argument, such as `threads: give 1 to 1024, not -1`."""
    return UsageError(f"{name}: give {give}, not {reprlib.repr(given)}")


def misspelt(name: str, given: object, right: Sequence[str]) -> UsageError:
    """The error for a name that is none of the right ones, with the one that was probably meant."""
    near = difflib.get_close_matches(str(given), right, n=1)
    hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(right)}"
    return UsageError(f"{name}: {reprlib.repr(given)} is not known; {hint}")


def text(name: str, given: object) -> str:
    """A text that can be written as UTF-8."""
    if not isinstance(given, str):
        raise wrong(name, "a text", given)
    try:
        given.encode()
    except UnicodeEncodeError:
        raise wrong(name, "a text that UTF-8 can write", given) from None
    return str(given)


def path(name: str, given: object) -> str:
    """The name of a file or directory."""
    if not isinstance(given, (str, bytes, os.PathLike)):
        raise wrong(name, "the name of a file or directory", given)
    return os.fsdecode(given)


def seconds(name: str, given: object) -> float:
    """A span of time in s, above 0."""
    try:
        number = float(given)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not 0 < number < math.inf:
        raise wrong(name, "s, above 0", given)
    return number


def whole(name: str, given: object, least: int, most: int) -> int:
    """A whole number from least to most."""
    try:
        number = operator.index(given)  # type: ignore[arg-type]
    except TypeError:
        raise wrong(name, f"{least} to {most}", given) from None
    if not least <= number <= most:
        raise wrong(name, f"{least} to {most}", given)
    return number
