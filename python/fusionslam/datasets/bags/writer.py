# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Writes bags: ROS 1, ROS 2 SQLite and MCAP. Incomplete ones are kept as ``.partial``."""

import logging
import os
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from fusionslam.base.argument_types import checked
from fusionslam.base.files import cannot_write, delay_interrupts, scratch_folder
from fusionslam.datasets.bags.image_messages import STORED
from fusionslam.datasets.bags.messages import MessageBuilder, is_static, ros_type
from fusionslam.datasets.bags.reader import open_bag
from fusionslam.datasets.bags.stores import KINDS, make_in, need_rosbags, type_store
from fusionslam.errors import ConfigError, DataError, naming
from fusionslam.sensors.messages import NANOSECONDS, Event, FrameTransforms

if TYPE_CHECKING:
    from rosbags.interfaces import Connection, Qos
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import Writer as Writer2

logger = logging.getLogger(__name__)

Images = str | Mapping[str, str]

_SUFFIXES = {".bag": "rosbag1", ".db3": "rosbag2", ".mcap": "mcap"}
# ROS 2 before Jazzy cannot read version 9.
_VERSION: Literal[8] = 8
# Most bytes that an SQLite bag may lose when the disk is full.
_COMMIT_BYTES = 4 << 20


@checked
@contextmanager
def open_writer(
    path: str | os.PathLike[str], format: str | None = None, *, images: Images = "raw"
) -> Iterator["BagWriter"]:
    """Write a bag that appears at ``path`` when the block ends and replaces a bag there.

    If the block raises or the disk is full, the messages written until then are kept in a bag
    named ``<name>.partial<suffix>``, which ``open_bag`` reads, if one is on the disk whole.

    >>> with open_writer("drive.mcap", images={"/camera/image": "jpeg"}) as bag:  # doctest: +SKIP
    ...     bag.write(event)

    Args:
        path: file, or folder for "rosbag2".
        format: "rosbag1", "rosbag2" (SQLite) or "mcap"; None chooses by the suffix .bag, .db3 or
            .mcap.
        images: format of pictures, "raw", "jpeg" or "png", for all topics or by topic; raw for
            topics that are not named.

    Raises:
        DataError: ``path`` cannot be written (code "cannot-write"), or exists and is not a bag.
        ConfigError: an unknown format of the bag or of pictures.
    """
    target, kind = Path(path).expanduser(), _kind(Path(path), format)
    for stored in [images] if isinstance(images, str) else images.values():
        if stored not in STORED:
            raise ConfigError(f"images is '{stored}', expected one of {', '.join(STORED)}")
    need_rosbags()
    _refuse_other(target, kind)
    with scratch_folder(target) as scratch:
        writer = BagWriter(target, kind, scratch, images)
        try:
            yield writer
            writer._close()
        except BaseException as error:
            with delay_interrupts():
                kept = writer._keep()
            if writer.broken:
                raise DataError(
                    f"{error}; {kept}", code="cannot-write", fields=(str(target),)
                ) from error
            logger.warning("%s is not complete; %s", target, kept)
            raise
        writer._put_in_place(target)


class BagWriter:
    """A bag being written; made by ``open_writer``.

    Attributes:
        count: number of messages written.
        broken: whether writing failed, so that nothing more can be written.
    """

    def __init__(self, target: Path, kind: str, scratch: Path, images: Images) -> None:
        self.count = 0
        self.broken = False
        self._target, self._kind, self._images = target, kind, images
        self._store = type_store(1 if kind == "rosbag1" else 2)
        self._builder = MessageBuilder(make_in(self._store), 1 if kind == "rosbag1" else 2)
        self._path = scratch / (f"{target.stem}.bag" if kind == "rosbag1" else target.stem)
        self._connections: dict[str, Connection] = {}
        self._uncommitted = 0
        self._writer = self._run(self._open)

    def write(self, event: Event) -> None:
        """Write a message as it arrived.

        Raises:
            DataError: the value cannot be written or differs in type from others on its topic;
                static transforms on a topic not called tf_static, or moving ones on one that is;
                a time out of range; or the disk is full.
        """
        if self.broken:
            raise DataError(f"{self._target} cannot be written any further")
        _check(event, self._kind)
        with naming(event.topic):
            message = self._builder.build(event.message, self._format_of(event.topic))
        self._run(self._write, event, message)
        self.count += 1

    def _format_of(self, topic: str) -> str:
        return self._images if isinstance(self._images, str) else self._images.get(topic, "raw")

    def _write(self, event: Event, message: Any) -> None:
        connection = self._connection(event)
        serialize = (
            self._store.serialize_ros1 if self._kind == "rosbag1" else self._store.serialize_cdr
        )
        data = serialize(message, connection.msgtype)
        self._writer.write(connection, event.time_ns, data)
        self._uncommitted += len(data)
        # rosbags would commit only at the end.
        if self._kind == "rosbag2" and self._uncommitted >= _COMMIT_BYTES:
            self._writer.storage.conn.commit()
            self._uncommitted = 0

    def _connection(self, event: Event) -> "Connection":
        name = ros_type(event.message, self._format_of(event.topic))
        if event.topic not in self._connections:
            how: dict[str, Any] = {"typestore": self._store}
            # Late subscribers need static transforms too.
            if is_static(event.topic) and self._kind == "rosbag1":
                how["latching"] = 1
            elif is_static(event.topic):
                how["offered_qos_profiles"] = [_latched_qos()]
            self._connections[event.topic] = self._writer.add_connection(event.topic, name, **how)
        connection = self._connections[event.topic]
        if connection.msgtype != name:
            raise DataError(f"{event.topic}: {name} after {connection.msgtype}, expected one type")
        return connection

    def _open(self) -> "Writer1 | Writer2":
        if self._kind == "rosbag1":
            from rosbags.rosbag1 import Writer

            first = Writer(self._path)
            first.open()
            return first
        from rosbags.rosbag2 import StoragePlugin
        from rosbags.rosbag2 import Writer as Second

        plugin = StoragePlugin.MCAP if self._kind == "mcap" else StoragePlugin.SQLITE3
        second = Second(self._path, version=_VERSION, storage_plugin=plugin)
        second.open()
        return second

    def _close(self) -> None:
        if self.broken:
            raise DataError(f"{self._target} could not be written")
        self._run(self._writer.close)

    def _run(self, action: Any, *arguments: Any) -> Any:
        """Run an action on the file; errors of the system become a DataError."""
        try:
            with delay_interrupts():
                return action(*arguments)
        except (OSError, sqlite3.Error) as error:
            self.broken = True
            reason = getattr(error, "strerror", None) or str(error)
            raise cannot_write(self._target, reason) from error

    def _keep(self) -> str:
        """Keep the partial bag under another name; returns a note that says where."""
        with suppress(DataError):
            if not self.broken:
                self._close()
        if self.broken:
            with suppress(OSError, sqlite3.Error):
                self._writer.abort()
        if self.broken and self._kind == "rosbag2":
            # The file still holds uncommitted rows, and its journal lies beside it. SQLite rolls
            # them back when it reads the file, except for rosbags, which opens it as immutable.
            with suppress(sqlite3.Error), closing(sqlite3.connect(self._storage)) as database:
                database.execute("SELECT count(*) FROM messages").fetchone()
        partial = self._target.with_name(f"{self._target.stem}.partial{self._target.suffix}")
        if not self.count:
            return "nothing was written before"
        is_readable = False
        with suppress(DataError), open_bag(self._made) as bag:
            is_readable = any(True for _ in bag.events())
        if not is_readable:
            return "and what was written before is lost: no message had reached the disk whole"
        try:
            self._put_in_place(partial)
        except DataError as error:
            return f"and what was written before is lost: {error}"
        return f"what was written before is kept in {partial}"

    @property
    def _storage(self) -> Path:
        return self._path / f"{self._path.name}.{'mcap' if self._kind == 'mcap' else 'db3'}"

    @property
    def _made(self) -> Path:
        """The file or folder that becomes the bag."""
        return self._storage if self._kind == "mcap" else self._path

    def _put_in_place(self, target: Path) -> None:
        try:
            if target.is_dir():
                target.rename(self._path.with_name("replaced"))
            self._made.replace(target)
        except OSError as error:
            raise cannot_write(target, error.strerror) from error


def _kind(path: Path, name: str | None) -> str:
    if name is not None and name not in KINDS:
        raise ConfigError(f"format is '{name}', expected one of {', '.join(KINDS)}")
    kind = name or _SUFFIXES.get(path.suffix.lower())
    if kind is None:
        raise ConfigError(f"{path} ends in none of {', '.join(_SUFFIXES)}: name the format")
    return kind


def _check(event: Event, kind: str) -> None:
    limit = 2**32 * NANOSECONDS if kind == "rosbag1" else 2**63
    if not 0 <= event.time_ns < limit:
        raise DataError(f"{event.topic}: time {event.time_ns} ns cannot be written")
    if not isinstance(event.message, FrameTransforms):
        return
    for transform in event.message.transforms:
        if transform.static != is_static(event.topic):
            what = "static" if transform.static else "moving"
            raise DataError(
                f"{event.topic}: {what} transform of '{transform.child}', but only the name "
                "of the topic says which are static: those on tf_static"
            )


def _refuse_other(target: Path, kind: str) -> None:
    """Raise DataError if the target exists and is not a bag of the same layout."""
    if kind != "rosbag2" and target.is_dir():
        raise DataError(f"{target} is a folder, expected a file to write")
    if kind == "rosbag2" and target.is_file():
        raise DataError(f"{target} is a file, expected a folder to write")
    if target.is_dir():
        for path in target.iterdir():
            if path.name != "metadata.yaml" and path.suffix not in (".db3", ".mcap"):
                raise DataError(f"{target} holds {path.name}, which is no part of a bag")


def _latched_qos() -> "Qos":
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    never = QosTime(2147483647, 4294967295)
    return Qos(
        QosHistory.KEEP_LAST,
        1,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL,
        never,
        never,
        QosLiveliness.AUTOMATIC,
        never,
        False,
    )
