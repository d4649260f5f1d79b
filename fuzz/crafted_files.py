# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Files that somebody made to hang, fill memory or reach other files, each with right checksums."""

import io
import json
import os
import resource
import signal
import sqlite3
import struct
import tempfile
import traceback
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from fleet_places import made_segment
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.fleet.recordings import FleetRecording
from fusionslam.fleet.segment import Segment, digest_of
from fusionslam.fleet.work import PLAN, PLAN_FORMAT, Plan
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.pipelines.recording import Recording
from fusionslam.views.second_stage.architecture import PointNetConfig
from fusionslam.views.second_stage.model import SecondStage
from fusionslam.views.second_stage.network_files import SHIPPED, About, Calibration
from fuzz.place_maps import valid_map
from fuzz.target import scratch
from map_rows import restore_crcs

ENDLESS = "WITH RECURSIVE n (id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n)"
_BOMB = np.zeros((3 << 20, 3), np.int16)  # 18 MB
_Change = Callable[[sqlite3.Connection], object]


def _change_points(packed: bytes) -> _Change:
    return _change_row("cloud", "points", packed)


def _change_row(table: str, column: str, value: Any) -> _Change:
    def change(database: sqlite3.Connection) -> None:
        database.execute(f"UPDATE {table} SET {column} = ?", (value,))
        restore_crcs(database)

    return change


def _change_schema(statement: str) -> _Change:
    def change(database: sqlite3.Connection) -> None:
        database.execute("PRAGMA writable_schema = ON")
        database.execute(statement)

    return change


def _npz(*, packed: bool) -> bytes:
    stream = io.BytesIO()
    (np.savez_compressed if packed else np.savez)(stream, points=_BOMB)
    return stream.getvalue()


def _npz_of_header(shape: str) -> bytes:
    stream = io.BytesIO()
    header = f"{{'descr': '<i2', 'fortran_order': False, 'shape': {shape}}}\n".encode()
    with zipfile.ZipFile(stream, "w") as archive:
        text = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header
        archive.writestr("points.npy", text)
    return stream.getvalue()


def _lead_in_rings(path: Path) -> None:
    """Make pages of table keyframe that lead to one leaf in a billion ways."""
    with closing(sqlite3.connect(path)) as database:
        (root,) = database.execute(
            "SELECT rootpage FROM sqlite_master WHERE name = 'keyframe'"
        ).fetchone()
    whole, page = bytearray(path.read_bytes()), 65536
    count = len(whole) // page
    leaf = bytes(whole[(root - 1) * page : root * page])

    def inner(child: int) -> bytes:
        cells = 30_000  # one cell, and as many pointers to it
        head = struct.pack(">BHHHBI", 5, 0, cells, page - 8, 0, child)
        pointers = struct.pack(">H", page - 8) * cells
        return (head + pointers).ljust(page - 8, b"\0") + struct.pack(">IBxxx", child, 1)

    whole[(root - 1) * page : root * page] = inner(count + 1)
    whole += inner(count + 2) + leaf
    whole[28:32] = struct.pack(">I", count + 2)
    path.write_bytes(whole)


def _change_header(place: int, byte: int) -> Callable[[Path], object]:
    def change(path: Path) -> None:
        whole = bytearray(path.read_bytes())
        whole[place] = byte
        path.write_bytes(whole)

    return change


_STATEMENTS: dict[str, str | Callable[[], _Change]] = {
    "a view that never ends": "DROP TABLE session; CREATE VIEW session (id, name, crc) AS "
    f"{ENDLESS} SELECT id, 'a', 0 FROM n",
    "a view of settings": "ALTER TABLE setting RENAME TO old; CREATE VIEW setting AS "
    "SELECT * FROM old",
    "another view": f"CREATE VIEW v AS {ENDLESS} SELECT id FROM n",
    "a trigger": "CREATE TRIGGER t AFTER INSERT ON keyframe BEGIN DELETE FROM cloud; END",
    "a trigger in place of": "DROP TABLE edge; CREATE VIEW edge AS SELECT 1 AS id; CREATE TRIGGER "
    "t INSTEAD OF INSERT ON edge BEGIN DELETE FROM cloud; END",
    "another table": "CREATE TABLE t (x)",
    "another index": "CREATE INDEX i ON edge (abs(a))",
    "a table without its index": "DROP INDEX edge_a",
    "a missing table": "DROP TABLE solution",
    "a missing state": "DELETE FROM state",
    "a column more": "ALTER TABLE session ADD COLUMN more TEXT DEFAULT 'x'",
    "a computed column": "ALTER TABLE session ADD COLUMN more AS (upper(name))",
    "a check": lambda: _change_schema(
        "UPDATE sqlite_master SET sql = replace(sql, 'frame INTEGER', "
        "'frame INTEGER CHECK (randomblob(1e9) > 0)') WHERE name = 'keyframe'"
    ),
    "an index twice": lambda: _change_schema(
        "INSERT INTO sqlite_master SELECT type, name, tbl_name, rootpage, sql "
        "FROM sqlite_master WHERE name = 'edge_b'"
    ),
    "tables that share pages": lambda: _change_schema(
        "UPDATE sqlite_master SET rootpage = (SELECT rootpage FROM sqlite_master WHERE name = "
        "'cloud') WHERE name = 'edge'"
    ),
    "a bomb": lambda: _change_points(zlib.compress(_npz(packed=False), level=1)),
    "a bomb in a bomb": lambda: _change_points(zlib.compress(_npz(packed=True))),
    "a vast array": lambda: _change_points(zlib.compress(_npz_of_header("(99999999999, 3)"))),
    "a point of no axes": lambda: _change_points(zlib.compress(_npz_of_header("(0,)"))),
    "settings that are no text": "UPDATE setting SET value = CAST(x'ff' || value AS TEXT)",
    "settings of brackets": lambda: _change_row("setting", "value", "[" * 100_000),
    "a number of many digits": lambda: _change_row("setting", "value", "9" * 100_000),
    "a long name": lambda: _change_row("session", "name", "x" * 2_000_000),
    "a name of lines": lambda: _change_row("session", "name", "a\nb"),
    "a change of words": lambda: _change_row("state", "number", "x"),
}
_ON_BYTES: dict[str, Callable[[Path], object]] = {
    "rings of pages": _lead_in_rings,
    "pages that move": _change_header(55, 1),
    "texts of two bytes": _change_header(59, 2),
    "one page": lambda path: path.write_bytes(path.read_bytes()[:65536]),
}


def _craft_map(path: Path, name: str) -> None:
    if name in _ON_BYTES:
        _ON_BYTES[name](path)
        return
    change = _STATEMENTS[name]
    with closing(sqlite3.connect(path)) as database:
        if isinstance(change, str):
            database.executescript(change)
        else:
            change()(database)
        database.commit()


Craft = Callable[[Path], object]
MAPS: dict[str, Craft] = {
    name: partial(_craft_map, name=name) for name in (*_STATEMENTS, *_ON_BYTES)
}
"""Each changes the file of a map."""

_LONG, _TALL = np.ones((1, 9000), np.float32), np.ones((3, 1), np.float32)
_Nodes = Sequence[tuple[str, ...]]
_GRAPHS: dict[str, tuple[_Nodes, dict[str, Any]]] = {
    "a vast constant": ([("ConstantOfShape", "size", "features")], {"size": [10**9]}),
    "a loop": (
        [("Loop", "count", "yes", "points", "features")],
        {"count": 10**12, "yes": True},
    ),
    "a vast expansion": ([("Expand", "points", "size", "features")], {"size": [10**9, 3]}),
    "many tiles": ([("Tile", "points", "size", "features")], {"size": [10**9, 3]}),
    "a vast product": ([("MatMul", "tall", "long", "features")], {"tall": _LONG.T, "long": _LONG}),
    "a sum of other sizes": ([("Add", "points", "tall", "features")], {"tall": _TALL}),
    "a product of three axes": (
        [("MatMul", "points", "deep", "features")],
        {"deep": np.ones((99, 3, 3), np.float32)},
    ),
    "doubled again and again": ([("Concat", "points", "points", f"v{i}") for i in range(40)], {}),
    "all pairs of points": (
        [
            ("Reshape", "points", "tall", "a"),
            ("Reshape", "points", "long", "b"),
            ("MatMul", "a", "b", "features"),
        ],
        {"tall": [-1, 1], "long": [1, -1]},
    ),
    "many nodes": ([("Relu", "points", f"v{i}") for i in range(2000)], {}),
}
_TINY = PointNetConfig(
    transform_points=(8, 16), transform_head=(8,), points=(8, 16, 32), embedding=None
)


def write_graph(path: Path, nodes: _Nodes, **stored: Any) -> None:
    """Write a graph from "points" (N, 3) to "features".

    Nodes are operators, inputs and an output; ``stored`` are constants by name.
    """
    import onnx

    make, values = onnx.helper, onnx.numpy_helper
    graph = make.make_graph(
        [make.make_node(operator, inputs, [output]) for operator, *inputs, output in nodes],
        "crafted",
        [make.make_tensor_value_info("points", onnx.TensorProto.FLOAT, ["N", 3])],
        [make.make_tensor_value_info("features", onnx.TensorProto.FLOAT, None)],
        [values.from_array(np.array(value), name) for name, value in stored.items()],
    )
    model = make.make_model(graph, opset_imports=[make.make_opsetid("", 17)], ir_version=8)
    about = About("pointnet", _TINY, Calibration(4.0, 8.0))
    make.set_model_props(model, about.metadata())
    onnx.save(model, path)


def _write_graph(path: Path, name: str) -> None:
    nodes, stored = _GRAPHS[name]
    write_graph(path, nodes, **stored)


def _add_function(model: Any) -> None:
    model.functions.add(name="Relu", domain="own")


def _add_sparse_tensor(model: Any) -> None:
    model.graph.sparse_initializer.add(dims=[10**9])


def _store_elsewhere(model: Any) -> None:
    model.graph.initializer[-1].external_data.add(key="location", value="/etc/passwd")


def _use_another_domain(model: Any) -> None:
    model.graph.node[0].domain = "com.microsoft"


def _change_network(path: Path, change: Callable[[Any], None]) -> None:
    import onnx

    model = onnx.load(SHIPPED / "places_features.onnx")
    change(model)
    onnx.save(model, path)


_CHANGES = {
    "a function of its own": _add_function,
    "a vast sparse tensor": _add_sparse_tensor,
    "tensors of another file": _store_elsewhere,
    "operators of another library": _use_another_domain,
}
NETWORKS: dict[str, Craft] = {
    **{name: partial(_write_graph, name=name) for name in _GRAPHS},
    **{name: partial(_change_network, change=change) for name, change in _CHANGES.items()},
}
"""Each writes a network."""

KEYS: Sequence[Any] = [
    *("{outside}", "../victim", "../../victim", "chunks/../../victim", "a/b", "/", "", ".", ".."),
    *("0" * 31, "0" * 33, "G" * 32, "0" * 32 + "\n", "0" * 31 + "\0", "\u0660" * 32, None, 7, []),
]
"""Keys of chunks that are no names of ours; {outside} is the path of a file elsewhere."""
HEADERS: Sequence[bytes] = [
    b"{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4),",
    b"(" * 60,
    b"\0",
    b"{}",
    b"\\",
]
"""Of .npy files; they replace the one of a segment."""


def with_header(content: bytes, header: bytes) -> bytes:
    """A segment's .npy file with another header, of any length."""
    return content[:8] + len(header).to_bytes(2, "little") + header + content[128:]


@dataclass(frozen=True)
class Crafted:
    """A crafted file.

    Attributes:
        write: makes it in a folder.
        read: reads it as a program would. Raises one of the package's errors.
    """

    write: Callable[[Path], object]
    read: Callable[[Path], object]


@dataclass(frozen=True)
class End:
    """What came of reading a crafted file: processor time and memory beyond the start."""

    said: str
    seconds: float
    megabytes: int

    @property
    def is_good(self) -> bool:
        return self.said.startswith(_REFUSED)


_REFUSED = "refused"
_MOST_BYTES, _MOST_S = 200 << 20, 1


def read_in_a_process(crafted: Crafted) -> End:
    """Read a crafted file in a process that may use 200 MB and 1 s beyond what it starts with."""
    with tempfile.TemporaryDirectory() as name:
        crafted.write(Path(name))
        reading, writing = os.pipe()
        child = os.fork()
        if not child:
            _read_within_limits(crafted, Path(name), writing)
        os.close(writing)
        with os.fdopen(reading) as said:
            text = said.read()
        _, status, used = os.wait4(child, 0)
    if status:
        end = os.waitstatus_to_exitcode(status)
        text = f"ended by {signal.Signals(-end).name}" if end < 0 else f"status {end}: {text}"
    before, _, text = text.rpartition("\t")
    growth = used.ru_maxrss - int(before or 0)
    return End(text, used.ru_utime + used.ru_stime, max(0, growth) >> 10)


def _read_within_limits(crafted: Crafted, folder: Path, said: int) -> None:
    """Read a crafted file and say what came of it; does not return."""
    code = 1
    try:
        began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        os.write(said, f"{began}\t".encode())
        data = int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_DATA, (data + _MOST_BYTES,) * 2)
        resource.setrlimit(resource.RLIMIT_CPU, (_MOST_S, _MOST_S + 1))
        try:
            crafted.read(folder)
            text = "accepted"
        except FusionSlamError as error:
            text = f"{_REFUSED}: {getattr(error, 'code', '')}"
        os.write(said, text.encode())
        code = 0
    except BaseException as error:
        os.write(said, "".join(traceback.format_exception_only(error)).replace("\t", " ").encode())
    finally:
        os._exit(code)


def _map(change: Craft) -> Crafted:
    def write(folder: Path) -> None:
        (folder / "site.fsmap").write_bytes(valid_map())
        change(folder / "site.fsmap")

    def read(folder: Path) -> None:
        with PlaceMap.open(folder / "site.fsmap", read_only=True) as site:
            if problems := site.check():
                raise DataError(problems[0], code="damaged")

    return Crafted(write, read)


def _network(write: Craft) -> Crafted:
    def read(folder: Path) -> SecondStage:
        return SecondStage(folder / "odd.onnx")

    return Crafted(lambda folder: write(folder / "odd.onnx"), read)


def _plan(key: Any) -> Crafted:
    """Of a file without a digest, as its message says that it can be changed."""

    def write(folder: Path) -> None:
        recording = FleetRecording("monday", Recording("/recordings/monday"))
        one = {"recording": asdict(recording), "frames": 4, "keys": [key], "content": "x"}
        values = {"format": PLAN_FORMAT, "root": "/recordings"}
        (folder / PLAN).write_text(json.dumps(values | {"recordings": [one], "outdated": []}))

    return Crafted(write, Plan.load)


@cache
def _segment() -> Path:
    return made_segment(scratch() / "crafted")


def _part_of_a_segment(suffix: str, change: Callable[[bytes], bytes]) -> Crafted:
    def write(folder: Path) -> None:
        for each in (".npy", ".faiss"):
            content = _segment().with_suffix(each).read_bytes()
            (folder / f"a{each}").write_bytes(change(content) if each == suffix else content)

    def read(folder: Path) -> Segment:
        (path,) = folder.glob("*.faiss")
        return Segment(path, digest_of(path))

    return Crafted(write, read)


def _numbers(place: int, value: bytes) -> Callable[[bytes], bytes]:
    return lambda content: content[:place] + value + content[place + len(value) :]


def _all() -> Iterator[tuple[str, Crafted]]:
    for name, change in MAPS.items():
        yield f"map: {name}", _map(change)
    for name, write in NETWORKS.items():
        yield f"network: {name}", _network(write)
    for key in KEYS:
        yield f"recordings.json: key {key!r}", _plan(key)
    for header in HEADERS:
        yield (
            f".npy: {header[:20]!r}",
            _part_of_a_segment(".npy", partial(with_header, header=header)),
        )
    for name, forge in _LISTS.items():
        yield f".faiss: {name}", _part_of_a_segment(".faiss", forge)


_LISTS: dict[str, Callable[[bytes], bytes]] = {
    "another kind": _numbers(0, b"IxF2"),
    "no kind": _numbers(0, bytes(4)),
    "a dimension below 0": _numbers(4, b"\xff" * 4),
    "a vast dimension": _numbers(4, b"\xff\xff\xff\x7f"),
    "rows below 0": _numbers(8, b"\xff" * 8),
    "vast rows": _numbers(8, b"\xff" * 7 + b"\x7f"),
    "half of it": lambda content: content[: len(content) // 2],
    "its header": lambda content: content[:33],
    "nothing": lambda content: b"",
}
CRAFTED: dict[str, Crafted] = dict(_all())
"""All crafted files, by name."""
