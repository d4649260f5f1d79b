# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How the package hangs together: import graph, code, and the files that a recording runs through.

python -m benchmarks.structure                # rooms, lines, functions, cycles
python -m benchmarks.structure --walk BAG     # files that commands run through on a short recording

It looks at the package that Python finds first, so PYTHONPATH compares two checkouts. A walk runs
a command in this process and follows every call: a reader has to open each file that is called.
"""

import argparse
import ast
import contextlib
import io
import sys
import tempfile
import threading
from collections import Counter
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
    """Figures of the import graph; type-checking imports count, the root's lazy names do not.

    Rooms are the packages and modules at the root, an arrow is that one imports another, and a room
    stands one floor above the highest of those that it imports.
    """
    graph = grimp.build_graph("fusionslam")
    packages = [name for name in graph.modules if graph.find_children(name)]
    circles = [size for name in packages for size in _circles(graph, name)]
    rooms, arrows = _rooms(graph)
    return [
        ("rooms", len(rooms)),
        ("floors", _floors(rooms, arrows)),
        ("arrows between rooms", int(arrows.sum())),
        ("modules", len(graph.modules)),
        ("imports between modules", graph.count_imports()),
        ("import cycles among siblings", len(circles)),
        ("modules or packages in such cycles", sum(circles)),
    ]


def measure_code() -> list[tuple[str, str]]:
    """Figures of the code itself, as Python's own parser reads it."""
    texts = [path.read_text(encoding="utf-8") for path in sorted(PACKAGE.rglob("*.py"))]
    trees = [ast.parse(text) for text in texts]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    functions = [each for each in nodes if isinstance(each, ast.FunctionDef)]
    lines = sum(len(text.splitlines()) for text in texts)
    private = [each.name for each in functions if each.name[0] == "_" != each.name[1]]
    used = Counter(each.id for each in nodes if isinstance(each, ast.Name))
    used += Counter(each.attr for each in nodes if isinstance(each, ast.Attribute))
    imports = [
        inner
        for each in functions
        for inner in ast.walk(each)
        if isinstance(inner, ast.Import | ast.ImportFrom)
    ]
    bases = [
        base.id
        for each in nodes
        if isinstance(each, ast.ClassDef)
        for base in each.bases
        if isinstance(base, ast.Name)
    ]
    guards = sum(map(_length, (each for each in nodes if isinstance(each, ast.Raise | ast.Try))))
    return [
        ("lines of Python", f"{lines}"),
        ("functions", f"{len(functions)}"),
        ("lines of the median function", f"{np.median([*map(_length, functions)]):g}"),
        ("private functions used once", f"{sum(used[name] == 1 for name in private)}"),
        ("imports inside functions", f"{len({id(each) for each in imports})}"),
        ("configuration classes", f"{sum(name in ('Section', 'CommonConfig') for name in bases)}"),
        ("share of lines in raise and try", f"{100 * guards / lines:.1f} %"),
    ]


def _length(node: ast.stmt) -> int:
    return (node.end_lineno or node.lineno) - node.lineno + 1


def _rooms(graph: grimp.ImportGraph) -> tuple[list[str], np.ndarray[Any, np.dtype[np.bool_]]]:
    """The rooms, and which row's room imports which column's."""
    rooms = sorted(graph.find_children("fusionslam"))
    arrows = np.zeros((len(rooms), len(rooms)), dtype=bool)
    for row, importer in enumerate(rooms):
        for column, imported in enumerate(rooms):
            if row != column:
                arrows[row, column] = graph.direct_import_exists(
                    importer=importer, imported=imported, as_packages=True
                )
    return rooms, arrows


def _floors(rooms: Sequence[str], arrows: np.ndarray[Any, np.dtype[np.bool_]]) -> int:
    floors = np.ones(len(rooms), dtype=int)
    for _ in rooms:
        below = np.where(arrows, floors, 0).max(axis=1)
        floors = np.maximum(floors, below + 1)
    return int(floors.max())


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
                code = app(arguments, standalone_mode=False)
            if code:
                raise SystemExit(f"{' '.join(arguments)} ends with {code}: {silent.getvalue()}")

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
        print()
        print(table(["code", "number"], measure_code()))
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
