# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scores many calibrations of a recording: rotations, translations and delays of its camera."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fusionslam.base.arrays import Floats
from fusionslam.calibration.edges import EdgeView, depth_edges, edge_map, in_view
from fusionslam.config import Section, option
from fusionslam.errors import DataError
from fusionslam.sensors.frame import Camera, Frame
from fusionslam.sensors.messages import NANOSECONDS, FrameTransform
from fusionslam.sensors.transforms import TransformTree

CAMERA = "left"
TURNS = ("roll", "pitch", "yaw")
SHIFTS = ("right", "down", "forward")
DELAY = "delay"
_WORLD, _BODY = "world", "body"
_FINER = 5
_STEPS = 10


class Recording(Protocol):
    """Frames in the order of their stamps: a ``Dataset``, or anything like it."""

    @property
    def name(self) -> str:
        """Name for display."""

    @property
    def numbers(self) -> NDArray[np.int64]:
        """Frame numbers as in the recording."""

    @property
    def body_from_points(self) -> Floats | None:
        """float64 (4, 4), maps points to the body of the frames' poses; None if unknown."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int) -> Frame: ...


class CalibrationCheckConfig(Section):
    """Range and resolution of the calibrations to try."""

    frames: int = option(60, "how many frames are looked at, evenly spread", ge=1)
    turn: float = option(3.0, "largest turn of the camera tried", unit="deg", gt=0, le=20)
    turn_step: float = option(0.5, "first grid of turns; the second is five times finer", gt=0)
    shift: float = option(0.2, "largest shift of the camera tried", unit="m", gt=0)
    delay: float = option(0.2, "largest delay of the images tried", unit="s", gt=0)
    jump: float = option(0.3, "smallest jump in depth that is an edge", unit="m", gt=0)
    reach: float = option(10.0, "how far from it an edge of the image is felt", unit="px", gt=0)
    points: int = option(1000, "depth edges of a frame that are used", ge=50)
    turn_tolerance: float = option(0.4, "turns smaller than this fit", unit="deg", ge=0)
    shift_tolerance: float = option(0.06, "shifts smaller than this fit", unit="m", ge=0)
    delay_tolerance: float = option(0.025, "delays smaller than this fit", unit="s", ge=0)
    sure: float = option(3.0, "gain in standard errors from which it is believed", ge=0)


class Site:
    """One frame, prepared for scoring with other calibrations and delays."""

    def __init__(self, recording: Recording, index: int, config: CalibrationCheckConfig) -> None:
        self._recording, self._index, self._config = recording, index, config
        self._frame = recording[index]
        points, image, self.camera = sensor_data(recording, index, self._frame)
        self.view = edge_view(points, edge_map(image, config.reach), self.camera, config)
        self.stamp_ns = self._frame.stamp_ns

    def other_image(self, steps: int) -> Floats | None:
        """(STRIPS,) scores on the image ``steps`` frames later; None if there is none."""
        if not 0 <= self._index + steps < len(self._recording):
            return None
        image = self._recording[self._index + steps].images[CAMERA]
        view = replace(self.view, edges=edge_map(image, self._config.reach))
        return np.asarray(view.scores(self.camera.rectified_from_points[None])[0])

    @cached_property
    def period(self) -> float:
        """Seconds between neighbouring frames here; 0 if there is only one."""
        stamps = [
            self._recording[n].stamp_ns
            for n in (self._index - 1, self._index, self._index + 1)
            if 0 <= n < len(self._recording)
        ]
        return float(stamps[-1] - stamps[0]) / max(len(stamps) - 1, 1) / NANOSECONDS

    @cached_property
    def motion(self) -> tuple[TransformTree, Floats] | None:
        """Poses of the body around this frame, and body_from_points; None if unknown."""
        tree = TransformTree(history_s=None, extrapolation_s=self._config.delay)
        place = None
        for index in range(self._index - 1, self._index + 2):
            if not 0 <= index < len(self._recording):
                continue
            frame = self._frame if index == self._index else self._recording[index]
            # Odometry if there is any, else ground truth.
            body_from_points = self._recording.body_from_points
            if frame.odometry is not None and frame.robot_from_points is not None:
                world_from_body, body_from_points = frame.odometry, frame.robot_from_points
            elif frame.pose is not None and body_from_points is not None:
                world_from_body = frame.pose
            else:
                return None
            tree.add(
                FrameTransform(
                    stamp_ns=frame.stamp_ns,
                    parent=_WORLD,
                    child=_BODY,
                    parent_from_child=world_from_body,
                )
            )
            place = body_from_points if index == self._index else place
        return None if place is None else (tree, place)

    def calibration_at(self, delay_ns: int) -> Floats:
        """rectified_from_points if the image was taken ``delay_ns`` before its stamp."""
        assert self.motion is not None  # checked by the caller
        tree, body_from_points = self.motion
        then, now = (tree.lookup(_WORLD, _BODY, self.stamp_ns - d) for d in (delay_ns, 0))
        moved = np.linalg.inv(then @ body_from_points) @ now @ body_from_points
        return np.asarray(self.camera.rectified_from_points @ moved)


def sensor_data(
    recording: Recording, index: int, frame: Frame
) -> tuple[NDArray[np.float32], NDArray[np.uint8], Camera]:
    """Points, image and camera of a frame. Raises DataError if one of them is missing."""
    if frame.points is None or CAMERA not in frame.images or CAMERA not in frame.cameras:
        have = [*(["points"] if frame.has_points else []), *frame.images]
        raise DataError(
            f"frame {recording.numbers[index]} has {', '.join(have) or 'nothing'}"
            f"{'' if frame.cameras else ' and no calibration'}: "
            f"expected points, the image '{CAMERA}' and its calibration",
            code="missing-sensor",
            fields=(str(recording.numbers[index]),),
        )
    return frame.points, frame.images[CAMERA], frame.cameras[CAMERA]


def edge_view(
    points: NDArray[np.float32],
    edges: NDArray[np.float32],
    camera: Camera,
    config: CalibrationCheckConfig,
) -> EdgeView:
    """The depth edges of a scan, float32 (N, 3), on the ``edge_map`` of an image, by a camera."""
    seen = in_view(points, camera, edges.shape[1:])
    found = depth_edges(seen, -camera.rectified_from_points[1, :3], config.jump)
    return EdgeView.of(*found, edges, camera, config.points)


@dataclass(frozen=True, eq=False)
class Trial:
    """Scores of K calibrations.

    Attributes:
        values: float64 (K) or (K, 3), the values tried.
        parts: float64 (K, parts), scores summed over the edge points of a strip of a frame.
        weight: sum of the weights of all edge points.
    """

    values: Floats
    parts: Floats
    weight: float

    @classmethod
    def of(cls, values: Floats, parts: Sequence[Floats], views: Iterable[EdgeView]) -> "Trial":
        """Join the scores of some frames, (K, STRIPS) each, and the weights of their views."""
        weight = sum(float(view.weights.sum()) for view in views)
        return cls(values, np.concatenate(parts, axis=1), weight)

    @property
    def scores(self) -> Floats:
        """(K): the mean score of an edge point, -1 to 1."""
        return np.asarray(self.parts.sum(axis=1) / self.weight)

    @property
    def best(self) -> int:
        """Index of the best calibration."""
        return int(np.argmax(self.scores))

    def errors(self, best: Floats) -> Floats:
        """(K): distance below ``best`` (parts,) in standard errors of the difference."""
        difference = best - self.parts
        spread = difference.std(axis=1, ddof=1) * np.sqrt(self.parts.shape[1])
        gain = difference.sum(axis=1)
        return np.asarray(np.divide(gain, spread, out=np.zeros_like(gain), where=spread > 0))

    @property
    def above_chance(self) -> float:
        """Standard errors by which the first score exceeds that of points anywhere, 0."""
        return -float(self.errors(np.zeros(self.parts.shape[1]))[0])

    @property
    def plausible(self) -> NDArray[np.bool_]:
        """(K): whether each is within two standard errors of the best."""
        return np.asarray(self.errors(self.parts[self.best]) <= 2)


def camera_turns(degrees: Floats) -> Floats:
    """float64 (K, 4, 4): changes of rectified_from_points that rotate the camera.

    Args:
        degrees: float64 (K, 3), roll (right side down), pitch (down) and yaw (to the left) of the
            camera, as of a robot that looks where the camera looks.
    """
    # Points rotate opposite to the camera; its axes are right, down, forward.
    axes = np.column_stack([degrees[:, 1], degrees[:, 2], -degrees[:, 0]])
    changes = np.tile(np.eye(4), (len(degrees), 1, 1))
    changes[:, :3, :3] = Rotation.from_rotvec(axes, degrees=True).as_matrix()
    return changes


def camera_shifts(metres: Floats) -> Floats:
    """float64 (K, 4, 4): changes of rectified_from_points that move the camera.

    Args:
        metres: float64 (K, 3), to the right, down and forward.
    """
    changes = np.tile(np.eye(4), (len(metres), 1, 1))
    changes[:, :3, 3] = -metres
    return changes


class Search:
    """Scores other calibrations on all frames together."""

    def __init__(self, sites: Sequence[Site], config: CalibrationCheckConfig) -> None:
        self._sites, self._config = sites, config
        self.present = self._score(np.zeros((1, 3)), np.eye(4)[None])

    def turns(self) -> Trial:
        """Try all three angles together, on a grid, then on a finer grid around its best."""
        step = self._config.turn_step
        degrees = _grid(self._config.turn, step)
        coarse = self._score(degrees, camera_turns(degrees))
        degrees = coarse.values[coarse.best] + _grid(step, step / _FINER)
        finer = self._score(degrees, camera_turns(degrees))
        return Trial(
            np.concatenate([coarse.values, finer.values]),
            np.concatenate([coarse.parts, finer.parts]),
            coarse.weight,
        )

    def single(self, name: str) -> Trial | None:
        """Try one angle (deg), shift (m) or the delay (s) alone; None for an unknown delay."""
        if name == DELAY:
            still = any(site.motion is None for site in self._sites)
            return self._delays_by_images() if still else self._delays_by_motion()
        kinds, change = (TURNS, camera_turns) if name in TURNS else (SHIFTS, camera_shifts)
        largest = self._config.turn if name in TURNS else self._config.shift
        step = self._config.turn_step / _FINER if name in TURNS else largest / _STEPS
        values = _line(largest, step)
        changes = change(values[:, None] * np.eye(3)[kinds.index(name)])
        return self._score(values, changes)

    def _score(self, values: Floats, changes: Floats) -> Trial:
        parts = [s.view.scores(changes @ s.camera.rectified_from_points) for s in self._sites]
        return Trial.of(values, parts, [site.view for site in self._sites])

    def _delays_by_motion(self) -> Trial:
        values = _line(self._config.delay, self._config.delay / _STEPS)
        parts = [
            site.view.scores(
                np.stack([site.calibration_at(round(v * NANOSECONDS)) for v in values])
            )
            for site in self._sites
        ]
        return Trial.of(values, parts, [site.view for site in self._sites])

    def _delays_by_images(self) -> Trial | None:
        period = self._sites[0].period
        reach = int(self._config.delay / period + 0.01) if period else 0
        steps = range(-reach, reach + 1)
        found = [(site, [site.other_image(step) for step in steps]) for site in self._sites]
        whole = [(site, parts) for site, parts in found if not any(p is None for p in parts)]
        if not whole or len(steps) < 3:
            return None
        values = np.array(steps) * period
        parts = [np.stack([p for p in parts if p is not None]) for _, parts in whole]
        return Trial.of(values, parts, [site.view for site, _ in whole])


def _line(largest: float, step: float) -> Floats:
    count = round(largest / step)
    return np.asarray(np.arange(-count, count + 1) * step)


def _grid(largest: float, step: float) -> Floats:
    """float64 (K, 3): all combinations of three values."""
    line = _line(largest, step)
    return np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
