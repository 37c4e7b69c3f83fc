"""Turns arguments of functions into words of a command line, which the library parses as the command does."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from typing import Union

from . import _checked

#: The name of a file or directory.
Path = Union[str, "os.PathLike[str]"]
#: Settings of `pipeline.toml`: a value by its dotted name.
Settings = Mapping[str, object]


def is_name(given: object) -> bool:
    """Whether an argument is the name of a file."""
    return isinstance(given, (str, bytes, os.PathLike))


def names(given: Path | Iterable[Path]) -> list[str]:
    """Names of recordings, of which one or several are given."""
    listed: list[object] = [given] if is_name(given) else list(given) if isinstance(given, Iterable) else []
    if not listed:
        raise _checked.wrong("recordings", "names of files, directories or patterns", given)
    return [_checked.text("recordings", _checked.path("recordings", one)) for one in listed]


def texts(name: str, given: object) -> list[str]:
    """Texts, of which none, one or several are given."""
    if not isinstance(given, Iterable):
        raise _checked.wrong(name, "a text, or several", given)
    return [_checked.text(name, one) for one in ([given] if isinstance(given, str) else given)]


def path(name: str, given: object) -> str | None:
    """The name of a file; None if none is given."""
    return None if given is None else _checked.path(name, given)


def threads(given: object) -> int | None:
    """The number of workers; None, which means as many as there are cores, stays None."""
    return None if given is None else _checked.whole("threads", given, 1, 1024)


def options(set: Settings | None, **given: object) -> list[str]:
    """`--name=value` for each argument that is given, a plain flag for True, and `--set` for each setting."""
    words = []
    for name, value in given.items():
        flag = "--" + name.replace("_", "-")
        if value is True:
            words.append(flag)
        elif value is not None and value is not False:
            said = _checked.path(name, value) if is_name(value) else str(value)
            words.append(f"{flag}={_checked.text(name, said)}")
    return words + [f"--set={pair}" for pair in settings(set)]


def settings(given: Settings | None) -> list[str]:
    """Settings as `--set` takes them: `key=value`."""
    if given is None:
        return []
    if not isinstance(given, Mapping):
        raise _checked.wrong("set", 'a dict, as {"detect.mu": 2}', given)
    return [_checked.text("set", f"{_checked.text('set', key)}={_setting(key, value)}") for key, value in given.items()]


def _setting(key: str, value: object) -> str:
    """A value as `--set` takes it: a text stands there without quotes."""
    return str(value) if isinstance(value, str) else _in_toml(key, value)


def _in_toml(key: str, value: object) -> str:
    """A value as it stands in TOML; within lists and dicts, texts have quotes."""
    if hasattr(value, "tolist"):  # an array or a number of NumPy
        value = value.tolist()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return str(value)
    if isinstance(value, (str, os.PathLike)):
        return json.dumps(os.fspath(value), ensure_ascii=False)
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_in_toml(key, one) for one in value) + "]"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{json.dumps(str(name))} = {_in_toml(key, one)}" for name, one in value.items()) + "}"
    raise _checked.wrong(f"set: {key}", "a number, a text, True or False, or a list or dict of these", value)
