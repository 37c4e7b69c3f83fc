"""The command `inkling`, as pip installs it: it runs the same code as the program in Rust."""

import sys

from ._inkling import main as run


def main() -> int:
    """Runs the command line of this process; gives its exit status."""
    return run(sys.argv)
