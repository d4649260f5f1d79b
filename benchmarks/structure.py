# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How the package hangs together: import graph, and the files that one recording passes through.

python -m benchmarks.structure                # modules, lines, cycles
python -m benchmarks.structure --walk BAG     # files that commands run through on a short recording

It looks at the package that Python finds first, so PYTHONPATH compares two checkouts. A walk runs
a command in this process and follows every call: a reader has to open each file that is called.
"""

import argparse
import contextlib
import io
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

import grimp
import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

import fusionslam
from benchmarks.accuracy.markdown import table

PACKAGE = Path(str(fusionslam.__file__)).parent
COMMANDS = {
    "ratslam DATA": ("ratslam", "{data}", "-o", "{out}/map", "--no-report"),
    "views match DATA": ("views", "match", "{data}", "-o", "{out}/views", "--no-report"),
    "describe DATA": ("describe", "{data}", "-d", "cm2dp", "-o", "{out}/runs"),
}


def measure_graph() -> list[tuple[str, int]]:
    """Figures of the import graph; type-checking imports count, the root's lazy names do not."""
    graph = grimp.build_graph("fusionslam")
    paths = sorted(PACKAGE.rglob("*.py"))
    root = [path for path in PACKAGE.glob("*.py") if path.name != "__init__.py"]
    lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)
    packages = [name for name in graph.modules if graph.find_children(name)]
    circles = [size for name in packages for size in _circles(graph, name)]
    return [
        ("modules", len(graph.modules)),
        ("modules at the root", len(root)),
        ("lines of Python", lines),
        ("imports between modules", graph.count_imports()),
        ("import cycles among siblings", len(circles)),
        ("modules or packages in such cycles", sum(circles)),
    ]


def _circles(graph: grimp.ImportGraph, package: str) -> Iterator[int]:
    """The sizes of the circles among the children of a package, grandchildren taken together."""
    children = sorted(graph.find_children(package))
    inside = {
        name: row
        for row, child in enumerate(children)
        for name in (child, *graph.find_descendants(child))
    }
    links = np.zeros((len(children), len(children)))
    for name, row in inside.items():
        for imported in graph.find_modules_directly_imported_by(name):
            if imported in inside:
                links[row, inside[imported]] = 1
    _, labels = connected_components(csr_array(links), connection="strong")
    for size in np.bincount(labels).tolist():
        if size > 1:
            yield size


def walk(data: Path, words: Sequence[str]) -> list[str]:
    """The files whose functions a command runs, in the order of their first call."""
    from fusionslam.cli import app

    def run() -> None:
        with tempfile.TemporaryDirectory() as out:
            arguments = [word.format(data=data, out=out) for word in words]
            silent = io.StringIO()
            with contextlib.redirect_stdout(silent), contextlib.redirect_stderr(silent):
                app(arguments, standalone_mode=False)

    files: dict[str, None] = {}

    def follow(frame: FrameType, event: str, argument: Any) -> None:
        name = frame.f_code.co_filename
        if event == "call" and name.startswith(str(PACKAGE)):
            files[str(Path(name).relative_to(PACKAGE))] = None

    run()  # imports, which run parts of every file, lie behind us after this
    sys.setprofile(follow)
    threading.setprofile(follow)
    try:
        run()
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    return list(files)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--walk", type=Path, metavar="BAG")
    parser.add_argument("--files", action="store_true", help="list the files of each walk")
    arguments = parser.parse_args()
    if arguments.walk is None:
        print(table(["import graph", "number"], measure_graph()))
        return
    rows = []
    for title, words in COMMANDS.items():
        found = walk(arguments.walk, words)
        rows.append((title, len(found)))
        if arguments.files:
            print(title, *found, sep="\n  ")
    print(table(["command", "files"], rows))


if __name__ == "__main__":
    main()
