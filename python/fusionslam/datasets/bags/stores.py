# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Message types of ROS 1 and ROS 2, from rosbags, and bounds of what its bags expand to."""

import bz2
import functools
from collections.abc import Callable
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Literal

from fusionslam.base.files import EXPANSION, MOST_EXPANDED, check_expansion
from fusionslam.errors import DataError

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

KINDS = ("rosbag1", "rosbag2", "mcap")
"""ROS 1 file, ROS 2 folder with an SQLite database, ROS 2 MCAP file or folder."""

_TRANSFORMS = "geometry_msgs/TransformStamped[] transforms\n"


def need_rosbags() -> None:
    """Raise DataError that says what to install if rosbags is missing."""
    try:
        import rosbags.rosbag1  # noqa: F401
    except ImportError as error:
        message = "bags need rosbags: pip install 'fusionslam[bags]'"
        raise DataError(message, code="missing-extra", fields=("bags",)) from error
    bound_decompression()


@functools.cache
def type_store(ros: Literal[1, 2]) -> "Typestore":
    """Message types of ROS 1 or 2; the definitions used here never changed within either."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    # rosbags' ROS 1 types lack those of tf2 and of tf, its predecessor.
    for name in ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"):
        if name not in store.fielddefs:
            store.register(get_types_from_msg(_TRANSFORMS, name))
    return store


def make_in(store: "Typestore") -> Any:
    """Return a function that builds messages of a type store, for ``MessageBuilder``."""

    def make(type_name: str, /, **fields: Any) -> Any:
        return store.types[type_name](**fields)

    return make


def bound_decompression() -> None:
    """Bound what a chunk, message or file of a bag expands to. Needs rosbags.

    rosbags, whose versions are pinned, decompresses whatever it finds and has no option for a
    limit: its tables of decompressors are replaced, for the whole process. They are looked up by
    name in its modules, deep in its readers, so a subclass of a reader would copy most of it. A
    program that uses rosbags beside us reads the same bytes as before, and gets a ValueError for
    what expands beyond the limit.
    """
    import lz4.frame  # type: ignore[import-untyped]
    from rosbags.rosbag1 import reader as first
    from rosbags.rosbag2 import reader as second
    from rosbags.rosbag2 import storage_mcap as mcap

    zstd: Any = vars(second)["zstd"]  # of Python, or its backport
    if isinstance(zstd, SimpleNamespace):
        return
    makers: dict[str, Callable[[], Any]] = {
        "bz2": bz2.BZ2Decompressor,
        "lz4": lz4.frame.LZ4FrameDecompressor,
        "zstd": zstd.ZstdDecompressor,
    }
    for name in ("bz2", "lz4"):
        first.decompressors[name] = functools.partial(_expand, makers[name])
    for name in ("lz4", "zstd"):
        mcap.DECOMPRESSORS[name] = functools.partial(_expand, makers[name])
    bounded = SimpleNamespace(
        open=lambda file, mode: _BoundedFile(zstd.open(file, mode), file),
        decompress=functools.partial(_expand, makers["zstd"]),
    )
    vars(second)["zstd"] = bounded


def _expand(make: Callable[[], Any], data: bytes, declared: int | None = None) -> bytes:
    """Decompress all frames of ``data``.

    Raises:
        ValueError: they expand beyond the limit or beyond the declared size, or are cut short.
    """
    size, most = len(data), max(MOST_EXPANDED, EXPANSION * len(data))
    if declared is not None:
        check_expansion(declared, size)
        most = declared
    parts, total, decompressor = [], 0, make()
    while True:
        parts.append(decompressor.decompress(data, max_length=most - total + 1))
        total += len(parts[-1])
        if total > most:
            raise ValueError(f"{size} compressed bytes expand to more than {most}")
        data = b""
        if decompressor.eof:
            data = decompressor.unused_data or b""
            if not data:
                return b"".join(parts)
            decompressor = make()
        elif not parts[-1]:
            raise ValueError(f"{size} compressed bytes are cut short")


class _BoundedFile:
    """A compressed file whose reading ends with an error at the limit."""

    def __init__(self, stream: Any, file: Any) -> None:
        self._stream = stream
        self._size = file.seek(0, 2)
        self._total = 0
        file.seek(0)

    def read(self, count: int = -1) -> bytes:
        data: bytes = self._stream.read(count)
        self._total += len(data)
        check_expansion(self._total, self._size)
        return data

    def __enter__(self) -> "_BoundedFile":
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()
