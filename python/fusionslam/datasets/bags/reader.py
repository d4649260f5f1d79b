# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reads bags: their topics, and their messages in sequence or one at a time."""

import functools
import logging
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fusionslam.base.argument_types import checked
from fusionslam.base.files import check_regular, is_map_file, reading
from fusionslam.datasets.bags.messages import check_data, is_known, plain_type, value_of
from fusionslam.datasets.bags.stores import need_rosbags, type_store
from fusionslam.errors import DataError, naming
from fusionslam.sensors.messages import Event, Message

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

logger = logging.getLogger(__name__)

_MAGIC = {b"#ROSBAG V": "rosbag1", b"\x89MCAP0\r\n": "mcap", b"SQLite format 3\0": "rosbag2"}
_ABOUT = "metadata.yaml"
_STORAGE = {".mcap": "mcap", ".db3": "rosbag2"}


OnError = Callable[[str, int, DataError], None]
"""Called with topic, time of arrival and error of a message whose bytes are not of its type."""


@dataclass(frozen=True)
class Topic:
    """A topic of a bag: its name, type ("sensor_msgs/Image") and number of messages."""

    name: str
    type: str
    count: int

    @property
    def is_known(self) -> bool:
        """Whether its messages can be converted to values."""
        return is_known(self.type)


@dataclass(frozen=True)
class RawMessage:
    """A ROS message of a bag, not yet converted to a value.

    Attributes:
        topic: the topic it was published on.
        type: its type, such as "sensor_msgs/Image".
        time_ns: time of arrival.
        content: the message as rosbags deserialised it.
    """

    topic: str
    type: str
    time_ns: int
    content: Any

    def value(self) -> Message:
        """Convert it to a value. Raises DataError naming topic, stamp and field."""
        return value_of(self.content, self.type, self.topic)


@checked
def open_bag(path: str | os.PathLike[str]) -> "Bag":
    """Open a ROS 1 bag (.bag), a ROS 2 bag (folder or .db3) or an MCAP file (or folder).

    Raises:
        DataError: the file is missing, empty, damaged or not a bag; or rosbags is not installed.
    """
    return Bag(Path(path).expanduser())


def bag_kind(path: Path) -> str | None:
    """ "rosbag1", "rosbag2" or "mcap" by the file's first bytes; None if it is not a bag."""
    storage = _storage(path)
    if storage is None or not storage.is_file() or is_map_file(storage):
        return None
    try:
        with storage.open("rb") as file:
            start = file.read(16)
    except OSError:
        return None
    found = next((kind for magic, kind in _MAGIC.items() if start.startswith(magic)), None)
    # Files that are damaged or compressed as a whole (.db3.zstd) are recognised by suffix alone.
    kinds = {".bag": "rosbag1"} | _STORAGE
    return found or next((kinds[each] for each in storage.suffixes if each in kinds), None)


def _storage(path: Path) -> Path | None:
    """The file with the messages, or the first of them; None if a folder is not a bag."""
    if not path.is_dir():
        return path
    files = sorted(path.iterdir())
    storage = [file for file in files if _STORAGE.keys() & set(file.suffixes)]
    # A folder with files other than a bag's is another kind of recording that contains a bag.
    return storage[0] if storage and ((path / _ABOUT).exists() or storage == files) else None


class Bag:
    """A bag open for reading; its methods may be called from several threads.

    Attributes:
        path: file or folder.
        kind: "rosbag1", "rosbag2" or "mcap".
        topics: by name.
        start_ns: arrival of the first message; 0 if there is none.
        stop_ns: arrival of the last message.
        is_cut: whether its end is missing; complete records before it are read.
    """

    def __init__(self, path: Path) -> None:
        need_rosbags()
        self.path = path
        self.kind = _find_kind(path)
        self.is_cut = False
        self._lock = threading.Lock()
        self._reader = self._open()
        connections = self._reader.connections
        self.topics: dict[str, Topic] = {}
        for name in sorted({connection.topic for connection in connections}):
            ours = [each for each in connections if each.topic == name]
            types = sorted({plain_type(each.msgtype) for each in ours})
            if len(types) > 1:
                raise DataError(f"{path}: {name} has types {', '.join(types)}, expected one")
            self.topics[name] = Topic(name, types[0], sum(each.msgcount for each in ours))
        has_messages = any(topic.count for topic in self.topics.values())
        self.start_ns = int(self._reader.start_time) if has_messages else 0
        self.stop_ns = int(self._reader.end_time) - 1 if has_messages else 0

    def __reduce__(self) -> tuple[type["Bag"], tuple[Path]]:
        return Bag, (self.path,)  # another process opens it again

    def events(
        self,
        topics: Sequence[str] | None = None,
        *,
        start: int | None = None,
        stop: int | None = None,
    ) -> Iterator[Event]:
        """Yield the messages in order of arrival; only one is in memory at a time.

        Args:
            topics: those to read; None for all of known type.
            start: nanoseconds of arrival; earlier messages are left out.
            stop: nanoseconds of arrival; messages from then on are left out.

        Raises:
            DataError: a topic does not exist or is of unknown type; or a message cannot be read,
                which the error names by topic, stamp and field.
        """
        for raw in self.raw(topics, start=start, stop=stop):
            with naming(self.path):
                value = raw.value()
            yield Event(raw.topic, raw.time_ns, value)

    def raw(
        self,
        topics: Sequence[str] | None = None,
        *,
        start: int | None = None,
        stop: int | None = None,
        on_error: OnError | None = None,
    ) -> Iterator[RawMessage]:
        """Yield messages like ``events``, with their content left as stored.

        Messages that cannot be decoded are passed to ``on_error``; without it they raise DataError.
        """
        names = self.known_topics(topics)
        # A separate reader: the bag may be iterated over several times at once.
        reader = self._open()
        try:
            for stored in self._messages(reader, names, start, stop):
                try:
                    raw = self._decode(*stored)
                except DataError as error:
                    if on_error is None:
                        with naming(self.path):
                            raise
                    on_error(stored[0].topic, stored[1], error)
                else:
                    yield raw
        finally:
            reader.close()

    def message(self, topic: str, time_ns: int, occurrence: int = 0) -> Message:
        """Read one message by topic and time of arrival; ``occurrence`` counts equal times.

        Raises:
            DataError: there is none, or it cannot be read.
        """
        names = self.known_topics([topic])
        with self._lock:
            found = self._messages(self._reader, names, time_ns, time_ns + 1)
            stored = next(islice(found, occurrence, None), None)
        if stored is None:
            message = f"{self.path}: {topic} has no message at {time_ns} ns"
            raise DataError(message, code="no-message", fields=(topic, str(time_ns)))
        with naming(self.path):
            return self._decode(*stored).value()

    def known_topics(self, topics: Sequence[str] | None = None) -> list[str]:
        """Return these topics; without any, all of known type.

        Raises DataError for a topic that does not exist or is of unknown type.
        """
        if topics is None:
            return [topic.name for topic in self.topics.values() if topic.is_known]
        for name in topics:
            if name not in self.topics:
                message = f"{self.path} has no topic {name}: expected {', '.join(self.topics)}"
                raise DataError(message, code="no-topic", fields=(name,))
            if not self.topics[name].is_known:
                message = f"{self.path}: {name} is of type {self.topics[name].type}, not supported"
                raise DataError(message, code="topic-type", fields=(name,))
        return list(topics)

    def close(self) -> None:
        """Close the file; the bag cannot be read afterwards."""
        self._reader.close()

    def __enter__(self) -> "Bag":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _messages(
        self, reader: "Reader1 | Reader2", names: list[str], start: int | None, stop: int | None
    ) -> Iterator[tuple["Connection", int, bytes]]:
        connections: list[Any] = [each for each in reader.connections if each.topic in names]
        if not connections:
            return
        with _reading_bag(self.path):
            for connection, time_ns, data in reader.messages(connections, start, stop):
                yield connection, int(time_ns), data

    def _decode(self, connection: "Connection", time_ns: int, data: bytes) -> RawMessage:
        """Decode a stored message. Raises DataError of code "undecodable" with its topic."""
        is_first, topic, digest = self.kind == "rosbag1", connection.topic, connection.digest
        store, type_name = type_store(1 if is_first else 2), plain_type(connection.msgtype)
        deserialize = store.deserialize_ros1 if is_first else store.deserialize_cdr
        # A ROS 1 type's MD5 sum; * matches any.
        if is_first and digest not in ("*", _ros1_digest(connection.msgtype)):
            raise DataError(
                f"{topic} has {type_name} of another definition (MD5 {digest}) than ROS 1 "
                f"(MD5 {_ros1_digest(connection.msgtype)})",
                code="undecodable",
                fields=(topic,),
            )
        try:
            content = deserialize(data, connection.msgtype)
        except Exception as error:
            raise DataError(
                f"{topic}, arrived at {time_ns / 1e9:.3f} s: {len(data)} bytes are no {type_name} "
                f"({_reason(error)})",
                code="undecodable",
                fields=(topic,),
            ) from error
        try:
            check_data(content, type_name, topic)
        except DataError as error:
            raise DataError(str(error), code="undecodable", fields=(topic,)) from error
        return RawMessage(topic, type_name, time_ns, content)

    def _open(self) -> "Reader1 | Reader2":
        from rosbags.rosbag1 import Reader as First
        from rosbags.rosbag2 import Reader as Second

        path = self.path
        if path.is_dir() and not (path / _ABOUT).exists():
            path = _storage(path) or path  # its only file
        try:
            with _reading_bag(self.path):
                reader = First(path) if self.kind == "rosbag1" else Second(path)
                reader.open()
                return reader
        except DataError:
            from fusionslam.datasets.bags.recovery import open_cut

            if path.is_dir() or (rest := open_cut(path, self.kind)) is None:
                raise
        if not self.is_cut:
            self.is_cut = True
            logger.warning(
                "%s was cut or not closed: read without its index, %d messages are whole",
                self.path,
                sum(connection.msgcount for connection in rest.connections),
            )
        return rest


@functools.cache
def _ros1_digest(name: str) -> str:
    return type_store(1).generate_msgdef(name)[1]


def _find_kind(path: Path) -> str:
    if not path.exists():
        raise DataError(
            f"{path} does not exist: expected a bag", code="missing-file", fields=(str(path),)
        )
    storage = _storage(path)
    if storage is None:
        raise DataError(
            f"{path} is no bag: expected a .db3 or .mcap file in it",
            code="not-a-bag",
            fields=(str(path),),
        )
    check_regular(storage, "a bag")
    with reading(storage, "a bag"):
        size = storage.stat().st_size
    if not size:
        raise DataError(
            f"{storage} is empty: expected a bag", code="empty-file", fields=(str(storage),)
        )
    kind = bag_kind(path)
    if kind is None:
        raise DataError(
            f"{path} is no bag: expected a ROS 1, ROS 2 SQLite or MCAP file",
            code="not-a-bag",
            fields=(str(path),),
        )
    with storage.open("rb") as file:
        start = file.read(16)
    magic = {kind: magic for magic, kind in _MAGIC.items()}[kind]
    if not start.startswith(magic) and storage.suffix != ".zstd":
        raise DataError(
            f"{storage} cannot be read as a bag: it begins with {start!r}, expected {magic!r}",
            code="not-a-bag",
            fields=(str(storage),),
        )
    return kind


@contextmanager
def _reading_bag(path: Path) -> Iterator[None]:
    """Turn any error that rosbags raises on a damaged file into a DataError."""
    try:
        yield
    except DataError:
        raise
    except Exception as error:
        reason = _reason(error).replace(f"Cannot open database {path}: ", "")
        raise DataError(f"{path} cannot be read as a bag: {reason}") from error


def _reason(error: Exception) -> str:
    """The error's message; rosbags and the decoders that it uses raise some with several values."""
    if isinstance(error, OSError):
        return error.strerror or str(error)
    return ": ".join(map(str, error.args)).rstrip(".") or type(error).__name__
