# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reads and writes text files of poses and times, and matches them to frames.

Of a table whose lines begin with a stamp or a frame number, frames without a pose have one of NaN:
``open_dataset`` leaves them out, or keeps it unknown.
"""

import logging
import warnings
from collections.abc import Callable, Iterable, Sequence
from decimal import Decimal
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import read_numbers
from fusionslam.base.files import PathLike, reading, write_file
from fusionslam.datasets.streams import PERIOD_NS, find_existing, regular_stamps
from fusionslam.errors import DataError, ShapeError

logger = logging.getLogger(__name__)

Scalar = TypeVar("Scalar", bound=np.generic)

# Largest time difference between a frame and its pose.
POSE_TOLERANCE_NS = 10_000_000
# Largest distance of two poses between which a frame's is interpolated. Every second pose of the
# simulated drive of 8 m/s, 0.5 s apart, gives those between with errors of 6 cm, in bends 35 cm.
POSE_GAP_NS = 500_000_000
# Largest deviation from a rotation matrix: text files have few digits.
ROTATION_TOLERANCE = 1e-2
# Keyframes of real recordings are up to some seconds apart.
_SLOWEST_S = 10.0
_UNITS = (("milliseconds", 3), ("microseconds", 6), ("nanoseconds", 9))
"""Units that times in seconds are mistaken for, and the power of ten that divides them."""
# Columns of TUM's quaternion in trimesh's order.
WXYZ = (7, 4, 5, 6)


@checked
def read_poses(path: PathLike) -> tuple[NDArray[np.int64] | None, NDArray[np.float64]]:
    """Read poses in KITTI (12 columns) or TUM format (8 columns).

    Returns:
        int64 (N) nanoseconds, None for KITTI, and float64 (N, 4, 4) world_from_body.

    Raises:
        DataError: the file is missing or empty, has another number of columns, or a value is not
            a number.
    """
    path = Path(path)
    expected = "poses, one a line: 12 numbers (KITTI) or 8 (TUM)"
    columns = _table(path, (8, 12), expected).shape[1]
    return read_poses_tum(path) if columns == 8 else (None, read_poses_kitti(path))


@checked
def read_poses_kitti(path: PathLike) -> NDArray[np.float64]:
    """Read float64 (N, 4, 4) from lines of 12 numbers, the row-major 3x4 matrix [R t].

    Raises:
        DataError: the file is missing or empty, has another number of columns, or a value is not
            a number or R not a rotation.
    """
    path = Path(path)
    return _matrices(path, _table(path, (12,), "poses of 12 numbers (row-major 3x4), one a line"))


@checked
def read_poses_tum(path: PathLike) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Read int64 (N) nanoseconds and float64 (N, 4, 4) from lines ``t x y z qx qy qz qw``.

    Raises:
        DataError: the file is missing or empty, has another number of columns, a value that is not
            a number, or a quaternion of zeros.
    """
    from trimesh.transformations import quaternion_matrix

    path = Path(path)
    rows = _table(path, (8,), "poses 't x y z qx qy qz qw', one a line")
    if (zero := np.flatnonzero(np.linalg.norm(rows[:, 4:], axis=1) < 1e-6)).size:
        raise DataError(
            f"{path}, line {line_of(path, zero[0])}: a quaternion of zeros, expected a rotation"
        )
    poses: NDArray[np.float64] = quaternion_matrix(  # type: ignore[no-untyped-call]
        rows[:, WXYZ]
    ).reshape(-1, 4, 4)
    poses[:, :3, 3] = rows[:, 1:4]
    return _exact_stamps(path), poses


@checked
def write_poses_tum(
    path: PathLike, stamps_ns: NDArray[np.int64], poses: NDArray[np.float64]
) -> None:
    """Write poses, float64 (N, 4, 4), and their stamps, int64 (N), as ``t x y z qx qy qz qw``.

    Times have all nine decimals, so that they are read back exactly.

    Raises:
        ShapeError: poses and stamps differ in number, or the poses are not (N, 4, 4).
        DataError: the file cannot be written.
    """
    from trimesh.transformations import quaternion_from_matrix

    poses, stamps = read_numbers("poses", poses, "(N, 4, 4)"), np.asarray(stamps_ns)
    if stamps.ndim != 1 or stamps.dtype.kind not in "iu":
        raise ShapeError(
            f"stamps_ns has shape {stamps.shape} and dtype {stamps.dtype}, expected int64 (N,)"
        )
    if poses.shape != (len(stamps), 4, 4):
        raise ShapeError(f"poses have shape {poses.shape}, expected ({len(stamps)}, 4, 4)")
    rows = []
    for pose in poses:
        wxyz = quaternion_from_matrix(pose)  # type: ignore[no-untyped-call]
        rows.append([*pose[:3, 3], *np.roll(wxyz, -1)])
    _write_rows(path, rows, [f"{Decimal(int(stamp)).scaleb(-9):f} " for stamp in stamps])


@checked
def write_poses_kitti(path: PathLike, poses: NDArray[np.float64]) -> None:
    """Write float64 (N, 4, 4) as KITTI lines, all 17 digits, so that they are read back exactly.

    Raises:
        ShapeError: the poses are not (N, 4, 4). DataError: the file cannot be written.
    """
    poses = read_numbers("poses", poses, "(N, 4, 4)")
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise ShapeError(f"poses have shape {poses.shape}, expected (N, 4, 4)")
    _write_rows(path, [pose[:3].ravel() for pose in poses], [""] * len(poses))


def _write_rows(path: PathLike, rows: Iterable[Iterable[float]], starts: Iterable[str]) -> None:
    """Write each row's numbers, with all digits, behind the start of its line."""
    texts = (" ".join(f"{value:.17g}" for value in row) for row in rows)
    lines = (f"{start}{text}\n" for start, text in zip(starts, texts, strict=True))
    write_file(path, "".join(lines))


@checked
def read_times(path: PathLike) -> NDArray[np.int64]:
    """Read int64 (N) nanoseconds from KITTI's times.txt: seconds, one per line.

    A warning says if they are so far apart that they seem to be in another unit.

    Raises:
        DataError: the file is missing or empty, has more than one column, a value that is not a
            number, or a time earlier than the one before.
    """
    path = Path(path)
    _table(path, (1,), "times in seconds, one a line")
    stamps = _exact_stamps(path)
    _check_order(path, stamps)
    step = float(np.median(np.diff(stamps))) / 1e9 if len(stamps) > 1 else 0.0
    if step >= _SLOWEST_S:
        unit, exponent = next(each for each in _UNITS if step < _SLOWEST_S * 10 ** each[1])
        logger.warning(
            "%s: the usual step between times is %g s (%.2g Hz), expected seconds and less than "
            "%g s: are they %s, which need division by 1e%d?",
            *(path, step, 1 / step, _SLOWEST_S, unit, exponent),
        )
    return stamps


def write_times(path: PathLike, stamps_ns: NDArray[np.int64]) -> None:
    """Write int64 (N) nanoseconds as times.txt, with nine decimals. Raises DataError."""
    seconds = (Decimal(stamp).scaleb(-9) for stamp in stamps_ns.tolist())
    write_file(path, "".join(f"{second:f}\n" for second in seconds))


@checked
def read_timestamps(path: PathLike) -> NDArray[np.int64]:
    """Read int64 (N) nanoseconds since 1970 from KITTI raw's timestamps.txt, taken as UTC.

    Raises:
        DataError: the file is missing or empty, a line is not a date and time, or a time is
            earlier than the one before.
    """
    path = Path(path)
    with reading(path, "dates and times such as 2011-09-26 13:02:25.964389445, one a line"):
        lines = path.read_text(encoding="ascii").strip().splitlines()
        stamps = np.array([line.strip() for line in lines], dtype="datetime64[ns]")
    if not len(stamps) or np.isnat(stamps).any():
        raise DataError(f"{path}: a line is empty, expected a date and time in each")
    _check_order(path, stamps.astype(np.int64))
    return stamps.astype(np.int64)


def stamps_of(
    numbers: NDArray[np.int64],
    paths: Sequence[Path],
    read: Callable[[Path], NDArray[np.int64]],
) -> tuple[NDArray[np.int64], int | None]:
    """Stamps of frames by number, from the first of some files that exists, else at 10 Hz.

    Returns:
        int64 (N) nanoseconds, and the number of frames of the whole recording; None without a file.

    Raises:
        DataError: the file cannot be read or is too short.
    """
    path = find_existing(*paths)
    if path is None:
        return regular_stamps(numbers, str(paths[0])), None
    times = read(path)
    return pick(times, numbers, path), len(times)


@checked
def match_poses(
    path: PathLike,
    numbers: NDArray[np.int64],
    stamps_ns: NDArray[np.int64],
    *,
    recorded: int | None = None,
    strict: bool = True,
) -> NDArray[np.float64]:
    """Read the poses of frames: KITTI lines are matched by frame number, TUM lines by time.

    A frame between two TUM poses at most 0.5 s apart gets one in between, and the log says so. One
    outside of them all by less than the time between two, as where they have half the frames' rate,
    has none: ``open_dataset`` leaves it out.

    Args:
        path: file in KITTI or TUM format.
        numbers: int64 (N), ascending.
        stamps_ns: int64 (N).
        recorded: number of frames of the whole recording, of which some may be missing here; None
            if unknown, as where the frames' times are assumed. Of KITTI lines, which have no
            times, only the number tells whether they belong to it.
        strict: whether lines beyond the frames are an error if ``recorded`` is known, too; they are
            logged otherwise.

    Returns:
        float64 (N, 4, 4) world_from_body, NaN for frames without a pose.

    Raises:
        DataError: the file cannot be read, is too short, has more KITTI lines than there are
            frames, has TUM lines although the frames' times are assumed, or has no pose within
            10 ms of a frame, nor two around it.
    """
    path = Path(path)
    pose_stamps, poses = read_poses(path)
    if pose_stamps is None:
        _check_count(path, len(poses), int(numbers[-1]) + 1, recorded, strict)
        return pick(poses, numbers, path)
    if recorded is None:
        check_times(path, pose_stamps, numbers, stamps_ns)
    nearest = _nearest(pose_stamps, stamps_ns)
    found, far = poses[nearest], np.abs(pose_stamps[nearest] - stamps_ns) > POSE_TOLERANCE_NS
    if not far.any():
        return found
    # Before or after all poses by less than the mean time between two.
    period_ns = min(float(np.ptp(pose_stamps)) / max(len(pose_stamps) - 1, 1), POSE_GAP_NS)
    beyond_ns = np.maximum(pose_stamps.min() - stamps_ns, stamps_ns - pose_stamps.max())
    outside = far & (beyond_ns > 0) & (beyond_ns < period_ns)
    if outside.all():
        outside[:] = False  # no frame would be left: refused below
    found[far], gaps_ns = interpolate_poses(pose_stamps, poses, stamps_ns[far])
    if (lacking := np.flatnonzero(far)[(gaps_ns > POSE_GAP_NS) & ~outside[far]]).size:
        first = lacking[0]
        raise DataError(
            f"{path} has no pose within 10 ms of {lacking.size} of {len(numbers)} frames, nor two "
            f"around them at most {POSE_GAP_NS / 1e9:g} s apart; the first is frame "
            f"{numbers[first]} at {stamps_ns[first] / 1e9:.9f} s; the poses are from "
            f"{_span(pose_stamps)}, the frames from {_span(stamps_ns)}",
            code="no-pose",
            fields=(str(path), str(numbers[first])),
        )
    found[outside] = np.nan
    for count, what in (
        ((far & ~outside).sum(), "have interpolated poses"),
        (outside.sum(), "have no pose, being before the first or after the last"),
    ):
        if count:
            logger.warning("%s: %d of %d frames %s", path, count, len(numbers), what)
    return found


def _span(stamps_ns: NDArray[np.int64]) -> str:
    return f"{stamps_ns.min() / 1e9:.3f} to {stamps_ns.max() / 1e9:.3f} s"


def check_times(
    path: Path,
    pose_stamps: NDArray[np.int64],
    numbers: NDArray[np.int64],
    stamps_ns: NDArray[np.int64],
) -> None:
    """Refuse TUM poses for frames whose times are assumed, unless they are of just these times.

    Args:
        path: file of the poses, for the message.
        pose_stamps: int64 (M), nanoseconds.
        numbers, stamps_ns: int64 (N), of the frames.

    Raises:
        DataError: not all times of the frames are among those of the poses (code "no-times").
    """
    assumed = np.array_equal(stamps_ns, numbers * PERIOD_NS)
    if assumed and not np.isin(stamps_ns, pose_stamps).all():
        raise DataError(
            f"{path} has poses by time, but the recording has no times: its frames are taken to be "
            f"{PERIOD_NS / 1e9:g} s apart; give it times.txt (a drive of KITTI raw: "
            "timestamps.txt); true poses may also be lines of 12 numbers (KITTI), one a frame",
            code="no-times",
            fields=(str(path),),
        )


def check_same_time(
    path: Path, pose_stamps: NDArray[np.int64], stamps_ns: NDArray[np.int64]
) -> None:
    """Raise DataError (code "other-time") if all poses are before or after the frames."""
    if pose_stamps.max() < stamps_ns.min() or pose_stamps.min() > stamps_ns.max():
        raise DataError(
            f"{path} is from {_span(pose_stamps)}, the frames from {_span(stamps_ns)}: expected "
            "poses of the time of the frames",
            code="other-time",
            fields=(str(path),),
        )


def _check_count(path: Path, count: int, needed: int, recorded: int | None, strict: bool) -> None:
    """Refuse or log KITTI lines that neither the frames here nor those of the drive account for."""
    if count <= needed or count == recorded:
        return
    if recorded is None or not strict:
        logger.warning(
            "%s has %d poses and the frames end with number %d: the first %d are used, if the file "
            "is of this drive",
            path,
            count,
            needed - 1,
            needed,
        )
        return
    here = "" if needed == recorded else f" (or {needed}, up to the last one here)"
    raise DataError(
        f"{path} has {count} poses without times: expected those of this drive, one for each of "
        f"its {recorded} frames{here}",
        code="other-drive",
        fields=(str(path), str(count), str(recorded)),
    )


def pick(values: NDArray[Scalar], numbers: NDArray[np.int64], path: Path) -> NDArray[Scalar]:
    """Select the rows of a file that belong to frames: row n, counted from 0, is frame n.

    Raises:
        DataError: the file is too short.
    """
    needed = int(numbers[-1]) + 1
    if len(values) < needed:
        message = f"{path} has {len(values)} lines, frame {numbers[-1]} needs {needed}"
        raise DataError(message, code="too-short", fields=(str(path), str(needed)))
    return values[numbers]


def _nearest(stamps: NDArray[np.int64], wanted: NDArray[np.int64]) -> NDArray[np.intp]:
    """Index of the stamp nearest to each wanted one; neither needs to be sorted."""
    order = np.argsort(stamps)
    after = np.searchsorted(stamps, wanted, sorter=order).clip(0, len(stamps) - 1)
    before = (after - 1).clip(0)
    earlier, later = stamps[order[before]], stamps[order[after]]
    return order[np.where(wanted - earlier < later - wanted, before, after)]


def interpolate_poses(
    stamps: NDArray[np.int64], poses: NDArray[np.float64], wanted: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return poses at the wanted stamps, and the time between the two around each.

    Args:
        stamps: int64 (n,), nanoseconds, n > 1.
        poses: float64 (n, 4, 4).
        wanted: int64 (m,), nanoseconds.

    Returns:
        float64 (m, 4, 4), and float64 (m,), nanoseconds, infinite outside of the stamps.
    """
    from scipy.spatial.transform import Rotation

    order = np.argsort(stamps)
    after = np.searchsorted(stamps, wanted, sorter=order).clip(1, len(stamps) - 1)
    first, last = order[after - 1], order[after]
    inside = (stamps[first] <= wanted) & (wanted <= stamps[last])
    gaps_ns = np.where(inside, stamps[last].astype(np.float64) - stamps[first], np.inf)
    share = np.where(inside, (wanted - stamps[first]) / np.maximum(gaps_ns, 1), 0)[:, None]
    start = Rotation.from_matrix(poses[first, :3, :3])
    turn = (start.inv() * Rotation.from_matrix(poses[last, :3, :3])).as_rotvec()
    between = poses[first]
    between[:, :3, :3] = (start * Rotation.from_rotvec(share * turn)).as_matrix()
    between[:, :3, 3] += share * (poses[last, :3, 3] - poses[first, :3, 3])
    return between, gaps_ns


def _table(path: Path, columns: tuple[int, ...], expected: str) -> NDArray[np.float64]:
    """Read numbers separated by blanks, float64 (N, columns), N > 0, all finite."""
    with reading(path, expected), warnings.catch_warnings():
        # An empty file is an error below.
        warnings.filterwarnings("ignore", "loadtxt: input contained no data", UserWarning)
        try:
            rows = np.loadtxt(path, dtype=np.float64, ndmin=2, encoding="utf-8")
        except ValueError as error:
            lines = _filled_lines(path)
            width = len(lines[0][1]) if lines else 0
            bad_lines = (n for n, words in lines if len(words) != width or not _are(float, words))
            if (bad_line := next(bad_lines, None)) is None:
                raise
            raise DataError(
                f"line {bad_line}: expected {expected}, with blanks between numbers",
                code="damaged-file",
                fields=(str(path),),
            ) from error
    if not rows.size:
        raise DataError(f"{path} is empty: expected {expected}")
    if rows.shape[1] not in columns:
        raise DataError(f"{path} has {rows.shape[1]} columns: expected {expected}")
    if (bad := np.flatnonzero(~np.isfinite(rows).all(axis=1))).size:
        line = line_of(path, bad[0])
        raise DataError(f"{path}, line {line}: NaN or infinity, expected {expected}")
    return rows


def _filled_lines(path: Path, delimiter: str | None = None) -> list[tuple[int, list[str]]]:
    """Number (from 1) and words of each line that is a row: not blank, and not only a comment."""
    contents = (line.partition("#")[0] for line in path.read_text(encoding="utf-8").splitlines())
    return [(n, text.split(delimiter)) for n, text in enumerate(contents, start=1) if text.strip()]


def _are(kind: type, words: Iterable[str]) -> bool:
    """Whether all words are numbers of a kind."""
    try:
        return all(kind(word) is not None for word in words)
    except (ValueError, OverflowError):
        return False


def line_of(path: Path, row: int | np.intp) -> int:
    """Line number (from 1) of a row (from 0)."""
    return _filled_lines(path)[row][0]


def _matrices(path: Path, rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """float64 (N, 4, 4) of the 12 numbers of [R t] in each row, within the precision of text.

    Raises:
        DataError: an R is no rotation.
    """
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = rows.reshape(-1, 3, 4)
    turns = poses[:, :3, :3]
    apart = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    if (bad := np.flatnonzero((apart > ROTATION_TOLERANCE) | (np.linalg.det(turns) < 0))).size:
        line = line_of(path, bad[0])
        raise DataError(
            f"{path}, line {line}: the first three columns of [R t] are no rotation",
            code="not-a-rotation",
            fields=(str(path), str(line)),
        )
    return poses


def _check_order(path: Path, stamps: NDArray[np.int64]) -> None:
    """Raise DataError if the stamps decrease."""
    if (back := np.flatnonzero(np.diff(stamps) < 0)).size:
        line = line_of(path, back[0] + 1)
        raise DataError(
            f"{path}, line {line}: earlier than the line before",
            code="stamps-decrease",
            fields=(str(path), str(line)),
        )


def _exact_stamps(path: Path) -> NDArray[np.int64]:
    """Read the first column, seconds, as int64 (N) nanoseconds; float64 would lose digits."""
    with reading(path, "times in seconds"):
        stamps = np.loadtxt(
            path,
            dtype=object,
            usecols=0,
            ndmin=1,
            encoding="utf-8",
            converters=lambda seconds: round(Decimal(seconds).scaleb(9)),
        )
    if (large := np.flatnonzero(np.abs(stamps) > np.iinfo(np.int64).max)).size:
        line, seconds = line_of(path, large[0]), stamps[large[0]] // 10**9
        # The unit in which it is a time of this century.
        fitting = (each for each in _UNITS if 10**9 <= seconds // 10 ** each[1] < 4 * 10**9)
        guesses = (f": these look like {u}, which need division by 1e{e}" for u, e in fitting)
        raise DataError(
            f"{path}, line {line}: {seconds:.4g} seconds do not fit 64 bits as nanoseconds, "
            f"expected times in seconds{next(guesses, '')}",
            code="not-seconds",
            fields=(str(path), str(line)),
        )
    return stamps.astype(np.int64)


def read_table(
    path: PathLike, columns: int, expected: str, *, delimiter: str | None = None
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Read lines of an integer and numbers; # begins a comment.

    Args:
        path: of the file.
        columns: how many numbers follow the integer.
        expected: description of a line, for errors.
        delimiter: between numbers; None for blanks.

    Returns:
        int64 (N) and float64 (N, columns), N > 0; numbers may be NaN.

    Raises:
        DataError: the file is missing or empty, or a line is something else; the message names it.
    """
    path, row = Path(path), np.dtype([("key", "<i8"), ("values", "<f8", (columns,))])
    with reading(path, expected), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "loadtxt: input contained no data", UserWarning)
        # An integer with decimals would lose digits.
        warnings.simplefilter("error", DeprecationWarning)
        try:
            rows = np.loadtxt(path, dtype=row, delimiter=delimiter, ndmin=1, encoding="utf-8")
        except (ValueError, DeprecationWarning) as error:
            bad_lines = (
                number
                for number, words in _filled_lines(path, delimiter)
                if len(words) != 1 + columns
                or not (_are(np.int64, words[:1]) and _are(float, words[1:]))
            )
            line = next(bad_lines, 1)
            raise DataError(
                f"line {line}: expected {expected}",
                code="damaged-file",
                fields=(str(path), str(line)),
            ) from error
    if not rows.size:
        raise DataError(
            f"{path} is empty: expected {expected}", code="too-short", fields=(str(path), "1")
        )
    return rows["key"].astype(np.int64), rows["values"].astype(np.float64)


def read_matrices(
    path: PathLike, expected: str, *, delimiter: str | None = None
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Read lines of an integer and the 12 numbers of a row-major 3x4 matrix [R t].

    Returns:
        int64 (N) and float64 (N, 4, 4).

    Raises:
        DataError: as ``read_table``; a number is not finite, or R is no rotation.
    """
    path = Path(path)
    keys, rows = read_table(path, 12, expected, delimiter=delimiter)
    if (bad := np.flatnonzero(~np.isfinite(rows).all(axis=1))).size:
        line = line_of(path, bad[0])
        raise DataError(
            f"{path}, line {line}: NaN or infinity, expected {expected}",
            code="not-finite",
            fields=(str(path), str(line)),
        )
    return keys, _matrices(path, rows)
