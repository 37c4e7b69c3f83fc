"""What the wheel of pyproject.toml holds beside its Python: the library that cargo builds, for this kind of machine."""

import os
import subprocess
import sys
from pathlib import Path

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from packaging.tags import platform_tags

#: Set: take the library as it was built before, with whatever features.
AS_BUILT = "INKLING_AS_BUILT"


class Library(BuildHookInterface):
    def initialize(self, version, build_data):
        build = ["cargo", "build", "--release", "--locked", "-p", "inkling-python"]
        if not os.environ.get(AS_BUILT):
            subprocess.run(build, cwd=self.root, check=True)
        name = {"win32": "inkling_python.dll", "darwin": "libinkling_python.dylib"}.get(sys.platform, "libinkling_python.so")
        library = Path(self.root, os.environ.get("CARGO_TARGET_DIR", "target"), "release", name)
        if not library.is_file():
            raise FileNotFoundError(f"{library}: not there; `{' '.join(build)}` makes it")
        build_data["pure_python"] = False
        # any Python 3.9 or newer; of a Linux the name that asks for this machine's C library or a newer one
        platform = next(tag for tag in platform_tags() if not tag.startswith("linux_"))
        build_data["tag"] = f"cp39-abi3-{platform}"
        extension = "pyd" if sys.platform == "win32" else "abi3.so"
        build_data["force_include"][str(library)] = f"inkling/_inkling.{extension}"
