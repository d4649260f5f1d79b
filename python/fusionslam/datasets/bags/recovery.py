# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the complete records of bags that were truncated or never closed.

Both formats are sequences of records with an index at the end, which such a file lacks. rosbags
needs the index; these readers rebuild it from the records (format 2.0 of ROS 1 bags; MCAP's
specification). They extend rosbags' readers, so that all bags are read alike without another
dependency: its versions are pinned.
"""

from collections import defaultdict
from collections.abc import Collection, Iterator
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any, cast

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader, ReaderError
from rosbags.rosbag1.reader import (
    Chunk,
    ChunkInfo,
    Header,
    IndexData,
    RecordType,
    read_bytes,
    read_uint32,
)
from rosbags.rosbag2 import Reader as Reader2
from rosbags.rosbag2.storage_mcap import McapReader

_ROS1_MAGIC = b"#ROSBAG V2.0\n"
_MCAP_MAGIC = b"\x89MCAP0\r\n"
_MCAP_DATA_END = 0x0F


def open_cut(path: Path, kind: str) -> Reader | Reader2 | None:
    """Open the complete records of a bag without index; None if there are none."""
    if kind == "rosbag2":  # a database is not a sequence of records
        return None
    with suppress(Exception):  # damaged bytes may raise anything, and so may a wrong suffix
        reader: Any = _CutRosbag1(path) if kind == "rosbag1" else Reader2(path)
        if kind == "mcap":
            reader.storage = _CutMcap(path)
        reader.open()
        if any(connection.msgcount for connection in reader.connections):
            return cast("Reader | Reader2", reader)
        reader.close()
    return None


class _CutRosbag1(Reader):
    """Reads the chunks that are complete and followed by their index records."""

    def open(self) -> None:
        self.bio = self.path.open("rb")
        if self.bio.read(len(_ROS1_MAGIC)) != _ROS1_MAGIC:
            raise ReaderError("File magic is invalid.")
        listed = self._list_chunks()
        for position, entries in listed.items():
            times = [each.time for ones in entries.values() for each in ones] or [2**63 - 1, -1]
            counts = {connection: len(ones) for connection, ones in entries.items()}
            self.chunk_infos.append(ChunkInfo(position, min(times), max(times) + 1, counts))
            if not {each.id for each in self.connections}.issuperset(entries):
                self._find_connections(self.chunks[position])
        indexes = {
            each.id: sorted(
                entry for entries in listed.values() for entry in entries.get(each.id, [])
            )
            for each in self.connections
        }
        self.indexes = indexes
        self.connections = [
            each._replace(msgcount=len(indexes[each.id])) for each in self.connections
        ]

    def _list_chunks(self) -> dict[int, dict[int, list[IndexData]]]:
        """Positions of messages, by position of the chunk and by connection."""
        listed: dict[int, dict[int, list[IndexData]]] = {}
        chunk = -1
        for position, operation in self._records():
            assert self.bio
            self.bio.seek(position)
            if operation == RecordType.CHUNK:
                chunk, listed[position] = position, defaultdict(list)
                self.chunks[position] = self.read_chunk()
            elif operation == RecordType.IDXDATA:
                self.read_index_data(chunk, listed[chunk])
        return listed

    def _records(self) -> Iterator[tuple[int, int]]:
        """Yield position and kind of each complete record."""
        assert self.bio
        size, position = self.path.stat().st_size, len(_ROS1_MAGIC)
        with suppress(ReaderError):  # the end
            while True:
                self.bio.seek(position)
                operation = Header.read(self.bio).get_uint8("op")
                length = read_uint32(self.bio)
                end = self.bio.tell() + length
                if end > size:
                    return
                yield position, operation
                position = end

    def _find_connections(self, chunk: Chunk) -> None:
        """Read the connection records of a chunk; each precedes the connection's first message."""
        assert self.bio
        self.bio.seek(chunk.datapos)
        content = BytesIO(chunk.decompressor(read_bytes(self.bio, chunk.datasize)))
        file, self.bio = self.bio, content
        known = {each.id for each in self.connections}
        try:
            while content.tell() < len(content.getbuffer()):
                position = content.tell()
                operation = Header.read(content).get_uint8("op")
                end = read_uint32(content) + content.tell()
                if operation == RecordType.CONNECTION:
                    content.seek(position)
                    found = self.read_connection()
                    self.connections += [found] if found.id not in known else []
                    known.add(found.id)
                content.seek(end)
        finally:
            self.bio = file


class _CutMcap(McapReader):
    """Reads the complete records in the order in which they were written."""

    def open(self) -> None:
        self.bio = self.path.open("rb")
        if self.bio.read(len(_MCAP_MAGIC)) != _MCAP_MAGIC:
            raise ReaderError("File magic is invalid.")
        self.data_start = self.data_end = len(_MCAP_MAGIC)
        size = self.path.stat().st_size
        # A record is its kind, its length and its content.
        while len(head := self.bio.read(9)) == 9 and head[0] != _MCAP_DATA_END:
            end = self.data_end + 9 + int.from_bytes(head[1:], "little")
            if end > size:
                break
            self.data_end = self.bio.seek(end)
        self.meta_scan()
        assert self.statistics
        found = self.statistics
        self.connections = [
            each._replace(msgcount=found.channel_message_counts.get(each.id, 0))
            for each in self.connections
        ]
        self.metadata = self.metadata._replace(
            start_time=found.start_time,
            end_time=found.end_time + 1,
            message_count=found.message_count,
        )

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Any:
        return self.messages_scan(connections, start, stop)
