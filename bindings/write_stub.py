# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write the type stub of the compiled module, which the build calls: write_stub.py MODULE STUB."""

import re
import shutil
import sys
import tempfile
from pathlib import Path

from pybind11_stubgen import main as run_stubgen

_AS_CHECKERS_WANT = (
    (r"^__version__.*", "__version__: str"),
    (r"os\.PathLike \|", "os.PathLike[str] |"),
    # Members of enumerations, without the methods of enum itself.
    (r"^(    [A-Z_]+): typing\.ClassVar\[.*\]$", r"\1 = ..."),
    (r"^    @classmethod\n", ""),
    (r"^.*def (__new__\(cls, value|__format__\(self, format_spec)\).*\n.*\n", ""),
)


def write_stub(module: Path, stub: Path) -> None:
    """Write what the compiled module says of itself, imported from a package of nothing else."""
    with tempfile.TemporaryDirectory() as folder:
        package = Path(folder, "fusionslam")
        package.mkdir()
        (package / "__init__.py").touch()
        shutil.copy(module, package)
        sys.path.insert(0, folder)
        run_stubgen(["fusionslam._core", "-o", folder, "--exit-code"])
        text = (package / "_core.pyi").read_text()
    for found, wanted in _AS_CHECKERS_WANT:
        text = re.sub(found, wanted, text, flags=re.MULTILINE)
    stub.write_text(text)


if __name__ == "__main__":
    write_stub(*map(Path, sys.argv[1:]))
