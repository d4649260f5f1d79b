# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Places as rows of a table in Arrow's format, and the settings that its schema carries."""

import json
from collections import Counter
from dataclasses import asdict, dataclass, field, fields
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.archive import dump_sealed, parse_sealed
from fusionslam.base.arrays import Floats, Floats32, Matrix, read_numbers
from fusionslam.descriptors import DESCRIPTORS
from fusionslam.descriptors.computation import find_descriptor
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.fleet.lance_extra import damaged, other_format
from fusionslam.fleet.places import ABOUT, Candidate, Places

VERSION = 3
"""Of the format."""
METRIC = "l2"
SHOWN = ("key", *ABOUT, "frame", "stamp_ns", "pose")
"""All columns but the vector and the checksum."""
CHECKSUM = "checksum"
"""Column of CRC-32 of ``SHOWN``, and above them those of the vector."""

LONGEST = float(np.sqrt(np.finfo(np.float32).max)) * 0.49
"""Norm of a vector: squares of distances between two of these are finite in float32."""

_SETTINGS = b"fusionslam.places"
_POSE = 16
_HALF, _LOW = np.uint64(32), np.uint64(2**32 - 1)


@dataclass(frozen=True)
class DatabaseSettings:
    """What makes vectors of one database comparable.

    Attributes:
        descriptor: its name, which may end with a preset, such as "cm2dp:robust".
        length: of a vector.
        metric: how vectors are compared; "l2" only.
        config: of the fusion and the descriptor, as JSON has it.
    """

    descriptor: str
    length: int
    metric: str = METRIC
    config: dict[str, Any] = field(default_factory=dict)

    def check(self) -> None:
        """Raise ConfigError for vectors that no database takes.

        Raises:
            ConfigError: an unknown descriptor, one that is not compared by l2 (code "choice"), or
                a length that is not positive (code "limit").
        """
        metric = find_descriptor(self.descriptor).metric
        if (self.metric, metric) != (METRIC, METRIC):
            known = ", ".join(name for name, kind in DESCRIPTORS.items() if kind.metric == METRIC)
            raise ConfigError(
                f"descriptor {self.descriptor!r} is compared by {metric}, a database of places "
                f"compares by {METRIC}, as {known} are",
                code="choice",
                fields=("metric", metric),
            )
        if self.length < 1:
            raise ConfigError(
                f"length: expected at least 1, not {self.length}", code="limit", fields=("length",)
            )

    def require(self, expected: "DatabaseSettings") -> None:
        """Raise ConfigError (code "other-descriptor") that names the first field that differs."""
        for each in fields(self):
            found, wanted = getattr(self, each.name), getattr(expected, each.name)
            if found != wanted:
                raise ConfigError(
                    f"the database holds places with {each.name} {found!r}, not {wanted!r}: use "
                    "these settings, or make another database",
                    code="other-descriptor",
                    fields=(each.name, str(found), str(wanted)),
                )


def schema_of(settings: DatabaseSettings) -> Any:
    """Arrow's schema of the table, with the settings in its metadata.

    Raises:
        ConfigError: the configuration is not representable in JSON (code "config").
    """
    import pyarrow as pa

    try:
        about = dump_sealed({"version": VERSION, **asdict(settings)})
    except (TypeError, ValueError) as error:
        raise ConfigError(f"config: expected values that JSON has; {error}") from error
    columns = [
        pa.field("key", pa.string(), False),
        pa.field("vector", pa.list_(pa.float32(), settings.length), False),
        *(pa.field(name, pa.string(), False) for name in ABOUT),
        pa.field("frame", pa.int64(), False),
        pa.field("stamp_ns", pa.int64(), False),
        pa.field("pose", pa.list_(pa.float64(), _POSE)),
        pa.field(CHECKSUM, pa.uint64(), False),
    ]
    return pa.schema(columns, metadata={_SETTINGS: about.encode()})


def settings_of(schema: Any, location: str) -> DatabaseSettings:
    """Read the settings that a table's schema carries.

    Raises:
        DataError: none of ours (code "other-format"), of a later version ("newer-version") or an
            earlier one ("older-version"), or other columns than its settings say ("damaged").
    """
    text = (schema.metadata or {}).get(_SETTINGS)
    if text is None:
        raise other_format(location)
    try:
        version = int(json.loads(text)["version"])
        if version != VERSION:
            raise _other_version(location, version)
        about = parse_sealed(text)
        del about["version"]
        settings = DatabaseSettings(**about)
        expected = schema_of(settings)
    except (DataError, ValueError, TypeError, KeyError, AttributeError) as error:
        if isinstance(error, DataError) and error.code != "wrong-digest":
            raise
        raise damaged(location, f"its settings cannot be read: {error}") from error
    if [(one.name, one.type) for one in schema] != [(one.name, one.type) for one in expected]:
        raise damaged(location, f"its columns are {', '.join(schema.names)}, not those of places")
    return settings


def check_vectors(name: str, vectors: Any, length: int) -> Floats32:
    """Return vectors as float32 (n, length), contiguous.

    Raises:
        ShapeError: another shape.
        DataError: a value is not finite as float32 (code "not-finite"), or a vector too long for
            distances in float32 ("too-long").
    """
    rows = read_numbers(name, vectors, f"(n, {length})")
    if rows.ndim != 2 or rows.shape[1] != length:
        raise ShapeError(
            f"{name}: expected float32 (n, {length}), not {rows.shape}", fields=(name,)
        )
    with np.errstate(over="ignore"):
        narrow = np.ascontiguousarray(rows, np.float32)
    norms = np.linalg.norm(narrow.astype(np.float64), axis=1)
    for row in np.flatnonzero(~(norms <= LONGEST))[:1].tolist():
        is_finite = bool(np.isfinite(norms[row]))
        what = f"is {norms[row]:.3g} long" if is_finite else "has values that are not finite"
        raise DataError(
            f"{name}: row {row} {what}, expected at most {LONGEST:.3g}",
            code="too-long" if is_finite else "not-finite",
            fields=(name, str(row)),
        )
    return narrow


def rows_of(places: Places, settings: DatabaseSettings) -> Any:
    """Make Arrow's table of places, all of which are checked.

    Raises:
        ShapeError: an array of another length or shape; the first of ``fields`` is its name.
        DataError: a key that is empty or no text (code "bad-key") or there twice
            ("duplicate-key"), or a vector that is not finite ("not-finite").
    """
    import pyarrow as pa

    vectors = check_vectors("vectors", places.vectors, settings.length)
    count = len(places)
    _check_keys(places.keys)
    _check_length("vectors", len(vectors), count)
    columns = {
        "key": pa.array(list(places.keys), pa.string()),
        "vector": pa.FixedSizeListArray.from_arrays(pa.array(vectors.ravel()), settings.length),
    }
    for name in ABOUT:
        columns[name] = _texts(name, places.column(name), count)
    columns["frame"] = _integers("frames", places.frames, count)
    columns["stamp_ns"] = _integers("stamps_ns", places.stamps_ns, count)
    columns["pose"] = _poses(places.poses, count)
    about, sums = (
        _sums_of(pa.table({name: columns[name] for name in SHOWN})),
        _sums_of_vectors(vectors),
    )
    columns[CHECKSUM] = pa.array(about | sums << _HALF)
    return pa.table(columns, schema=schema_of(settings))


def check_rows(rows: Any, location: str) -> None:
    """Raise DataError (code "damaged") for a row that is not as it was written.

    Args:
        rows: Arrow's table with ``SHOWN`` and ``CHECKSUM``, and the vectors if they are checked.
        location: of the database.
    """
    stored = rows[CHECKSUM].to_numpy()
    is_wrong = (stored & _LOW) != _sums_of(rows)
    if "vector" in rows.schema.names:
        vectors = vectors_of(rows["vector"], rows.schema.field("vector").type.list_size)
        is_wrong |= stored >> _HALF != _sums_of_vectors(vectors)
    for row in np.flatnonzero(is_wrong)[:1].tolist():
        key = rows["key"][row].as_py()
        raise damaged(location, f"the place {key!r} was changed after it was written")


def _sums_of(rows: Any) -> NDArray[np.uint64]:
    """Checksums of ``SHOWN``, (n)."""
    texts = zip(*(rows[name].to_pylist() for name in SHOWN if name != "pose"), strict=True)
    pairs = zip(texts, poses_of(rows["pose"]), strict=True)
    return np.array([crc32(pose, crc32(repr(text).encode())) for text, pose in pairs], np.uint64)


def _sums_of_vectors(vectors: Floats32) -> NDArray[np.uint64]:
    return np.array([crc32(vector) for vector in np.ascontiguousarray(vectors)], np.uint64)


def pose_of(values: Any) -> Matrix | None:
    """float64 (4, 4) of a row's pose."""
    return None if values is None else np.array(values, np.float64).reshape(4, 4)


def candidate_of(row: dict[str, Any], distance: float) -> Candidate:
    """Make a candidate of the columns ``SHOWN``."""
    known = {name: row[name] for name in SHOWN if name != "pose"}
    return Candidate(distance=distance, pose=pose_of(row["pose"]), **known)


def vectors_of(column: Any, length: int) -> Floats32:
    """float32 (n, length) of a column of vectors, in one array or several."""
    import pyarrow as pa

    whole = column.combine_chunks() if isinstance(column, pa.ChunkedArray) else column
    rows: Floats32 = whole.flatten().to_numpy(zero_copy_only=False).reshape(-1, length)
    return rows


def poses_of(column: Any) -> Floats:
    """float64 (n, 4, 4) of a column of poses; NaN where there is none."""
    poses = np.full((len(column), 4, 4), np.nan)
    known = np.asarray(column.is_valid(), bool)
    values = column.drop_null().combine_chunks().flatten()
    poses[known] = values.to_numpy(zero_copy_only=False).reshape(-1, 4, 4)
    return poses


def thin_out(batch: Any, every: int, seen: Counter[str]) -> Any:
    """Return every n-th row of each session, in Arrow's batch of many.

    Args:
        batch: with a column "session".
        every: n.
        seen: numbers of rows by session in the batches before, to which these are added.
    """
    encoded = batch["session"].dictionary_encode()
    codes, kept = encoded.indices.to_numpy(), []
    for code, session in enumerate(encoded.dictionary.to_pylist()):
        rows = np.flatnonzero(codes == code)
        kept.append(rows[-seen[session] % every :: every])
        seen[session] += len(rows)
    return batch.take(np.sort(np.concatenate([*kept, codes[:0]])))


def _other_version(location: str, version: int) -> DataError:
    is_newer = version > VERSION
    what = "it was written by a later one" if is_newer else "delete it, and describe again"
    return DataError(
        f"{location} has version {version} of the format, this fusionslam reads {VERSION}: {what}",
        code="newer-version" if is_newer else "older-version",
        fields=(location, str(version)),
    )


def _check_length(name: str, found: int, expected: int) -> None:
    if found != expected:
        raise ShapeError(
            f"{name}: expected one for each of {expected} keys, not {found}", fields=(name,)
        )


def _check_keys(keys: Any) -> None:
    seen: set[str] = set()
    for row, key in enumerate(keys):
        if not _is_text(key) or not key:
            raise DataError(
                f"keys: row {row} is {key!r}, expected a text that is not empty",
                code="bad-key",
                fields=("keys", str(row)),
            )
        if key in seen:
            raise DataError(
                f"keys: {key!r} is there twice", code="duplicate-key", fields=("keys", key)
            )
        seen.add(key)


def _is_text(value: Any) -> bool:
    """Whether it is a text that UTF-8 has: names of files may be none."""
    try:
        return isinstance(value, str) and bool(value.encode() or True)
    except UnicodeEncodeError:
        return False


def _texts(name: str, values: list[str], count: int) -> Any:
    import pyarrow as pa

    _check_length(name, len(values), count)
    if not all(map(_is_text, values)):
        raise ShapeError(f"{name}: expected texts in Unicode", fields=(name,))
    return pa.array(values, pa.string())


def _integers(name: str, values: Any, count: int) -> Any:
    import pyarrow as pa

    rows = np.asarray(values)
    if rows.ndim != 1 or (len(rows) and rows.dtype.kind not in "iu"):
        raise ShapeError(
            f"{name}: expected int64 (n), not {rows.dtype} {rows.shape}", fields=(name,)
        )
    _check_length(name, len(rows), count)
    return pa.array(rows.astype(np.int64))


def _poses(poses: Any, count: int) -> Any:
    import pyarrow as pa

    if poses is None:
        return pa.nulls(count, pa.list_(pa.float64(), _POSE))
    rows = read_numbers("poses", poses, "(n, 4, 4)")
    if rows.shape[1:] != (4, 4):
        raise ShapeError(f"poses: expected float64 (n, 4, 4), not {rows.shape}", fields=("poses",))
    _check_length("poses", len(rows), count)
    unknown = np.logical_not(np.isfinite(rows).reshape(count, _POSE).min(axis=1))
    values = pa.array(np.where(unknown[:, None, None], 0.0, rows).ravel())
    return pa.FixedSizeListArray.from_arrays(values, _POSE, mask=pa.array(unknown))
