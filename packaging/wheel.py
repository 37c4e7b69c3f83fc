"""What the wheel of pyproject.toml holds: the program that `cargo build --release` made, for this kind of machine."""

import os
from pathlib import Path

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from packaging.tags import platform_tags


class Program(BuildHookInterface):
    def initialize(self, version, build_data):
        name = "inkling.exe" if os.name == "nt" else "inkling"
        program = Path(self.root, "target", "release", name)
        if not program.is_file():
            raise FileNotFoundError(f"{program}: not there; `cargo build --release` makes it")
        build_data["pure_python"] = False
        # any Python 3; of a Linux the name that asks for this machine's C library or a newer one, not plain `linux_x86_64`
        platform = next(tag for tag in platform_tags() if not tag.startswith("linux_"))
        build_data["tag"] = f"py3-none-{platform}"
        build_data["shared_scripts"] = {str(program): name}
