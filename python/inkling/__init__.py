"""inkling tells from piezo ring-downs which ink channels of a printhead are faulty.

    import inkling
    design = inkling.Design.load("design.json")
    table = design.judge(samples, period_s=1e-6, printhead="cyan-1")

`samples` is a NumPy array in counts, channels x samples or bursts x channels x samples. `table` is a
`pyarrow.Table` with one row per channel and burst, as `inkling replay` writes them (`schemas/verdicts.md`).

Work is done on all cores without the interpreter's lock, and Ctrl-C ends it. Where the command would fail, an
exception has its sentence, `UsageError` for wrong usage or settings, else `Error`. Where the command would warn,
there is an `InklingWarning`.
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
