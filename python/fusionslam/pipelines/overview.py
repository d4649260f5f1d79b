# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Summarise a recording, or results that fusionslam stored, as a printable value."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml
from numpy.typing import NDArray

from fusionslam.base.archive import format_of, load_archive, load_json
from fusionslam.base.texts import counted
from fusionslam.config import flatten
from fusionslam.datasets.base import CloudDataset, FileDataset, OdometryOrigin, PosesOrigin
from fusionslam.descriptors import DescriptorConfig
from fusionslam.errors import DataError, FusionSlamError, one_line
from fusionslam.evaluation import DescriptorRun
from fusionslam.fusion import FusionConfig
from fusionslam.loop_closure.config import LoopConfig
from fusionslam.loop_closure.observation import FrameObserver
from fusionslam.loop_closure.profile import profile_sensor
from fusionslam.mapping.map_database import is_map
from fusionslam.mapping.map_file import MapFile
from fusionslam.pipelines.describe import PipelineConfig
from fusionslam.pipelines.frame_check import (
    FirstCloud,
    FrameCheck,
    check_frames,
    check_rows,
    first_cloud,
    source_of,
)
from fusionslam.pipelines.recording import SceneRecording
from fusionslam.pipelines.results import FILE, Work, load_verified, run_files, runs_folder
from fusionslam.registration import RegistrationConfig
from fusionslam.sensors.frame import Camera
from fusionslam.sensors.messages import Fix
from fusionslam.views.scene_set import is_scene_set

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset
    from fusionslam.pipelines.bag_overview import Inspection
    from fusionslam.pipelines.recording import Recording


_PREFIX = "fusionslam."
_LOOKED_AT = 100
"""Frames whose odometry is looked at."""
_LEVEL = 1e-4
"""Metres, and sines, by which height and tilt of odometry change in a plane."""
_STORED: Mapping[str, Any] = yaml.safe_load(
    Path(__file__).with_name("overview.yaml").read_text(encoding="utf-8")
)
"""What stored files hold."""


@dataclass(frozen=True)
class Overview:
    """Summary of a recording.

    Attributes:
        rows: (label, value) pairs, the most interesting first.
        gaps: numbers of the frames that lack a file.
        error: why a bag has no frames; None if it has some.
        fusion: outcome of fusing the first frame of a bag; None for other recordings.
    """

    rows: list[tuple[str, str]]
    gaps: list[int]
    error: DataError | None = None
    fusion: FirstCloud | None = None

    def __str__(self) -> str:
        return "\n".join(f"{name:<15} {value}" for name, value in self.rows)


def overview(dataset: "Dataset") -> Overview:
    """Summarise a recording without reading scans; of images only the size is read."""
    return Overview(list(_rows(dataset)), [int(number) for number in dataset.gaps])


Check = Callable[["Dataset"], list[FrameCheck]]
"""Reads all frames: ``check_frames`` with its options."""


def look_at(recording: "Recording", check: Check | None = None) -> Overview:
    """Summarise a recording and fuse its first frame; for a bag, summarise its content.

    Stored results are no recording; the summary says what they are.

    Args:
        recording: the data.
        check: reads all frames, not only the first.

    The summary of a bag that cannot be opened as a dataset gives the reason.

    Raises:
        DataError: a file cannot be read. ConfigError: as ``open_dataset``.
    """
    path = Path(recording.path)
    # A folder of results may hold clouds of fuse, and then is a recording.
    if path.is_file() and not is_scene_set(path) and (rows := _stored_rows(path)):
        return Overview(rows, [])
    try:
        found = _look_at_data(recording, path, check)
    except DataError as error:
        if error.code == "no-recording" and (rows := _stored_rows(path)):
            return Overview(rows, [])
        raise
    return found


def _look_at_data(recording: "Recording", path: Path, check: Check | None) -> Overview:
    from fusionslam.datasets.bags.reader import bag_kind
    from fusionslam.datasets.bags.stores import KINDS as BAG_KINDS
    from fusionslam.pipelines.bag_overview import Inspection

    if (recording.kind or bag_kind(path)) not in BAG_KINDS:
        dataset = recording.open()
        whole = overview(dataset)
        rows = [*whole.rows, ("fusion", str(first_cloud(dataset)))]
        rows += [*profile_rows(dataset), *_checked(dataset, check)]
        return Overview(rows, whole.gaps)
    calibration = Path(recording.calibration) if recording.calibration else None
    bag = Inspection.of(path, recording.topics, recording.stamps, calibration)
    return look_at_bag(bag, recording.open, check)


def look_at_bag(
    bag: "Inspection", open_dataset: "Callable[[], Dataset]", check: Check | None = None
) -> Overview:
    """As ``look_at``, for messages that are indexed already."""
    rows = [*bag.rows()]
    try:
        dataset = open_dataset()
    except DataError as error:
        fusion = bag.fusion(None)
        rows += [("frames", f"none: {error}"), ("fusion", str(fusion))]
        return Overview(rows, [], error, fusion)
    if not dataset.cameras:
        rows.append(("cameras", bag.cameras()))
    rows += [row for row in _rows(dataset) if row[0] not in dict(rows)]
    fusion = bag.fusion(dataset)
    rows += [("fusion", str(fusion)), *profile_rows(dataset), *_checked(dataset, check)]
    return Overview(rows, list(dataset.gaps), None, fusion)


def profile_rows(dataset: "Dataset") -> Iterator[tuple[str, str]]:
    """Yield what the first cloud says of the sensor, and how detectors and maps take its clouds."""
    source = source_of(dataset)
    if source is None or isinstance(dataset, SceneRecording):
        return
    fits = FrameObserver(
        {}, DescriptorConfig(), FusionConfig(source=source), RegistrationConfig(), fits_lengths=True
    )
    try:
        profile = profile_sensor(dataset[0], fits.verifying(LoopConfig().voters))
    except FusionSlamError as error:
        yield "sensor", f"unknown: {one_line(error)}"
        return
    for label, text in profile.rows():
        yield f"sensor {label}" if label != "configuration" else label, text


def _checked(dataset: "Dataset", check: Check | None) -> list[tuple[str, str]]:
    """Return what reading all frames found, or the first one without a check."""
    if check is not None:
        return list(check_rows(check(dataset)))
    rows = list(check_rows(check_frames(dataset.only([0]))))
    return [("checked", "the first frame only; --all reads all"), *rows[1:]]


def _rows(dataset: "Dataset") -> Iterator[tuple[str, str]]:
    yield "name", dataset.name
    yield "kind", dataset.kind
    yield "folder", str(dataset.root)
    yield "frames", f"{len(dataset)}, numbers {dataset.numbers[0]} to {dataset.numbers[-1]}"
    yield "time", _time(dataset.stamps_ns)
    for sensor in dataset.counts:
        yield f"sensor {sensor}", dataset.content(sensor)
    if isinstance(dataset, SceneRecording):
        yield from dataset.rows()
    for name, camera in dataset.cameras.items():
        yield f"camera {name}", calibration_words(camera)
    if not dataset.cameras:
        yield "cameras", _no_cameras(dataset)
    if {"left", "right"} <= dataset.cameras.keys():
        left, right = (dataset.cameras[name].projection for name in ("left", "right"))
        baseline = (left[0, 3] - right[0, 3]) / left[0, 0]
        yield "stereo", f"baseline {baseline:.3f} m"
    yield "poses", _path(dataset)
    if (odometry := _odometry(dataset)) is not None:
        yield "odometry", odometry
    if fixes := [*dataset.fixes()]:
        yield "satellites", _fix_words(fixes, dataset)
    yield "gaps", _gaps(dataset)
    yield "time offsets", _offsets(dataset)


def _odometry(dataset: "Dataset") -> str | None:
    """Describe the odometry of frames: where it is from, and in how many directions it moves."""
    if isinstance(dataset, FileDataset) and dataset.odometry is not None:
        name = dataset.odometry.name
        try:
            moved = dataset.motion("odometry")
        except DataError as error:  # the frames need none
            return f"{name}; {one_line(error)}"
        first, last = (moved[row].stamp_ns / 1e9 for row in (0, -1))
        span = f"from {first:.3f} to {last:.3f} s"
        kind = _kind_of_motion([each.pose for each in moved])
        return f"{counted(len(moved), 'pose')} in {name}, {span}, {kind}"
    if dataset.odometry_origin is OdometryOrigin.NONE:
        return None
    rows = np.unique(np.linspace(0, len(dataset) - 1, _LOOKED_AT).astype(int))
    poses = [dataset[row].odometry for row in rows.tolist()]
    known = [pose for pose in poses if pose is not None and np.isfinite(pose).all()]
    return f"by {dataset.odometry_topic or 'TF'}, {_kind_of_motion(known)}"


def _fix_words(fixes: Sequence[Fix], dataset: "Dataset") -> str:
    """Describe what a satellite receiver says, and what it lacks to place a map."""
    known = [fix for fix in fixes if fix.position is not None]
    words = [f"{counted(len(known), 'position')} in {counted(len(fixes), 'message')}"]
    if known:
        places = np.stack([fix.position for fix in known if fix.position is not None])
        latitude, longitude, height = np.median(places, axis=0)
        words.append(f"near {latitude:.5f}, {longitude:.5f}, {height:.0f} m above WGS 84")
    stated = [fix.covariance for fix in known if fix.covariance is not None]
    if stated:
        level_m = np.sqrt(np.median([np.trace(each[:2, :2]) / 2 for each in stated]))
        words.append(f"stated deviation {level_m:.2g} m")
    if len(stated) < len(known):
        words.append(f"{len(known) - len(stated)} without a covariance")
    stamps = np.array([fix.stamp_ns for fix in known])
    first, last = dataset.stamps_ns[[0, -1]]
    if known and not ((stamps >= first) & (stamps <= last)).any():
        late_s = (stamps[0] - first) / 1e9
        words.append(f"none during the frames: the first is {late_s:+.3f} s from theirs")
    mount = dataset.robot_from_antenna()
    if mount is None:
        words.append("TF does not say where the antenna is")
    else:
        words.append(f"antenna at {', '.join(f'{x:.2f}' for x in mount[:3, 3])} m")
    return ", ".join(words)


def _kind_of_motion(poses: Sequence[NDArray[np.float64]]) -> str:
    """Say whether poses move in a plane, as wheels know it, or in space."""
    if len(poses) < 2:
        return "not known at the frames"
    moved = np.stack(poses)
    apart = np.abs(moved - moved[0])
    is_flat = apart[:, 2, 3].max() < _LEVEL and apart[:, 2, :3].max() < _LEVEL
    return "in a plane: height and tilt stay" if is_flat else "in six degrees of freedom"


def _time(stamps_ns: NDArray[np.int64]) -> str:
    if len(stamps_ns) < 2:
        return "one instant"
    steps = np.diff(stamps_ns) / 1e9
    median = float(np.median(steps))
    rate = f"{1 / median:.2f} Hz" if median > 0 else "no rate"
    lasts = (stamps_ns[-1] - stamps_ns[0]) / 1e9
    return f"{lasts:.1f} s, {rate} (steps {steps.min():.3f} to {steps.max():.3f} s)"


def calibration_words(camera: Camera) -> str:
    """Describe focal length, centre and size of a camera."""
    focal = camera.projection[[0, 1], [0, 1]]
    centre = camera.projection[:2, 2]
    size = "" if camera.size is None else f", made for {camera.size[0]}x{camera.size[1]}"
    return (
        f"focal {focal[0]:.1f} {focal[1]:.1f} px, centre {centre[0]:.1f} {centre[1]:.1f} px{size}"
    )


def _path(dataset: "Dataset") -> str:
    if dataset.poses is None:
        return "none"
    steps = np.linalg.norm(np.diff(dataset.poses[:, :3, 3], axis=0), axis=1)
    # The distance driven across missing frames is unknown.
    known = np.diff(dataset.numbers) == 1
    gaps = "" if known.all() else f", {counted((~known).sum(), 'gap')} not counted"
    metres = steps[known].sum()
    # Short paths need a decimal.
    path = f"path of {metres:.{0 if metres >= 100 else 1}f} m{gaps}"
    return f"{len(dataset.poses)} of {dataset.pose_frame} {_origin(dataset)}, {path}"


def _origin(dataset: "Dataset") -> str:
    """Describe the origin of the poses."""
    if dataset.poses_origin is PosesOrigin.TRUTH:
        return f"from true poses in {dataset.truth_topic}"
    if dataset.poses_origin is PosesOrigin.ODOMETRY:
        return f"from odometry in {dataset.odometry_topic or 'TF'}"
    if isinstance(dataset, FileDataset) and dataset.poses_file is not None:
        return f"from {dataset.poses_file.parent.name}/{dataset.poses_file.name}"
    return "from a file"


def _no_cameras(dataset: "Dataset") -> str:
    if isinstance(dataset, CloudDataset):
        return "no images; the points have their colours"
    if dataset.body_from_points is not None and dataset.kind.startswith("kitti"):
        return "no images; the calibration is there and places the scanner"
    return "no calibration" if {*dataset.sensors} - {"points"} else "no images, no calibration"


def _gaps(dataset: "Dataset") -> str:
    if not dataset.gaps:
        return "none"
    frames = counted(len(dataset.gaps), "frame")
    some = ", ".join(str(number) for number in dataset.gaps[:8])
    more = ", ..." if len(dataset.gaps) > 8 else ""
    if not isinstance(dataset, FileDataset):
        return f"{frames} left out, see the log: {some}{more}"
    return (
        f"{frames} without a file: {some}{more} (left out here; fuse, describe, loops, bench, "
        "views, ratslam and calib-check leave them out with --skip-gaps)"
    )


def _offsets(dataset: "Dataset") -> str:
    """Describe the median time offset of each sensor to the first, if sensors have own times."""
    if len(dataset.sensors) < 2:
        return "none: one sensor"
    times = {sensor: dataset.sensor_stamps(sensor) for sensor in dataset.sensors}
    known = {sensor: stamps for sensor, stamps in times.items() if stamps is not None}
    if len(known) < 2:
        return "unknown: the sensors share one time a frame"
    first, *others = known
    count = min(len(stamps) for stamps in known.values())
    parts = []
    for sensor in others:
        offsets = (known[sensor][:count] - known[first][:count]) / 1e6
        parts.append(
            f"{sensor} {np.median(offsets):+.1f} ms ({offsets.min():+.1f} to {offsets.max():+.1f})"
        )
    return f"against {first}: {', '.join(parts)}"


def _map_rows(path: Path) -> list[tuple[str, str]]:
    with MapFile(path, read_only=True) as file:
        keyframes = Counter(each.session for each in file.keyframes())
        rows = [("kind", "map, by map build")]
        for name, number in file.sessions().items():
            rows.append((f"session {name}", counted(keyframes[number], "keyframe")))
        loops = Counter(each.state for each in file.edges() if each.kind != "odometry")
    if not keyframes:
        return [*rows, ("keyframes", "none yet: map build adds them")]
    measured = ", ".join(f"{count} {state}" for state, count in sorted(loops.items()))
    return [*rows, ("registered pairs", measured or "none")]


def _stored_rows(path: Path) -> list[tuple[str, str]] | None:
    """Return (label, value) pairs about a stored file or folder; None for anything else.

    Raises:
        DataError: the file is damaged.
    """
    if is_map(path):
        return _map_rows(path)
    file = path
    if path.is_dir():
        inner = [path / name for name in _STORED["in_folders"] if (path / name).is_file()]
        if not inner:
            return None
        file = inner[0]
    format = _json_format(file) if file.suffix == ".json" else format_of(file)
    if format is None or not format.startswith(_PREFIX):
        return None
    rows = _json_rows if file.suffix == ".json" else _archive_rows
    return [
        ("name", path.name),
        ("kind", f"{_describe_format(format)} ({format}); no recording"),
        ("folder", str(path.parent)),
        *(_work_rows(file.parent) if _name_of(format) == "work" else rows(file, format)),
        *([("files", _files_in(path))] if path.is_dir() else []),
    ]


def _files_in(folder: Path) -> str:
    """Name the stored files in a folder, with what each holds."""
    found = []
    for path in sorted(folder.iterdir()):
        format = _json_format(path) if path.suffix == ".json" else format_of(path)
        if format is not None and format.startswith(_PREFIX):
            found.append(f"{path.name} ({_describe_format(format)})")
    return "; ".join(found)


def _work_rows(folder: Path) -> Iterator[tuple[str, str]]:
    """Yield what was done with which data, and what differs from the defaults."""
    work = Work.load(folder)
    assert work is not None  # its file is there
    yield "dataset", f"{work.dataset} ({work.recording.path})"
    yield "command", work.command or "none: written by a program"
    written = datetime.fromtimestamp((folder / FILE).stat().st_mtime, UTC)
    yield "written", f"{written:%Y-%m-%d %H:%M} UTC"
    defaults = flatten(PipelineConfig().model_dump(mode="json"))
    for source, config in work.configs.items():
        values = {**flatten(config), "fusion.source": defaults["fusion.source"]}
        other = [f"{key}={value}" for key, value in values.items() if value != defaults.get(key)]
        yield f"source {source}", ", ".join(other) or "defaults"
    for path in run_files(runs_folder(folder)):
        run = DescriptorRun.load(path)
        skipped = f", {len(run.skipped)} left out" if run.skipped else ""
        yield f"{run.source} {run.descriptor}", f"{counted(len(run), 'frame')}{skipped}"
    for proven in load_verified(folder):
        loops = counted(int(proven.accepted.sum()), "loop")
        yield f"{proven.source} {proven.name}", f"{loops} in {counted(len(proven), 'frame')}"


def _describe_format(format: str) -> str:
    """Describe what files of a format hold."""
    name = _name_of(format)
    return str(_STORED["kinds"].get(name, name.replace("_", " ")))


def _name_of(format: str) -> str:
    """Name of a format without "fusionslam" and version."""
    return format.removeprefix(_PREFIX).rpartition(".")[0]


def _json_format(path: Path) -> str | None:
    try:
        with load_json(path, None, "stored values") as content:
            return str(content["format"])
    except DataError:
        return None


def _json_rows(path: Path, format: str) -> Iterator[tuple[str, str]]:
    with load_json(path, format, _describe_format(format)) as content:
        yield from _values(content)
        long = {name: value for name, value in content.items() if isinstance(value, list | dict)}
        counts = [f"{name} {len(value)}" for name, value in long.items()]
        yield "counts", ", ".join(counts) or "none"


def _archive_rows(path: Path, format: str) -> Iterator[tuple[str, str]]:
    with load_archive(path, format, _describe_format(format)) as (about, arrays):
        yield from _values(about)
        counts = _STORED["counts"].get(_name_of(format), {})
        for thing, name in counts.items():
            if name in arrays:
                yield thing, str(len(arrays[name]))
        if counts:
            return
        shapes = {name: " x ".join(map(str, rows.shape)) for name, rows in arrays.items()}
        yield "arrays", ", ".join(f"{name} {shape or 1}" for name, shape in shapes.items())


def _values(content: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for name, value in content.items():
        if isinstance(value, str | int | float) and name != "format":
            yield name if name != "name" else "of", str(value)
