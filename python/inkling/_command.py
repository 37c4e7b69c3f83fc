"""The command `inkling`."""

import sys

from ._inkling import main as run


def main() -> int:
    """The command line of this process; its exit status."""
    return run(sys.argv)
