"""Runs verbs of the command (`replay`, `critique`), and reads what they leave behind."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import weakref
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path as File
from typing import TYPE_CHECKING, Any, Literal

from . import _arrays, _checked, _inkling, _words
from ._design import Design, warn
from ._words import Path, Settings

if TYPE_CHECKING:
    import numpy.typing as npt
    import pyarrow as pa


@dataclass(frozen=True)
class Read:
    """The tables of a directory of results. They are lazy: Polars LazyFrames if Polars is installed, else
    pyarrow datasets. None: there is no such file."""

    #: A row per channel and burst (`schemas/verdicts.md`).
    verdicts: Any
    #: A row per fault episode (`schemas/episodes.md`).
    episodes: Any
    #: A row per fault over recordings (`schemas/faults.md`): what `inkling report` wrote.
    faults: Any


def read(directory: Path) -> Read:
    """The tables that `replay` and `report` wrote into a directory and below. A recording whose verdicts lie
    in two places counts twice. Raises `UsageError` if there is no such directory."""
    root = File(_checked.path("directory", directory))
    if not root.is_dir():
        raise _inkling.UsageError(f"{root}: not a directory of results; `inkling replay --out` makes one")

    def table(kind: str) -> Any:
        files = sorted(os.fspath(file) for file in root.rglob(f"*.{kind}.parquet"))
        if not files:
            return None
        try:
            import polars
        except ImportError:
            import pyarrow.dataset

            return pyarrow.dataset.dataset(files)
        return polars.scan_parquet(files)

    return Read(verdicts=table("verdicts"), episodes=table("episodes"), faults=table("faults"))


@dataclass(frozen=True)
class Replay:
    """What a run of `inkling replay` left behind."""

    #: The directory of results.
    out: File
    #: Exit status. 0: done; 3: some input was damaged or rejected, or one of several recordings failed; 4: something
    #: was not judged.
    exit: int
    #: `run.json` (`schemas/journal.md`): what became of each recording.
    run: dict[str, Any]

    def read(self) -> Read:
        """The tables that it wrote."""
        return read(self.out)


def replay(
    paths: Path | Iterable[Path],
    design: Design | Path | None,
    out: Path,
    *,
    identify: Literal["design", "windows"] | None = None,
    baseline: Path | None = None,
    layout: str | None = None,
    force: bool = False,
    threads: int | None = None,
    set: Settings | None = None,
) -> Replay:
    """Judges recordings into files, as `inkling replay` does; recordings that are finished are skipped.

    paths: MCAP files, directories, glob patterns.
    design: a design or its file. None: faults are detected, but not named.
    out: the directory of results.
    identify: by the design's models, or by models of the recordings' own healthy windows.
    baseline: a file in which the state of heads and channels is kept from run to run.
    layout: how results are laid out in `out`: `tree`, `date` or `hive`.
    force: judge again what is finished.
    threads: workers per parallel stage, 1 to 1024; by default the machine's cores.
    set: settings of `pipeline.toml` by their names.

    What the command warns of is an `InklingWarning`, each kind once; so is one recording of several that
    fails. Raises `Error` if all fail, and `UsageError` for wrong arguments.
    """
    names, out = _words.names(paths), _checked.path("out", out)
    threads = _words.threads(threads)
    baseline = _words.path("baseline", baseline)
    words = _words.options(set, out=out, identify=identify, baseline=baseline, layout=layout, force=force, threads=threads)
    with tempfile.TemporaryDirectory() as beside:
        if isinstance(design, Design):
            design.save(File(beside, "design.json"))
            design = File(beside, "design.json")
        file = _words.path("design", design)
        exit, said = _inkling.verb(["replay", *words, *_words.options(None, design=file), "--", *names])
    warn(said)
    run = json.loads(File(out, "run.json").read_text(encoding="utf-8"))
    return Replay(out=File(out), exit=exit, run=run)


class Result:
    """The result of a critique: what the model gets wrong, why, what repairs it and what that gains
    (`schemas/critique.md`)."""

    def __init__(self, directory: File) -> None:
        self.directory = directory
        #: The content of `critique.json`.
        self.critique: dict[str, Any] = json.loads((directory / "critique.json").read_text(encoding="utf-8"))

    @property
    def verdict(self) -> str:
        """`none`, `named`, `tie` or `unknown`."""
        return str(self.critique["verdict"])

    @property
    def causes(self) -> list[dict[str, Any]]:
        """The causes that were found, the strongest first, as in `critique.json`."""
        return list(self.critique["causes"])

    @property
    def html(self) -> str:
        """The report as HTML, one page with its plots. A notebook shows it."""
        return (self.directory / "report.html").read_text(encoding="utf-8")

    def _table(self, name: str) -> pa.Table:
        """A Parquet file of the critique."""
        import pyarrow.parquet

        return pyarrow.parquet.read_table(self.directory / name)

    @property
    def evidence(self) -> pa.Table:
        """The numbers that the plots show."""
        return self._table("evidence.parquet")

    def extended(self) -> Design | None:
        """The design that takes what was found into account; None if there is none."""
        name = self.critique.get("extended_model")
        return Design.load(self.directory / name) if name else None

    def _repr_html_(self) -> str:
        from html import escape

        return f'<iframe style="width:100%;height:40em;border:0" srcdoc="{escape(self.html)}"></iframe>'

    def __repr__(self) -> str:
        causes = ", ".join(cause["id"] for cause in self.causes)
        return f"<inkling.Result {self.verdict}{': ' + causes if causes else ''}>"


def critique(
    recordings: Path | Iterable[Path] | npt.ArrayLike,
    out: Path | None = None,
    *,
    labels: Path | None = None,
    plant: Literal["ink-channel", "oscillator"] = "ink-channel",
    set: Settings | None = None,
    **of_array: Any,
) -> Result:
    """Finds what the identified model gets wrong on healthy signals, as `inkling critique` does.

    recordings, of_array: as in `Design.train`.
    out: the directory for its files. Without it they are deleted together with the result.
    labels: a CSV file that says which channels are healthy. Without it, outliers are found and left out.
    plant: what rings. `ink-channel`: an ink channel; `oscillator`: an oscillator, whose displacement is what
        was recorded.
    set: settings of `pipeline.toml` by their names.
    """
    given = _arrays.given(recordings, of_array, ("out", "labels", "plant", "set"))
    labels = _words.path("labels", labels)
    directory = File(tempfile.mkdtemp() if out is None else _checked.path("out", out))
    try:
        options = _words.options(set, out=directory if out is None else out, labels=labels, plant=plant)
        if isinstance(given, _arrays.Bursts):
            _, said = _inkling.critique(given, options)
        else:
            _, said = _inkling.verb(["critique", *options, "--", *given])
        warn(said)
        result = Result(directory)
    except BaseException:
        if out is None:
            shutil.rmtree(directory, ignore_errors=True)
        raise
    if out is None:
        weakref.finalize(result, shutil.rmtree, directory, ignore_errors=True)
    return result
