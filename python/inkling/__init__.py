"""inkling tells from piezo ring-downs which ink channels of a printhead are faulty.

    import inkling
    design = inkling.Design.load("design.json")
    table = design.judge(samples, period_s=1e-6, printhead="cyan-1")

`samples` is a NumPy array, channels x samples or bursts x channels x samples, in counts; `table` a `pyarrow.Table`, one row per
channel and burst, as `inkling replay` writes them (`schemas/verdicts.md`). Work is done without the interpreter's lock, on all
cores, and Ctrl-C ends it. What the command fails with or warns of on stderr is an exception's sentence (`Error`, `UsageError`)
or a warning (`InklingWarning`).
"""

from ._design import Design, InklingWarning, State
from ._inkling import Error, UsageError, __version__
from ._results import Read, Replay, Result, critique, read, replay

__all__ = [
    "Design",
    "Error",
    "InklingWarning",
    "Read",
    "Replay",
    "Result",
    "State",
    "UsageError",
    "__version__",
    "critique",
    "read",
    "replay",
]
